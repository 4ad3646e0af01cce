// The client library: an editor's connection to a project, with real SdfLayers that are live.
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

#include "usdlive/client/session/Events.h"
#include "usdlive/client/usd/LoadSet.h"
#include "usdlive/client/usd/Misuse.h"

namespace usdlive {

namespace client {
struct ClientInternals;
}

/// Edits one project together with others: gives an editor real SdfLayers that are live.
///
/// A client belongs to one thread, the one that owns the editor's stage: the first thread that
/// calls a function of it, after connect(). On any other thread every function refuses to work:
/// functions that return a Result return an error, and all others throw Misuse. Two exceptions:
/// setEventHandler() does not choose the thread, and the destructor runs on any thread.
///
/// Only the functions of this class touch USD, and only while they are called: call tick() once per
/// frame. The network has a thread of its own. A layer is live through one client of a process.
///
///     auto client = usdlive::Client::connect("ws://127.0.0.1:7447", {.user = "ada"});
///     auto layer = (*client)->openLayer(usdlive::LayerId{"shot.usda"});
///     for (;;) { editAndDraw(); (*client)->tick(2.0); }
class Client {
public:
    struct Options {
        std::string user;         ///< empty: the system's user name
        std::string application;  ///< shown to others
        /// The folder in which this process finds layers of the project, so that relative paths
        /// between them resolve. Empty: a fresh folder below the system's temporary folder, which
        /// is removed with the client.
        std::filesystem::path cacheFolder;
        double connectTimeoutMs = 10'000;
        /// The folder that keeps work which the server has not acknowledged, by project and user.
        /// Empty: below the cache folder if that is set, else $XDG_STATE_HOME/usdlive or
        /// ~/.local/state/usdlive.
        std::filesystem::path stateFolder = {};
        /// The most bytes of big values in the cache folder; the values used longest ago are
        /// removed first. Values that the server does not have yet do not count.
        std::uint64_t cacheBytes = std::uint64_t(4) << 30;
    };

    using Misuse = usdlive::Misuse;
    /// Why `function` may not be called here: on another thread, or, for one that `blocks`, by a
    /// notice handler within tick(). Nothing: it may be called.
    [[nodiscard]] std::optional<Error> misuse(const std::string& function, bool blocks) const;

    /// Connects to a server, and waits until it has welcomed this client. Fails after a second
    /// where no server can be reached, and after the time-out where one does not answer.
    [[nodiscard]] static Result<std::unique_ptr<Client>> connect(const std::string& url,
                                                                 Options options);
    /// Leaves the project at once. The journal keeps what is not acknowledged; see leave().
    ~Client();

