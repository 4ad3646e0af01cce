// Differences between two contents of a layer, as a layer.
#include "cli/DifferenceLayer.h"

#include "usdlive/common/layer/Inverse.h"
#include "usdlive/common/layer/SpecPath.h"

namespace usdlive::cli {

namespace {

/// Fields without which a property cannot be written.
constexpr const char* kDeclarations[] = {"typeName", "variability", "custom"};

void ensure(LayerDoc& layer, const LayerDoc& to, const std::string& path) {
    if (path.empty() || layer.has(path)) return;
    ensure(layer, to, specpath::parent(path));
    const auto kind = to.kind(path);
    if (!kind) return;
    (void)layer.apply(path, CreateSpec{*kind});
    if (*kind == SpecKind::Attribute || *kind == SpecKind::Relationship)
        for (const char* field : kDeclarations)
            if (const FieldValue* value = to.field(path, field))
                (void)layer.apply(path, SetField{field, {}, *value});
}

}  // namespace

bool isInDifferenceLayer(const EditAction& action) {
    return std::holds_alternative<CreateSpec>(action) || std::holds_alternative<SetField>(action);
}

LayerDoc differenceLayer(const LayerDoc& to, const std::vector<Edit>& edits) {
    LayerDoc layer;
    for (const Edit& edit : edits) {
        const std::string& path = edit.address.path;
        if (!isInDifferenceLayer(edit.action) || !to.has(path)) continue;
        ensure(layer, to, path);
        const auto* set = std::get_if<SetField>(&edit.action);
        const FieldValue* value = set ? to.field(path, set->field) : nullptr;
        if (value) (void)layer.apply(path, SetField{set->field, {}, *value});
    }
    return layer;
}

std::optional<FieldValue> replacedBy(const LayerDoc& doc, const Edit& edit) {
    const std::string& path = edit.address.path;
    if (!doc.has(path)) return std::nullopt;
    if (const auto* set = std::get_if<SetField>(&edit.action))
        return contentOf(doc.field(path, set->field), set->part);
    if (const auto* erase = std::get_if<EraseField>(&edit.action))
        return contentOf(doc.field(path, erase->field), erase->part);
    return std::nullopt;
}

}  // namespace usdlive::cli
