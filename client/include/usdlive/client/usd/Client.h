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

#include "usdlive/client/history/History.h"
#include "usdlive/client/session/Events.h"
#include "usdlive/client/session/Undo.h"
#include "usdlive/client/usd/HistoryPlayer.h"
#include "usdlive/client/usd/LoadSet.h"
#include "usdlive/client/usd/Misuse.h"

namespace usdlive {

namespace client {
struct ClientInternals;
}

/// Edits one project together with other users. Gives an editor real SdfLayers that are live: edits
/// of all users appear in them, and the editor's own edits are sent.
///
/// A client belongs to one thread, the one that owns the editor's stage: the first thread that
/// calls a function of it, after connect(). On any other thread every function refuses to work:
/// functions that return a Result return an error, and all others throw Misuse. Two exceptions:
/// setEventHandler() does not choose the thread, and the destructor runs on any thread.
///
/// Only the functions of this class use USD, and only during their calls: call tick() once per
/// frame. The network has a thread of its own. A layer can be live through one client of a process
/// only.
///
///     auto client = usdlive::Client::connect("ws://127.0.0.1:7447", {.user = "ada"});
///     auto layer = (*client)->openLayer(usdlive::LayerId{"shot.usda"});
///     for (;;) { editAndDraw(); (*client)->tick(2.0); }
class Client {
public:
    struct Options {
        std::string user;         ///< empty: the system's user name
        std::string application;  ///< the name of the application, shown to others
        /// The folder in which this process finds the layers of the project, so that relative paths
        /// between them resolve. Empty: a new folder below the system's temporary folder, which is
        /// removed with the client.
        std::filesystem::path cacheFolder;
        double connectTimeoutMs = 10'000;
        /// The folder for edits that the server has not acknowledged, by project and user. Empty:
        /// below the cache folder if that is set, otherwise $XDG_STATE_HOME/usdlive or
        /// ~/.local/state/usdlive.
        std::filesystem::path stateFolder = {};
        /// The most bytes of big values in the cache folder. The least recently used values are
        /// removed first. Values that the server does not have yet do not count.
        std::uint64_t cacheBytes = std::uint64_t(4) << 30;
        /// Gives the layers `usdlive://` addresses, so that everything that they name is found as
        /// in the project's folder: textures, packages, and other files. Needs the resolver plug-in
        /// (plugins/resolver), which OpenUSD has to know when it resolves the first path. Without
        /// it, or without HTTP, layers are paths in the cache folder: see filesProblem().
        bool addresses = false;
        /// The token with which the user signs in (AC1), for a process that acts for several users.
        /// Empty: the one that this user's programs know for the server. Not used over DDS.
        std::string token = {};
    };

    using Misuse = usdlive::Misuse;
    /// Returns the reason why `function` must not be called here: this is another thread, or, if it
    /// `blocks`, the call comes from a notice handler within tick(). Returns nothing if the call is
    /// allowed.
    [[nodiscard]] std::optional<Error> misuse(const std::string& function, bool blocks) const;

    /// Connects to a server and waits for its welcome. `url` may also be an invitation, which is
    /// exchanged for a token first (AC2). Fails after a second if no server can be
    /// reached, and after the time-out if it does not answer.
    [[nodiscard]] static Result<std::unique_ptr<Client>> connect(const std::string& url,
                                                                 Options options);
    /// Disconnects at once. The journal keeps unacknowledged edits; see leave(). The layers are
    /// closed as by close(). Does nothing in a process that fork() made.
    ~Client();

