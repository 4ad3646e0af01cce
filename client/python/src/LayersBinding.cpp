// Binds usdlive::layers for Python.
#include "LayersBinding.h"

#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/notice.h>

#include <memory>
#include <optional>
#include <tuple>
#include <utility>

#include "usd/layers/OmniLayerData.h"
#include "usdlive/client/usd/content/Recorder.h"
#include "usdlive/client/usd/layers/LayerUtils.h"
#include "usdlive/client/usd/layers/Layers.h"

namespace nb = nanobind;
using namespace usdlive::layers;

namespace usdlive {

namespace {

using Strings = std::vector<std::string>;

std::vector<pxr::TfToken> tokens(const Strings& names) { return {names.begin(), names.end()}; }

Strings texts(const std::vector<pxr::SdfPath>& paths) {
    Strings texts;
    for (const auto& path : paths) texts.push_back(path.GetString());
    return texts;
}

std::map<std::string, Strings> texts(const SpecsLinking::Links& links) {
    std::map<std::string, Strings> result;
    for (const auto& [path, layers] : links) result[path.GetString()] = layers;
    return result;
}

pxr::SdfLayerHandle find(const std::string& identifier) {
    return identifier.empty() ? pxr::SdfLayerHandle() : pxr::SdfLayer::Find(identifier);
}

/// A Usd.Stage, represented by an object of the package. Its methods must not raise: an exception
/// is only reported as unraisable.
class PythonHost final : public StageHost {
public:
    explicit PythonHost(nb::object host)
        : host_(std::move(host)),
          root_(find(nb::cast<std::string>(host_.attr("root")()))),
          session_(find(nb::cast<std::string>(host_.attr("session")()))) {}

    ~PythonHost() override {
        const nb::gil_scoped_acquire acquire;
        host_.reset();
    }

    [[nodiscard]] pxr::SdfLayerHandle rootLayer() const override { return root_; }
    [[nodiscard]] pxr::SdfLayerHandle sessionLayer() const override { return session_; }
    [[nodiscard]] Strings mutedLayers() const override { return call<Strings>("muted_layers"); }
    void muteAndUnmute(const Strings& mute, const Strings& unmute) override {
        call<bool>("mute_and_unmute", mute, unmute);
    }
    [[nodiscard]] pxr::SdfLayerHandle editTarget() const override {
        return find(call<std::string>("edit_target"));
    }
    bool setEditTarget(const pxr::SdfLayerHandle& layer) override {
        return layer && call<bool>("set_edit_target", layer->GetIdentifier());
    }
    [[nodiscard]] std::vector<pxr::SdfLayerHandle> usedLayers() const override {
        std::vector<pxr::SdfLayerHandle> layers;
        for (const auto& identifier : call<Strings>("used_layers"))
            if (auto layer = find(identifier)) layers.push_back(std::move(layer));
        return layers;
    }
    [[nodiscard]] std::vector<pxr::TfToken> childNames(const pxr::SdfPath& prim) const override {
        return tokens(call<Strings>("child_names", prim.GetString()));
    }
    [[nodiscard]] std::vector<pxr::TfToken> propertyNames(const pxr::SdfPath& prim) const override {
        return tokens(call<Strings>("property_names", prim.GetString()));
    }

private:
    template <class T, class... Arguments>
    T call(const char* name, const Arguments&... arguments) const {
        const nb::gil_scoped_acquire acquire;
        try {
            return nb::cast<T>(host_.attr(name)(arguments...));
        } catch (nb::python_error& error) {
            error.restore();
            PyErr_WriteUnraisable(host_.ptr());
        } catch (const nb::cast_error&) {
            PyErr_SetString(PyExc_TypeError, name);
            PyErr_WriteUnraisable(host_.ptr());
        }
        return T();
    }

