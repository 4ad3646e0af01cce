// Converts layers, commits and states to JSON.
#include "cli/Json.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <optional>
#include <type_traits>
#include <variant>

#include "cli/ValueShape.h"
#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/layer/NoBlobs.h"
#include "usdlive/common/layer/SpecPath.h"

namespace usdlive::cli {

namespace {

// Prints a float with the fewest digits: 0.1f as 0.1 instead of 0.10000000149011612.
Json numberToJson(float value) {
    if (!std::isfinite(value)) return number(value);
    return std::strtod(number(value).c_str(), nullptr);
}
Json numberToJson(double value) {
    if (!std::isfinite(value)) return number(value);
    return value;
}
template <class T>
Json numberToJson(T value) {
    return value;
}

Json element(ByteReader& bytes, Element type) {
    return readElement(bytes, type, [](auto value) { return numberToJson(value); });
}

Json elements(ByteReader& bytes, Element type, int count) {
    Json all = Json::array();
    for (int i = 0; i < count; ++i) all.push_back(element(bytes, type));
    return all;
}

// Converts one scalar: a number, [x, y, z], or a matrix by rows.
Json numbers(ByteReader& bytes, const Shape& shape) {
    if (shape.count == 1) return element(bytes, shape.element);
    if (shape.row == 0) return elements(bytes, shape.element, shape.count);
    Json rows = Json::array();
    for (int row = 0; row < shape.count / shape.row; ++row)
        rows.push_back(elements(bytes, shape.element, shape.row));
    return rows;
}

// Reads the body inside a leaf (V8) as a field.
Json body(ByteReader& bytes, ValueType type, BlobSource& blobs) {
    const ByteView rest = bytes.take(bytes.left());
    Bytes field;
    appendNumber<std::uint16_t>(field, std::uint16_t(type));
    appendNumber<std::uint8_t>(field, 0);
    appendNumber<std::uint64_t>(field, rest.size());
    appendBytes(field, rest);
    const auto value = decodeFieldValue(field);
    return value ? toJson(*value, blobs) : Json();
}

Json arc(ByteReader& bytes, ValueType type, BlobSource& blobs) {
    Json json{{"asset", bytes.text()}};
    if (type != ValueType::SubLayer) json["prim"] = bytes.text();
    json["offset"] = numberToJson(bytes.f64());
    json["scale"] = numberToJson(bytes.f64());
    if (type == ValueType::Reference) {
        Json customData = body(bytes, ValueType::Dictionary, blobs);
        if (!customData.empty()) json["customData"] = std::move(customData);
    }
    return json;
}

Json texts(ByteReader& bytes) {
    Json all = Json::array();
    for (std::uint32_t count = bytes.u32(); count > 0 && !bytes.failed(); --count)
        all.push_back(bytes.text());
    return all;
}

Json unregistered(ByteReader& bytes, BlobSource& blobs) {
    const std::uint8_t kind = bytes.u8();
    if (kind == 0) return bytes.text();
    return body(bytes, kind == 1 ? ValueType::Dictionary : ValueType::ListOp, blobs);
}

Json arrayElement(ByteReader& bytes, const Shape& shape) {
    if (shape.element == Element::None) return bytes.text();
    return numbers(bytes, shape);
}

Json array(ByteReader& bytes, const Shape& shape) {
    Json all = Json::array();
    for (std::uint64_t count = bytes.u64(); count > 0 && !bytes.failed(); --count)
        all.push_back(arrayElement(bytes, shape));
    return all;
}

// Returns the bytes of a value. `held` keeps those of a big one alive.
std::optional<ByteView> bytesOf(const Value& value, BlobSource& blobs, SharedBytes& held) {
    if (!value.isBlob()) return value.bytes();
    held = blobs.blob(value.hash());
    if (!held) return std::nullopt;
    return ByteView(*held);
}

Json leaf(const Value& value, BlobSource& blobs) {
    SharedBytes held;
    const auto content = bytesOf(value, blobs, held);
    if (!content) return Json{{"blob", value.hash().hex()}, {"bytes", value.size()}};
    ByteReader bytes(*content);
    const Shape shape = shapeOf(scalarOf(value.type()));
    if (isArrayEdit(value.type())) return Json{{"literals", array(bytes, shape)}};
    if (isArray(value.type())) return array(bytes, shape);
    if (shape.element != Element::None) return numbers(bytes, shape);
    if (const auto name = enumText(value.type(), *content)) return *name;
    switch (value.type()) {
        case ValueType::Block:
        case ValueType::AnimationBlock:
        case ValueType::Opaque:
        case ValueType::None:
            return nullptr;
        case ValueType::TokenVector:
        case ValueType::StringVector:
            return texts(bytes);
        case ValueType::Reference:
        case ValueType::Payload:
        case ValueType::SubLayer:
            return arc(bytes, value.type(), blobs);
        case ValueType::Unregistered:
            return unregistered(bytes, blobs);
        case ValueType::Spline:
            return Json{{"bytes", content->size()}};
        default:
            return bytes.text();
    }
}

struct Contents {
    BlobSource& blobs;

