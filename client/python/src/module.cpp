// The extension under the package `usdlive`: the C++ client, with layers named by their identifiers
// (the package looks them up with pxr.Sdf) and events as plain dictionaries (the package makes
// dataclasses of them).

#include <nanobind/nanobind.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>
#include <pxr/usd/sdf/layer.h>

#include <chrono>
#include <memory>
#include <thread>

#include "EventDictionary.h"
#include "LayersBinding.h"
#include "usdlive/client/usd/Client.h"
#include "usdlive/common/core/LayerPath.h"

namespace nb = nanobind;
using namespace usdlive;

namespace {

/// Raises usdlive.Error(code, message).
[[noreturn]] void raise(const Error& error) {
    const nb::object type = nb::module_::import_("usdlive._errors").attr("Error");
    const nb::object value = type(std::string(errorName(error.code)), error.message);
    PyErr_SetObject(type.ptr(), value.ptr());
    throw nb::python_error();
}

template <class T>
T orRaise(Result<T> result) {
    if (!result) raise(result.error());
    return std::move(*result);
}

/// The client with the interpreter's lock let go while it works: notices of Sdf reach Python
/// listeners, which take it themselves.
class PythonClient {
public:
    PythonClient(const std::string& url, const std::string& user, const std::string& application,
                 const std::string& cacheFolder, double timeoutMs) {
        client_ = orRaise([&] {
            nb::gil_scoped_release release;
            return Client::connect(url, {.user = user,
                                         .application = application,
                                         .cacheFolder = cacheFolder,
                                         .connectTimeoutMs = timeoutMs});
        }());
        client_->setEventHandler([this](const client::Event& event) {
            nb::gil_scoped_acquire acquire;
            events_.append(toDictionary(event));
        });
    }

    ~PythonClient() { close(); }

    void close() {
        nb::gil_scoped_release release;
        client_.reset();
    }

    std::vector<std::string> layers() {
        std::vector<std::string> names;
        for (const LayerId& layer : client().layers()) names.push_back(layer.value);
        return names;
    }

    /// The identifier of the live layer; the client keeps the layer alive.
    std::string openLayer(const std::string& name) {
        const LayerId layer = orRaise(parseLayerId(name));
        return orRaise([&] {
                   nb::gil_scoped_release release;
                   return client().openLayer(layer);
               }())
            ->GetIdentifier();
    }

    std::vector<std::string> attach(const std::string& projectFolder) {
        const auto attached = orRaise([&] {
            nb::gil_scoped_release release;
            return client().attach(projectFolder);
        }());
        std::vector<std::string> names;
        for (const LayerId& layer : attached) names.push_back(layer.value);
        return names;
    }

    void closeLayer(const std::string& name) {
        const LayerId layer = orRaise(parseLayerId(name));
        nb::gil_scoped_release release;
        client().close(layer);
    }

    /// (commits applied, is there more, events)
    nb::tuple tick(double budgetMs) {
        const Client::TickResult result = [&] {
            nb::gil_scoped_release release;
            return client().tick(budgetMs);
        }();
        return nb::make_tuple(result.applied, result.more, takeEvents());
    }

    nb::tuple flush(double timeoutMs) {
        const bool done = [&] {
            nb::gil_scoped_release release;
            return client().flush(timeoutMs);
        }();
        return nb::make_tuple(done, takeEvents());
    }

    void save(const std::vector<std::string>& names, bool force) {
        client().save(layerIds(names), force);
    }

    void reload(const std::vector<std::string>& names) { client().reload(layerIds(names)); }

    // Each returns the number that the event which answers it has.
    std::uint64_t createCheckpoint(const std::string& name) {
        return client().createCheckpoint(name);
    }
    std::uint64_t listCheckpoints() { return client().listCheckpoints(); }

    void setGloballyMuted(const std::string& root, const std::string& layer, bool muted) {
        const auto set = client().setGloballyMuted(orRaise(parseLayerId(root)),
                                                   orRaise(parseLayerId(layer)), muted);
        if (!set) raise(set.error());
    }

    std::vector<std::string> globallyMuted(const std::string& root) {
        std::vector<std::string> names;
        for (const LayerId& layer : client().globallyMuted(orRaise(parseLayerId(root))))
            names.push_back(layer.value);
        return names;
    }

