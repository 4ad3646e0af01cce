// The extension module `_session`: a session without OpenUSD, for the portable backend. The content
// of fields is bytes as in PROTOCOL.md (V10). Events are dictionaries, as those of `_usdlive`.

#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "Errors.h"
#include "EventDictionary.h"
#include "Fields.h"
#include "FromPython.h"
#include "SessionsBinding.h"
#include "SharedLayers.h"
#include "history/Moment.h"
#include "session/OwnRights.h"
#include "session/Permissions.h"
#include "session/RootEdits.h"
#include "usdlive/common/core/LayerPath.h"
#include "usdlive/common/core/Overloaded.h"
#include "usdlive/common/fetch/Join.h"
#include "usdlive/common/layer/FileRules.h"
#include "usdlive/common/layer/SpecPath.h"
#include "usdlive/common/protocol/Role.h"

namespace nb = nanobind;
using namespace usdlive;
using client::LayerChange;
using client::SeenSpec;
using client::SharedLayers;

namespace {

nb::bytes toBytes(const Bytes& bytes) { return nb::bytes(bytes.data(), bytes.size()); }

/// A session as Python sees it. Releases the interpreter's lock while it works.
class PythonSession {
public:
    PythonSession(const std::string& url, const std::string& user, const std::string& application,
                  const std::string& cacheFolder, double timeoutMs, std::uint64_t cacheBytes,
                  const std::string& token) {
        layers_ = orRaise([&] {
            const nb::gil_scoped_release release;
            return SharedLayers::connect(
                url, {user, application, cacheFolder, timeoutMs, cacheBytes, token});
        }());
    }
    ~PythonSession() { close(); }
    PythonSession(const PythonSession&) = delete;
    PythonSession& operator=(const PythonSession&) = delete;

    void close() {
        if (!layers_) return;
        auto closing = std::move(layers_);
        // After fork(), the threads that the destructor would wait for are not there.
        if (closing->thread().isForked()) return static_cast<void>(closing.release());
        const nb::gil_scoped_release release;
        closing.reset();
    }
    [[nodiscard]] bool isClosed() const { return !layers_; }

    /// Raises an error if the connection was closed, or belongs to another thread.
    void checkCaller(const std::string& function) { here(function.c_str()); }

    bool advance(double budgetMs) {
        auto& layers = here("advance");
        const nb::gil_scoped_release release;
        return layers.advance(budgetMs);
    }
    bool wait(double ms) {
        auto& layers = here("wait");
        const nb::gil_scoped_release release;
        return layers.wait(ms);
    }
    nb::list takeEvents() {
        nb::list events;
        for (const auto& event : here("take_events").takeEvents())
            events.append(toDictionary(event));
        return events;
    }

    std::vector<std::string> layers() {
        std::vector<std::string> names;
        for (const LayerId& layer : session("layers").projectLayers()) names.push_back(layer.value);
        return names;
    }
    void open(const std::string& name) { here("open").open(orRaise(parseLayerId(name))); }
    void closeLayer(const std::string& name) {
        here("close_layer").close(orRaise(parseLayerId(name)));
    }
    bool isJoined(const std::string& name) {
        return session("is_joined").isJoined(orRaise(parseLayerId(name)));
    }

