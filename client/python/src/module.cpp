// The extension module of the package `usdlive`: the C++ client. Layers are named by their
// identifiers, and the package finds them with pxr.Sdf. Events are dictionaries, and the package
// converts them to dataclasses.

#include <nanobind/nanobind.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>
#include <pxr/usd/sdf/layer.h>

#include <chrono>
#include <memory>
#include <thread>
#include <type_traits>

#include "ContentBinding.h"
#include "Errors.h"
#include "EventDictionary.h"
#include "Fields.h"
#include "FromPython.h"
#include "LayersBinding.h"
#include "NamespaceBinding.h"
#include "usdlive/client/usd/Client.h"
#include "usdlive/client/usd/Misuse.h"
#include "usdlive/common/core/LayerPath.h"

namespace nb = nanobind;
using namespace usdlive;

namespace {

/// The client. Releases the interpreter's lock while it works, because notices of Sdf reach Python
/// listeners, which take it.
class PythonClient {
public:
    PythonClient(const std::string& url, const std::string& user, const std::string& application,
                 const std::string& cacheFolder, double timeoutMs, std::uint64_t cacheBytes,
                 bool addresses, const std::string& token) {
        client_ = orRaise([&] {
            nb::gil_scoped_release release;
            return Client::connect(url, {.user = user,
                                         .application = application,
                                         .cacheFolder = cacheFolder,
                                         .connectTimeoutMs = timeoutMs,
                                         .cacheBytes = cacheBytes,
                                         .addresses = addresses,
                                         .token = token});
        }());
        client_->setEventHandler([this](const client::Event& event) {
            nb::gil_scoped_acquire acquire;
            events_.append(toDictionary(event));
        });
    }

    // Runs on the thread that dropped the last reference.
    ~PythonClient() {
        auto client = std::move(client_);
        nb::gil_scoped_release release;
        client.reset();
    }

    /// Leaves the project. Returns (unsent work or None, events). Inside a call of this connection
    /// (a notice handler), returns None and closes when that call ends.
    nb::tuple close(double timeoutMs) {
        if (!client_ || closing_) return nb::make_tuple(nb::none(), nb::list());
        client("close");
        if (depth_ > 0) {
            closing_ = true;
            closeTimeoutMs_ = timeoutMs;
            return nb::make_tuple(nb::none(), nb::list());
        }
        return closeNow(timeoutMs);
    }

    [[nodiscard]] bool isClosed() const { return !client_ || closing_; }

    void withoutWaiting(const nb::callable& compose) {
        work("without_waiting", false, [&](Client& live) {
            live.withoutWaiting([&] {
                nb::gil_scoped_acquire acquire;
                compose();
            });
        });
    }

    std::vector<std::string> layers() {
        std::vector<std::string> names;
        for (const LayerId& layer : client("layers").layers()) names.push_back(layer.value);
        return names;
    }

    /// Returns the identifier of the live layer. The client keeps the layer alive.
    std::string openLayer(const std::string& name, bool payloads) {
        const LayerId layer = orRaise(parseLayerId(name));
        const auto load = payloads ? client::LoadSet::All : client::LoadSet::NoPayloads;
        return orRaise(work("open_layer", true,
                            [&](Client& live) { return live.openLayer(layer, load); }))
            ->GetIdentifier();
    }

    /// Returns why files that are no layers are not found, or None.
    std::optional<std::string> filesProblem() {
        // Does not belong to a thread yet: connect() may run on another one.
        const auto problem = client_->filesProblem();
        return problem ? std::optional(problem->message) : std::nullopt;
    }

    std::uint64_t requestOpenLayer(const std::string& name, bool payloads) {
        const LayerId layer = orRaise(parseLayerId(name));
        return client("request_open_layer")
            .requestOpenLayer(layer, payloads ? client::LoadSet::All : client::LoadSet::NoPayloads);
    }

    /// The identifier of an open layer, or None.
    std::optional<std::string> openedLayer(const std::string& name) {
        const auto layer = client("opened_layer").layer(orRaise(parseLayerId(name)));
        return layer ? std::optional(layer->GetIdentifier()) : std::nullopt;
    }

    std::string identifierOf(const std::string& name, const std::string& beside) {
        return client("identifier_of")
            .identifierOf(orRaise(parseLayerId(name)), pxr::SdfLayer::Find(beside));
    }

