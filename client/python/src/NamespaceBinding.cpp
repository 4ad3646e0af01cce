// The namespace editor, over a Usd.Stage that the package's object stands for.
#include "NamespaceBinding.h"

#include <nanobind/stl/map.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>
#include <pxr/usd/sdf/layer.h>

#include <algorithm>
#include <map>
#include <memory>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "Errors.h"
#include "usdlive/client/usd/namespace/NamespaceEditor.h"

namespace nb = nanobind;

namespace usdlive {

namespace {

using Names = std::vector<std::string>;

pxr::SdfLayerHandle layerNamed(const std::string& identifier) {
    return identifier.empty() ? pxr::SdfLayerHandle() : pxr::SdfLayer::Find(identifier);
}

/// A Usd.Stage. Errors of its methods reach the caller of the editor.
class PythonEditedStage final : public EditedStage {
public:
    explicit PythonEditedStage(nb::object host) : host_(std::move(host)) {}
    ~PythonEditedStage() override {
        const nb::gil_scoped_acquire acquire;
        host_.reset();
    }

    [[nodiscard]] pxr::SdfLayerHandle rootLayer() const override {
        return layerNamed(call<std::string>("root"));
    }
    [[nodiscard]] pxr::SdfLayerHandle sessionLayer() const override {
        return layerNamed(call<std::string>("session"));
    }
    [[nodiscard]] StageView view() const override {
        const auto [muted, rules, mask, fallbacks] = call<
            std::tuple<Names, std::map<std::string, int>, Names, std::map<std::string, Names>>>(
            "view");
        StageView view;
        view.muted = muted;
        for (const auto& [path, rule] : rules)
            view.loadRules.emplace(pxr::SdfPath(path), StageView::Load(rule));
        for (const auto& path : mask)
            view.mask.push_back(path.empty() ? pxr::SdfPath() : pxr::SdfPath(path));
        for (const auto& [set, variants] : fallbacks) view.variantFallbacks[set] = variants;
        return view;
    }
    [[nodiscard]] EditTarget editTarget() const override {
        const auto [layer, mapsPaths] = call<std::pair<std::string, bool>>("edit_target");
        return {layerNamed(layer), mapsPaths};
    }
    [[nodiscard]] bool isBuiltIn(const pxr::TfToken& typeName, const pxr::TfTokenVector& apiSchemas,
                                 const pxr::TfToken& property) const override {
        Names schemas;
        for (const auto& schema : apiSchemas) schemas.push_back(schema.GetString());
        return call<bool>("is_built_in", typeName.GetString(), schemas, property.GetString());
    }
    [[nodiscard]] bool isInPrototype(const pxr::SdfPath& path) const override {
        // The names that UsdStage gives to prototypes.
        if (path.GetString().rfind("/__Prototype_", 0) != 0) return false;
        return call<bool>("is_in_prototype", path.GetString());
    }

private:
    template <class T, class... Arguments>
    T call(const char* name, const Arguments&... arguments) const {
        const nb::gil_scoped_acquire acquire;
        return nb::cast<T>(host_.attr(name)(arguments...));
    }

    nb::object host_;
};

/// Works without the interpreter's lock: listeners of Sdf's notices take it themselves.
template <class Work>
auto released(const Work& work) {
    const nb::gil_scoped_release release;
    return work();
}

nb::tuple toTuple(const CanApplyResult& result) {
    return nb::make_tuple(result.errors, result.warnings);
}

nb::object partOfKept(const content::Part& part) {
    if (const auto* keys = std::get_if<Names>(&part)) return nb::tuple(nb::cast(*keys));
    if (const auto* time = std::get_if<double>(&part)) return nb::float_(*time);
    return nb::none();
}

nb::list undoEdits(const NamespaceRecord& record, const Names& shared) {
    const auto isShared = [&](const pxr::SdfLayerHandle& layer) {
        return std::ranges::find(shared, layer->GetIdentifier()) != shared.end();
    };
    nb::list result;
    for (const auto& kept : released([&] { return record.undo(isShared); })) {
        const nb::object field =
            kept.field.IsEmpty() ? nb::object(nb::none()) : nb::cast(kept.field.GetString());
        result.append(nb::make_tuple(kept.layer, kept.path.GetString(), field,
                                     partOfKept(kept.part), kept.reason));
    }
    return result;
}

Names identifiersOf(const std::vector<pxr::SdfLayerHandle>& layers) {
    Names names;
    for (const auto& layer : layers)
        if (layer) names.push_back(layer->GetIdentifier());
    return names;
}

}  // namespace

void bindNamespace(nb::module_& parent) {
    auto module = parent.def_submodule("namespace");
    nb::class_<NamespaceRecord>(module, "Record")
        .def(nb::init<>())
        .def("is_empty", &NamespaceRecord::isEmpty)
        .def("layers", [](const NamespaceRecord& self) { return identifiersOf(self.layers()); })
        .def("undo", &undoEdits);
    nb::class_<NamespaceEditor>(module, "Editor")
        .def("__init__",
             [](NamespaceEditor* self, nb::object host, bool relocates, bool variants) {
                 new (self) NamespaceEditor(
                     std::make_unique<PythonEditedStage>(std::move(host)),
                     {.allowRelocatesAuthoring = relocates, .editVariants = variants});
             })
        // Each returns why the edit is none; empty: it is added.
        .def("delete_prim",
             [](NamespaceEditor& self, const std::string& path) {
                 return self.DeletePrimAtPath(pxr::SdfPath(path)) ? std::string() : self.invalid();
             })
        .def("move_prim",
             [](NamespaceEditor& self, const std::string& path, const std::string& newPath) {
                 const bool added = self.MovePrimAtPath(pxr::SdfPath(path), pxr::SdfPath(newPath));
                 return added ? std::string() : self.invalid();
             })
        .def("delete_property",
             [](NamespaceEditor& self, const std::string& path) {
                 return self.DeletePropertyAtPath(pxr::SdfPath(path)) ? std::string()
                                                                      : self.invalid();
             })
        .def("move_property",
             [](NamespaceEditor& self, const std::string& path, const std::string& newPath) {
                 const bool added =
                     self.MovePropertyAtPath(pxr::SdfPath(path), pxr::SdfPath(newPath));
                 return added ? std::string() : self.invalid();
             })
        .def("edits",
             [](NamespaceEditor& self) {
                 std::vector<std::pair<std::string, std::string>> edits;
                 for (const auto& [from, to] : self.GetEdits())
                     edits.emplace_back(from.GetString(), to.GetString());
                 return edits;
             })
        .def("clear", &NamespaceEditor::ClearEdits)
        .def(
            "add_dependent",
            [](NamespaceEditor& self, nb::object host) {
                return self.AddDependentStage(std::make_unique<PythonEditedStage>(std::move(host)));
            })
        .def("remove_dependent", &NamespaceEditor::RemoveDependentStage)
        .def("can_apply",
             [](NamespaceEditor& self) {
                 return toTuple(released([&] { return self.CanApplyEdits(); }));
             })
        .def("apply",
             [](NamespaceEditor& self) {
                 return toTuple(released([&] { return self.ApplyEdits(); }));
             })
        .def("layers_to_edit",
             [](NamespaceEditor& self) {
                 return identifiersOf(released([&] { return self.GetLayersToEdit(); }));
             })
        .def("prepare",
             [](NamespaceEditor& self) {
                 released([&] {
                     self.Prepare();
                     return true;
                 });
             })
        .def("record", [](NamespaceEditor& self) { return self.GetRecord(); });
}

}  // namespace usdlive