    nb::object host_;
    const pxr::SdfLayerRefPtr root_, session_;
};

/// The layers of a Python client while it is connected.
class PythonLive final : public LiveLayers {
public:
    explicit PythonLive(nb::object client) : client_(std::move(client)) {}
    ~PythonLive() override {
        const nb::gil_scoped_acquire acquire;
        client_.reset();
    }

    [[nodiscard]] UserName user() const override {
        auto* client = get();
        return {client ? client->user() : std::string()};
    }
    [[nodiscard]] std::optional<LiveState> state(const pxr::SdfLayerHandle& layer) const override {
        auto* client = get();
        return client ? ClientLayers(*client).state(layer) : std::nullopt;
    }
    bool setLocked(const pxr::SdfLayerHandle& layer, bool locked,
                   const std::function<void()>& alongside) override {
        auto* client = get();
        return client && ClientLayers(*client).setLocked(layer, locked, alongside);
    }
    [[nodiscard]] bool isApplying() const override {
        auto* client = get();
        return client && client->isApplying();
    }
    void reload(const pxr::SdfLayerHandle& layer) override {
        if (auto* client = get()) ClientLayers(*client).reload(layer);
    }

private:
    [[nodiscard]] Client* get() const {
        const nb::gil_scoped_acquire acquire;
        return clientOf(client_);
    }

    nb::object client_;
};

nb::dict toDictionary(const LayerEvent& event) {
    nb::dict result;
    result["type"] = int(event.type);
    result["layer"] = event.layer;
    result["values"] = event.paths.empty() ? event.values : texts(event.paths);
    result["entries"] = event.entries;
    return result;
}

/// A Layers with the error of its last call, which Kit's API returns afterwards.
class PythonLayers {
public:
    PythonLayers(nb::object host, const std::string& user, nb::object client)
        : live_(client.is_none() ? nullptr : std::make_unique<PythonLive>(std::move(client))),
          layers_(std::make_unique<PythonHost>(std::move(host)),
                  {.user = {user}, .live = live_.get()}) {}

    void setClient(nb::object client) {
        auto live = client.is_none() ? nullptr : std::make_unique<PythonLive>(std::move(client));
        layers_.setLive(live.get());
        live_ = std::move(live);
    }

    LayersState& state() { return layers_.state(); }
    AutoAuthoring& authoring() { return layers_.autoAuthoring(); }
    SpecsLinking& linking() { return layers_.specsLinking(); }
    SpecsLocking& locking() { return layers_.specsLocking(); }
    Layers& layers() { return layers_; }

    nb::list takeEvents() {
        nb::list events;
        for (const auto& event : layers_.takeEvents()) events.append(toDictionary(event));
        return events;
    }

    /// Returns the last error; 0 and an empty text if the last call succeeded.
    [[nodiscard]] nb::tuple lastError() const {
        return error_ ? nb::make_tuple(int(error_->type), error_->text) : nb::make_tuple(0, "");
    }
    void note(std::optional<LayerError> error) { error_ = std::move(error); }
    template <class T>
    T noted(LayerResult<T> result) {
        note(result ? std::nullopt : std::optional(result.error()));
        return result ? std::move(*result) : T();
    }
    /// Notes the result. Returns true if it is a success.
    bool noted(const LayerResult<void>& result) {
        note(result ? std::nullopt : std::optional(result.error()));
        return result.has_value();
    }
    SpecsLocking::Paths noted(SpecsLocking::Unlocked unlocked) {
        note(std::move(unlocked.refused));
        return std::move(unlocked.specs);
    }
    /// Notes the last refused edit, if any; otherwise keeps the error.
    void noted(const std::vector<RefusedEdit>& refused) {
        if (!refused.empty()) note(LayerError{refused.back().type, refused.back().reason});
    }
    /// Calls `function` with the path of the text.
    template <class Function>
    SpecsLinking::Paths atPath(const std::string& text, Function function) {
        if (const auto path = pathFrom(text)) return noted(function(*path));
        return {};
    }
    std::optional<pxr::SdfPath> pathFrom(const std::string& text) {
        if (pxr::SdfPath::IsValidPathString(text)) return pxr::SdfPath(text);
        note(LayerError{LayerErrorType::InvalidParam,
                        "'" + text + "' is not the path of a prim or property"});
        return std::nullopt;
    }