    /// `seen`: (path, kind, {field: bytes}, prims, properties, variant sets, variants) of each
    /// spec, with the names of its children. `keeps(path, field, bytes)`: see compareLayer().
    /// Returns (path, field, code, message) of what cannot be shared.
    nb::list capture(const std::string& name, const nb::list& seen, const nb::callable& keeps) {
        std::vector<SeenSpec> specs;
        specs.reserve(nb::len(seen));
        for (const nb::handle each : seen) {
            const auto spec = nb::cast<nb::tuple>(each);
            SeenSpec& one = specs.emplace_back();
            one.path = nb::cast<std::string>(spec[0]);
            one.kind = SpecKind(nb::cast<int>(spec[1]));
            // `seen` keeps the bytes alive.
            for (const auto [field, value] : nb::borrow<nb::dict>(spec[2])) {
                const auto bytes = nb::borrow<nb::bytes>(value);
                one.fields.emplace_back(
                    nb::cast<std::string>(field),
                    ByteView(static_cast<const std::uint8_t*>(bytes.data()), bytes.size()));
            }
            for (std::size_t list = 0; list < one.children.size(); ++list)
                for (const nb::handle child : spec[3 + list])
                    one.children[list].push_back(nb::cast<std::string>(child));
        }
        const auto refused = here("capture").capture(
            orRaise(parseLayerId(name)), specs,
            [&](std::string_view path, std::string_view field, const Bytes& bytes) {
                return nb::cast<bool>(keeps(nb::str(path.data(), path.size()),
                                            nb::str(field.data(), field.size()), toBytes(bytes)));
            });
        nb::list result;
        for (const auto& one : refused)
            result.append(nb::make_tuple(
                one.path, one.field, std::string(errorName(one.reason.code)), one.reason.message));
        return result;
    }
    void lose(const std::string& layer, const std::string& path, const std::string& field,
              const std::string& code, const std::string& message, const std::string& text) {
        ErrorMessage reason;
        reason.code = code;
        reason.message = message;
        here("lose").lose(LayerId{layer}, path, field, toError(reason), text);
    }
    void submit() {
        auto& layers = here("submit");
        const nb::gil_scoped_release release;
        layers.submit();
    }

    /// Returns ("replaced",), ("create", path, kind), ("delete", path), ("move", path, new path),
    /// ("place", path, name before which it is or ""), ("field", path, field, bytes or None).
    nb::list takeChanges(const std::string& name) {
        nb::list changes;
        for (const LayerChange& change :
             here("take_changes").takeChanges(orRaise(parseLayerId(name))))
            changes.append(std::visit([](const auto& what) { return toTuple(what); }, change.what));
        return changes;
    }
    /// Returns [(path, kind, {field: bytes})]: parents before children, siblings in order.
    nb::list content(const std::string& name) {
        nb::list specs;
        here("content").content(orRaise(parseLayerId(name)), adderTo(specs));
        return specs;
    }

    /// Raises an error if the layer cannot be read at a revision. Waits for the server.
    void checkReadable(const std::string& name, Revision revision) {
        const LayerId layer = orRaise(parseLayerId(name));
        auto& layers = here("open_stage");
        const auto readable = [&] {
            const nb::gil_scoped_release release;
            return layers.history().checkReadable(layer, revision);
        }();
        if (!readable) raise(readable.error());
    }
    /// Returns content() of a layer as it was at a revision. Waits for it.
    nb::list contentAt(const std::string& name, Revision revision) {
        const LayerId layer = orRaise(parseLayerId(name));
        auto& layers = here("open_stage");
        const LayerDoc past = orRaise([&] {
            const nb::gil_scoped_release release;
            return layers.past(layer, revision);
        }());
        nb::list specs;
        layers.content(past, adderTo(specs));
        return specs;
    }

    /// Whether the editor should have a spec.
    bool has(const std::string& name, const std::string& path) {
        return here("has").has(orRaise(parseLayerId(name)), path);
    }
    /// The content of a field as the editor should have it, or None.
    nb::object held(const std::string& name, const std::string& path, const std::string& field) {
        const auto bytes = here("held").held(orRaise(parseLayerId(name)), path, field);
        return bytes ? nb::object(toBytes(*bytes)) : nb::none();
    }

    std::uint64_t save(const std::vector<std::string>& names, bool force) {
        std::vector<LayerId> layers;
        for (const auto& name : names) layers.push_back(orRaise(parseLayerId(name)));
        const auto forced = force ? std::optional(true) : std::nullopt;
        return session("save").request(SaveLayers{.layers = std::move(layers), .force = forced});
    }
    /// `type` as in PROTOCOL.md, "createCheckpoint".
    std::uint64_t request(const std::string& type, const nb::dict& fields) {
        auto request = requestFrom(type, fields);
        return session(pythonName(type).c_str()).request(std::move(request));
    }

    /// `file`: the path as the system has it.
    std::uint64_t requestUpload(const nb::bytes& file, const std::string& path, bool overwrite) {
        return here("request_upload").requestUpload(pathOf(file), path, overwrite);
    }
    void upload(const nb::bytes& file, const std::string& path, bool overwrite) {
        auto& layers = here("upload");
        const auto from = pathOf(file);
        const auto done = [&] {
            const nb::gil_scoped_release release;
            return layers.upload(from, path, overwrite);
        }();
        if (!done) raise(done.error());
    }

