// Writes the authored opinions of a composed stage into one layer.
#include "usdlive/client/usd/stage/Flatten.h"

#include <pxr/base/ts/spline.h>
#include <pxr/usd/sdf/attributeSpec.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/reference.h>
#include <pxr/usd/sdf/relationshipSpec.h>
#include <pxr/usd/sdf/schema.h>

#include <map>
#include <optional>
#include <string>

#include "usd/stage/Opinions.h"
#include "usdlive/client/usd/stage/Stage.h"

namespace usdlive::stage {

using pxr::SdfFieldKeys;
using pxr::SdfPath;
using pxr::VtValue;

namespace {

class Flattening {
public:
    explicit Flattening(const Stage& stage)
        : stage_(stage), layer_(pxr::SdfLayer::CreateAnonymous(".usda")) {}

    pxr::SdfLayerRefPtr run(bool withSource) {
        const pxr::SdfChangeBlock block;
        namePrototypes();
        for (const auto& prototype : stage_.prototypes()) copyTree(prototype);
        copyFields(SdfPath::AbsoluteRootPath(),
                   stage_.pseudoRoot().authoredMetadata(AssetPaths::Anchored));
        for (const auto& prim : stage_.pseudoRoot().children(PrimPredicate::all())) copyTree(prim);
        if (withSource) noteSource();
        return layer_;
    }

private:
    void namePrototypes() {
        int number = 0;
        for (const auto& prototype : stage_.prototypes()) {
            SdfPath path;
            do path = SdfPath("/Flattened_Prototype_" + std::to_string(++number));
            while (stage_.prim(path));
            prototypes_[prototype.path()] = path;
        }
    }

    // Returns the value with the paths of its path expressions mapped by flat().
    [[nodiscard]] VtValue flatValue(VtValue value) const {
        if (!prototypes_.empty())
            mapPaths(value, [this](const SdfPath& path) { return flat(path); });
        return value;
    }

    // Returns the path in the flat layer of a path inside a prototype.
    [[nodiscard]] SdfPath flat(const SdfPath& path) const {
        for (const auto& [from, to] : prototypes_)
            if (path.HasPrefix(from)) return path.ReplacePrefix(from, to);
        return path;
    }

    void copyTree(const Prim& prim) {
        if (!prim.has(PrimFlag::Active)) return;
        const SdfPath path = flat(prim.path());
        const auto spec =
            pxr::SdfPrimSpec::New(layer_->GetPrimAtPath(path.GetParentPath()), path.GetName(),
                                  prim.specifier(), prim.typeName().GetString());
        if (!spec) return;
        if (prim.isInstance())
            spec->GetReferenceList().Prepend(
                pxr::SdfReference("", prototypes_.at(prim.prototype().path())));
        // The root of a prototype has no opinions of its own. They belong to the instances.
        if (prim.has(PrimFlag::PrototypeRoot))
            spec->SetSpecifier(pxr::SdfSpecifierOver);
        else
            copyFields(path, prim.authoredMetadata(AssetPaths::Anchored));
        for (const auto& property : prim.properties())
            if (property.isAuthored()) copyProperty(property, spec);
        for (const auto& child : prim.children(PrimPredicate::all())) copyTree(child);
    }

    void copyFields(const SdfPath& path, const Metadata& fields) {
        for (const auto& [field, value] : fields)
            // The strongest spline is not always the source of the value. copyValues() writes the
            // right one.
            if (!value.IsEmpty() && field != SdfFieldKeys->Spline)
                layer_->SetField(path, field, flatValue(value));
    }

    void copyProperty(const Property& property, const pxr::SdfPrimSpecHandle& prim) {
        const std::string name = property.name().GetString();
        const SdfPath path = prim->GetPath().AppendProperty(property.name());
        if (property.isRelationship()) {
            (void)pxr::SdfRelationshipSpec::New(prim, name, property.isCustom());
        } else {
            const auto type = pxr::SdfSchema::GetInstance().FindType(property.typeName());
            if (!type) return;  // an attribute spec needs a type
            (void)pxr::SdfAttributeSpec::New(prim, name, type, property.variability(),
                                             property.isCustom());
            copyValues(property, path);
        }
        copyFields(path, property.authoredMetadata(AssetPaths::Anchored));
        copyTargets(property, path);
    }

    void copyTargets(const Property& property, const SdfPath& path) {
        auto targets = property.targets();
        if (targets.empty()) return;
        for (auto& target : targets) target = flat(target);
        layer_->SetField(
            path,
            property.isAttribute() ? SdfFieldKeys->ConnectionPaths : SdfFieldKeys->TargetPaths,
            pxr::SdfPathListOp::CreateExplicit(targets));
    }

    void copyValues(const Property& property, const SdfPath& path) {
        const auto query = property.query(AssetPaths::Anchored);
        if (query.hasSpline())
            layer_->SetField(path, SdfFieldKeys->Spline, VtValue(query.spline()));
        if (query.numTimeSamples() > 0) {
            pxr::SdfTimeSampleMap samples;
            for (const double time : query.timeSamples())
                samples[time] = valueOrBlock(property, query, time);
            layer_->SetField(path, SdfFieldKeys->TimeSamples, VtValue::Take(samples));
        }
        if (query.hasAuthoredDefault())
            layer_->SetField(path, SdfFieldKeys->Default, valueOrBlock(property, query, {}));
    }

    [[nodiscard]] VtValue valueOrBlock(const Property& property, const AttributeQuery& query,
                                       std::optional<double> time) const {
        const VtValue value = property.value(query, time);
        return value.IsEmpty() ? VtValue(pxr::SdfValueBlock()) : flatValue(value);
    }

    void noteSource() {
        std::string text = layer_->GetDocumentation();
        if (!text.empty()) text += "\n\n";
        layer_->SetDocumentation(text + "Generated from Composed Stage of root layer " +
                                 stage_.rootLayer()->GetRealPath() + "\n");
    }

    const Stage& stage_;
    const pxr::SdfLayerRefPtr layer_;
    std::map<SdfPath, SdfPath> prototypes_;  // to their paths in the layer
};

}  // namespace

pxr::SdfLayerRefPtr flatten(const Stage& stage, bool withSource) {
    return Flattening(stage).run(withSource);
}

}  // namespace usdlive::stage
