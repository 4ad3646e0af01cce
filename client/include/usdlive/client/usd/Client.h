#pragma once

#include <pxr/usd/sdf/layer.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "usdlive/client/session/Session.h"

namespace usdlive {

namespace client {
class Connection;
}

/// Edits one project together with others: gives an editor real SdfLayers that are live.
///
/// Used from one thread, the one that owns the editor's stage. Nothing but the functions of this
/// class touches USD, and only when called: call tick() once per frame. The network has a thread of
/// its own.
///
///     auto client = usdlive::Client::connect("ws://127.0.0.1:7447", {.user = "ada"});
///     auto layer = (*client)->openLayer("shot.usda");
///     for (;;) { editAndDraw(); (*client)->tick(2.0); }
class Client {
public:
    struct Options {
        std::string user;         ///< empty: the system's user name
        std::string application;  ///< shown to others
        /// Where layers of the project stand for this process, so that relative paths resolve.
        /// Empty: a fresh folder below the system's temporary folder, removed when the client goes.
        std::filesystem::path cacheFolder;
        double connectTimeoutMs = 10'000;
    };

    /// Connects and greets; blocks until then or the time is over. Fails after a second where no
    /// server can be reached.
    [[nodiscard]] static Result<std::unique_ptr<Client>> connect(const std::string& url,
                                                                 Options options);
    /// The same over a connection of another kind.
    [[nodiscard]] static Result<std::unique_ptr<Client>> connectBy(
        std::unique_ptr<client::Connection> connection, Options options);
    ~Client();

    /// What the project has.
    [[nodiscard]] std::vector<LayerId> layers() const;

    /// A layer of the project as a live SdfLayer; blocks until it is here. It stands at
    /// cacheFolder/<layer>. The layers it uses (sublayers, references, payloads inside the project,
    /// all the way down) are opened with it.
    [[nodiscard]] Result<pxr::SdfLayerRefPtr> openLayer(const LayerId& layer);
    /// Makes layers live that the editor has opened itself from `projectFolder` (the folder the
    /// server serves, or a copy): each found layer of the project that is loaded in this process.
    /// Returns them sorted. Refuses with InvalidArgument when one of them has unsaved edits.
    Result<std::vector<LayerId>> attach(const std::filesystem::path& projectFolder);
    /// Ends being live; the layer stays with its content. Pending edits of it are sent first.
    void close(const LayerId& layer);

    struct TickResult {
        std::size_t applied = 0;  ///< commits
        bool more = false;        ///< the budget ended first
        std::size_t filling = 0;  ///< layers whose content is being made: a later tick brings it
    };
    /// Sends what was authored since the last call, applies what has arrived, in one SdfChangeBlock
    /// and about `budgetMs`; calls the callbacks. A layer that composition has meanwhile opened
    /// from the cache folder becomes live. A layer's whole content is made by a thread of the
    /// client's and brought in when it is done.
    TickResult tick(double budgetMs = 4.0);

    /// M11: what is authored between the two is shown to others at once and committed once.
    void beginGesture();
    void endGesture();

    /// Locks a live layer in one's own name, or ends its lock: edits of the layer itself (LK1),
    /// sent with the next tick. What the server refuses comes back as lost work, with the holder's
    /// name. LayerNotOpen; InvalidArgument for a root layer that holds Kit's map of locks.
    Result<void> setLocked(const LayerId& layer, bool locked);
    /// Mutes a layer for everybody on the stages of `root`, a live layer, or ends that: edits of
    /// the root layer (MU1), sent with the next tick. LayerNotOpen; InvalidArgument for the root
    /// layer itself.
    Result<void> setGloballyMuted(const LayerId& root, const LayerId& layer, bool muted);
    /// What is muted for everybody on the stages of `root`, as the layer says now; nothing of one
    /// that is not live. A stage is to be told by its owner (Usd.Stage.MuteAndUnmuteLayers).
    [[nodiscard]] std::set<LayerId> globallyMuted(const LayerId& root) const;

    /// What the server says of layers beside their content: dirty, locked and by whom, who has them
    /// open. Layers that are saved, unlocked and open nowhere are left out.
    [[nodiscard]] const std::map<LayerId, LayerState>& layerStates() const;

    /// Where one is; shown to the others until hidePresence(). A client begins with user and
    /// application alone, which the server fills in.
    void showPresence(Presence presence);
    void hidePresence();
    /// Where the others are, by client.
    [[nodiscard]] const std::map<ClientId, Presence>& presences() const;

    /// Asks the server to write layers (none: all changed) to their files; answered by
    /// event::Saved. One whose file somebody else has changed fails (LayerOutdated), unless
    /// `force`.
    void save(std::vector<LayerId> layers = {}, bool force = false);
    /// Asks the server to take the files of layers (none: of all that are outdated) as commits, so
    /// that everybody has what is in them; answered by event::Reloaded.
    void reload(std::vector<LayerId> layers = {});
    /// Has the server name what the project is now; flush() first what has to be in it. Answered by
    /// event::CheckpointMade, or event::ServerError, with the number that this returns.
    std::uint64_t createCheckpoint(std::string name);
    /// Likewise event::CheckpointsListed.
    std::uint64_t listCheckpoints();
    /// Ticks until what was authored is committed, or the time is over (false).
    bool flush(double timeoutMs = 10'000);

    using EventHandler = std::function<void(const client::Event&)>;
    /// Called from tick(), in order, on its thread.
    void setEventHandler(EventHandler handler);

    /// M12: work that was refused or dropped since the start, newest last, and one of it as a
    /// layer.
    [[nodiscard]] const std::vector<client::LostWork>& lostWork() const;
    [[nodiscard]] Result<pxr::SdfLayerRefPtr> lostWorkAsLayer(std::size_t index,
                                                              const LayerId& layer) const;

    [[nodiscard]] bool isConnected() const;
    /// True while tick() writes into layers what others did, or takes back what was refused.
    [[nodiscard]] bool isApplying() const;
    [[nodiscard]] Revision revision() const;
    [[nodiscard]] std::size_t pendingTransactions() const;
    [[nodiscard]] ClientId id() const;
    [[nodiscard]] const std::string& user() const;  ///< as the others see
    [[nodiscard]] std::filesystem::path cacheFolder() const;
    /// The live layer's name, if it is one of ours.
    [[nodiscard]] std::optional<LayerId> layerId(const pxr::SdfLayerHandle& layer) const;
    /// The session itself, for tools (log, history, peeking).
    [[nodiscard]] client::Session& session();

private:
    Client();
    class Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace usdlive
