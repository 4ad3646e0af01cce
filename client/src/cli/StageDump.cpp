// Writes a whole composed stage as text.
#include "cli/StageDump.h"

#include <pxr/usd/sdf/layer.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <tuple>

#include "cli/ComposedValue.h"
#include "usdlive/client/usd/stage/AttributeQuery.h"

namespace usdlive::cli {

using nlohmann::json;
using stage::PrimFlag;

namespace {

using Names = std::set<std::string>;
const Names kOfPrims{"specifier", "typeName", "active", "kind", "instanceable"};
const Names kOfAttributes{"typeName",    "variability",     "custom", "default",
                          "timeSamples", "connectionPaths", "spline"};
const Names kOfRelationships{"variability", "custom", "targetPaths"};

const char* nameOf(stage::ValueSource source) {
    constexpr const char* kNames[] = {"none",        "fallback",   "default",
                                      "timeSamples", "valueClips", "spline"};
    return kNames[std::size_t(source)];
}

const char* nameOf(pxr::SdfSpecifier specifier) {
    constexpr const char* kNames[] = {"def", "over", "class"};
    return kNames[specifier];
}

json textsOf(const auto& items) {
    json list = json::array();
    for (const auto& item : items) list.push_back(item.GetString());
    return list;
}

json pathsOf(const pxr::SdfPathVector& paths) {
    json list = json::array();
    for (const auto& path : paths) list.push_back(path.GetAsString());
    return list;
}

class Dump {
public:
    Dump(const stage::Stage& stage, const DumpOptions& options)
        : stage_(stage), encode_(options.base, options.fold) {
        if (stage.hasTimeRange()) {
            const double start = stage.startTime(), end = stage.endTime();
            times_ = {start, (start + end) / 2 + 0.25, end};
        }
    }

    json all() {
        json prims = json::array();
        stage_.traverse(stage::PrimPredicate::all().throughInstances(),
                        [&](const stage::Prim& prim) {
                            prims.push_back(primRecord(prim));
                            return true;
                        });
        json times = json::array(), layers = json::array(), errors = json::array();
        for (const double time : times_) times.push_back(ComposedValue::number(time));
        for (const auto& layer : stage_.localLayers()) {
            const auto file = encode_.file(layer->GetRealPath());
            layers.push_back(file.empty() ? "anonymous" : file);
        }
        for (const auto& error : stage_.errors())
            errors.push_back({{"type", error.type}, {"prim", error.prim.GetAsString()}});
        const auto root = stage_.pseudoRoot();
        return {{"format", "stage-dump/1"},
                {"times", std::move(times)},
                {"layers", std::move(layers)},
                {"metadata", metadata(root.authoredMetadata(),
                                      {"subLayers", "subLayerOffsets", "primChildren"})},
                {"rootChildren", childrenOf(root)},
                {"errors", std::move(errors)},
                {"prims", std::move(prims)}};
    }

private:
    json metadata(const stage::Metadata& fields, const Names& skip) const {
        json out = json::object();
        for (const auto& [field, value] : fields)
            if (!skip.contains(field.GetString())) out[field.GetString()] = encode_(value);
        return out;
    }

    json childrenOf(const stage::Prim& prim) const {
        json names = json::array();
        for (const auto& child : prim.children(stage::PrimPredicate::all()))
            names.push_back(child.name().GetString());
        return names;
    }

    json attributeRecord(const stage::Property& attribute) const {
        const auto query = attribute.query();
        json out{{"kind", "attribute"},
                 {"type", attribute.typeName().GetString()},
                 {"variability",
                  attribute.variability() == pxr::SdfVariabilityUniform ? "uniform" : "varying"},
                 {"custom", attribute.isCustom()},
                 {"authored", attribute.isAuthored()},
                 {"source", nameOf(query.source())},
                 {"blocked", query.isBlocked()},
                 {"default", encode_(attribute.value(query))}};
        const auto samples = query.timeSamples();
        if (!samples.empty()) out["samples"] = encode_.numbers(samples);
        if (query.hasSpline()) out["spline"] = true;
        if (!samples.empty() || query.hasSpline() || query.mightBeTimeVarying()) {
            json at = json::array();
            for (const double time : times_) at.push_back(encode_(attribute.value(query, time)));
            out["at"] = std::move(at);
        }
        const auto connections = attribute.targets();
        if (!connections.empty() || attribute.hasAuthoredTargets())
            out["connections"] = pathsOf(connections);
        return out;
    }

    json propertyRecord(const stage::Property& property) const {
        const bool attribute = property.isAttribute();
        json out = attribute ? attributeRecord(property)
                             : json{{"kind", "relationship"},
                                    {"custom", property.isCustom()},
                                    {"authored", property.isAuthored()},
                                    {"targets", pathsOf(property.targets())}};
        json fields =
            metadata(property.authoredMetadata(), attribute ? kOfAttributes : kOfRelationships);
        if (!fields.empty()) out["metadata"] = std::move(fields);
        return out;
    }

    json primRecord(const stage::Prim& prim) {
        json out{
            {"path", prim.path().GetAsString()},         {"specifier", nameOf(prim.specifier())},
            {"type", prim.typeName().GetString()},       {"active", prim.has(PrimFlag::Active)},
            {"loaded", prim.has(PrimFlag::Loaded)},      {"defined", prim.has(PrimFlag::Defined)},
            {"abstract", prim.has(PrimFlag::Abstract)},  {"model", prim.has(PrimFlag::Model)},
            {"group", prim.has(PrimFlag::Group)},        {"kind", prim.kind().GetString()},
            {"schemas", textsOf(prim.appliedSchemas())}, {"children", childrenOf(prim)}};
        const auto instanceable = prim.metadata(pxr::SdfFieldKeys->Instanceable);
        if (instanceable.IsHolding<bool>()) out["instanceable"] = instanceable.Get<bool>();
        if (const auto prototype = prim.prototype())
            out["prototype"] =
                prototypes_.try_emplace(prototype.path(), prototypes_.size()).first->second;
        if (prim.isInstanceProxy()) out["proxy"] = true;
        const auto sets = prim.variantSets();
        if (!sets.empty()) {
            json variants = json::object();
            for (const auto& set : sets)
                variants[set.name] = {{"selection", set.selection}, {"options", set.options}};
            out["variants"] = std::move(variants);
        }
        out["metadata"] = metadata(prim.authoredMetadata(), kOfPrims);
        json properties = json::object(), order = json::array();
        for (const auto& property : prim.properties()) {
            order.push_back(property.name().GetString());
            properties[property.name().GetString()] = propertyRecord(property);
        }
        out["properties"] = std::move(properties);
        out["propertyOrder"] = std::move(order);
        return out;
    }

    const stage::Stage& stage_;
    const ComposedValue encode_;
    std::vector<double> times_{0, 1.25, 24};
    std::map<pxr::SdfPath, std::size_t> prototypes_;
};

}  // namespace

json dumpStage(const stage::Stage& stage, const DumpOptions& options) {
    return Dump(stage, options).all();
}

}  // namespace usdlive::cli
