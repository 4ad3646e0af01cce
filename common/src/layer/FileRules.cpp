// Checks that edits of authors can be saved as files and read back (ED8-ED12).
#include "usdlive/common/layer/FileRules.h"

#include <algorithm>
#include <array>
#include <iterator>
#include <unordered_map>
#include <utility>

#include "FieldLeaves.h"
#include "Identifier.h"
#include "ValueRules.h"
#include "usdlive/common/core/Utf8.h"

namespace usdlive {

namespace {

// The names of Sdf's value types, including the old ones. A unit test compares them with Sdf.
const std::unordered_map<std::string_view, ValueType>& scalarTypes() {
    using enum ValueType;
    static const std::unordered_map<std::string_view, ValueType> kTypes{
        {"bool", Bool},
        {"uchar", UChar},
        {"int", Int},
        {"uint", UInt},
        {"int64", Int64},
        {"uint64", UInt64},
        {"half", Half},
        {"float", Float},
        {"double", Double},
        {"timecode", TimeCode},
        {"string", String},
        {"token", Token},
        {"asset", Asset},
        {"pathExpression", PathExpression},
        {"opaque", Opaque},
        {"group", Opaque},
        {"int2", Int2},
        {"int3", Int3},
        {"int4", Int4},
        {"half2", Half2},
        {"half3", Half3},
        {"half4", Half4},
        {"float2", Float2},
        {"float3", Float3},
        {"float4", Float4},
        {"double2", Double2},
        {"double3", Double3},
        {"double4", Double4},
        {"color3h", Half3},
        {"color3f", Float3},
        {"color3d", Double3},
        {"color4h", Half4},
        {"color4f", Float4},
        {"color4d", Double4},
        {"point3h", Half3},
        {"point3f", Float3},
        {"point3d", Double3},
        {"vector3h", Half3},
        {"vector3f", Float3},
        {"vector3d", Double3},
        {"normal3h", Half3},
        {"normal3f", Float3},
        {"normal3d", Double3},
        {"texCoord2h", Half2},
        {"texCoord2f", Float2},
        {"texCoord2d", Double2},
        {"texCoord3h", Half3},
        {"texCoord3f", Float3},
        {"texCoord3d", Double3},
        {"quath", Quath},
        {"quatf", Quatf},
        {"quatd", Quatd},
        {"matrix2d", Matrix2d},
        {"matrix3d", Matrix3d},
        {"matrix4d", Matrix4d},
        {"frame4d", Matrix4d},
        {"Vec2i", Int2},
        {"Vec3i", Int3},
        {"Vec4i", Int4},
        {"Vec2h", Half2},
        {"Vec3h", Half3},
        {"Vec4h", Half4},
        {"Vec2f", Float2},
        {"Vec3f", Float3},
        {"Vec4f", Float4},
        {"Vec2d", Double2},
        {"Vec3d", Double3},
        {"Vec4d", Double4},
        {"Color", Double3},
        {"ColorFloat", Float3},
        {"Point", Double3},
        {"PointFloat", Float3},
        {"Vector", Double3},
        {"VectorFloat", Float3},
        {"Normal", Double3},
        {"NormalFloat", Float3},
        {"Quath", Quath},
        {"Quatf", Quatf},
        {"Quatd", Quatd},
        {"Matrix2d", Matrix2d},
        {"Matrix3d", Matrix3d},
        {"Matrix4d", Matrix4d},
        {"Frame", Matrix4d},
        {"FaceIndex", Int},
        {"EdgeIndex", Int},
        {"PointIndex", Int},
        {"Transform", Matrix4d},
    };
    return kTypes;
}

// Words with another meaning in the place of a type name in the text format.
bool isKeyword(std::string_view name) {
    static constexpr std::string_view kWords[] = {"None",
                                                  "add",
                                                  "append",
                                                  "class",
                                                  "config",
                                                  "connect",
                                                  "custom",
                                                  "customData",
                                                  "def",
                                                  "default",
                                                  "delete",
                                                  "dictionary",
                                                  "displayUnit",
                                                  "doc",
                                                  "inherits",
                                                  "kind",
                                                  "nameChildren",
                                                  "offset",
                                                  "over",
                                                  "payload",
                                                  "permission",
                                                  "prefixSubstitutions",
                                                  "prepend",
                                                  "properties",
                                                  "references",
                                                  "rel",
                                                  "relocates",
                                                  "reorder",
                                                  "rootPrims",
                                                  "scale",
                                                  "specializes",
                                                  "spline",
                                                  "subLayers",
                                                  "suffixSubstitutions",
                                                  "symmetryArguments",
                                                  "symmetryFunction",
                                                  "timeSamples",
                                                  "uniform",
                                                  "variantSet",
                                                  "variantSets",
                                                  "variants",
                                                  "varying"};
    return std::ranges::find(kWords, name) != std::end(kWords);
}

// Returns true if `name` consists of identifiers with `separator` between them.
bool isTypeName(std::string_view name, std::string_view separator) {
    if (isKeyword(name)) return false;
    for (;;) {
        const auto end = name.find(separator);
        if (!isIdentifier(name.substr(0, end))) return false;
        if (end == std::string_view::npos) return true;
        name.remove_prefix(end + separator.size());
    }
}

bool canBeWritten(SpecKind kind, std::string_view name) {
    if (kind != SpecKind::Attribute) return name.empty() || isTypeName(name, ".");
    if (name.ends_with("[]")) name.remove_suffix(2);
    return isTypeName(name, "::");
}

// Returns true if the text format writes both number types alike and `type` can hold every `value`.
// In a family each type can hold all types before it.
bool isWidened(ValueType value, ValueType type) {
    using enum ValueType;
    static constexpr std::array kFamilies{
        std::array{Half, Float, Double, TimeCode}, std::array{Half2, Float2, Double2, Double2},
        std::array{Half3, Float3, Double3, Double3}, std::array{Half4, Float4, Double4, Double4},
        std::array{Quath, Quatf, Quatd, Quatd}};
    static constexpr std::pair<ValueType, ValueType> kPairs[] = {
        {TimeCode, Double}, {String, Token}, {Token, String}, {Bool, Int},    {Bool, Double},
        {Int, Int64},       {Int, Double},   {UInt, Int64},   {UInt, UInt64}, {UInt, Double},
        {Int2, Double2},    {Int3, Double3}, {Int4, Double4}};
    if (std::ranges::find(kPairs, std::pair(value, type)) != std::end(kPairs)) return true;
    return std::ranges::any_of(kFamilies, [&](const auto& family) {
        const auto at = std::ranges::find(family, value);
        return at != family.end() && std::find(at, family.end(), type) != family.end();
    });
}

bool fits(ValueType value, ValueType type) {
    using enum ValueType;
    if (value == Block) return true;
    constexpr auto kFlags = std::uint16_t(std::uint16_t(ArrayFlag) | std::uint16_t(ArrayEditFlag));
    const auto number = std::uint16_t(value), wanted = std::uint16_t(type);
    if (((number & kFlags) != 0) != ((wanted & kFlags) != 0)) return false;
    const ValueType element{std::uint16_t(number & ~kFlags)}, of{std::uint16_t(wanted & ~kFlags)};
    return element == of || isWidened(element, of);
}

bool isFloatingPoint(ValueType type) {
    using enum ValueType;
    return type == Half || type == Float || type == Double || type == TimeCode;
}

// For an unknown type, Sdf reads no samples and reads a default as its text.
bool fitsDefault(std::optional<ValueType> type, ValueType value) {
    if (value == ValueType::AnimationBlock) return true;
    return fits(value, type.value_or(ValueType::Unregistered));
}
bool fitsSample(std::optional<ValueType> type, ValueType value) {
    return value == ValueType::Block || (type && fits(value, *type));
}

// Returns true for the value types of dictionaries in the text format.
bool isInDictionaries(ValueType type) {
    using enum ValueType;
    constexpr auto kArray = std::uint16_t(ArrayFlag);
    const ValueType element{std::uint16_t(std::uint16_t(type) & ~kArray)};
    return (element >= Bool && element <= Asset) || (element >= Matrix2d && element <= Double4);
}

// Returns the key of a value that a dictionary cannot hold, or nullptr if there is none.
const std::string* misplacedIn(const Dictionary& dictionary) {
    for (const auto& [key, entry] : dictionary.entries) {
        if (const auto* inner = std::get_if<Dictionary>(&entry)) {
            if (const std::string* found = misplacedIn(*inner)) return found;
        } else if (!isInDictionaries(std::get<Value>(entry).type())) {
            return &key;
        }
    }
    return nullptr;
}

bool hasNul(std::string_view text) { return text.find('\0') != std::string_view::npos; }

bool hasNul(const Value& value) { return !value.isBlob() && holdsNul(value.type(), value.bytes()); }

bool hasNulInKeys(const Dictionary& dictionary) {
    return std::ranges::any_of(dictionary.entries, [](const auto& entry) {
        const auto* inner = std::get_if<Dictionary>(&entry.second);
        return hasNul(entry.first) || (inner && hasNulInKeys(*inner));
    });
}

bool hasNul(const FieldValue& field) {
    const auto* dictionary = field.as<Dictionary>();
    bool found = dictionary && hasNulInKeys(*dictionary);
    forEachLeaf(field, [&](const Value& leaf) { found = found || hasNul(leaf); });
    return found;
}

bool hasNul(std::monostate) { return false; }
bool hasNul(const SampleTime&) { return false; }
bool hasNul(const DictionaryKey& part) {
    return std::ranges::any_of(part.path, [](const std::string& key) { return hasNul(key); });
}
bool hasNul(const ListItem& part) { return hasNul(part.item); }
bool hasNul(const MapKey& part) { return hasNul(part.key); }

}  // namespace

bool holdsNul(ValueType type, ByteView bytes) {
    const ValueType element{std::uint16_t(std::uint16_t(type) & 0xFF)};
    const bool mayHold = element == ValueType::String || element == ValueType::StringVector ||
                         element == ValueType::Unregistered || element == ValueType::Reference ||
                         element == ValueType::Spline;
    bool found = false;
    return mayHold && !problemOfLeaf(type, bytes, &found) && found;
}

Result<void> checkTexts(const SetField& set) {
    if (!hasNul(set.value) && !std::visit([](const auto& part) { return hasNul(part); }, set.part))
        return {};
    return fail(ErrorCode::InvalidValue, "a text in " + inQuotes(set.field) +
                                             " holds a NUL, and no file keeps what comes after it");
}

Result<void> checkDictionary(const SetField& set) {
    const auto* part = std::get_if<DictionaryKey>(&set.part);
    const auto* leaf = set.value.as<Value>();
    const auto* dictionary = set.value.as<Dictionary>();
    const std::string* key = dictionary ? misplacedIn(*dictionary) : nullptr;
    if (part && leaf && !part->path.empty() && !isInDictionaries(leaf->type()))
        key = &part->path.back();
    if (!key) return {};
    return fail(ErrorCode::InvalidValue, "the value at the key " + inQuotes(*key) + " in " +
                                             inQuotes(set.field) +
                                             " has a type that no attribute can have");
}

std::optional<ValueType> valueTypeOf(std::string_view typeName) {
    const bool array = typeName.ends_with("[]");
    if (array) typeName.remove_suffix(2);
    const auto found = scalarTypes().find(typeName);
    if (found == scalarTypes().end()) return std::nullopt;
    return array ? arrayOf(found->second) : found->second;
}

bool dependsOnType(std::string_view field) {
    return field == "default" || field == "timeSamples" || field == "spline";
}

bool fitsType(std::string_view typeName, std::string_view field, const FieldValue& content) {
    if (!dependsOnType(field) || typeName.empty()) return true;
    const auto type = valueTypeOf(typeName);
    if (field == "spline") return type && isFloatingPoint(*type);
    if (const auto* value = content.as<Value>(); value && field == "default")
        return fitsDefault(type, value->type());
    const auto* samples = content.as<TimeSamples>();
    return !samples || std::ranges::all_of(samples->samples, [&](const auto& sample) {
        return fitsSample(type, sample.second.type());
    });
}

bool fitsType(std::string_view typeName, const SetField& set) {
    if (std::holds_alternative<std::monostate>(set.part))
        return fitsType(typeName, set.field, set.value);
    const auto* value = set.value.as<Value>();
    const bool sample = std::holds_alternative<SampleTime>(set.part) && set.field == "timeSamples";
    return !sample || !value || typeName.empty() ||
           fitsSample(valueTypeOf(typeName), value->type());
}

std::string_view attributeType(const LayerDoc& doc, std::string_view path) {
    const FieldValue* field = doc.field(path, "typeName");
    const auto* value = field ? field->as<Value>() : nullptr;
    return value ? textOf(*value).value_or("") : std::string_view();
}

Result<void> checkTypeName(SpecKind kind, const EditAction& action) {
    if (const auto* erase = std::get_if<EraseField>(&action))
        return kind == SpecKind::Attribute && erase->field == "typeName"
                   ? fail(ErrorCode::InvalidEdit, "an attribute cannot be without a type")
                   : Result<void>();
    const auto* set = std::get_if<SetField>(&action);
    if (!set || set->field != "typeName" || kind == SpecKind::Relationship) return {};
    const auto* value = set->value.as<Value>();
    const auto text = value && value->type() == ValueType::Token ? textOf(*value) : std::nullopt;
    if (!text || !std::holds_alternative<std::monostate>(set->part))
        return fail(ErrorCode::InvalidValue, "a type name is a token");
    if (canBeWritten(kind, *text)) return {};
    return fail(ErrorCode::InvalidValue, inQuotes(*text) +
                                             " is not a type name that a file can contain: " +
                                             "it must be an identifier that is not a keyword");
}

bool saysNothing(std::string_view field, const FieldValue& content) {
    if (const auto* map = content.as<Map>()) return map->entries.empty();
    const auto* list = content.as<ListOp>();
    if (!list || (list->isExplicit && field != "variantSetNames")) return false;
    return std::ranges::all_of(list->lists, [](const auto& items) { return items.empty(); });
}

Result<void> checkForFile(const LayerDoc& doc, std::string_view path, const EditAction& action) {
    const auto* set = std::get_if<SetField>(&action);
    if (set && dependsOnType(set->field)) {
        const std::string_view type = attributeType(doc, path);
        if (!fitsType(type, *set))
            return fail(ErrorCode::InvalidValue,
                        "the value is of another type than the attribute, "
                        "which is a " +
                            inQuotes(type));
    }
    const auto* erase = std::get_if<EraseField>(&action);
    const std::string_view field = set     ? std::string_view(set->field)
                                   : erase ? std::string_view(erase->field)
                                           : std::string_view();
    const auto kind = field == "typeName" ? doc.kind(path) : std::nullopt;
    if (kind)
        if (auto proper = checkTypeName(*kind, action); !proper) return proper;
    return set ? checkDictionary(*set).and_then([&] { return checkTexts(*set); }) : Result<void>();
}

}  // namespace usdlive