    Json operator()(const Value& value) const { return leaf(value, blobs); }
    Json operator()(const Dictionary& value) const {
        Json json = Json::object();
        for (const auto& [key, entry] : value.entries) json[key] = std::visit(*this, entry);
        return json;
    }
    Json operator()(const TimeSamples& value) const {
        Json json = Json::array();
        for (const auto& [time, sample] : value.samples)
            json.push_back(Json::array({numberToJson(time), leaf(sample, blobs)}));
        return json;
    }
    Json operator()(const ListOp& value) const {
        Json json = Json::object();
        for (std::size_t i = 0; i < kListNames; ++i) {
            if (value.lists[i].empty() && !(value.isExplicit && i == 0)) continue;
            Json& items = json[std::string(kListOpNames[i])] = Json::array();
            for (const Value& item : value.lists[i]) items.push_back(leaf(item, blobs));
        }
        return json;
    }
    Json operator()(const Map& value) const {
        Json json = Json::object();
        for (const auto& [key, entry] : value.entries)
            json[std::string(textOf(key).value_or(""))] = leaf(entry, blobs);
        return json;
    }
};

struct Parts {
    BlobSource& blobs;

    Json operator()(std::monostate) const { return nullptr; }
    Json operator()(const DictionaryKey& part) const { return Json{{"key", part.path}}; }
    Json operator()(const SampleTime& part) const {
        return Json{{"time", numberToJson(part.time)}};
    }
    Json operator()(const ListItem& part) const {
        return Json{{"list", kListOpNames[std::size_t(part.list)]},
                    {"item", leaf(part.item, blobs)}};
    }
    Json operator()(const MapKey& part) const { return Json{{"key", leaf(part.key, blobs)}}; }
};

struct Actions {
    Json& json;
    BlobSource& blobs;

    void operator()(const CreateSpec& action) const { json["kind"] = specKindName(action.kind); }
    void operator()(const DeleteSpec&) const {}
    void operator()(const MoveSpec& action) const {
        json["parent"] = action.parent.path;
        json["name"] = action.name;
    }
    void operator()(const PlaceSpec& action) const { json["before"] = action.before; }
    void operator()(const SetField& action) const {
        field(action.field, action.part);
        if (std::holds_alternative<ListItem>(action.part)) return;  // it has its own value
        json["type"] = typeText(action.value);
        json["value"] = toJson(action.value, blobs);
    }
    void operator()(const EraseField& action) const { field(action.field, action.part); }

