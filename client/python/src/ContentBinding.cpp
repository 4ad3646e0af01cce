// Binds usdlive::content for Python.
#include "ContentBinding.h"

#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>
#include <pxr/base/tf/errorMark.h>
#include <pxr/usd/sdf/layer.h>

#include <algorithm>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "Errors.h"
#include "usd/content/LayerEdits.h"
#include "usd/content/SpecEdits.h"
#include "usdlive/client/usd/content/Recorder.h"

namespace nb = nanobind;
using namespace usdlive::content;

namespace usdlive {

namespace {

using Texts = std::vector<std::string>;
using Text = const std::string&;

pxr::SdfLayerRefPtr layerOf(const std::string& identifier) {
    pxr::SdfLayerRefPtr layer = pxr::SdfLayer::Find(identifier);
    if (!layer) raise({ErrorCode::LayerNotFound, "no layer " + identifier + " is open"});
    return layer;
}

/// Calls `work` without the interpreter's lock, because listeners of Sdf's notices take it. Raises
/// the errors that Sdf reports.
template <class Work>
auto written(const Work& work) {
    std::string error;
    const auto result = [&] {
        const nb::gil_scoped_release released;
        pxr::TfErrorMark mark;
        auto value = work();
        if (!mark.IsClean()) error = mark.begin()->GetCommentary();
        mark.Clear();
        return value;
    }();
    if (!error.empty()) raise({ErrorCode::InvalidEdit, error});
    return result;
}
void write(const std::function<void()>& work) {
    written([&] {
        work();
        return true;
    });
}

nb::object partOf(const Part& part) {
    if (const auto* keys = std::get_if<Texts>(&part)) return nb::tuple(nb::cast(*keys));
    if (const auto* time = std::get_if<double>(&part)) return nb::float_(*time);
    return nb::none();
}

nb::tuple toTuple(const Kept& kept) {
    const nb::object field =
        kept.field.IsEmpty() ? nb::object(nb::none()) : nb::cast(kept.field.GetString());
    return nb::make_tuple(kept.layer, kept.path.GetString(), field, partOf(kept.part), kept.reason);
}

Record::IsShared isAmong(const Texts& shared) {
    return [&](const pxr::SdfLayerHandle& layer) {
        return std::ranges::find(shared, layer->GetIdentifier()) != shared.end();
    };
}

nb::list toList(const std::vector<Kept>& kept) {
    nb::list result;
    for (const Kept& one : kept) result.append(toTuple(one));
    return result;
}

nb::list undo(const Record& record, const Texts& shared) {
    return toList(written([&] { return record.undo(isAmong(shared)); }));
}

nb::list keepOthers(Record& record, const Record& earlier, const Texts& shared) {
    return toList(written([&] { return record.keepOthers(earlier, isAmong(shared)); }));
}

Texts identifiers(const Record& record) {
    Texts ids;
    for (const auto& layer : record.layers()) ids.push_back(layer->GetIdentifier());
    return ids;
}

void bindRecorder(nb::module_& module) {
    nb::class_<Record>(module, "Record")
        .def(nb::init<>())
        .def("is_empty", &Record::isEmpty)
        .def("is_followed",
             [](const Record& self, Text layer) { return self.isFollowed(layerOf(layer)); })
        .def("layers", &identifiers)
        .def("undo", &undo)
        .def("keep_others", &keepOthers);
    nb::class_<Recorder>(module, "Recorder")
        .def(nb::init<>())
        .def("touch", [](Recorder& self, Text layer, Text path,
                         bool deep) { self.touch(layerOf(layer), pxr::SdfPath(path), deep); })
        .def("touch_with_ancestors",
             [](Recorder& self, Text layer, Text path) {
                 self.touchWithAncestors(layerOf(layer), pxr::SdfPath(path));
             })
        .def("finish", &Recorder::finish);
}

}  // namespace

void bindContent(nb::module_& parent) {
    auto module = parent.def_submodule("content");
    bindRecorder(module);
    module.def("prim_children", [](Text layer, Text path) {
        Texts names;
        for (const auto& name : primChildren(layerOf(layer), pxr::SdfPath(path)))
            names.push_back(name.GetString());
        return names;
    });
    module.def("arrange", [](Text id, Text parentPath, const Texts& order, const Texts& names) {
        const auto layer = layerOf(id);
        write([&] {
            arrange(layer, pxr::SdfPath(parentPath), {order.begin(), order.end()},
                    {names.begin(), names.end()});
        });
    });
    module.def("remove_spec", [](Text id, Text path) {
        const auto layer = layerOf(id);
        write([&] { removeSpec(layer, pxr::SdfPath(path)); });
    });
    module.def("make_like", [](Text id, Text wantedId, Text root) {
        const auto layer = layerOf(id), wanted = layerOf(wantedId);
        write([&] { makeLike(layer, wanted, pxr::SdfPath(root)); });
    });
    module.def("take_metadata", [](Text id, Text from) {
        const auto content = layerOf(id), layer = layerOf(from);
        write([&] { takeMetadata(content, layer); });
    });
    module.def("retarget", [](Text id, const std::vector<std::pair<std::string, std::string>>& to) {
        const auto layer = layerOf(id);
        Moves moves;
        for (const auto& [before, after] : to) moves.emplace_back(before, after);
        write([&] { retarget(layer, moves); });
    });
}

}  // namespace usdlive