    /// Ends an open gesture and waits until what was authored is committed, at most `timeoutMs`.
    /// Returns what was not committed, which the journal keeps; nothing when all was.
    std::optional<client::UnsentWork> leave(double timeoutMs = 5'000);

    // --- work that earlier connections could not send

    /// Work of this user in this project that earlier connections could not send, because their
    /// process, the server or the network ended first. event::UnsentFound reports it at the start.
    [[nodiscard]] std::vector<client::UnsentWork> unsentWork();
    /// Sends it. Each transaction is committed once, however often this is called. Blocks. Work
    /// that is refused or dropped becomes lost work of this client.
    Result<client::SentWork> sendUnsent(const ClientId& work, double timeoutMs = 60'000);
    /// Returns its edits of one layer as a layer of their own; the journal keeps them.
    [[nodiscard]] Result<pxr::SdfLayerRefPtr> unsentAsLayer(const ClientId& work,
                                                            const LayerId& layer);
    /// Deletes it for good.
    Result<void> discardUnsent(const ClientId& work);

    // --- layers

    /// The layers of the project, sorted.
    [[nodiscard]] std::vector<LayerId> layers() const;

    /// Opens a layer of the project as a live SdfLayer, and waits until its content is here. The
    /// layers that it uses (sublayers, references, payloads inside the project, all the way down)
    /// are opened with it. `NoPayloads` leaves out layers that only payloads bring in, for a stage
    /// that is opened without its payloads: such a layer becomes live within the ticks after
    /// composition has opened it.
    [[nodiscard]] Result<pxr::SdfLayerRefPtr> openLayer(
        const LayerId& layer, client::LoadSet load = client::LoadSet::All);
    /// Begins to open a layer and returns at once: the next ticks do the work, within their
    /// budgets, also while there is no connection. Returns the number of the request. The request
    /// ends with event::LayerOpened, after which layer() returns the layer, or with
    /// event::LayerOpenFailed; event::Progress reports one that takes long. close() cancels it.
    /// Any number of requests may be open, also for one layer. No other request has its number.
    std::uint64_t requestOpenLayer(const LayerId& layer,
                                   client::LoadSet load = client::LoadSet::All);
    /// Creates a new, empty layer of the project, for everybody, and opens it (FI6). Waits until it
    /// is here. Its file is in the project's folder then, with folders as needed. `layer` is a path
    /// relative to the project that ends in .usda, .usdc or .usd (binary). A notice handler must
    /// not call this within tick(). InvalidLayerName; LayerExists: the project, or its folder, has
    /// a file of this name; NotConnected: only the server knows which names are free; SaveFailed,
    /// StorageFull: the server could not write it.
    [[nodiscard]] Result<pxr::SdfLayerRefPtr> createLayer(const LayerId& layer);
    /// Makes layers live that the editor itself has opened from `projectFolder` (the folder that
    /// the server serves, or a copy of it): each layer of the project that this process has loaded
    /// from there. Returns them sorted. InvalidArgument: one of them has unsaved edits.
    Result<std::vector<LayerId>> attach(const std::filesystem::path& projectFolder);
    /// Ends being live, after the layer's pending edits are sent; the layer keeps its content. A
    /// layer that is still opening is closed at once, and requests to open it fail. A notice
    /// handler must not call this within tick(): an error event reports it.
    void close(const LayerId& layer);
    /// The live layer, with all its content. Null: it is not open, or still opening.
    [[nodiscard]] pxr::SdfLayerRefPtr layer(const LayerId& layer) const;
    /// The name of a live layer of this client.
    [[nodiscard]] std::optional<LayerId> layerId(const pxr::SdfLayerHandle& layer) const;
    /// The identifier by which OpenUSD finds a layer of the project; where `beside` is a layer of
    /// an attached folder, that of the layer in the same folder.
    [[nodiscard]] std::string identifierOf(const LayerId& layer,
                                           const pxr::SdfLayerHandle& beside = {}) const;

    // --- the frame

    struct TickResult {
        std::size_t applied = 0;  ///< commits
        bool more = false;        ///< the budget ended first
        std::size_t filling = 0;  ///< layers whose content is being made: a later tick brings it
    };
    /// Sends what was authored since the last call, applies what has arrived, in one SdfChangeBlock
    /// and about `budgetMs`, and calls the event handler. A layer that composition has opened
    /// meanwhile becomes live. A thread of the client makes the whole content of a layer; a tick
    /// brings it in when it is done.
    TickResult tick(double budgetMs = 4.0);

    /// M11: what is authored between the two is shown to others at once and committed once.
    void beginGesture();
    void endGesture();

    /// Ticks until what was authored is committed. False: the time is over.
    bool flush(double timeoutMs = 10'000);

    using EventHandler = std::function<void(const client::Event&)>;
    /// Sets what tick() calls for each event, in order. The handler may call any function.
    void setEventHandler(EventHandler handler);

    // --- locks and mutes

    /// Locks a live layer in the user's own name, or ends the lock: edits of the layer itself
    /// (LK1), sent with the next tick. If the server refuses them they become lost work, with the
    /// holder's name. While a lock holds, `permissionToEdit` of the layer is false for all others
    /// but administrators. LayerNotOpen; InvalidArgument for a root layer that holds Kit's map of
    /// locks.
    Result<void> setLocked(const LayerId& layer, bool locked);
    /// Mutes a layer for everybody on the stages of `root`, a live layer, or ends that: edits of
    /// the root layer (MU1), sent with the next tick. LayerNotOpen; InvalidArgument for the root
    /// layer itself.
    Result<void> setGloballyMuted(const LayerId& root, const LayerId& layer, bool muted);
    /// The layers that are muted for everybody on the stages of `root`, as that layer says now;
    /// none if it is not live. The owner of a stage applies them (Usd.Stage.MuteAndUnmuteLayers).
    [[nodiscard]] std::set<LayerId> globallyMuted(const LayerId& root) const;

    // --- people

    /// Returns the states of layers as the server has reported them: dirty, the lock and its
    /// holder, the users that have them open. Layers that are saved, unlocked and not open are left
    /// out.
    [[nodiscard]] const std::map<LayerId, LayerState>& layerStates() const;
    /// Shows the others where the user is, until hidePresence(). At first they see user and
    /// application alone, which the server fills in.
    void showPresence(Presence presence);
    void hidePresence();
    /// Returns the presences of the other users, by client.
    [[nodiscard]] const std::map<ClientId, Presence>& presences() const;

    // --- requests
    // Each ends with one event that has its number: event::Answered, or event::ServerError, also
    // when the connection is lost (NotConnected).

    /// Sends a request (common/protocol/Requests.h) and returns its number.
    std::uint64_t request(AnyRequest request);
    /// Sends a request and waits for its answer. NotConnected: also when the time is over.
    ///
    ///     auto created = live.ask(usdlive::CreateCheckpoint{.name = "before lunch"});
    ///     if (!created) std::cerr << created.error().message << "\n";
    template <IsSingleRequest Request>
    [[nodiscard]] Result<typename Request::Answer> ask(Request what, double timeoutMs = 10'000);
    /// Waits until a request has ended; returns the event::Answered.
    [[nodiscard]] Result<client::Event> waitFor(std::uint64_t request, double timeoutMs);

    // --- files and checkpoints: requests by name

    /// Asks the server to write layers (none: all that have changed) to their files, with what is
    /// confirmed; answered by event::Saved. A layer whose file somebody else has changed fails
    /// (LayerOutdated), unless `force`.
    std::uint64_t save(std::vector<LayerId> layers = {}, bool force = false);
    /// The same with all that was authored here; waits until the files are written. NotConnected:
    /// the time is over.
    Result<LayersSaved> saveAndWait(std::vector<LayerId> layers = {}, bool force = false,
                                    double timeoutMs = 60'000);
    /// Asks the server to take the files of layers (none: of all that are outdated) as commits, so
    /// that everybody has what is in them; answered by event::Reloaded.
    std::uint64_t reload(std::vector<LayerId> layers = {});
    /// Asks the server to name the state of the project; flush() first what has to be in it.
    /// Answered by event::CheckpointMade.
    std::uint64_t createCheckpoint(std::string name);
    /// Answered by event::CheckpointsListed.
    std::uint64_t listCheckpoints();
    /// Asks which files of the project are not served; answered by event::SkippedListed.
    std::uint64_t listSkipped();

    // --- work that did not get into the project (M12)

    /// The number of pieces of work that were refused or dropped since the start. The index of a
    /// piece is that of its event::Lost.
    [[nodiscard]] std::uint64_t lostWorkCount() const;
    [[nodiscard]] Result<client::LostWork> lostWork(std::uint64_t index) const;
    /// Its edits of one layer as a layer of their own.
    [[nodiscard]] Result<pxr::SdfLayerRefPtr> lostWorkAsLayer(std::uint64_t index,
                                                              const LayerId& layer) const;

    // --- state

    [[nodiscard]] bool isConnected() const;
    /// True while tick() writes into layers what others did, or takes back what was refused.
    [[nodiscard]] bool isApplying() const;
    [[nodiscard]] Revision revision() const;
    /// Transactions that the server has not acknowledged, and a frame that waits for its big arrays
    /// to be encoded.
    [[nodiscard]] std::size_t pendingTransactions() const;
    [[nodiscard]] ClientId id() const;
    [[nodiscard]] const std::string& user() const;  ///< the name that others see
    [[nodiscard]] std::filesystem::path cacheFolder() const;

private:
    friend struct client::ClientInternals;

    Client();
    class Impl;
    /// The inside, for a call on the client's thread. Throws Misuse on another one.
    [[nodiscard]] Impl& here(const char* function) const;

    std::unique_ptr<Impl> impl_;
};

template <IsSingleRequest Request>
Result<typename Request::Answer> Client::ask(Request what, double timeoutMs) {
    if (const auto error = misuse("ask", true)) return tl::unexpected(*error);
    return waitFor(request(std::move(what)), timeoutMs).map([](client::Event&& event) {
        return std::get<client::event::Answered<Request>>(std::move(event)).answer;
    });
}

}  // namespace usdlive