    std::string addressAt(const std::string& name, Revision revision) {
        const LayerId layer = orRaise(parseLayerId(name));
        return orRaise(work("address_at", true,
                            [&](Client& live) { return live.addressAt(layer, revision); }));
    }

    /// Returns (page, events).
    nb::tuple readLog(const nb::dict& query, Revision before, std::size_t limit) {
        const auto page =
            orRaise(work("log", true, [asked = logQueryFrom(query, before, limit)](Client& live) {
                return live.readLog(asked);
            }));
        return nb::make_tuple(toTuple(page), takeEvents());
    }

    /// Returns (opinions, events).
    nb::tuple blame(const std::string& name, const std::string& path, bool below) {
        const LayerId layer = orRaise(parseLayerId(name));
        const auto found = orRaise(
            work("blame", true, [&](Client& live) { return live.blame(layer, path, below); }));
        return nb::make_tuple(toDictionaries(found), takeEvents());
    }

    /// A player. Its calls are calls of the connection, too: a close() within one waits for its
    /// end.
    class Player {
    public:
        Player(PythonClient& client, const std::string& name, Revision revision) : client_(client) {
            const LayerId layer = orRaise(parseLayerId(name));
            player_ = orRaise(client.work(
                "player", true, [&](Client& live) { return live.openPlayer(layer, revision); }));
        }
        ~Player() {
            const nb::gil_scoped_release release;
            player_.reset();
        }
        /// The identifier of the root layer.
        [[nodiscard]] std::string layer() const {
            const auto layer = player_->layer();
            return layer ? layer->GetIdentifier() : std::string();
        }
        /// Returns the events.
        nb::list seek(Revision revision) {
            const auto moved =
                client_.work("seek", true, [&](Client&) { return player_->seek(revision); });
            if (!moved) raise(moved.error());
            return client_.takeEvents();
        }
        void play(double speed) {
            client_.work("play", false, [&](Client&) { player_->play(speed); });
        }
        bool tick() {
            return orRaise(client_.work("tick", true, [&](Client&) { return player_->tick(); }));
        }
        void close() {
            const nb::gil_scoped_release release;
            player_->close();
        }
        [[nodiscard]] const HistoryPlayer& player() const { return *player_; }

    private:
        PythonClient& client_;  // kept by the binding
        std::unique_ptr<HistoryPlayer> player_;
    };

    std::string createLayer(const std::string& name) {
        const LayerId layer = orRaise(parseLayerId(name));
        return orRaise(work("create_layer", true,
                            [&](Client& live) { return live.createLayer(layer); }))
            ->GetIdentifier();
    }

    void upload(const nb::bytes& file, const std::string& path, bool overwrite) {
        const std::filesystem::path from(std::string(file.c_str(), file.size()));
        const auto done =
            work("upload", true, [&](Client& live) { return live.upload(from, path, overwrite); });
        if (!done) raise(done.error());
    }

    std::uint64_t requestUpload(const nb::bytes& file, const std::string& path, bool overwrite) {
        return client("request_upload")
            .requestUpload(std::string(file.c_str(), file.size()), path, overwrite);
    }

    std::vector<std::string> attach(const std::string& projectFolder) {
        const auto attached =
            orRaise(work("attach", true, [&](Client& live) { return live.attach(projectFolder); }));
        std::vector<std::string> names;
        for (const LayerId& layer : attached) names.push_back(layer.value);
        return names;
    }

    void closeLayer(const std::string& name) {
        const LayerId layer = orRaise(parseLayerId(name));
        const auto closed =
            work("close_layer", true, [&](Client& live) { return live.close(layer); });
        if (!closed) raise(closed.error());
    }

    /// Returns (applied commits, more to apply, events).
    nb::tuple tick(double budgetMs) {
        const auto result = work("tick", false, [&](Client& live) { return live.tick(budgetMs); });
        return nb::make_tuple(result.applied, result.more, takeEvents());
    }

    nb::tuple flush(double timeoutMs) {
        const bool done = work("flush", true, [&](Client& live) { return live.flush(timeoutMs); });
        return nb::make_tuple(done, takeEvents());
    }

    /// Raises an error if the caller must not wait for the server here.
    void mayWait(const std::string& function) { client(function.c_str(), true); }

    void beginGesture() {
        work("begin_gesture", false, [](Client& live) { live.beginGesture(); });
    }
    void endGesture() {
        work("end_gesture", false, [](Client& live) { live.endGesture(); });
    }

