// The access rules of a project.
#pragma once

#include <memory>
#include <optional>
#include <set>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "project/Wiring.h"
#include "project/layers/LayerListener.h"
#include "project/lines/LineListener.h"
#include "project/sessions/Session.h"  // Subject
#include "usdlive/common/access/AccessRules.h"
#include "usdlive/common/layer/LayerLock.h"
#include "usdlive/common/layer/SpecLocks.h"
#include "usdlive/common/layer/TransactionExecutor.h"

namespace usdlive::server {

/// The access rules of a project. Every operation that edits, previews, saves, reloads, creates,
/// names or removes something asks this class. An answer is the error that gives the reason, or
/// nothing if the operation is allowed.
class AccessPolicy : public LineListener, public LayerListener, public SessionListener {
public:
    /// The state of the project on which the decisions depend.
    class Facts {
    public:
        virtual ~Facts() = default;
        /// Returns the loaded layers with all executed commits.
        [[nodiscard]] virtual const LayerDocs& loadedLayers() const = 0;
        /// Returns the lock of a layer, loaded or not.
        [[nodiscard]] virtual LayerLock lockAt(const LayerId& layer) const = 0;
        /// Returns whether the user has a session.
        [[nodiscard]] virtual bool isUserConnected(const UserName& user) const = 0;
        [[nodiscard]] virtual std::int64_t steadyMs() const = 0;
    };
    /// `takeoverMs` is the time after which others may end a lock whose holder is not connected.
    AccessPolicy(const Facts& facts, std::set<UserName> administrators, std::int64_t takeoverMs);

    /// Returns the user who says this name in the hello, if users do not sign in.
    [[nodiscard]] Subject subject(UserName user) const;
    /// Returns the signed-in user. Error: SignInRequired if `claimed`, the name in the hello, is
    /// that of somebody else.
    [[nodiscard]] Result<Subject> subject(const SignedIn& proof, UserName claimed) const;

    /// Replaces the rules that add to roles or take from them (AC6).
    void setRules(std::shared_ptr<const AccessRules> rules) { rules_ = std::move(rules); }

    /// Returns the rules that concern the user, as far as the client of the session can understand
    /// them (AC8).
    [[nodiscard]] std::vector<SentRule> rulesOf(const Session& session) const;

    // --- decisions

    /// Decides by role and rules about an action on a layer or a file, or on the project if `place`
    /// is empty (AC11). `what` says it in the error, for example "upload a.png".
    [[nodiscard]] std::optional<Error> toAction(const Subject& subject, ProjectAction action,
                                                const LayerId& place,
                                                const std::string& what) const;
    /// Decides about saves and reloads of a layer (AC11, LK1, LK3).
    [[nodiscard]] std::optional<Error> toSave(const Subject& subject, const LayerId& layer) const;
    [[nodiscard]] std::optional<Error> toReload(const Subject& subject, const LayerId& layer) const;
    /// Decides by the lock of the layer alone.
    [[nodiscard]] std::optional<Error> toLock(const Subject& subject, const LayerId& layer) const;
    /// Decides about a transaction before it is executed (LK1, LK2, LK4). Precondition: its layers
    /// are loaded.
    [[nodiscard]] std::optional<Refused> toTransaction(const Subject& subject,
                                                       const Transaction& transaction) const;
    /// Returns whether toEdits() must be called after the edits were executed.
    [[nodiscard]] bool dependsOnEffects(const Subject& subject,
                                        const std::vector<Edit>& edits) const;
    /// Decides about executed edits, which are undone if they are not allowed (LK5, AC6). `before`
    /// has the edited layers before them. Returns the index of the first forbidden edit, and the
    /// error.
    [[nodiscard]] std::optional<std::pair<std::size_t, Error>> toEdits(
        const Subject& subject, const std::vector<ExecutedEdit>& executed,
        const LayerDocs& before) const;
    /// Returns whether a preview may be sent to others (LK1, LK5). The server does not execute
    /// previews, so their addresses are checked as they are.
    [[nodiscard]] bool mayPreview(const Subject& subject, const std::vector<Edit>& edits) const;
    /// Decides about the replacement of old commits (CH4). All users may do it if the server has no
    /// administrators.
    [[nodiscard]] std::optional<Error> toHistory(const Subject& subject) const;
    /// Decides about a part of a big value that a transaction or a preview will name (V9).
    [[nodiscard]] std::optional<Error> toBigValue(const Subject& subject) const;

    /// Returns the root layers that lock specs.
    [[nodiscard]] const std::set<LayerId>& lockingRoots() const { return lockingRoots_; }

    void ordered(const OrderedCommit& commit) override;
    void rolledBack(const Error& error, const LostCommits& lost) override;
    void loaded(const LayerId& layer, const LoadedLayer& loaded) override;
    void failed(const LayerId& layer, const Error& error) override;
    void left(const Session& session) override;

private:
    /// AC3: returns an error if the user has a lower role.
    [[nodiscard]] static std::optional<Error> needs(Role role, const Subject& subject,
                                                    const std::string& action);
    /// Returns the error of a user whom a rule denies something.
    [[nodiscard]] Error denied(const Subject& subject, const std::string& what,
                               std::size_t rule) const;
    [[nodiscard]] AccessRules::Decision decide(const Subject& subject, ProjectAction action,
                                               const LayerId& place) const;
    /// Decides about the end of a lock of somebody else in the layer, of which `locked` is the
    /// error (LK2, LK4, AC11).
    [[nodiscard]] std::optional<Error> toTakeOver(const Subject& subject, const LayerId& layer,
                                                  const LayerLock& lock, const Error& locked) const;
    /// Decides about an edit that locks or mutes. `before` is the layer before the transaction.
    [[nodiscard]] std::optional<Error> toLockOrMute(const Subject& subject, const LayerId& layer,
                                                    ProjectAction action,
                                                    const LayerDoc* before) const;
    /// Decides about locks and mutes that edits of more than these have changed.
    [[nodiscard]] std::optional<Error> toChangedLocks(const Subject& subject, const LayerId& layer,
                                                      const LayerDoc& before) const;
    /// AC6, AC7: decides about one edit by the rules. `doc` is the layer before the transaction;
    /// nullptr if it is not loaded.
    [[nodiscard]] std::optional<Error> toOpinion(const Subject& subject, const Edit& edit,
                                                 const LayerDoc* doc) const;
    [[nodiscard]] std::optional<Error> toOpinionAt(const AccessRules::Question& question) const;
    [[nodiscard]] std::optional<Error> toAllBelow(const AccessRules::Question& question,
                                                  const LayerDoc& doc) const;
    [[nodiscard]] bool areRulesFor(const Subject& subject) const;
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
    std::shared_ptr<const AccessRules> rules_ = std::make_shared<const AccessRules>();
    std::int64_t takeoverMs_;
    std::int64_t startedMs_;
    std::set<LayerId> lockingRoots_;                     ///< after all executed commits
    std::unordered_map<UserName, std::int64_t> leftMs_;  ///< since when users are without a session
};

}  // namespace usdlive::server
