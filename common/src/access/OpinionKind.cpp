// Tells the kind of opinion of an edit.
#include "usdlive/common/access/OpinionKind.h"

#include <algorithm>

#include "usdlive/common/core/Overloaded.h"
#include "usdlive/common/layer/FieldParts.h"
#include "usdlive/common/layer/SpecPath.h"

namespace usdlive {

namespace {

template <std::size_t N>
bool isOneOf(std::string_view name, const std::array<std::string_view, N>& names) {
    return std::ranges::find(names, name) != names.end();
}

// Attributes of UsdGeom that are no primvar and no xformOp.
constexpr std::array<std::string_view, 46> kGeometryNames{"accelerations",
                                                          "angularVelocities",
                                                          "axis",
                                                          "basis",
                                                          "cornerIndices",
                                                          "cornerSharpnesses",
                                                          "creaseIndices",
                                                          "creaseLengths",
                                                          "creaseSharpnesses",
                                                          "curveVertexCounts",
                                                          "doubleSided",
                                                          "extent",
                                                          "extentsHint",
                                                          "faceVaryingLinearInterpolation",
                                                          "faceVertexCounts",
                                                          "faceVertexIndices",
                                                          "form",
                                                          "height",
                                                          "holeIndices",
                                                          "ids",
                                                          "indices",
                                                          "inactiveIds",
                                                          "interpolateBoundary",
                                                          "invisibleIds",
                                                          "knots",
                                                          "length",
                                                          "normals",
                                                          "order",
                                                          "orientation",
                                                          "orientations",
                                                          "pointWeights",
                                                          "points",
                                                          "positions",
                                                          "protoIndices",
                                                          "prototypes",
                                                          "radius",
                                                          "ranges",
                                                          "scales",
                                                          "size",
                                                          "subdivisionScheme",
                                                          "triangleSubdivisionRule",
                                                          "type",
                                                          "uKnots",
                                                          "velocities",
                                                          "width",
                                                          "widths"};

constexpr std::array<std::string_view, 8> kCompositionFields{
    "references", "payload",         "inheritPaths",   "specializes",
    "subLayers",  "subLayerOffsets", "layerRelocates", "expressionVariables"};

// Fields that say what a property is, not what it is worth.
constexpr std::array<std::string_view, 3> kDeclarationFields{"typeName", "variability", "custom"};
// Fields that are the value of a property.
constexpr std::array<std::string_view, 6> kValueFields{"default",         "targetPaths",
                                                       "connectionPaths", "interpolation",
                                                       "elementSize",     "unauthoredValuesIndex"};

OpinionKind kindOfProperty(std::string_view name) {
    using enum OpinionKind;
    if (name.starts_with("xformOp:") || name == "xformOpOrder") return Transform;
    if (name.starts_with("inputs:") || name.starts_with("outputs:") || name.starts_with("info:") ||
        name.starts_with("material:") || name.starts_with("primvars:displayColor") ||
        name.starts_with("primvars:displayOpacity"))
        return Shading;
    if (name.starts_with("primvars:") || isOneOf(name, kGeometryNames)) return Geometry;
    return Property;
}

OpinionKind kindOfPrimField(std::string_view field) {
    using enum OpinionKind;
    if (field == "specifier" || field == "primOrder") return Namespace;
    if (field == "typeName" || field == "apiSchemas") return Schema;
    if (field == "variantSelection" || field == "variantSetNames") return Variants;
    if (field == "clips" || field == "clipSets") return Animation;
    if (field == "relocates" || isOneOf(field, kCompositionFields)) return Composition;
    return Metadata;
}

OpinionKind kindOfPropertyField(std::string_view name, std::string_view field) {
    if (field == "timeSamples" || field == "spline") return OpinionKind::Animation;
    return isOneOf(field, kValueFields) ? kindOfProperty(name) : OpinionKind::Metadata;
}

}  // namespace

std::optional<OpinionKind> opinionKindOf(std::string_view path, const EditAction& action,
                                         bool exists) {
    const bool isRoot = path == "/";
    const PathElement last = isRoot ? PathElement{ChildList::Prims, ""} : specpath::last(path);
    const auto ofSpec = [&] {
        if (last.list == ChildList::Properties) return kindOfProperty(last.name);
        return last.list == ChildList::Prims ? OpinionKind::Namespace : OpinionKind::Variants;
    };
    const auto ofField = [&](const std::string& field) -> std::optional<OpinionKind> {
        if (last.list != ChildList::Properties) return kindOfPrimField(field);
        if (isOneOf(field, kDeclarationFields)) return std::nullopt;
        return kindOfPropertyField(last.name, field);
    };
    return std::visit(
        Overloaded{
            [&](const CreateSpec& create) -> std::optional<OpinionKind> {
                const bool isVariant =
                    create.kind == SpecKind::Variant || create.kind == SpecKind::VariantSet;
                return isVariant ? std::optional(OpinionKind::Variants) : std::nullopt;
            },
            [&](const MoveSpec&) -> std::optional<OpinionKind> {
                return last.list == ChildList::Variants || last.list == ChildList::VariantSets
                           ? OpinionKind::Variants
                           : OpinionKind::Namespace;
            },
            [&](const SetField& set) -> std::optional<OpinionKind> {
                if (set.field == "specifier" && makesOver(set) && !exists) return std::nullopt;
                return ofField(set.field);
            },
            [&](const EraseField& erase) { return ofField(erase.field); },
            [&](const auto&) -> std::optional<OpinionKind> { return ofSpec(); },
        },
        action);
}

}  // namespace usdlive
