// Edits a layer at random through Sdf's API.
#include "RandomEditor.h"

#include <pxr/base/gf/matrix4d.h>
#include <pxr/base/gf/vec3d.h>
#include <pxr/base/gf/vec3f.h>
#include <pxr/base/tf/token.h>
#include <pxr/base/vt/array.h>
#include <pxr/base/vt/dictionary.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/assetPath.h>
#include <pxr/usd/sdf/attributeSpec.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/copyUtils.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/layerOffset.h>
#include <pxr/usd/sdf/namespaceEdit.h>
#include <pxr/usd/sdf/path.h>
#include <pxr/usd/sdf/pathExpression.h>
#include <pxr/usd/sdf/payload.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/reference.h>
#include <pxr/usd/sdf/relationshipSpec.h>
#include <pxr/usd/sdf/schema.h>
#include <pxr/usd/sdf/timeCode.h>
#include <pxr/usd/sdf/types.h>
#include <pxr/usd/sdf/valueTypeName.h>
#include <pxr/usd/sdf/variantSetSpec.h>
#include <pxr/usd/sdf/variantSpec.h>

#include <algorithm>

namespace usdlive::tests {

using namespace pxr;

std::string RandomEditor::name() { return std::string(1, char('A' + pick(8))); }

std::vector<SdfPath> RandomEditor::paths(bool prims, bool properties, bool attributesOnly) const {
    std::vector<SdfPath> found;
    layer_->Traverse(SdfPath::AbsoluteRootPath(), [&](const SdfPath& path) {
        if (path.ContainsTargetPath() || path.IsAbsoluteRootPath()) return;
        if (prims && path.IsPrimPath()) found.push_back(path);
        if (properties && path.IsPropertyPath() &&
            (!attributesOnly || layer_->GetSpecType(path) == SdfSpecTypeAttribute))
            found.push_back(path);
    });
    std::sort(found.begin(), found.end());
    return found;
}

SdfPath RandomEditor::prim(bool orVariant) {
    const auto all = paths(true, false);
    if (all.empty()) return {};
    const Path path = all[pick(all.size())];
    if (!orVariant) return path;
    std::vector<Path> variants;
    const auto sets = layer_->GetPrimAtPath(path)->GetVariantSets();
    for (const auto& [set, spec] : sets)
        for (const auto& variant : spec->GetVariantList()) variants.push_back(variant->GetPath());
    return variants.empty() || chance(2) ? path : variants[pick(variants.size())];
}

SdfPath RandomEditor::anyPrimOrRoot() {
    const Path path = prim(true);
    return path.IsEmpty() || chance(5) ? SdfPath::AbsoluteRootPath() : path;
}

SdfPath RandomEditor::property() {
    const auto all = paths(false, true);
    return all.empty() ? SdfPath() : all[pick(all.size())];
}

SdfPath RandomEditor::attribute() {
    const auto all = paths(false, true, true);
    return all.empty() ? SdfPath() : all[pick(all.size())];
}

const std::vector<SdfValueTypeName>& RandomEditor::types() {
    static const std::vector<SdfValueTypeName> all{
        SdfValueTypeNames->Int,          SdfValueTypeNames->Double,
        SdfValueTypeNames->String,       SdfValueTypeNames->Token,
        SdfValueTypeNames->Vector3f,     SdfValueTypeNames->Asset,
        SdfValueTypeNames->Point3fArray, SdfValueTypeNames->TimeCode,
        SdfValueTypeNames->Matrix4d,     SdfValueTypeNames->TokenArray,
        SdfValueTypeNames->Bool,         SdfValueTypeNames->PathExpression};
    return all;
}

VtValue RandomEditor::value(std::size_t type) {
    const int number = int(pick(5));
    switch (type) {
        case 0:
            return VtValue(number);
        case 1:
            return VtValue(double(number) / 3);
        case 2:
            return VtValue(std::string(pick(40), 'x') + "ä\n\"");
        case 3:
            return VtValue(TfToken(name()));
        case 4:
            return VtValue(GfVec3f(float(number), 1, 2));
        case 5:
            return VtValue(SdfAssetPath("./" + name() + ".png"));
        case 6:
            return VtValue(VtArray<GfVec3f>(pick(5), GfVec3f(float(number))));
        case 7:
            return VtValue(SdfTimeCode(number));
        case 8:
            return VtValue(GfMatrix4d(double(number)));
        case 9:
            return VtValue(VtArray<TfToken>(pick(3), TfToken(name())));
        case 10:
            return VtValue(number % 2 == 0);
        default:
            return VtValue(SdfPathExpression("//" + name()));
    }
}

// Leaves out the last type: Sdf writes a path expression in a dictionary as text that does not
// parse.
VtValue RandomEditor::value() { return value(pick(types().size() - 1)); }

VtValue RandomEditor::valueFor(const Path& attribute) {
    const auto type = layer_->GetAttributeAtPath(attribute)->GetTypeName();
    const auto found = std::find(types().begin(), types().end(), type);
    return value(std::size_t(found - types().begin()));
}

std::string RandomEditor::createPrim() {
    const Path parent = anyPrimOrRoot();
    const Path path = parent.AppendChild(TfToken(name()));
    if (chance(4)) {
        SdfCreatePrimInLayer(layer_, path.AppendChild(TfToken(name())));
    } else if (layer_->GetPrimAtPath(path)) {
        return "nothing";
    } else if (parent.IsAbsoluteRootPath()) {
        SdfPrimSpec::New(layer_, path.GetName(), SdfSpecifier(pick(3)), chance(2) ? "Xform" : "");
    } else {
        SdfPrimSpec::New(layer_->GetPrimAtPath(parent), path.GetName(), SdfSpecifierDef);
    }
    return "create " + path.GetString();
}

std::string RandomEditor::createProperty() {
    const Path owner = prim(true);
    if (owner.IsEmpty()) return "nothing";
    const Path path = owner.AppendProperty(TfToken(chance(3) ? "ns:" + name() : name()));
    if (layer_->GetPropertyAtPath(path)) return "nothing";
    const auto spec = layer_->GetPrimAtPath(owner);
    if (chance(3)) {
        SdfRelationshipSpec::New(spec, path.GetName(), chance(2));
    } else {
        SdfAttributeSpec::New(spec, path.GetName(), types()[pick(types().size())],
                              chance(2) ? SdfVariabilityUniform : SdfVariabilityVarying, chance(2));
    }
    return "create " + path.GetString();
}

std::string RandomEditor::remove() {
    if (chance(2)) {
        const Path path = property();
        if (path.IsEmpty()) return "nothing";
        const auto owner = layer_->GetPrimAtPath(path.GetParentPath());
        owner->RemoveProperty(layer_->GetPropertyAtPath(path));
        return "remove " + path.GetString();
    }
    const Path path = prim();
    if (path.IsEmpty()) return "nothing";
    const Path parent = path.GetParentPath();
    const auto spec = layer_->GetPrimAtPath(path);
    if (parent.IsAbsoluteRootPath())
        layer_->RemoveRootPrim(spec);
    else
        layer_->GetPrimAtPath(parent)->RemoveNameChild(spec);
    return "remove " + path.GetString();
}

std::string RandomEditor::namespaceEdit() {
    SdfBatchNamespaceEdit batch;
    std::string what = "batch";
    for (std::size_t i = 0; i <= pick(3); ++i) {
        const bool moveProperty = chance(4);
        const Path from = moveProperty ? property() : prim();
        if (from.IsEmpty()) continue;
        const Path parent = chance(2)      ? from.GetParentPath()
                            : moveProperty ? prim()
                                           : anyPrimOrRoot();
        const TfToken newName = chance(2) ? from.GetNameToken() : TfToken(name());
        const Path to = moveProperty ? parent.AppendProperty(newName) : parent.AppendChild(newName);
        if (from == to || to.HasPrefix(from)) continue;
        batch.Add(SdfNamespaceEdit(from, to, int(pick(4)) - 2));
        what += " " + from.GetString() + "->" + to.GetString();
    }
    SdfNamespaceEditDetailVector details;
    if (layer_->CanApply(batch, &details) == SdfNamespaceEditDetail::Error) return "nothing";
    layer_->Apply(batch);
    return what;
}

std::string RandomEditor::renamePrim() {
    const Path path = prim();
    const std::string newName = name();
    if (path.IsEmpty() || layer_->HasSpec(path.ReplaceName(TfToken(newName)))) return "nothing";
    layer_->GetPrimAtPath(path)->SetName(newName);
    return "rename " + path.GetString() + " " + newName;
}

std::string RandomEditor::orderChildren() {
    const Path path = anyPrimOrRoot();
    if (path.IsAbsoluteRootPath()) {
        auto prims = layer_->GetRootPrims().values();
        std::shuffle(prims.begin(), prims.end(), random_);
        layer_->SetRootPrims(prims);
        return "order /";
    }
    const auto spec = layer_->GetPrimAtPath(path);
    if (chance(2)) {
        auto children = spec->GetNameChildren().values();
        std::shuffle(children.begin(), children.end(), random_);
        spec->SetNameChildren(children);
    } else if (chance(2)) {
        auto properties = spec->GetProperties().values();
        std::shuffle(properties.begin(), properties.end(), random_);
        spec->SetProperties(properties);
    } else {
        spec->SetNameChildrenOrder({TfToken(name()), TfToken("x" + name())});
    }
    return "order " + path.GetString();
}

std::string RandomEditor::setValue() {
    const Path path = attribute();
    if (path.IsEmpty()) return "nothing";
    switch (pick(5)) {
        case 0:
            layer_->EraseField(path, SdfFieldKeys->Default);
            break;
        case 1:
            layer_->SetField(path, SdfFieldKeys->Default, SdfValueBlock());
            break;
        case 2:
            layer_->SetField(path, SdfFieldKeys->Documentation, value().GetTypeName());
            break;
        default:
            layer_->SetField(path, SdfFieldKeys->Default, valueFor(path));
    }
    return "value " + path.GetString();
}

std::string RandomEditor::setSample() {
    const Path path = attribute();
    if (path.IsEmpty()) return "nothing";
    const double time = double(pick(4));
    switch (pick(5)) {
        case 0:
            layer_->EraseTimeSample(path, time);
            break;
        case 1:
            layer_->EraseField(path, SdfFieldKeys->TimeSamples);
            break;
        case 2:
            layer_->SetField(path, SdfFieldKeys->TimeSamples,
                             SdfTimeSampleMap{{1, valueFor(path)}, {time + 10, valueFor(path)}});
            break;
        default:
            layer_->SetTimeSample(path, time, valueFor(path));
    }
    return "sample " + path.GetString();
}

std::string RandomEditor::setDictionary() {
    const bool ofProperty = chance(3);
    Path path = ofProperty ? property() : prim();
    if (path.IsEmpty()) return "nothing";
    const TfToken field = SdfFieldKeys->CustomData;
    const TfToken key(chance(2) ? name() : name() + ":" + name());
    switch (pick(6)) {
        case 0:
            layer_->EraseField(path, field);
            break;
        case 1:
            layer_->EraseFieldDictValueByKey(path, field, key);
            break;
        case 2: {
            VtDictionary whole;
            whole["a:b"] = value();
            whole[name()] = VtDictionary{{name(), value()}, {name(), VtValue(VtDictionary())}};
            layer_->SetField(path, field, whole);
            break;
        }
        case 3:
            layer_->SetFieldDictValueByKey(path, field, key, VtDictionary{{name(), value()}});
            break;
        default:
            layer_->SetFieldDictValueByKey(path, field, key, value());
    }
    return "dictionary " + path.GetString() + " " + key.GetString();
}

std::string RandomEditor::setTargets() {
    const Path path = property();
    if (path.IsEmpty()) return "nothing";
    const Path target = Path("/" + name() + (chance(2) ? "." + name() : ""));
    const auto edit = [&](auto list) {
        switch (pick(6)) {
            case 0:
                list.Add(target);
                break;
            case 1:
                list.Remove(target);
                break;
            case 2:
                list.Prepend(target);
                break;
            case 3:
                list.ClearEditsAndMakeExplicit();
                break;
            case 4:
                list.ClearEdits();
                break;
            default:
                list.GetAppendedItems().push_back(target);
        }
    };
    if (const auto relationship = layer_->GetRelationshipAtPath(path))
        edit(relationship->GetTargetPathList());
    else
        edit(layer_->GetAttributeAtPath(path)->GetConnectionPathList());
    return "targets " + path.GetString();
}

std::string RandomEditor::setArcs() {
    const Path path = prim();
    if (path.IsEmpty()) return "nothing";
    const auto spec = layer_->GetPrimAtPath(path);
    const SdfReference reference("./" + name() + ".usda", Path("/" + name()),
                                 SdfLayerOffset(double(pick(2)), 1));
    switch (pick(7)) {
        case 0:
            spec->GetReferenceList().Prepend(reference);
            break;
        case 1:
            spec->GetReferenceList().Append(reference);
            break;
        case 2:
            spec->GetReferenceList().Remove(reference);
            break;
        case 3:
            spec->GetReferenceList().ClearEdits();
            break;
        case 4:
            spec->GetInheritPathList().Prepend(Path("/" + name()));
            break;
        case 5:
            spec->GetPayloadList().Append(SdfPayload("./" + name() + ".usdc"));
            break;
        default: {
            auto items = TfToken("apiSchemas");
            auto list = layer_->GetFieldAs<SdfTokenListOp>(path, items);
            list.SetPrependedItems({TfToken(name()), TfToken("x" + name())});
            layer_->SetField(path, items, list);
        }
    }
    return "arcs " + path.GetString();
}

std::string RandomEditor::setVariants() {
    const Path path = prim(true);
    if (path.IsEmpty()) return "nothing";
    const auto spec = layer_->GetPrimAtPath(path);
    const auto sets = spec->GetVariantSets();
    const std::string set = "s" + name(), variant = "v" + name();
    switch (pick(6)) {
        case 0: {
            auto setSpec = sets.find(set) == sets.end()
                               ? SdfVariantSetSpec::New(spec, set)
                               : SdfVariantSetSpecHandle(sets.find(set)->second);
            if (setSpec->GetVariants().get(variant)) break;
            SdfVariantSpec::New(setSpec, variant);
            spec->GetVariantSetNameList().Prepend(set);
            break;
        }
        case 1:
            if (!sets.empty()) spec->RemoveVariantSet(sets.begin()->first);
            break;
        case 2:
            if (!sets.empty()) {
                const SdfVariantSetSpecHandle setSpec = sets.begin()->second;
                const auto variants = setSpec->GetVariantList();
                if (!variants.empty()) setSpec->RemoveVariant(variants[pick(variants.size())]);
            }
            break;
        case 3:
            spec->SetVariantSelection(set, "");
            break;
        default:
            spec->SetVariantSelection(set, variant);
    }
    return "variants " + path.GetString();
}

std::string RandomEditor::setLayerFields() {
    const std::string asset = "./sub" + name() + ".usda";
    const int count = int(layer_->GetNumSubLayerPaths());
    switch (pick(9)) {
        case 0: {
            const auto present = layer_->GetSubLayerPaths();
            if (present.Find(asset) == std::size_t(-1))
                layer_->InsertSubLayerPath(asset, int(pick(std::size_t(count) + 1)));
            break;
        }
        case 1:
            if (count) layer_->RemoveSubLayerPath(int(pick(std::size_t(count))));
            break;
        case 2:
            if (count)
                layer_->SetSubLayerOffset(SdfLayerOffset(double(pick(3)), 2),
                                          int(pick(std::size_t(count))));
            break;
        case 3:
            layer_->SetDefaultPrim(TfToken(name()));
            break;
        case 4:
            layer_->SetComment(name());
            break;
        case 5:
            layer_->SetCustomLayerData(VtDictionary{{name(), value()}});
            break;
        case 6:
            layer_->SetRelocates({{Path("/" + name() + "/X"), Path("/Y/" + name())},
                                  {Path("/Q/Z"), Path("/Q/" + name())}});
            break;
        case 7:
            layer_->ClearRelocates();
            break;
        default:
            layer_->SetStartTimeCode(double(pick(10)));
    }
    return "layer";
}

std::string RandomEditor::setPrimFields() {
    const Path path = prim();
    if (path.IsEmpty()) return "nothing";
    const auto spec = layer_->GetPrimAtPath(path);
    switch (pick(7)) {
        case 0:
            spec->SetTypeName(name());
            break;
        case 1:
            spec->SetSpecifier(SdfSpecifier(pick(3)));
            break;
        case 2:
            spec->SetKind(TfToken(name()));
            break;
        case 3:
            spec->SetInstanceable(chance(2));
            break;
        case 4:
            spec->SetDocumentation("doc " + name());
            break;
        case 5:
            spec->SetActive(chance(2));
            break;
        default:
            if (!path.ContainsPrimVariantSelection())
                spec->SetRelocates({{Path(name()), Path("to" + name())}});
    }
    return "prim " + path.GetString();
}

std::string RandomEditor::copy() {
    const Path from = prim(), parent = anyPrimOrRoot();
    if (from.IsEmpty() || paths(true, false).size() > 30) return "nothing";
    const Path to = parent.AppendChild(TfToken(name()));
    if (to.HasPrefix(from) || from.HasPrefix(to)) return "nothing";
    // When Sdf copies onto a property of the other kind, it copies fields that do not belong there.
    if (layer_->HasField(to, SdfChildrenKeys->PropertyChildren)) return "nothing";
    SdfCopySpec(layer_, from, layer_, to);
    return "copy " + from.GetString() + " " + to.GetString();
}

std::string RandomEditor::replace() {
    const auto other = SdfLayer::CreateAnonymous(".usda");
    RandomEditor(other, unsigned(random_())).createPrim();
    RandomEditor editor(other, unsigned(random_()));
    for (int i = 0; i < 15; ++i) {
        switch (editor.pick(4)) {
            case 0:
                editor.createPrim();
                break;
            case 1:
                editor.createProperty();
                break;
            case 2:
                editor.setVariants();
                break;
            default:
                editor.setValue();
        }
    }
    switch (pick(3)) {
        case 0:
            layer_->TransferContent(other);
            return "transfer";
        case 1:
            layer_->Clear();
            return "clear";
        default:
            break;
    }
    std::string text;
    layer_->ExportToString(&text);
    if (chance(2)) other->ExportToString(&text);
    layer_->ImportFromString(text);
    return "import";
}

std::string RandomEditor::step() {
    switch (pick(60)) {
        case 0:
            return replace();
        case 1:
        case 2:
            return copy();
        case 3:
        case 4:
        case 5:
        case 6:
        case 7:
        case 8:
        case 9:
            return createPrim();
        case 10:
        case 11:
        case 12:
        case 13:
        case 14:
        case 15:
            return createProperty();
        case 16:
        case 17:
        case 18:
            return remove();
        case 19:
        case 20:
        case 21:
            return namespaceEdit();
        case 22:
        case 23:
            return renamePrim();
        case 24:
        case 25:
        case 26:
            return orderChildren();
        case 27:
        case 28:
        case 29:
            return setSample();
        case 30:
        case 31:
        case 32:
        case 33:
            return setDictionary();
        case 34:
        case 35:
        case 36:
            return setTargets();
        case 37:
        case 38:
        case 39:
            return setArcs();
        case 40:
        case 41:
        case 42:
        case 43:
            return setVariants();
        case 44:
        case 45:
        case 46:
            return setLayerFields();
        case 47:
        case 48:
        case 49:
        case 50:
            return setPrimFields();
        default:
            return setValue();
    }
}

}  // namespace usdlive::tests