    // --- locks and rights

    void setLocked(const std::string& name, bool locked) {
        const LayerId layer = orRaise(parseLayerId(name));
        if (const auto set = here(locked ? "lock" : "unlock").setLocked(layer, locked); !set)
            raise(set.error());
    }
    void setGloballyMuted(const std::string& root, const std::string& layer, bool muted) {
        const LayerId rootId = orRaise(parseLayerId(root)), layerId = orRaise(parseLayerId(layer));
        auto& layers = here(muted ? "mute" : "unmute");
        if (const auto set = layers.setGloballyMuted(rootId, layerId, muted); !set)
            raise(set.error());
    }
    std::vector<std::string> globallyMuted(const std::string& root) {
        std::vector<std::string> names;
        const LayerId id = orRaise(parseLayerId(root));
        for (const LayerId& layer : client::globallyMuted(session("globally_muted"), id))
            names.push_back(layer.value);
        return names;
    }
    nb::list layerStates() { return toDictionaries(session("layer_states").layerStates()); }
    bool mayWrite(const std::string& name) {
        return client::mayWriteIn(session("may_write"), orRaise(parseLayerId(name)));
    }
    nb::tuple mayEdit(const std::string& layer, const std::string& path, const std::string& kind) {
        const LayerId id = orRaise(parseLayerId(layer));
        return usdlive::toTuple(orRaise(client::mayEdit(session("may_edit"), id, path, kind)));
    }
    nb::tuple mayDo(const std::string& action, const std::optional<std::string>& layer) {
        const LayerId place{layer.value_or("")};
        return usdlive::toTuple(orRaise(client::mayDo(session("may_do"), action, place)));
    }

    // --- history

    nb::tuple readLog(const nb::dict& query, Revision before, std::size_t limit) {
        const auto asked = logQueryFrom(query, before, limit);
        auto& layers = here("log");
        const auto page = orRaise([&] {
            const nb::gil_scoped_release release;
            return layers.history().log(asked);
        }());
        return usdlive::toTuple(page);
    }
    nb::list blame(const std::string& name, const std::string& path, bool below) {
        const LayerId layer = orRaise(parseLayerId(name));
        auto& layers = here("blame");
        const auto found = orRaise([&] {
            const nb::gil_scoped_release release;
            return layers.history().blame(layer, path, below);
        }());
        return toDictionaries(found);
    }

    // --- undo

    nb::dict undo() { return toDictionary(orRaise(session("undo").undo())); }
    nb::dict redo() { return toDictionary(orRaise(session("redo").redo())); }
    /// Returns the labels of (undo, redo).
    nb::tuple undoStack() {
        const auto labels = session("undo_stack").undoLabels();
        return nb::make_tuple(labels.undo, labels.redo);
    }
    void beginUndoGroup(const std::string& label) {
        session("begin_undo_group").beginUndoGroup(label);
    }
    void endUndoGroup() { session("end_undo_group").endUndoGroup(); }
    void beginGesture() { session("begin_gesture").beginGesture(); }
    void endGesture() { session("end_gesture").endGesture(); }

    // --- presence

    void showPresence(const std::vector<std::string>& selection, const std::vector<double>& camera,
                      std::optional<double> time, const std::string& editTarget,
                      const std::string& data) {
        Presence presence{{}, {}, {}, selection, camera, time, editTarget, data};
        if (const auto shown = session("show_presence").showPresence(std::move(presence)); !shown)
            raise(shown.error());
    }
    void hidePresence() { session("hide_presence").hidePresence(); }
    nb::list presences() { return toDictionaries(session("presences").presences()); }

    // --- unsent and lost work