    /// Return (result, events).
    nb::tuple undo() {
        const auto result = orRaise(work("undo", true, [](Client& live) { return live.undo(); }));
        return nb::make_tuple(toDictionary(result), takeEvents());
    }
    nb::tuple redo() {
        const auto result = orRaise(work("redo", true, [](Client& live) { return live.redo(); }));
        return nb::make_tuple(toDictionary(result), takeEvents());
    }
    /// Returns the labels of (undo, redo).
    nb::tuple undoStack() {
        const auto labels = client("undo_stack").undoStack();
        return nb::make_tuple(labels.undo, labels.redo);
    }
    void beginUndoGroup(const std::string& label) {
        work("begin_undo_group", false, [&](Client& live) { live.beginUndoGroup(label); });
    }
    void endUndoGroup() {
        work("end_undo_group", false, [](Client& live) { live.endUndoGroup(); });
    }

    // Return the number of the request, which its result event contains.
    std::uint64_t save(const std::vector<std::string>& names, bool force) {
        const auto layers = layerIds(names);
        return work("save", false, [&](Client& live) { return live.save(layers, force); });
    }
    /// `type` as in PROTOCOL.md, "createCheckpoint".
    std::uint64_t request(const std::string& type, const nb::dict& fields) {
        auto request = requestFrom(type, fields);
        return client(pythonName(type).c_str()).request(std::move(request));
    }

    void setGloballyMuted(const std::string& root, const std::string& layer, bool muted) {
        const LayerId rootId = orRaise(parseLayerId(root)), layerId = orRaise(parseLayerId(layer));
        const auto set = work(muted ? "mute" : "unmute", true, [&](Client& live) {
            return live.setGloballyMuted(rootId, layerId, muted);
        });
        if (!set) raise(set.error());
    }

    std::vector<std::string> globallyMuted(const std::string& root) {
        std::vector<std::string> names;
        for (const LayerId& layer :
             client("globally_muted").globallyMuted(orRaise(parseLayerId(root))))
            names.push_back(layer.value);
        return names;
    }

    void setLocked(const std::string& name, bool locked) {
        const LayerId layer = orRaise(parseLayerId(name));
        const auto set = work(locked ? "lock" : "unlock", true,
                              [&](Client& live) { return live.setLocked(layer, locked); });
        if (!set) raise(set.error());
    }

    nb::tuple mayEdit(const std::string& layer, const std::string& path, const std::string& kind) {
        const LayerId id = orRaise(parseLayerId(layer));
        return toTuple(orRaise(client("may_edit").mayEdit(id, path, kind)));
    }

    nb::tuple mayDo(const std::string& action, const std::optional<std::string>& layer) {
        return toTuple(orRaise(client("may_do").mayDo(action, LayerId{layer.value_or("")})));
    }

    nb::list layerStates() { return toDictionaries(client("layer_states").layerStates()); }

    void showPresence(const std::vector<std::string>& selection, const std::vector<double>& camera,
                      std::optional<double> time, const std::string& editTarget,
                      const std::string& data) {
        Presence presence{{}, {}, {}, selection, camera, time, editTarget, data};
        if (const auto shown = client("show_presence").showPresence(std::move(presence)); !shown)
            raise(shown.error());
    }

    nb::list presences() { return toDictionaries(client("presences").presences()); }

    std::string lostWorkAsLayer(std::uint64_t index, const std::string& name) {
        lostLayers_.push_back(orRaise(
            client("lost_work_as_layer").lostWorkAsLayer(index, orRaise(parseLayerId(name)))));
        return lostLayers_.back()->GetIdentifier();
    }

    nb::object otherHistory() {
        const auto& other = client("other_history").otherHistory();
        return other ? nb::object(toDictionary(*other)) : nb::object(nb::none());
    }
    void joinOtherHistory() {
        if (const auto done = client("join_other_history").joinOtherHistory(); !done)
            raise(done.error());
    }

    nb::list unsentWork() {
        nb::list all;
        for (const auto& one : client("unsent_work").unsentWork()) all.append(toDictionary(one));
        return all;
    }
    /// Returns (committed now, committed before, lost).
    nb::tuple sendUnsent(const std::string& id, double timeoutMs) {
        const auto sent = orRaise(work(
            "send", true, [&](Client& live) { return live.sendUnsent(ClientId{id}, timeoutMs); }));
        return nb::make_tuple(sent.committed, sent.before, sent.lost);
    }
    std::string unsentAsLayer(const std::string& id, const std::string& name) {
        lostLayers_.push_back(
            orRaise(client("as_layer").unsentAsLayer(ClientId{id}, orRaise(parseLayerId(name)))));
        return lostLayers_.back()->GetIdentifier();
    }
    void discardUnsent(const std::string& id) {
        if (const auto done = client("discard").discardUnsent(ClientId{id}); !done)
            raise(done.error());
    }