    using Refused = std::tuple<std::string, std::string, std::string>;  // path, field, layer
    void refuse(int type, const std::string& reason, const std::vector<Refused>& edits) {
        std::vector<RefusedEdit> refused;
        for (const auto& [path, field, layer] : edits)
            if (pxr::SdfPath::IsValidPathString(path))
                refused.push_back({pxr::SdfPath(path), field, layer, LayerErrorType(type), reason});
        noted(refused);
        layers_.refuse(std::move(refused));
    }

    void beginClearing(const Strings& specs, std::optional<double> time) {
        std::vector<pxr::SdfPath> paths;
        for (const auto& spec : specs)
            if (const auto path = pathFrom(spec)) paths.push_back(*path);
        clearing_.push_back(std::make_unique<Clearing>(authoring(), paths, time));
    }
    void endClearing() { clearing_.pop_back(); }

    nb::list refusedEdits() {
        nb::list refused;
        for (const auto& edit : layers_.refusedEdits())
            refused.append(nb::make_tuple(edit.path.GetString(), edit.field, edit.layer,
                                          int(edit.type), edit.reason));
        return refused;
    }

private:
    std::unique_ptr<PythonLive> live_;
    Layers layers_;
    std::vector<std::unique_ptr<Clearing>> clearing_;
    std::optional<LayerError> error_;
};

/// Returns (identifier, an object that keeps the layer alive), or None.
nb::object kept(const pxr::SdfLayerRefPtr& layer) {
    if (!layer) return nb::none();
    auto* keeper = new pxr::SdfLayerRefPtr(layer);
    const nb::capsule capsule(
        keeper, [](void* held) noexcept { delete static_cast<pxr::SdfLayerRefPtr*>(held); });
    return nb::make_tuple(layer->GetIdentifier(), capsule);
}

void bindUtils(nb::module_& module) {
    namespace utils = LayerUtils;
    module.def("create_sublayer",
               [](const std::string& layer, int position, const std::string& id) {
                   return kept(utils::createSublayer(find(layer), position, id));
               });
    module.def("insert_sublayer",
               [](const std::string& layer, int position, const std::string& id, bool checkEmpty) {
                   return kept(utils::insertSublayer(find(layer), position, id, checkEmpty));
               });
    module.def("replace_sublayer",
               [](const std::string& layer, int position, const std::string& id) {
                   return kept(utils::replaceSublayer(find(layer), position, id));
               });
    module.def("remove_sublayer", [](const std::string& layer, int position) {
        return utils::removeSublayer(find(layer), position);
    });
    module.def("move_layer", [](const std::string& from, int fromPosition, const std::string& to,
                                int toPosition, bool removeSource) {
        return utils::moveLayer(find(from), fromPosition, find(to), toPosition, removeSource);
    });
    module.def("sublayer_identifier", [](const std::string& layer, int position) {
        return utils::sublayerIdentifier(find(layer), position);
    });
    module.def("sublayer_position", [](const std::string& layer, const std::string& id) {
        return utils::sublayerPosition(find(layer), id);
    });
    module.def("all_sublayers",
               [](const std::string& layer) { return utils::allSublayers(find(layer)); });
    module.def("remove_prim_spec", [](const std::string& layer, const std::string& path) {
        return pxr::SdfPath::IsValidPathString(path) &&
               utils::removePrimSpec(find(layer), pxr::SdfPath(path));
    });
    module.def("transfer_content",
               [](const std::string& from, const std::string& to, bool data, bool skip) {
                   return utils::transferContent(find(from), find(to), data, skip);
               });
    module.def("resolve_paths", [](const std::string& base, const std::string& target,
                                   bool relative, bool toBase, bool offsets) {
        utils::resolvePaths(find(base), find(target), relative, toBase, offsets);
    });
    module.def("custom_layer_name",
               [](const std::string& layer) { return utils::customLayerName(find(layer)); });
    module.def("set_custom_layer_name", [](const std::string& layer, const std::string& name) {
        return utils::setCustomLayerName(find(layer), name);
    });
    module.def("reload_layers", &utils::reloadLayers, nb::call_guard<nb::gil_scoped_release>());
    module.def("save_layers", [](const Strings& ids) {
        Strings failed;
        utils::saveLayers(ids, &failed);
        return failed;
    });
    module.def("normalize_url", &utils::normalizeUrl);
    module.def("without_file_scheme", &utils::withoutFileScheme);
    module.def("reanchor_states",
               [](const std::string& content, const std::string& from, const std::string& to) {
                   utils::reanchorStates(find(content), from, to);
               });
    // Reports that a file was written by other means than Sdf, for watchers of saves.
    module.def(
        "file_was_written",
        [](const std::string& id) {
            if (const auto layer = find(id)) pxr::SdfNotice::LayerDidSaveLayerToFile().Send(layer);
        },
        nb::call_guard<nb::gil_scoped_release>());
    module.def("layer_flags", [](const std::string& root, const std::string& name) {
        return layerFlags(find(root), name);
    });
    module.def("set_layer_flag",
               [](const std::string& root, const std::string& name, const std::string& id,
                  bool flag) { return setLayerFlags(find(root), name, {{id, flag}}); });
    module.def("remove_layer_flag",
               [](const std::string& root, const std::string& name, const std::string& id) {
                   return removeLayerFlag(find(root), name, id);
               });
    module.def("is_layer_locked", [](const std::string& layer, const std::string& root) {
        return isLayerLocked(find(layer), find(root));
    });
    module.def("has_own_lock", [](const std::string& layer) { return hasOwnLock(find(layer)); });
    module.def("set_own_lock", [](const std::string& layer) { return setOwnLock(find(layer)); });
    module.def("authoring_layer",
               [](const std::string& root) { return authoringLayer(find(root)); });
    module.def("set_authoring_layer", [](const std::string& root, const std::string& layer) {
        return setAuthoringLayer(find(root), layer);
    });
}

void bindEvents(nb::module_& module) {
    module.def("event_suffix",
               [](int type) { return std::string(eventSuffix(LayerEventType(type))); });
}

using Class = nb::class_<PythonLayers>;
using P = PythonLayers;
using Which = LayersState::Which;

void bindState(Class& type) {
    const auto query = [&type](const char* name,
                               bool (LayersState::*function)(const std::string&)) {
        type.def(name, [function](P& self, const std::string& id) {
            self.note(self.state().whyUnknown(id));
            return (self.state().*function)(id);
        });
    };
    query("is_layer_locally_muted", &LayersState::isLayerLocallyMuted);
    query("is_layer_globally_muted", &LayersState::isLayerGloballyMuted);
    query("is_layer_writable", &LayersState::isLayerWritable);
    query("is_layer_readonly_on_disk", &LayersState::isLayerReadonlyOnDisk);
    query("is_layer_savable", &LayersState::isLayerSavable);
    query("is_layer_dirty", &LayersState::isLayerDirty);
    query("is_layer_locked", &LayersState::isLayerLocked);
    query("is_layer_outdated", &LayersState::isLayerOutdated);
    using Outcome = LayersState::Outcome;
    type.def("is_layer_muted",
             [](P& self, const std::string& id) { return self.state().isLayerMuted(id); })
        .def("has_local_layer",
             [](P& self, const std::string& id) { return self.state().hasLocalLayer(id); })
        .def("has_used_layer",
             [](P& self, const std::string& id) { return self.state().hasUsedLayer(id); })
        .def("add_auto_reload_layer",
             [](P& self, const std::string& id) {
                 auto added = self.state().addAutoReloadLayer(id);
                 const bool changed = added == Outcome::Changed;
                 self.noted(std::move(added));
                 return changed;
             })
        .def("remove_auto_reload_layer", [](P& self, const std::string& id) {
            self.note(std::nullopt);
            return self.state().removeAutoReloadLayer(id) == Outcome::Changed;
        });
    const nb::call_guard<nb::gil_scoped_release> released;
    type.def("muteness_changed", [](P& self) { self.state().mutenessChanged(); }, released);
    type.def(
            "set_muteness_scope",
            [](P& self, bool global) {
                self.note(std::nullopt);
                self.state().setMutenessScope(global);
            },
            released)
        .def("is_muteness_global", [](P& self) { return self.state().isMutenessGlobal(); })
        .def(
            "set_layer_global_muteness",
            [](P& self, const std::string& id, bool muted) {
                return self.noted(self.state().setLayerGlobalMuteness(id, muted));
            },
            released)
        .def(
            "set_layer_lock_state",
            [](P& self, const std::string& id, bool locked) {
                return self.noted(self.state().setLayerLockState(id, locked));
            },
            released)
        .def(
            "set_layer_name",
            [](P& self, const std::string& id, const std::string& name) {
                return self.noted(self.state().setLayerName(id, name));
            },
            released)
        .def("get_layer_name",
             [](P& self, const std::string& id) {
                 self.note(self.state().whyUnknown(id));
                 return self.state().layerName(id);
             })
        .def("get_layer_owner",
             [](P& self, const std::string& id) {
                 self.note(self.state().whyUnknown(id));
                 return self.state().layerOwner(id);
             })
        .def("local_layers",
             [](P& self, bool session, bool anonymous, bool invalid) {
                 self.note(std::nullopt);
                 return self.state().localLayerIdentifiers(session, anonymous, invalid);
             })
        .def("dirty_layers",
             [](P& self) {
                 self.note(std::nullopt);
                 return self.state().dirtyLayerIdentifiers();
             })
        .def("outdated_layers",
             [](P& self, int which, bool notAuto) {
                 self.note(std::nullopt);
                 return self.state().outdatedLayerIdentifiers(Which(which), notAuto);
             })
        .def(
            "reload_outdated_layers",
            [](P& self, int which, bool notAuto) {
                return self.noted(self.state().reloadOutdatedLayers(Which(which), notAuto));
            },
            released)
        .def("is_auto_reload_layer",
             [](P& self, const std::string& id) { return self.state().isAutoReloadLayer(id); })
        .def("set_auto_reload",
             [](P& self, bool sublayers, bool nonSublayers) {
                 self.state().setAutoReload({sublayers, nonSublayers});
             })
        .def("auto_reload_layers", [](P& self) { return self.state().autoReloadLayers(); });
}

void bindAuthoring(Class& type) {
    type.def("set_default_layer",
             [](P& self, const std::string& id) {
                 return self.noted(self.authoring().setDefaultLayer(id));
             })
        .def("default_layer", [](P& self) { return self.authoring().defaultLayer(); })
        .def("is_auto_authoring_layer",
             [](P& self, const std::string& id) {
                 return self.authoring().isAutoAuthoringLayer(id);
             })
        .def("begin_clearing", &P::beginClearing, nb::arg("specs"), nb::arg("time").none(),
             nb::call_guard<nb::gil_scoped_release>())
        .def("end_clearing", &P::endClearing, nb::call_guard<nb::gil_scoped_release>())
        .def("is_suspended", [](P& self) { return self.authoring().isSuspended(); })
        .def("suspend", [](P& self) { self.authoring().suspend(); })
        .def("resume", [](P& self) { self.authoring().resume(); })
        .def("refuse", &P::refuse)
        .def("refused_edits", &P::refusedEdits);
}

void bindSpecs(Class& type) {
    const nb::call_guard<nb::gil_scoped_release> released;
    using S = const std::string&;
    using Path = const pxr::SdfPath&;
    type.def(
            "link_spec",
            [](P& self, S path, S layer, bool hierarchy) {
                return texts(self.atPath(path, [&](Path spec) {
                    return self.linking().linkSpec(spec, layer, hierarchy);
                }));
            },
            released)
        .def(
            "unlink_spec",
            [](P& self, S path, S layer, bool hierarchy) {
                return texts(self.atPath(path, [&](Path spec) {
                    return self.linking().unlinkSpec(spec, layer, hierarchy);
                }));
            },
            released)
        .def(
            "unlink_spec_from_all_layers",
            [](P& self, S path, bool hierarchy) {
                return texts(self.atPath(path, [&](Path spec) {
                    return self.linking().unlinkSpecFromAllLayers(spec, hierarchy);
                }));
            },
            released)
        .def(
            "unlink_specs_to_layer",
            [](P& self, S layer) {
                return texts(self.noted(self.linking().unlinkSpecsToLayer(layer)));
            },
            released)
        .def(
            "unlink_all_specs", [](P& self) { self.noted(self.linking().unlinkAllSpecs()); },
            released)
        .def("spec_links",
             [](P& self, S path, bool hierarchy) {
                 const auto spec = self.pathFrom(path);
                 return spec ? texts(self.noted(self.linking().specLinks(*spec, hierarchy)))
                             : texts(SpecsLinking::Links());
             })
        .def(
            "links_for_layer",
            [](P& self, S layer) { return texts(self.noted(self.linking().linksForLayer(layer))); })
        .def("all_links", [](P& self) { return texts(self.linking().allLinks()); })
        .def("is_spec_linked",
             [](P& self, S path, S layer) {
                 const auto& links = self.linking();
                 if (!pxr::SdfPath::IsValidPathString(path)) return false;
                 const pxr::SdfPath spec(path);
                 return layer.empty() ? links.isSpecLinked(spec)
                                      : links.isSpecLinkedTo(spec, layer);
             })
        .def(
            "lock_spec",
            [](P& self, S path, bool hierarchy) {
                return texts(self.atPath(
                    path, [&](Path spec) { return self.locking().lockSpec(spec, hierarchy); }));
            },
            released)
        .def(
            "unlock_spec",
            [](P& self, S path, bool hierarchy) {
                return texts(self.atPath(
                    path, [&](Path spec) { return self.locking().unlockSpec(spec, hierarchy); }));
            },
            released)
        .def(
            "unlock_all_specs", [](P& self) { self.noted(self.locking().unlockAllSpecs()); },
            released)
        .def("all_locked_specs", [](P& self) { return texts(self.locking().allLockedSpecs()); })
        .def("is_spec_locked", [](P& self, S path) {
            return pxr::SdfPath::IsValidPathString(path) &&
                   self.locking().isSpecLocked(pxr::SdfPath(path));
        });
}

}  // namespace

void bindLayers(nb::module_& module) {
    const nb::call_guard<nb::gil_scoped_release> released;
    Class type(module, "Layers");
    type.def(nb::init<nb::object, const std::string&, nb::object>(), nb::arg("host"),
             nb::arg("user"), nb::arg("client").none())
        .def("set_client", &P::setClient, nb::arg("client").none())
        .def(
            "update", [](P& self, double nowMs) { self.noted(self.layers().update(nowMs)); },
            released)
        .def(
            "distribute",
            [](P& self, content::Recorder* recorder) {
                self.noted(self.layers().distribute(recorder));
            },
            nb::arg("recorder").none(), released)
        .def("take_events", &P::takeEvents)
        .def("last_error", &P::lastError)
        .def("edit_mode", [](P& self) { return int(self.layers().editMode()); })
        .def(
            "set_edit_mode",
            [](P& self, int mode) {
                return self.noted(self.layers().setEditMode(LayerEditMode(mode)));
            },
            released);
    bindState(type);
    bindAuthoring(type);
    bindSpecs(type);
    auto utils = module.def_submodule("layer_utils");
    bindUtils(utils);
    bindEvents(utils);
}

}  // namespace usdlive