    /// Returns the unsent work, or None.
    nb::object leave() {
        auto& layers = here("close");
        const auto unsent = [&] {
            const nb::gil_scoped_release release;
            return layers.leave();
        }();
        return unsent ? nb::object(toDictionary(*unsent)) : nb::none();
    }
    nb::list unsentWork() {
        nb::list all;
        for (const auto& one : here("unsent_work").unsent().left()) all.append(toDictionary(one));
        return all;
    }
    /// Returns (committed now, committed before, lost).
    nb::tuple sendUnsent(const std::string& id, double timeoutMs) {
        auto& layers = here("send");
        const auto sent = orRaise([&] {
            const nb::gil_scoped_release release;
            return layers.sendUnsent(ClientId{id}, timeoutMs);
        }());
        return nb::make_tuple(sent.committed, sent.before, sent.lost);
    }
    /// Return content() of a sparse layer. `name_of_type(bytes)` names the type of an attribute by
    /// its value.
    nb::list unsentAsLayer(const std::string& id, const std::string& name,
                           const nb::callable& nameOfType) {
        nb::list specs;
        const auto visited = here("as_layer")
                                 .unsentContent(ClientId{id}, orRaise(parseLayerId(name)),
                                                namerBy(nameOfType), adderTo(specs));
        if (!visited) raise(visited.error());
        return specs;
    }
    nb::list lostWorkAsLayer(std::uint64_t index, const std::string& name,
                             const nb::callable& nameOfType) {
        nb::list specs;
        const auto visited = here("lost_work_as_layer")
                                 .lostContent(index, orRaise(parseLayerId(name)),
                                              namerBy(nameOfType), adderTo(specs));
        if (!visited) raise(visited.error());
        return specs;
    }
    void discardUnsent(const std::string& id) {
        if (const auto done = here("discard").unsent().discard(ClientId{id}); !done)
            raise(done.error());
    }
    nb::object otherHistory() {
        const auto& other = session("other_history").otherHistory();
        return other ? nb::object(toDictionary(*other)) : nb::none();
    }
    void joinOtherHistory() {
        if (const auto done = session("join_other_history").joinOtherHistory(); !done)
            raise(done.error());
    }

    client::Session& session(const char* function) { return here(function).session(); }
    SharedLayers& here(const char* function) {
        if (!layers_)
            raise({ErrorCode::NotConnected, std::string(function) +
                                                "(): this connection was closed. Make another "
                                                "with usdlive.connect()"});
        if (const auto error = layers_->thread().claim(function)) raise(*error);
        return *layers_;
    }

private:
    static std::filesystem::path pathOf(const nb::bytes& file) {
        return std::string(file.c_str(), file.size());
    }
    static SharedLayers::Visit adderTo(nb::list specs) {
        return [specs](const LayerDoc::SpecView& spec, const auto& fields) mutable {
            nb::dict values;
            for (const auto& [field, bytes] : fields)
                values[nb::str(field.data(), field.size())] = toBytes(bytes);
            specs.append(nb::make_tuple(nb::str(spec.path.data(), spec.path.size()), int(spec.kind),
                                        values));
        };
    }
    static SharedLayers::NameOfType namerBy(nb::callable nameOfType) {
        return [nameOfType](const Bytes& value) {
            return nb::cast<std::string>(nameOfType(toBytes(value)));
        };
    }
    static nb::tuple toTuple(const LayerChange::Replaced&) { return nb::make_tuple("replaced"); }
    static nb::tuple toTuple(const LayerChange::Namespace& change) {
        const std::string& path = change.path;
        return std::visit(
            Overloaded{
                [&](const CreateSpec& create) {
                    return nb::make_tuple("create", path, int(create.kind));
                },
                [&](const MoveSpec& move) {
                    return nb::make_tuple("move", path, destination(path, move));
                },
                [&](const PlaceSpec& place) { return nb::make_tuple("place", path, place.before); },
                [&](const auto&) { return nb::make_tuple("delete", path); }},
            change.action);
    }
    static nb::tuple toTuple(const LayerChange::Field& change) {
        return nb::make_tuple("field", change.path, change.field,
                              change.value ? nb::object(toBytes(*change.value)) : nb::none());
    }

    std::unique_ptr<SharedLayers> layers_;
};

}  // namespace

