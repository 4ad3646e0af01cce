// Makes random edits for the simulated editors.
#include "EditScript.h"

#include <array>

#include "NamespaceEdits.h"
#include "usdlive/common/core/ByteStream.h"

namespace usdlive::simulation {

namespace {

const char* const kPrims[] = {"A", "B", "C", "D"};
const char* const kProperties[] = {"x", "y", "ns:z", "big"};
const char* const kSets[] = {"look", "size"};
const char* const kVariants[] = {"one", "two-2"};
const char* const kKeys[] = {"k", "l", "m:n"};
constexpr std::size_t kMaxDepth = 5;
constexpr std::size_t kEnoughSpecs = 40;

Value subLayer(const std::string& asset, double offset) {
    Bytes bytes;
    appendText(bytes, asset);
    appendNumber<double>(bytes, offset);
    appendNumber<double>(bytes, 1.0);
    return {ValueType::SubLayer, std::move(bytes)};
}

Value typeName(const std::string& path) {
    return tokenValue(path.ends_with(".big") ? "float[]" : "double");
}
bool isBig(const LayerDoc& doc, const std::string& path) {
    const FieldValue* type = doc.field(path, "typeName");
    return type && textOf(*type->as<Value>()) == "float[]";
}
Value smallArray() {
    Bytes none(sizeof(std::uint64_t), 0);
    return {arrayOf(ValueType::Float), std::move(none)};
}

bool isPrimLike(SpecKind kind) { return kind == SpecKind::Prim || kind == SpecKind::Variant; }

}  // namespace

// Walks down from the root to a random spec.
std::string EditScript::somewhere(const LayerDoc& doc, std::optional<SpecKind> kind) {
    std::string path = "/";
    std::string found = "/";
    for (int step = 0; step < 8; ++step) {
        if (kind ? doc.kind(path) == kind : random_.chance(25) && path != "/") found = path;
        const ChildList list = ChildList(random_.below(4));
        const auto names = doc.children(path, list);
        if (names.empty()) continue;
        path = specpath::child(path, list, random_.pick(names));
        if (doc.kind(path) == kind || !kind) found = path;
    }
    return found;
}

std::vector<client::AuthoredEdit> EditScript::edits(const LayerId& layer, const LayerDoc& doc,
                                                    std::map<Hash, SharedBytes>& blobs,
                                                    bool bigValues) {
    std::string path = somewhere(doc, {});
    std::optional<EditAction> action;
    if (random_.chance(doc.specCount() < 8 ? 70 : 40))
        action = structural(doc, path);
    else if (isBig(doc, path))
        action = SetField{"default", {}, bigValues ? bigValue(blobs) : smallArray(), {}};
    else if (const auto kind = doc.kind(path))
        action = fieldOf(*kind);
    if (!action) return {};
    std::vector<client::AuthoredEdit> edits{{layer, path, *action}};
    const auto* set = std::get_if<SetField>(&*action);
    if (set && std::holds_alternative<std::monostate>(set->part)) {  // like Capture (M1)
        edits.clear();
        for (auto& part : authoredParts(set->field, doc.field(path, set->field), &set->value))
            edits.push_back({layer, path, std::move(part)});
    }
    if (const auto* create = std::get_if<CreateSpec>(&*action)) {
        if (doc.has(path)) return {};  // an SdfLayer sends no notice of such a creation
        if (create->kind == SpecKind::Prim)
            edits.push_back({layer, path, SetField{"specifier", {}, specifier(), {}}});
        if (create->kind == SpecKind::Prim && identifiesPrims_)
            edits.push_back({layer, path, NamespaceEdits::identity(++lastValue_)});
        // M13: the fields of a new spec are sent as a whole.
        if (create->kind != SpecKind::VariantSet && random_.chance(40))
            edits.push_back({layer, path, SetField{"customData", {}, someKeys(), {}}});
        if (create->kind == SpecKind::Attribute && !path.ends_with(".big") && random_.chance(40))
            edits.push_back({layer, path, SetField{"timeSamples", {}, someSamples(), {}}});
        if (create->kind == SpecKind::Attribute)
            edits.push_back({layer, path, SetField{"typeName", {}, typeName(path), {}}});
    }
    return edits;
}

std::vector<client::AuthoredEdit> EditScript::slide(const LayerId& layer, const LayerDoc& doc,
                                                    std::map<Hash, SharedBytes>& blobs,
                                                    bool bigValues) {
    const std::string path = somewhere(doc, SpecKind::Attribute);
    if (doc.kind(path) != SpecKind::Attribute) return {};
    if (isBig(doc, path)) {
        if (!bigValues) return {};
        return {{layer, path, SetField{"default", {}, bigValue(blobs), {}}}};
    }
    SetField set{"default", {}, number(), {}};
    if (random_.chance(40))
        set = {"timeSamples", SampleTime{double(random_.below(3))}, number(), {}};
    return {{layer, path, std::move(set)}};
}

LayerDoc EditScript::start() {
    LayerDoc doc;
    std::map<Hash, SharedBytes> none;
    const auto count = random_.below(12);
    for (std::uint64_t step = 0; step < count; ++step)
        for (const auto& edit : edits({"-"}, doc, none, false))
            (void)doc.apply(edit.path, edit.action);
    return doc;
}

std::optional<EditAction> EditScript::structural(const LayerDoc& doc, std::string& path) {
    const auto dice = random_.below(100);
    if (dice < 50 && doc.specCount() < kEnoughSpecs) return create(doc, path);
    if (path == "/") return create(doc, path);
    if (dice < 65) return DeleteSpec{};
    if (dice < 85) return move(doc, path);
    return place(doc, path);
}

std::optional<EditAction> EditScript::create(const LayerDoc& doc, std::string& path) {
    const auto kind = doc.kind(path);
    if (!kind) return std::nullopt;
    if (*kind == SpecKind::VariantSet) {
        path = specpath::child(path, ChildList::Variants, random_.pick(kVariants));
        return CreateSpec{SpecKind::Variant};
    }
    if (*kind == SpecKind::PseudoRoot || random_.chance(45)) {
        if (*kind != SpecKind::PseudoRoot && !isPrimLike(*kind)) return std::nullopt;
        if (specpath::parse(path)->size() >= kMaxDepth) return std::nullopt;
        path = specpath::child(path, ChildList::Prims, random_.pick(kPrims));
        return CreateSpec{SpecKind::Prim};
    }
    if (!isPrimLike(*kind)) return std::nullopt;
    if (random_.chance(25)) {
        path = specpath::child(path, ChildList::VariantSets, random_.pick(kSets));
        return CreateSpec{SpecKind::VariantSet};
    }
    path = specpath::child(path, ChildList::Properties, random_.pick(kProperties));
    return CreateSpec{random_.chance(75) ? SpecKind::Attribute : SpecKind::Relationship};
}

std::optional<EditAction> EditScript::move(const LayerDoc& doc, const std::string& path) {
    const ChildList list = specpath::last(path).list;
    const char* name = nullptr;
    switch (list) {
        case ChildList::Prims:
            name = random_.pick(kPrims);
            break;
        case ChildList::Properties:
            // The edit includes the type, and sets properties that others set, too.
            name = isBig(doc, path) ? "big" : kProperties[random_.below(3)];
            break;
        case ChildList::VariantSets:
            name = random_.pick(kSets);
            break;
        case ChildList::Variants:
            name = random_.pick(kVariants);
            break;
    }
    std::string parent = specpath::parent(path);
    if (random_.chance(50) && (list == ChildList::Prims || list == ChildList::Properties)) {
        parent = somewhere(doc, {});
        if (random_.chance(20) && list == ChildList::Prims) parent = "/";
    }
    return MoveSpec{{parent, {}}, name};
}

std::optional<EditAction> EditScript::place(const LayerDoc& doc, const std::string& path) {
    const auto names = doc.children(specpath::parent(path), specpath::last(path).list);
    if (names.size() < 2) return std::nullopt;
    return PlaceSpec{random_.chance(30) ? std::string() : random_.pick(names)};
}

std::optional<EditAction> EditScript::fieldOf(SpecKind kind) {
    switch (kind) {
        case SpecKind::PseudoRoot:
            return rootField();
        case SpecKind::Attribute:
            return attributeField();
        case SpecKind::Relationship:
            return list("targetPaths", ValueType::Path, somePath(), somePath());
        case SpecKind::Prim:
        case SpecKind::Variant:
            return primField();
        case SpecKind::VariantSet:
            return std::nullopt;
    }
    return std::nullopt;
}

EditAction EditScript::attributeField() {
    const double time = double(random_.below(4));
    switch (random_.below(9)) {
        case 0:
        case 1:
            return SetField{"default", {}, number(), {}};
        case 2:
            return EraseField{"default", {}};
        case 3:
        case 4:
            return SetField{"timeSamples", SampleTime{time}, number(), {}};
        case 5:
            return EraseField{"timeSamples", SampleTime{time}};
        case 6:
            return list("connectionPaths", ValueType::Path, someProperty(), someProperty());
        case 7:
            return SetField{"timeSamples", {}, someSamples(), {}};
        default:
            return dictionary("customData");
    }
}

EditAction EditScript::primField() {
    switch (random_.below(7)) {
        case 0:
            return SetField{"kind", {}, tokenValue("k" + std::to_string(++lastValue_)), {}};
        case 1:
            return SetField{"comment", {}, stringValue("c" + std::to_string(++lastValue_)), {}};
        case 2:
            return list("apiSchemas", ValueType::Token, tokenValue(random_.pick(kKeys)),
                        tokenValue(random_.pick(kKeys)));
        case 3: {
            const Value key = stringValue(random_.pick(kSets));
            if (random_.chance(25)) return EraseField{"variantSelection", MapKey{key}};
            return SetField{"variantSelection", MapKey{key},
                            stringValue("v" + std::to_string(++lastValue_)), ValueType::String};
        }
        case 4:
            return EraseField{random_.chance(50) ? "customData" : "comment", {}};
        case 5:
            return list("inheritPaths", ValueType::Path, somePath(), somePath());
        default:
            return dictionary("customData");
    }
}

EditAction EditScript::rootField() {
    switch (random_.below(5)) {
        case 0:
            return SetField{"comment", {}, stringValue("r" + std::to_string(++lastValue_)), {}};
        case 1: {
            const std::string asset = std::string("./") + random_.pick(kPrims) + ".usda";
            const std::string other = std::string("./") + random_.pick(kPrims) + ".usda";
            return list("subLayers", ValueType::SubLayer, subLayer(asset, double(++lastValue_)),
                        subLayer(other, 0));
        }
        case 2: {
            const Value key = pathValue("/" + std::string(random_.pick(kPrims)) + "/Old");
            if (random_.chance(25)) return EraseField{"layerRelocates", MapKey{key}};
            return SetField{"layerRelocates", MapKey{key},
                            pathValue("/N" + std::to_string(++lastValue_)), ValueType::Path};
        }
        case 3:  // D1; refused wherever it is tried
            if (random_.chance(30)) return SetField{"timeCodesPerSecond", {}, doubleValue(0), {}};
            [[fallthrough]];
        default:
            return dictionary("customLayerData");
    }
}

EditAction EditScript::dictionary(const std::string& field) {
    DictionaryKey key{{random_.pick(kKeys)}};
    if (random_.chance(40)) key.path.push_back(random_.pick(kKeys));
    if (random_.chance(25)) return EraseField{field, key};
    if (random_.chance(10)) return SetField{field, {}, someKeys(), {}};
    return SetField{field, key, number(), {}};
}

EditAction EditScript::list(const std::string& field, ValueType type, const Value& item,
                            const Value& other) {
    static constexpr std::array kLists{ListName::Prepended, ListName::Appended, ListName::Deleted};
    const bool explicitly = type == ValueType::SubLayer || random_.chance(20);
    ListItem part{explicitly ? ListName::Explicit : random_.pick(kLists), item, {}};
    if (random_.chance(30)) return EraseField{field, part};
    if (random_.chance(10)) return EraseField{field, {}};
    if (random_.chance(50)) part.before = other;
    return SetField{field, part, {}, type};
}

Dictionary EditScript::someKeys() {
    Dictionary whole, inner;
    whole.entries[random_.pick(kKeys)] = number();
    inner.entries[random_.pick(kKeys)] = number();
    if (random_.chance(50)) whole.entries[random_.pick(kKeys)] = inner;
    return whole;
}

TimeSamples EditScript::someSamples() {
    return {{{0.0, number()}, {1.0 + double(random_.below(4)), number()}}};
}

Value EditScript::specifier() {
    return {ValueType::Specifier, Bytes{std::uint8_t(random_.below(3))}};
}

Value EditScript::number() { return doubleValue(double(++lastValue_)); }

Value EditScript::bigValue(std::map<Hash, SharedBytes>& blobs) {
    // A VtFloatArray, mostly of two chunks. It compresses well, because its content does not
    // matter.
    Bytes bytes;
    const std::uint64_t count = random_.chance(50) ? 66'000 : 140'000;
    appendNumber<std::uint64_t>(bytes, count);
    // Sometimes several editors author the same value, also at the same time.
    const auto filling = random_.chance(20) ? random_.below(2) : ++lastValue_;
    bytes.resize(bytes.size() + 4 * count, std::uint8_t(filling));
    const Hash hash = sha256(bytes);
    const std::uint64_t size = bytes.size();
    blobs[hash] = std::make_shared<const Bytes>(std::move(bytes));
    return Value::blob(arrayOf(ValueType::Float), hash, size);
}

Value EditScript::someProperty() {
    return pathValue("/" + std::string(random_.pick(kPrims)) + "." + random_.pick(kProperties));
}

Value EditScript::somePath() { return pathValue("/" + std::string(random_.pick(kPrims))); }

}  // namespace usdlive::simulation
