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
#include "usdlive/client/usd/Misuse.h"
#include "usdlive/client/usd/UsedLayers.h"

namespace usdlive {

namespace client {
class Connection;
struct SentWork;
}  // namespace client

/// Edits one project together with others: gives an editor real SdfLayers that are live.
///
/// Used from one thread, the one that owns the editor's stage: the first that calls a function
/// which touches layers. From another one, functions that return a Result fail and others throw
/// Misuse; see also misuse(). A layer is live through one connection of a process. Nothing but the
/// functions of this class touches USD, and only when called: call tick() once per frame. The
/// network has a thread of its own.
///
///     auto client = usdlive::Client::connect("ws://127.0.0.1:7447", {.user = "ada"});
///     auto layer = (*client)->openLayer(usdlive::LayerId{"shot.usda"});
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
        /// Where work that the server has not acknowledged is kept, by project and user. Empty:
        /// below the cache folder if one is named, else $XDG_STATE_HOME/usdlive or
        /// ~/.local/state/usdlive.
        std::filesystem::path stateFolder = {};
        /// Big values that the cache folder holds, in bytes: of more the ones used longest ago are
        /// removed. Values of one's own that the server does not have yet come on top.
        std::uint64_t cacheBytes = std::uint64_t(4) << 30;
    };

    using Misuse = usdlive::Misuse;
    /// Why `function` may not be called here: on another thread, or (one that `blocks`) by a notice
    /// handler within tick(). Nothing when it may be.
    [[nodiscard]] std::optional<Error> misuse(const std::string& function, bool blocks) const;

    /// Connects and greets; blocks until then or the time is over. Fails after a second where no
    /// server can be reached.
    [[nodiscard]] static Result<std::unique_ptr<Client>> connect(const std::string& url,
                                                                 Options options);
    /// The same over connections of another kind.
    using Connector = std::function<Result<std::unique_ptr<client::Connection>>()>;
    [[nodiscard]] static Result<std::unique_ptr<Client>> connectBy(Connector connector,
                                                                   Options options);
    /// Over one connection, which is all there is: unsent work is kept only in a `stateFolder` that
    /// is named, and cannot be sent.
    [[nodiscard]] static Result<std::unique_ptr<Client>> connectBy(
        std::unique_ptr<client::Connection> connection, Options options);
    /// Leaves the project at once. What is not acknowledged stays in the journal; see leave().
    ~Client();

    /// Ends an open gesture and waits until what was authored is committed, at most `timeoutMs`.
    /// Returns what was not and the journal that keeps it; nothing when all was.
    std::optional<client::UnsentWork> leave(double timeoutMs = 5'000);

    // Work that earlier connections of this user to this project could not send, because their
    // process, the server or the network ended first. event::UnsentFound tells of it at the start.
    [[nodiscard]] std::vector<client::UnsentWork> unsentWork();
    /// Sends it, each transaction once, however often this is called: what was committed before is
    /// not committed again. Blocks. What is refused or dropped becomes lost work of this client.
    Result<client::SentWork> sendUnsent(const ClientId& work, double timeoutMs = 60'000);
    /// Its edits of one layer as a layer of their own; the journal stays.
    [[nodiscard]] Result<pxr::SdfLayerRefPtr> unsentAsLayer(const ClientId& work,
                                                            const LayerId& layer);
    Result<void> discardUnsent(const ClientId& work);

    /// What the project has.
    [[nodiscard]] std::vector<LayerId> layers() const;

    /// A layer of the project as a live SdfLayer; blocks until it is here. It stands at
    /// cacheFolder/<layer>. The layers it uses (sublayers, references, payloads inside the project,
    /// all the way down) are opened with it. For a stage that is opened without its payloads,
    /// `NoPayloads` leaves out what only payloads bring in: such a layer becomes live within the
    /// ticks after composition has opened it.
    [[nodiscard]] Result<pxr::SdfLayerRefPtr> openLayer(
        const LayerId& layer, client::LoadSet load = client::LoadSet::All);
    /// Makes a new, empty layer of the project, for everybody, and opens it (FI6); blocks until it
    /// is here. Its file is in the project's folder then, with folders as needed. `layer` is a path
    /// relative to the project that ends in .usda, .usdc or .usd (binary). Not possible from a
    /// notice handler within tick(). InvalidLayerName; LayerExists: the project, or its folder, has
    /// a file of this name; NotConnected: only the server knows which names are free; SaveFailed,
    /// StorageFull: the server could not write it.
    [[nodiscard]] Result<pxr::SdfLayerRefPtr> createLayer(const LayerId& layer);
    /// Makes layers live that the editor has opened itself from `projectFolder` (the folder the
    /// server serves, or a copy): each found layer of the project that is loaded in this process.
    /// Returns them sorted. Refuses with InvalidArgument when one of them has unsaved edits.
    Result<std::vector<LayerId>> attach(const std::filesystem::path& projectFolder);
    /// Ends being live; the layer stays with its content. Pending edits of it are sent first. Not
    /// possible from a notice handler within tick(): an error event says so.
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
    /// name. While the lock stands, `permissionToEdit` of the layer is false for others, but for
    /// administrators. LayerNotOpen; InvalidArgument for a root layer that holds Kit's map of
    /// locks.
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

    /// Asks the server to write layers (none: all changed) to their files, with what is confirmed.
    /// Answered by event::Saved, or event::ServerError, with the number that this returns. A layer
    /// whose file somebody else has changed fails (LayerOutdated), unless `force`.
    std::uint64_t save(std::vector<LayerId> layers = {}, bool force = false);
    /// The same with all that was authored here; returns when the files are written. NotConnected
    /// when the time is over.
    Result<LayersSaved> saveAndWait(std::vector<LayerId> layers = {}, bool force = false,
                                    double timeoutMs = 60'000);
    /// Asks the server to take the files of layers (none: of all that are outdated) as commits, so
    /// that everybody has what is in them; answered by event::Reloaded.
    std::uint64_t reload(std::vector<LayerId> layers = {});
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

    /// M12: work that was refused or dropped since the start, by the index of its event::Lost, and
    /// as a layer. Older work is read from the disk.
    [[nodiscard]] std::uint64_t lostWorkCount() const;
    [[nodiscard]] Result<client::LostWork> lostWork(std::uint64_t index) const;
    [[nodiscard]] Result<pxr::SdfLayerRefPtr> lostWorkAsLayer(std::uint64_t index,
                                                              const LayerId& layer) const;

    [[nodiscard]] bool isConnected() const;
    /// True while tick() writes into layers what others did, or takes back what was refused.
    [[nodiscard]] bool isApplying() const;
    [[nodiscard]] Revision revision() const;
    /// Not acknowledged by the server. Counts a frame that waits for its big arrays to be encoded.
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
    static Result<std::unique_ptr<Client>> make(std::unique_ptr<client::Connection> connection,
                                                Connector connector, Options options);
    class Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace usdlive