NB_MODULE(_session, module) {
    module.attr("__version__") = USDLIVE_VERSION;
    bindSessions(module);
    // The number of the type (V1) of an attribute with this type name, or None.
    module.def("value_type_of", [](const std::string& name) -> nb::object {
        const auto type = valueTypeOf(name);
        return type ? nb::object(nb::int_(int(*type))) : nb::none();
    });
    // Lets nothing destroy the object any more.
    module.def("keep_for_ever", [](nb::object object) { object.release(); });
    module.def("join", [](const std::string& invitation) {
        return orRaise([&] {
                   const nb::gil_scoped_release release;
                   return parseInvitation(invitation).and_then(fetch::join);
               }())
            .url;
    });
    module.def("moment", [](const std::string& text) { return orRaise(client::momentOf(text)); });
    module.def("parent_of", [](const std::string& path) { return specpath::parent(path); });
    module.def("name_of",
               [](const std::string& path) { return std::string(specpath::last(path).name); });
    nb::class_<PythonSession>(module, "Session")
        .def(nb::init<const std::string&, const std::string&, const std::string&,
                      const std::string&, double, std::uint64_t, const std::string&>())
        .def("close", &PythonSession::close)
        .def_prop_ro("closed", &PythonSession::isClosed)
        .def("check_caller", &PythonSession::checkCaller)
        .def("advance", &PythonSession::advance)
        .def("wait", &PythonSession::wait)
        .def("take_events", &PythonSession::takeEvents)
        .def("layers", &PythonSession::layers)
        .def("open", &PythonSession::open)
        .def("close_layer", &PythonSession::closeLayer)
        .def("is_joined", &PythonSession::isJoined)
        .def("capture", &PythonSession::capture)
        .def("lose", &PythonSession::lose)
        .def("submit", &PythonSession::submit)
        .def("take_changes", &PythonSession::takeChanges)
        .def("content", &PythonSession::content)
        .def("check_readable", &PythonSession::checkReadable)
        .def("content_at", &PythonSession::contentAt)
        .def("has", &PythonSession::has)
        .def("held", &PythonSession::held)
        .def("undo", &PythonSession::undo)
        .def("redo", &PythonSession::redo)
        .def("undo_stack", &PythonSession::undoStack)
        .def("begin_undo_group", &PythonSession::beginUndoGroup)
        .def("end_undo_group", &PythonSession::endUndoGroup)
        .def("begin_gesture", &PythonSession::beginGesture)
        .def("end_gesture", &PythonSession::endGesture)
        .def("show_presence", &PythonSession::showPresence, nb::arg("selection"), nb::arg("camera"),
             nb::arg("time").none(), nb::arg("edit_target"), nb::arg("data"))
        .def("hide_presence", &PythonSession::hidePresence)
        .def("presences", &PythonSession::presences)
        .def("leave", &PythonSession::leave)
        .def("unsent_work", &PythonSession::unsentWork)
        .def("send_unsent", &PythonSession::sendUnsent)
        .def("unsent_as_layer", &PythonSession::unsentAsLayer)
        .def("lost_work_as_layer", &PythonSession::lostWorkAsLayer)
        .def("discard_unsent", &PythonSession::discardUnsent)
        .def("other_history", &PythonSession::otherHistory)
        .def("join_other_history", &PythonSession::joinOtherHistory)
        .def("save", &PythonSession::save)
        .def("upload", &PythonSession::upload)
        .def("request_upload", &PythonSession::requestUpload)
        .def("request", &PythonSession::request)
        .def("set_locked", &PythonSession::setLocked)
        .def("set_globally_muted", &PythonSession::setGloballyMuted)
        .def("globally_muted", &PythonSession::globallyMuted)
        .def("layer_states", &PythonSession::layerStates)
        .def("may_write", &PythonSession::mayWrite)
        .def("may_edit", &PythonSession::mayEdit)
        .def("may_do", &PythonSession::mayDo)
        .def("log", &PythonSession::readLog)
        .def("blame", &PythonSession::blame)
        .def_prop_ro("connected",
                     [](PythonSession& self) { return self.session("connected").isConnected(); })
        .def_prop_ro("revision",
                     [](PythonSession& self) { return self.session("revision").revision(); })
        .def_prop_ro(
            "pending",
            [](PythonSession& self) { return self.session("pending").pendingTransactions(); })
        .def_prop_ro(
            "cache_folder",
            [](PythonSession& self) { return self.here("cache_folder").cacheFolder().string(); })
        .def_prop_ro("user", [](PythonSession& self) { return self.here("user").user(); })
        .def_prop_ro("role",
                     [](PythonSession& self) {
                         return std::string(nameOf(self.session("role").rights().role()));
                     })
        .def_prop_ro("id", [](PythonSession& self) { return self.session("id").id().value; });
}