    void field(const std::string& name, const auto& part) const {
        json["field"] = name;
        if (!std::holds_alternative<std::monostate>(part))
            json["part"] = std::visit(Parts{blobs}, part);
    }
};

std::string textField(const LayerDoc& doc, const std::string& path, std::string_view name) {
    const FieldValue* field = doc.field(path, name);
    const Value* value = field ? field->as<Value>() : nullptr;
    return std::string(value ? textOf(*value).value_or("") : "");
}

Json branchesBelow(const LayerDoc& doc, const std::string& path);

Json branch(const LayerDoc& doc, const std::string& path, const std::string& name) {
    Json json{{"name", name}, {"path", path}};
    if (const auto type = textField(doc, path, "typeName"); !type.empty()) json["type"] = type;
    NoBlobs none;
    if (const FieldValue* specifier = doc.field(path, "specifier"))
        json["specifier"] = toJson(*specifier, none);
    if (Json below = branchesBelow(doc, path); !below.empty()) json["children"] = std::move(below);
    return json;
}

Json branchesBelow(const LayerDoc& doc, const std::string& path) {
    Json all = Json::array();
    for (const auto& set : doc.children(path, ChildList::VariantSets)) {
        const auto setPath = specpath::child(path, ChildList::VariantSets, set);
        for (const auto& variant : doc.children(setPath, ChildList::Variants)) {
            std::string name = "{";
            name.append(set).append("=").append(variant).append("}");
            all.push_back(
                branch(doc, specpath::child(setPath, ChildList::Variants, variant), name));
        }
    }
    for (const auto& name : doc.children(path, ChildList::Prims))
        all.push_back(branch(doc, specpath::child(path, ChildList::Prims, name), name));
    return all;
}

// ---- messages of the protocol, field by field

template <class Tag>
Json fieldToJson(const Id<Tag>& id) {
    return id.value;
}
Json fieldToJson(const std::string& text) { return text; }
Json fieldToJson(const Hash& hash) { return hash.hex(); }
template <class T>
    requires std::is_arithmetic_v<T>
Json fieldToJson(T value) {
    return value;
}
template <class T>
Json fieldToJson(const std::optional<T>& value);
template <class T>
Json fieldToJson(const std::vector<T>& values);
template <HasFields T>
Json fieldToJson(const T& message);

template <class T>
Json fieldToJson(const std::optional<T>& value) {
    return value ? fieldToJson(*value) : Json();
}
template <class T>
Json fieldToJson(const std::vector<T>& values) {
    Json array = Json::array();
    for (const T& value : values) array.push_back(fieldToJson(value));
    return array;
}
// All fields but the number of the request.
template <HasFields T>
Json fieldToJson(const T& message) {
    Json object = Json::object();
    forEachField(message, [&](std::string_view name, const auto& value) {
        if (name != "request") object[std::string(name)] = fieldToJson(value);
    });
    return object;
}

}  // namespace

Json toJson(const FieldValue& value, BlobSource& blobs) { return value.visit(Contents{blobs}); }

std::string typeText(const FieldValue& value) {
    const ValueType type = value.type();
    const std::string name(shapeOf(scalarOf(type)).name);
    if (isArrayEdit(type)) return name + "[] edit";
    return isArray(type) ? name + "[]" : name;
}

Json toJson(const Commit& commit, const LayerId& layer, BlobSource& blobs) {
    Json json{{"revision", commit.revision},
              {"timeMs", commit.timeMs},
              {"user", commit.user.value},
              {"client", commit.id.client.value},
              {"sequence", commit.id.sequence}};
    if (!commit.label.empty()) json["label"] = commit.label;
    if (commit.imported) json["imported"] = commit.imported->value;
    json["dropped"] = commit.dropped.size();
    Json& edits = json["edits"] = Json::array();
    for (const Edit& edit : commit.edits) {
        if (!layer.empty() && edit.layer != layer) continue;
        Json one{{"layer", edit.layer.value},
                 {"action", kActionNames[edit.action.index()]},
                 {"path", edit.address.path}};
        std::visit(Actions{one, blobs}, edit.action);
        edits.push_back(std::move(one));
    }
    return json;
}

Json toJson(const LayerDoc& doc, BlobSource& blobs) {
    Json specs = Json::array();
    doc.visit([&](const LayerDoc::SpecView& spec) {
        Json one{{"path", spec.path}, {"kind", specKindName(spec.kind)}};
        Json& fields = one["fields"] = Json::object();
        for (const auto& [name, value] : *spec.fields)
            fields[name] = Json{{"type", typeText(value)}, {"value", toJson(value, blobs)}};
        specs.push_back(std::move(one));
    });
    return Json{{"specs", std::move(specs)}};
}

Json toJson(const client::KeptByUndo& kept) {
    return Json{{"layer", kept.layer.value},
                {"path", kept.path},
                {"field", kept.field},
                {"author", kept.author.value},
                {"reason", kept.reason}};
}

Json treeToJson(const LayerDoc& doc) { return branchesBelow(doc, "/"); }

Json toJson(const LayerState& state) {
    Json editors = Json::array();
    for (const UserName& user : state.editors) editors.push_back(user.value);
    Json json{{"layer", state.layer.value}, {"revision", state.revision},
              {"saved", state.saved},       {"dirty", state.dirty},
              {"outdated", state.outdated}, {"globallyMuted", state.globallyMuted},
              {"writable", state.writable}, {"owner", state.owner},
              {"locked", state.locked},     {"editors", std::move(editors)}};
    if (state.locked) {
        json["holder"] = state.holder.value;
        json["lockedAtMs"] = state.lockedAtMs;
    }
    return json;
}

Json toJson(const Presence& presence) {
    Json json{{"client", presence.client.value},
              {"user", presence.user.value},
              {"application", presence.application},
              {"selection", presence.selection},
              {"camera", presence.camera},
              {"editTarget", presence.editTarget},
              {"data", presence.data}};
    json["time"] = presence.time ? Json(*presence.time) : Json();
    return json;
}

Json answerToJson(const ControlMessage& answer) {
    return std::visit([](const auto& message) { return fieldToJson(message); }, answer);
}

std::string line(const Json& json) {
    return json.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace usdlive::cli