    std::optional<std::string> layerName(const std::string& identifier) {
        Client& live = client("layer_name");
        const auto layer = pxr::SdfLayer::Find(identifier);
        const auto name = layer ? live.layerId(layer) : std::nullopt;
        return name ? std::optional(name->value) : std::nullopt;
    }

    Client* clientOrNull() { return client_.get(); }

    /// Returns the client for a call. Raises if the call is not possible now. `blocks`: the call
    /// waits for the server.
    Client& client(const char* function, bool blocks = false) {
        if (isClosed())
            raise({ErrorCode::NotConnected, std::string(function) +
                                                "(): this connection was closed. Make another "
                                                "with usdlive.connect()"});
        if (const auto error = client_->misuse(function, blocks)) raise(*error);
        return *client_;
    }

private:
    /// Calls `function` without the interpreter's lock. Finishes a close() that was called inside
    /// it.
    template <class Function>
    std::invoke_result_t<Function, Client&> work(const char* name, bool blocks, Function function) {
        Client& live = client(name, blocks);
        ++depth_;
        const Ended ended{*this};
        nb::gil_scoped_release release;
        return function(live);
    }
    struct Ended {
        PythonClient& self;
        ~Ended() {
            if (--self.depth_ == 0 && self.closing_) self.closeDeferred();
        }
    };

    nb::tuple closeNow(double timeoutMs) {
        std::optional<client::UnsentWork> unsent;
        auto client = std::move(client_);
        {
            nb::gil_scoped_release release;
            unsent = client->leave(timeoutMs);
            client.reset();
        }
        closing_ = false;
        return nb::make_tuple(unsent ? nb::object(toDictionary(*unsent)) : nb::object(nb::none()),
                              takeEvents());
    }

    // Reports unsent work as an event, because the caller of close() has continued.
    void closeDeferred() {
        const nb::tuple closed = closeNow(closeTimeoutMs_);
        for (const nb::handle event : nb::list(closed[1])) events_.append(event);
        if (closed[0].is_none()) return;
        nb::list work;
        work.append(closed[0]);
        nb::dict event;
        event["event"] = "UnsentFound";
        event["work"] = work;
        events_.append(event);
    }

    static std::vector<LayerId> layerIds(const std::vector<std::string>& names) {
        std::vector<LayerId> layers;
        for (const std::string& name : names) layers.push_back(orRaise(parseLayerId(name)));
        return layers;
    }

    nb::list takeEvents() {
        nb::list taken = std::move(events_);
        events_ = nb::list();
        return taken;
    }

    std::unique_ptr<Client> client_;
    int depth_ = 0;  // number of nested calls of this connection
    bool closing_ = false;
    double closeTimeoutMs_ = 0;
    nb::list events_;
    std::vector<pxr::SdfLayerRefPtr> lostLayers_;
};

}  // namespace

Client* usdlive::clientOf(nb::handle client) {
    return nb::cast<PythonClient&>(client).clientOrNull();
}