    /// Ends an open gesture and waits until all edits are committed, at most `timeoutMs`. Returns
    /// the uncommitted edits, which the journal keeps; nothing if all were committed.
    std::optional<client::UnsentWork> leave(double timeoutMs = 5'000);

    // --- another history at the address

    /// Returns what was found if the client has stopped because the server has another history than
    /// the editor shows: another project is served at the address, or an older copy of this one
    /// (ID2). An event::ServerError with HistoryDiverged reports it once. Layers stay as they are,
    /// edits are kept as without a connection, and work continues when the right server is back.
    [[nodiscard]] const std::optional<client::OtherHistory>& otherHistory() const;
    /// Decides to join that history with the next connection, if it is still the one that was found
    /// (ID4). Then all open layers get its content, and everything that the editor was told is
    /// committed and that this history lacks becomes lost work. Unsent edits are sent if it is the
    /// same project; those made in another project become lost work, too. Returns at once;
    /// event::Connected reports the result. Error: InvalidArgument (the client has not stopped).
    Result<void> joinOtherHistory();

    // --- edits that earlier connections could not send

    /// Returns the edits of this user in this project that earlier connections could not send,
    /// because their process, the server or the network failed. event::UnsentFound reports them at
    /// the start. Includes edits in another project of the same name, which cannot be sent to this
    /// one (UnsentWork::otherProject).
    [[nodiscard]] std::vector<client::UnsentWork> unsentWork();
    /// Sends the edits of an earlier connection, and waits. Each transaction is committed once,
    /// also if this is called repeatedly. Refused and dropped edits become lost work of this
    /// client.
    Result<client::SentWork> sendUnsent(const ClientId& work, double timeoutMs = 60'000);
    /// Returns the unsent edits of one layer as a separate layer. The journal keeps them.
    [[nodiscard]] Result<pxr::SdfLayerRefPtr> unsentAsLayer(const ClientId& work,
                                                            const LayerId& layer);
    /// Deletes the unsent edits permanently.
    Result<void> discardUnsent(const ClientId& work);

    // --- layers

    /// Returns why files that are no layers are not found, if Options::addresses is set.
    [[nodiscard]] std::optional<Error> filesProblem() const;

    /// Returns the layers of the project, sorted.
    [[nodiscard]] std::vector<LayerId> layers() const;

    /// Opens a layer of the project as a live SdfLayer, and waits for its content. The layers that
    /// it uses (sublayers, references and payloads inside the project, recursively) are opened with
    /// it. `NoPayloads` leaves out layers that are used by payloads only, for a stage that is
    /// opened without its payloads: such a layer becomes live within the ticks after composition
    /// has opened it.
    [[nodiscard]] Result<pxr::SdfLayerRefPtr> openLayer(
        const LayerId& layer, client::LoadSet load = client::LoadSet::All);
    /// Starts to open a layer and returns at once. The following ticks do the work within their
    /// budgets, also while there is no connection. Returns the number of the request, which no
    /// other request has. The request ends with event::LayerOpened, after which layer() returns the
    /// layer, or with event::LayerOpenFailed. event::Progress reports its progress if it takes
    /// long. close() cancels it. Any number of requests may be open, also for one layer.
    std::uint64_t requestOpenLayer(const LayerId& layer,
                                   client::LoadSet load = client::LoadSet::All);
    /// Creates a new, empty layer of the project for all users, opens it, and waits until it is
    /// open (FI6). The server creates its file in the project's folder, with folders as needed.
    /// `layer` is a path relative to the project that ends in .usda, .usdc or .usd (binary). A
    /// notice handler must not call this within tick(). Errors: InvalidLayerName, LayerExists (the
    /// project or its folder has a file with this name), NotConnected (only the server knows which
    /// names are free), SaveFailed and StorageFull (the server could not write the file).
    [[nodiscard]] Result<pxr::SdfLayerRefPtr> createLayer(const LayerId& layer);
    /// Uploads a file of this machine that is no layer, such as a texture or a package, and waits
    /// until the server has written it to its folder and everybody can open it (FI7). `path` is the
    /// name of the new file relative to the project; folders are created as needed. A file that the
    /// project has already with the same content is a success; one with another content is replaced
    /// only if `overwrite` is true. The server writes the whole file or nothing. A notice handler
    /// must not call this within tick(). Errors: InvalidFileName, FileExists, NotConnected (also if
    /// the connection is lost; upload it again), InvalidArgument (the file of this machine cannot
    /// be read, or was changed while it was read), BlobTooLarge, SaveFailed and StorageFull (the
    /// server could not write it).
    [[nodiscard]] Result<void> upload(const std::filesystem::path& file, const std::string& path,
                                      bool overwrite = false);
    /// Starts an upload and returns at once. The following ticks send the file within their
    /// budgets, while another thread reads it. Returns the number of the request. It ends with
    /// event::Uploaded or event::UploadFailed; event::Progress reports its progress if it takes
    /// long. Uploads are executed one after the other.
    std::uint64_t requestUpload(const std::filesystem::path& file, const std::string& path,
                                bool overwrite = false);
    /// Makes the layers of the project live that this process has loaded from `projectFolder`,
    /// which is the served folder or a copy of it. Returns them sorted, without those that the
    /// server cannot read now: they refuse edits and are joined later (event::JoinFailed). Error:
    /// InvalidArgument (one of them has unsaved edits).
    Result<std::vector<LayerId>> attach(const std::filesystem::path& projectFolder);
    /// Sends the layer's pending edits, then makes it stop being live. The layer keeps its content,
    /// and refuses edits, which nobody would get (`permissionToEdit`), unless it is a file of an
    /// attached folder.
    /// A layer that is still being opened is closed at once, and requests to open it fail. A notice
    /// handler must not call this within tick(); an error event reports such a call.
    /// Error: LayerNotOpen.
    Result<void> close(const LayerId& layer);
    /// Returns the live layer with all its content; null if it is not open or still being opened.
    [[nodiscard]] pxr::SdfLayerRefPtr layer(const LayerId& layer) const;
    /// Returns the name of a live layer of this client; nothing for other layers.
    [[nodiscard]] std::optional<LayerId> layerId(const pxr::SdfLayerHandle& layer) const;
    /// Returns the identifier by which OpenUSD finds a layer of the project. If `beside` is a layer
    /// of an attached folder, it is that of the layer in the same folder.
    [[nodiscard]] std::string identifierOf(const LayerId& layer,
                                           const pxr::SdfLayerHandle& beside = {}) const;

    // --- the past (docs/history.md)

    /// Returns the address by which OpenUSD opens a layer of the project as it was at a revision,
    /// with all layers that it uses as they were then. Waits for the server, which says whether the
    /// revision can be read; the layers are fetched when they are opened, and can be used without
    /// this client. Errors: LayerNotFound; InvalidArgument (revision 0; a call within tick());
    /// FutureRevision and HistoryReplaced name the revisions that there are; NotConnected;
    /// InvalidConfiguration (Options::addresses is not set, or filesProblem() has an error).
    [[nodiscard]] Result<std::string> addressAt(const LayerId& layer, Revision revision);
    /// Returns the next commits that a query chooses, the newest first. Waits for the server.
    /// Continue with LogPage::next. Errors: InvalidArgument (a path without a layer; a call within
    /// tick()), InvalidPath, LayerNotFound, NotConnected.
    [[nodiscard]] Result<client::LogPage> readLog(const client::LogQuery& query);
    /// Returns who has made the opinions of a spec and its properties, when, and what was there
    /// before; with `below` also those of everything below it. `path` is a prim or property, or one
    /// and a field (`/World/Ball.radius.default`), which is looked at part by part. Reads the
    /// commits until all are found, and waits for them; what was there before is read for the
    /// newest 20 commits. Own edits count when they are committed. Errors: LayerNotFound,
    /// SpecNotFound, InvalidArgument (a call within tick()), NotConnected.
    [[nodiscard]] Result<client::BlameResult> blame(const LayerId& layer, const std::string& path,
                                                    bool below = false);

    /// Opens a layer of the project as it was at a revision (0: the newest one), in layers that can
    /// be moved through the history. Waits for the content. The player must be used on this
    /// client's thread. Errors: those of addressAt(), without InvalidConfiguration: without
    /// addresses, only layers are found. LayerUnreadable, BlobNotFound.
    [[nodiscard]] Result<std::unique_ptr<HistoryPlayer>> openPlayer(const LayerId& layer,
                                                                    Revision revision = 0);

    // --- the frame

    struct TickResult {
        std::size_t applied = 0;  ///< applied commits
        bool more = false;        ///< the budget was not sufficient for all
        std::size_t filling = 0;  ///< layers whose content is still being built
    };
    /// Sends the edits since the last call as one transaction, applies received edits in one
    /// SdfChangeBlock for about `budgetMs`, and calls the event handler. Layers that composition
    /// has opened meanwhile become live. A thread of the client builds the content of an opened
    /// layer, and a later tick puts it in. Never waits for the server: a package that an edit names
    /// and that has to be fetched is composed in a later tick.
    TickResult tick(double budgetMs = 4.0);
    /// Calls a function of yours within a frame that lets stages compose something, for example one
    /// that unmutes a layer or loads a payload. As in tick(), packages and value clips that have to
    /// be fetched are fetched in the background, and a later tick composes them.
    void withoutWaiting(const std::function<void()>& compose);

    /// M11: edits between the two calls are shown to others at once, and committed as one
    /// transaction. Calls nest: the outermost two count.
    void beginGesture();
    void endGesture();

    // --- undo (docs/undo.md)

    /// Takes back the newest step of the user's own work: the edits of one tick, of a gesture or of
    /// a group, in all live layers. Edits that are not ticked yet are a step of their own, the
    /// newest. The layers show the result when this returns; it is sent like any edit, and comes
    /// back as lost work if the server refuses it. What others have written since stays, and is
    /// returned. `done` is false if there is no step. Errors: InvalidArgument (a gesture or a group
    /// is open; the call comes from a notice handler within tick()), NotConnected (too many
    /// transactions wait to be sent), those of misuse().
    Result<client::UndoResult> undo();
    /// Takes back the newest undo in the same way. Own edits in between end what can be redone.
    Result<client::UndoResult> redo();
    /// Returns the labels of the steps.
    [[nodiscard]] client::UndoLabels undoStack() const;
    /// Edits between the two calls are one step, over any number of ticks. Calls nest: the
    /// outermost two count. A gesture is a group, too. The history has the label of the first of
    /// them that has one, at most kMaxLabelBytes of it.
    void beginUndoGroup(const std::string& label);
    void endUndoGroup();
    /// Ends a group at the end of a scope: `auto group = client.undoGroup("Move chairs");`
    class UndoGroup {
    public:
        UndoGroup(const UndoGroup&) = delete;
        UndoGroup& operator=(const UndoGroup&) = delete;
        ~UndoGroup();

    private:
        friend class Client;
        UndoGroup(Client& client, const std::string& label);
        Client& client_;
    };
    /// Begins a group. The client outlives the returned object, which belongs to its thread.
    [[nodiscard]] UndoGroup undoGroup(const std::string& label) { return {*this, label}; }

    /// Calls tick() until all edits are committed. Returns false if the time limit was reached.
    bool flush(double timeoutMs = 10'000);

    using EventHandler = std::function<void(const client::Event&)>;
    /// Sets the function that tick() calls for each event, in order. It may call any function of
    /// the client.
    void setEventHandler(EventHandler handler);

    // --- locks and mutes

    /// Locks a live layer in the user's own name, or ends the lock. These are edits of the layer
    /// itself (LK1), sent with the next tick. If the server refuses them, they become lost work,
    /// and the error names the holder. While a layer is locked, its `permissionToEdit` is false for
    /// all other users but administrators. Errors: LayerNotOpen, InvalidArgument (a root layer with
    /// Kit's map of locks). What `alongside` writes into live layers becomes part of the same
    /// transaction; it is not called after an error.
    Result<void> setLocked(const LayerId& layer, bool locked,
                           const std::function<void()>& alongside = {});
    /// Mutes or unmutes a layer for all users on the stages of `root`, a live layer. These are
    /// edits of the root layer (MU1), sent with the next tick. Errors: LayerNotOpen, LayerNotFound
    /// (a layer that has left the project can still be unmuted), InvalidArgument (`layer` is the
    /// root layer itself).
    Result<void> setGloballyMuted(const LayerId& root, const LayerId& layer, bool muted);
    /// Returns the layers that are muted for all users on the stages of `root`; none if `root` is
    /// not live. The owner of a stage applies them (Usd.Stage.MuteAndUnmuteLayers).
    [[nodiscard]] std::set<LayerId> globallyMuted(const LayerId& root) const;

    // --- people

    /// Returns the states of layers as the server has reported them: dirty, the lock and its
    /// holder, the users that have them open. Layers that are saved, unlocked and not open are left
    /// out.
    [[nodiscard]] const std::map<LayerId, LayerState>& layerStates() const;
    /// Sends the user's presence to others, until hidePresence(). The server fills in the client,
    /// the user and the application. Errors: MalformedControl (a camera that is neither empty nor a
    /// matrix of 16 numbers, a number that is not finite, text that is not UTF-8),
    /// TransactionTooLarge (more than 64 KiB). What was shown before stays then.
    Result<void> showPresence(Presence presence);
    void hidePresence();
    /// Returns the presences of the other users, by client.
    [[nodiscard]] const std::map<ClientId, Presence>& presences() const;

    // --- requests Each request ends with one event that has its number: event::Answered, or
    // event::ServerError, also if the connection is lost (NotConnected).

    /// Sends a request (common/protocol/Requests.h) and returns its number.
    std::uint64_t request(AnyRequest request);
    /// Sends a request and waits for its answer. Error: that of the server, or NotConnected, also
    /// if the time limit was reached.
    ///
    ///     auto created = live.ask(usdlive::CreateCheckpoint{.name = "before lunch"});
    ///     if (!created) std::cerr << created.error().message << "\n";
    template <IsSingleRequest Request>
    [[nodiscard]] Result<typename Request::Answer> ask(Request what, double timeoutMs = 10'000);
    /// Waits until a request has ended. Returns the event::Answered.
    [[nodiscard]] Result<client::Event> waitFor(std::uint64_t request, double timeoutMs);

    // --- files and checkpoints: requests by name

    /// Requests the server to write layers with their committed content to their files. An empty
    /// list means all changed layers. Answered by event::Saved. A layer whose file was changed
    /// outside fails (LayerOutdated), unless `force` is true.
    std::uint64_t save(std::vector<LayerId> layers = {}, bool force = false);
    /// Commits all edits first, then does the same and waits until the files are written. Error:
    /// NotConnected (the time limit was reached).
    Result<LayersSaved> saveAndWait(std::vector<LayerId> layers = {}, bool force = false,
                                    double timeoutMs = 60'000);
    /// Requests the server to commit the content of files that were changed outside, so that all
    /// users have it. An empty list means all outdated layers. Answered by event::Reloaded.
    std::uint64_t reload(std::vector<LayerId> layers = {});
    /// Requests a checkpoint: a name for the newest state of the project. Call flush() before, to
    /// include all own edits. Answered by event::CheckpointMade.
    std::uint64_t createCheckpoint(std::string name);
    /// Requests the list of checkpoints. Answered by event::CheckpointsListed.
    std::uint64_t listCheckpoints();
    /// Requests the list of files that are not served. Answered by event::SkippedListed.
    std::uint64_t listSkipped();

    // --- lost work: edits that are not in the project (M12)

    /// Returns the number of refused or dropped pieces of work since the start. The index of a
    /// piece is that of its event::Lost.
    [[nodiscard]] std::uint64_t lostWorkCount() const;
    [[nodiscard]] Result<client::LostWork> lostWork(std::uint64_t index) const;
    /// Returns the lost edits of one layer as a separate layer.
    [[nodiscard]] Result<pxr::SdfLayerRefPtr> lostWorkAsLayer(std::uint64_t index,
                                                              const LayerId& layer) const;

    // --- state

    [[nodiscard]] bool isConnected() const;
    /// Returns true while tick() changes layers: it applies edits of others, or reverts refused
    /// edits.
    [[nodiscard]] bool isApplying() const;
    [[nodiscard]] Revision revision() const;
    /// Returns the number of unacknowledged transactions, including a frame that waits for its big
    /// arrays to be encoded.
    [[nodiscard]] std::size_t pendingTransactions() const;
    [[nodiscard]] ClientId id() const;
    [[nodiscard]] const std::string& user() const;  ///< the name that others see
    /// Returns true if the server lets the user edit and unlock what others lock. False while the
    /// project is not known.
    [[nodiscard]] bool isAdministrator() const;
    /// Returns "viewer", "reviewer", "editor" or "admin": what the server lets the user do (AC3).
    /// Live layers refuse edits of viewers and reviewers. Empty while the project is not known.
    [[nodiscard]] std::string role() const;
    using Permission = client::Permission;
    /// Returns whether the server lets the user write opinions of this kind at the place now, by
    /// role, access rules and the lock of the layer (AC3, AC6, LK1). Asks nobody and does not
    /// wait. `path` names a prim or property; `kind` is a kind of opinion (AC7), for example
    /// "transform"; empty: any one. The server decides again when it orders an edit. After
    /// event::RightsChanged and event::LayerStatesChanged the answer may be another one. Errors:
    /// InvalidArgument (path, kind), LayerNotFound, NotConnected (the project is not known yet).
    [[nodiscard]] Result<Permission> mayEdit(const LayerId& layer, const std::string& path,
                                             std::string_view kind = {}) const;
    /// Returns whether the server lets the user do something else than edit now, by role, access
    /// rules and the lock of the layer (AC3, AC11, LK3). Asks nobody and does not wait. `action`
    /// is "save", "reload", "lock", "takeOver" (end the lock of somebody else), "mute" (for
    /// everybody, in a root layer), "upload" (`place` is a file of the project), "createLayer",
    /// "checkpoint" or "compact"; the last two concern the project, and `place` is empty. Else as
    /// mayEdit(). Errors: InvalidArgument (action, place), InvalidLayerName,
    /// InvalidFileName, LayerNotFound (not for "upload" and
    /// "createLayer"), NotConnected (the project is not known yet).
    [[nodiscard]] Result<Permission> mayDo(std::string_view action,
                                           const LayerId& place = {}) const;
    [[nodiscard]] std::filesystem::path cacheFolder() const;

private:
    friend struct client::ClientInternals;
    friend class HistoryPlayer;

    Client();
    class Impl;
    /// Returns the implementation. Throws Misuse on another thread than the client's.
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
