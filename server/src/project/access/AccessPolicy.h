// Decides who may do what in a project.
#pragma once

#include <optional>
#include <set>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "Wiring.h"
#include "layers/LayerListener.h"
#include "lines/LineListener.h"
#include "sessions/Session.h"  // Subject
#include "usdlive/common/layer/LayerLock.h"
#include "usdlive/common/layer/SpecLocks.h"
#include "usdlive/common/layer/TransactionExecutor.h"

namespace usdlive::server {

/// Decides who may do what in a project. Each path that edits, previews, saves, reloads, creates,
/// names or removes something asks here, and gets the error that says why not; nothing: it is
/// allowed.
class AccessPolicy : public LineListener, public LayerListener, public SessionListener {
public:
    /// The state of the project that it decides by.
    class Facts {
    public:
        virtual ~Facts() = default;
        /// The layers that are loaded, as executed.
        [[nodiscard]] virtual const LayerDocs& loadedLayers() const = 0;
        /// Also of a layer that is not loaded.
        [[nodiscard]] virtual LayerLock lockAt(const LayerId& layer) const = 0;
        /// Has the user a session?
        [[nodiscard]] virtual bool isUserConnected(const UserName& user) const = 0;
        [[nodiscard]] virtual std::int64_t wallClockMs() const = 0;
    };
    /// `takeoverMs`: for how long the holder of a lock has to be away until others may end it.
    AccessPolicy(const Facts& facts, std::set<UserName> administrators, std::int64_t takeoverMs);

    [[nodiscard]] Subject subject(UserName user) const;

    // --- questions

    /// May the layer be edited, saved, or given what its file holds (LK1, LK3)?
    [[nodiscard]] std::optional<Error> toLayer(const Subject& subject, const LayerId& layer) const;
    /// May the transaction be executed (LK1, LK2, LK4)? Its layers have to be loaded.
    [[nodiscard]] std::optional<Refused> toTransaction(const Subject& subject,
                                                       const Transaction& transaction) const;
    /// Does toEdits() have to be asked, once the edits are executed?
    [[nodiscard]] bool dependsOnEffects(const std::vector<Edit>& edits) const;
    /// May what was executed stay (LK5)? `before`: the layers that were edited, as they were. With
    /// the index of the first edit that may not.
    [[nodiscard]] std::optional<std::pair<std::size_t, Error>> toEdits(
        const Subject& subject, const std::vector<ExecutedEdit>& executed,
        const LayerDocs& before) const;
    /// May others see the preview (LK1, LK5)? It is not executed on the server, so its addresses
    /// are looked at as they are.
    [[nodiscard]] bool mayPreview(const Subject& subject, const std::vector<Edit>& edits) const;
    /// May old commits be replaced (CH4)? Where the server has no administrators, everybody may.
    [[nodiscard]] std::optional<Error> toHistory(const Subject& subject) const;
    /// May a revision be named (CP1)? Everybody may.
    [[nodiscard]] std::optional<Error> toCheckpoint(const Subject& subject,
                                                    const std::string& name) const;
    /// May a layer be created (FI6)? Everybody may.
    [[nodiscard]] std::optional<Error> toNewLayer(const Subject& subject,
                                                  const LayerId& layer) const;

    /// The root layers that lock specs.
    [[nodiscard]] const std::set<LayerId>& lockingRoots() const { return lockingRoots_; }

    void ordered(const OrderedCommit& commit) override;
    void rolledBack(const Error& error, const LostCommits& lost) override;
    void loaded(const LayerId& layer, const LoadedLayer& loaded) override;
    void failed(const LayerId& layer, const Error& error) override;
    void left(const Session& session) override;

private:
    [[nodiscard]] static bool holds(const Subject& subject, const LayerLock& lock);
    [[nodiscard]] static bool isForeign(const UserName& owner, const Subject& subject);
    [[nodiscard]] bool isFree(const LayerLock& lock) const;
    void updateSpecLocks(const LayerId& layer);
    [[nodiscard]] SpecLocks specLocksIn(const LayerId& layer, const LayerDocs& before) const;
    [[nodiscard]] static std::optional<Error> specLockOn(const Subject& subject, const Edit& edit,
                                                         const SpecLocks& locks,
                                                         const LayerDoc* doc);
    [[nodiscard]] std::optional<Error> toSpecLocks(const Subject& subject,
                                                   const LayerDocs& before) const;

    Wire<const Facts> facts_;
    std::set<UserName> administrators_;
    std::int64_t takeoverMs_;
    std::int64_t startedMs_;
    std::set<LayerId> lockingRoots_;                     ///< as executed
    std::unordered_map<UserName, std::int64_t> leftMs_;  ///< of users without a session
};

}  // namespace usdlive::server