NB_MODULE(_usdlive, module) {
    // A script that ends with an exception keeps objects until the interpreter ends; nanobind would
    // report leaks of the binding.
    nb::set_leak_warnings(false);
    module.attr("__version__") = USDLIVE_VERSION;
    nb::register_exception_translator([](const std::exception_ptr& thrown, void*) {
        try {
            std::rethrow_exception(thrown);
        } catch (const Misuse& misuse) {
            setError(misuse.error);
        }
    });
    nb::class_<PythonClient>(module, "Client")
        .def(nb::init<const std::string&, const std::string&, const std::string&,
                      const std::string&, double, std::uint64_t, bool, const std::string&>(),
             nb::arg("url"), nb::arg("user"), nb::arg("application"), nb::arg("cache_folder"),
             nb::arg("timeout_ms"), nb::arg("cache_bytes"), nb::arg("addresses") = false,
             nb::arg("token") = "")
        .def("close", &PythonClient::close)
        .def("may_wait", &PythonClient::mayWait)
        .def_prop_ro("closed", &PythonClient::isClosed)
        .def("without_waiting", &PythonClient::withoutWaiting)
        .def("layers", &PythonClient::layers)
        .def("files_problem", &PythonClient::filesProblem)
        .def("open_layer", &PythonClient::openLayer)
        .def("request_open_layer", &PythonClient::requestOpenLayer)
        .def("opened_layer", &PythonClient::openedLayer)
        .def("identifier_of", &PythonClient::identifierOf)
        .def("address_at", &PythonClient::addressAt)
        .def("log", &PythonClient::readLog)
        .def("blame", &PythonClient::blame)
        .def("create_layer", &PythonClient::createLayer)
        .def("upload", &PythonClient::upload)
        .def("request_upload", &PythonClient::requestUpload)
        .def("attach", &PythonClient::attach)
        .def("close_layer", &PythonClient::closeLayer)
        .def("tick", &PythonClient::tick)
        .def("flush", &PythonClient::flush)
        .def("save", &PythonClient::save)
        .def("request", &PythonClient::request)
        .def("set_globally_muted", &PythonClient::setGloballyMuted)
        .def("globally_muted", &PythonClient::globallyMuted)
        .def("begin_gesture", &PythonClient::beginGesture)
        .def("end_gesture", &PythonClient::endGesture)
        .def("undo", &PythonClient::undo)
        .def("redo", &PythonClient::redo)
        .def("undo_stack", &PythonClient::undoStack)
        .def("begin_undo_group", &PythonClient::beginUndoGroup, nb::arg("label"))
        .def("end_undo_group", &PythonClient::endUndoGroup)
        .def("set_locked", &PythonClient::setLocked)
        .def("layer_states", &PythonClient::layerStates)
        .def("may_edit", &PythonClient::mayEdit)
        .def("may_do", &PythonClient::mayDo)
        .def("show_presence", &PythonClient::showPresence, nb::arg("selection"), nb::arg("camera"),
             nb::arg("time").none(), nb::arg("edit_target"), nb::arg("data"))
        .def("hide_presence",
             [](PythonClient& self) { self.client("hide_presence").hidePresence(); })
        .def("presences", &PythonClient::presences)
        .def("lost_work_as_layer", &PythonClient::lostWorkAsLayer)
        .def("other_history", &PythonClient::otherHistory)
        .def("join_other_history", &PythonClient::joinOtherHistory)
        .def("unsent_work", &PythonClient::unsentWork)
        .def("send_unsent", &PythonClient::sendUnsent)
        .def("unsent_as_layer", &PythonClient::unsentAsLayer)
        .def("discard_unsent", &PythonClient::discardUnsent)
        .def("layer_name", &PythonClient::layerName)
        .def_prop_ro("connected",
                     [](PythonClient& self) { return self.client("connected").isConnected(); })
        .def_prop_ro("revision",
                     [](PythonClient& self) { return self.client("revision").revision(); })
        .def_prop_ro(
            "pending",
            [](PythonClient& self) { return self.client("pending").pendingTransactions(); })
        .def_prop_ro("user", [](PythonClient& self) { return self.client("user").user(); })
        .def_prop_ro("role", [](PythonClient& self) { return self.client("role").role(); })
        .def_prop_ro("id", [](PythonClient& self) { return self.client("id").id().value; })
        .def_prop_ro("cache_folder", [](PythonClient& self) {
            return self.client("cache_folder").cacheFolder().string();
        });
    using Player = PythonClient::Player;
    nb::class_<Player>(module, "Player")
        .def(nb::init<PythonClient&, const std::string&, Revision>(), nb::keep_alive<1, 2>())
        .def_prop_ro("layer", &Player::layer)
        .def("seek", &Player::seek)
        .def("play", &Player::play)
        .def("tick", &Player::tick)
        .def("close", &Player::close)
        .def_prop_ro("closed", [](const Player& self) { return self.player().isClosed(); })
        .def_prop_ro("playing", [](const Player& self) { return self.player().isPlaying(); })
        .def_prop_ro("revision", [](const Player& self) { return self.player().revision(); })
        .def_prop_ro("first", [](const Player& self) { return self.player().first(); })
        .def_prop_ro("last", [](const Player& self) { return self.player().last(); });
    nb::list requests;
    forEachRequest(
        [&](const auto& request) { requests.append(toPython(std::string(request.kType))); });
    module.attr("REQUESTS") = nb::tuple(requests);
    bindContent(module);
    bindLayers(module);
    bindNamespace(module);
}