    void setLocked(const std::string& name, bool locked) {
        const auto set = client().setLocked(orRaise(parseLayerId(name)), locked);
        if (!set) raise(set.error());
    }

    nb::list layerStates() {
        nb::list states;
        for (const auto& [layer, state] : client().layerStates())
            states.append(toDictionary(state));
        return states;
    }

    void showPresence(const std::vector<std::string>& selection, const std::vector<double>& camera,
                      std::optional<double> time, const std::string& editTarget,
                      const std::string& data) {
        Presence presence;
        presence.selection = selection;
        presence.camera = camera;
        presence.time = time;
        presence.editTarget = editTarget;
        presence.data = data;
        client().showPresence(std::move(presence));
    }

    nb::list presences() {
        nb::list presences;
        for (const auto& [id, presence] : client().presences())
            presences.append(toDictionary(presence));
        return presences;
    }

    std::string lostWorkAsLayer(std::size_t index, const std::string& name) {
        lostLayers_.push_back(
            orRaise(client().lostWorkAsLayer(index, orRaise(parseLayerId(name)))));
        return lostLayers_.back()->GetIdentifier();
    }

    std::optional<std::string> layerName(const std::string& identifier) {
        const auto layer = pxr::SdfLayer::Find(identifier);
        const auto name = layer ? client().layerId(layer) : std::nullopt;
        return name ? std::optional(name->value) : std::nullopt;
    }

    Client* clientOrNull() { return client_.get(); }

    Client& client() {
        if (!client_) raise({ErrorCode::NotConnected, "this connection was closed"});
        return *client_;
    }

private:
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
    nb::list events_;
    std::vector<pxr::SdfLayerRefPtr> lostLayers_;
};

}  // namespace

Client* usdlive::clientOf(nb::handle client) {
    return nb::cast<PythonClient&>(client).clientOrNull();
}

NB_MODULE(_usdlive, module) {
    nb::class_<PythonClient>(module, "Client")
        .def(nb::init<const std::string&, const std::string&, const std::string&,
                      const std::string&, double>(),
             nb::arg("url"), nb::arg("user"), nb::arg("application"), nb::arg("cache_folder"),
             nb::arg("timeout_ms"))
        .def("close", &PythonClient::close)
        .def("layers", &PythonClient::layers)
        .def("open_layer", &PythonClient::openLayer)
        .def("attach", &PythonClient::attach)
        .def("close_layer", &PythonClient::closeLayer)
        .def("tick", &PythonClient::tick)
        .def("flush", &PythonClient::flush)
        .def("save", &PythonClient::save)
        .def("reload", &PythonClient::reload)
        .def("create_checkpoint", &PythonClient::createCheckpoint)
        .def("list_checkpoints", &PythonClient::listCheckpoints)
        .def("set_globally_muted", &PythonClient::setGloballyMuted)
        .def("globally_muted", &PythonClient::globallyMuted)
        .def("begin_gesture", [](PythonClient& self) { self.client().beginGesture(); })
        .def("end_gesture", [](PythonClient& self) { self.client().endGesture(); })
        .def("set_locked", &PythonClient::setLocked)
        .def("layer_states", &PythonClient::layerStates)
        .def("show_presence", &PythonClient::showPresence, nb::arg("selection"), nb::arg("camera"),
             nb::arg("time").none(), nb::arg("edit_target"), nb::arg("data"))
        .def("hide_presence", [](PythonClient& self) { self.client().hidePresence(); })
        .def("presences", &PythonClient::presences)
        .def("lost_work_as_layer", &PythonClient::lostWorkAsLayer)
        .def("layer_name", &PythonClient::layerName)
        .def_prop_ro("connected", [](PythonClient& self) { return self.client().isConnected(); })
        .def_prop_ro("revision", [](PythonClient& self) { return self.client().revision(); })
        .def_prop_ro("pending",
                     [](PythonClient& self) { return self.client().pendingTransactions(); })
        .def_prop_ro("id", [](PythonClient& self) { return self.client().id().value; })
        .def_prop_ro("cache_folder",
                     [](PythonClient& self) { return self.client().cacheFolder().string(); });
    bindLayers(module);
}
