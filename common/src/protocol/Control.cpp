// Control messages to JSON and back.
#include "usdlive/common/protocol/Control.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <type_traits>

#include "usdlive/common/core/LayerPath.h"
#include "usdlive/common/protocol/CompactFrame.h"
#include "usdlive/common/protocol/FrameParts.h"
#include "usdlive/common/protocol/ServerControl.h"

namespace usdlive {

namespace {

using Json = nlohmann::json;

constexpr std::size_t kMaxControlBytes = 16 * 1024 * 1024;  // limit for clients
constexpr std::size_t kMaxTextBytes = 64 * 1024;
constexpr std::size_t kMaxIdBytes = 256;
constexpr int kMaxDepth = 16;

struct Malformed {
    Error error;
};
[[noreturn]] void stop(std::string message) {
    throw Malformed{{ErrorCode::MalformedControl, std::move(message)}};
}

class Writer {
public:
    template <class T>
    void operator()(std::string_view name, const T& value) {
        object[std::string(name)] = write(value);
    }
    template <class T>
    void operator()(std::string_view name, const std::optional<T>& value) {
        if (value) object[std::string(name)] = write(*value);
    }
    Json object = Json::object();

private:
    template <class T>
        requires std::is_arithmetic_v<T>
    static Json write(const T& value) {
        return value;
    }
    static Json write(const std::string& text) { return text.substr(0, kMaxTextBytes); }
    template <class Tag>
    static Json write(const Id<Tag>& id) {
        return id.value;
    }
    static Json write(const Hash& hash) { return hash.hex(); }
    template <class T>
    static Json write(const std::vector<T>& values) {
        Json array = Json::array();
        for (const T& value : values) array.push_back(write(value));
        return array;
    }
    template <class T>
        requires HasFields<T>
    static Json write(const T& message) {
        Writer writer;
        forEachField(message, writer);
        return std::move(writer.object);
    }
};

class Reader {
public:
    explicit Reader(const Json& object) : object_(object) {}

    template <class T>
    void operator()(std::string_view name, T& value) {
        const auto member = object_.find(name);
        if (member == object_.end()) stop(inQuotes(name) + " is missing");
        read(name, *member, value);
    }
    template <class T>
    void operator()(std::string_view name, std::optional<T>& value) {
        const auto member = object_.find(name);
        if (member != object_.end() && !member->is_null()) read(name, *member, value.emplace(T{}));
    }

private:
    static std::string inQuotes(std::string_view name) {
        return "member '" + std::string(name) + "'";
    }
    [[noreturn]] static void wrong(std::string_view name) {
        stop(inQuotes(name) + " has the wrong type or value");
    }
    static const std::string& text(std::string_view name, const Json& json, std::size_t maxBytes) {
        if (!json.is_string()) wrong(name);
        const auto& text = json.get_ref<const std::string&>();
        if (text.size() > maxBytes) stop(inQuotes(name) + " is too long");
        return text;
    }
    static void read(std::string_view name, const Json& json, bool& value) {
        if (!json.is_boolean()) wrong(name);
        value = json.get<bool>();
    }
    static void read(std::string_view name, const Json& json, int& value) {
        if (!json.is_number_unsigned() || json.get<std::uint64_t>() > 1'000'000) wrong(name);
        value = json.get<int>();
    }
    static void read(std::string_view name, const Json& json, std::uint64_t& value) {
        if (!json.is_number_unsigned()) wrong(name);
        value = json.get<std::uint64_t>();
    }
    static void read(std::string_view name, const Json& json, double& value) {
        if (!json.is_number()) wrong(name);
        value = json.get<double>();
        if (!std::isfinite(value)) wrong(name);
    }
    static void read(std::string_view name, const Json& json, std::string& value) {
        value = text(name, json, kMaxTextBytes);
    }
    template <class Tag>
    static void read(std::string_view name, const Json& json, Id<Tag>& value) {
        value.value = text(name, json, kMaxIdBytes);
    }
    static void read(std::string_view name, const Json& json, LayerId& value) {
        auto layer = parseLayerId(text(name, json, kMaxTextBytes));
        if (!layer) throw Malformed{layer.error()};
        value = std::move(*layer);
    }
    static void read(std::string_view name, const Json& json, Hash& value) {
        const auto hash = hashFromHex(text(name, json, kMaxTextBytes));
        if (!hash) wrong(name);
        value = *hash;
    }
    template <class T>
    static void read(std::string_view name, const Json& json, std::vector<T>& values) {
        if (!json.is_array()) wrong(name);
        for (const Json& element : json) read(name, element, values.emplace_back());
    }
    template <class T>
        requires HasFields<T>
    static void read(std::string_view name, const Json& json, T& message) {
        if (!json.is_object()) wrong(name);
        Reader reader(json);
        forEachField(message, reader);
    }

    const Json& object_;
};

/// The parser takes memory for each level, so depth is checked before parsing.
bool isTooDeep(std::string_view json) {
    int depth = 0;
    bool quoted = false;
    for (std::size_t index = 0; index < json.size(); ++index) {
        const char character = json[index];
        if (quoted && character == '\\') ++index;
        if (character == '"') quoted = !quoted;
        if (quoted) continue;
        if (character == '{' || character == '[') ++depth;
        if (character == '}' || character == ']') --depth;
        if (depth > kMaxDepth) return true;
    }
    return false;
}

template <std::size_t index = 0>
ControlMessage readMessage(const std::string& type, const Json& object) {
    if constexpr (index == std::variant_size_v<ControlMessage>) {
        stop("unknown message type '" + type.substr(0, 64) + "'");
    } else {
        using Message = std::variant_alternative_t<index, ControlMessage>;
        if (type != Message::kType) return readMessage<index + 1>(type, object);
        Message message;
        Reader reader(object);
        forEachField(message, reader);
        return message;
    }
}

}  // namespace

Error toError(const ErrorMessage& message) {
    return {errorFromName(message.code).value_or(ErrorCode::Internal),
            message.message.empty() ? message.code : message.message};
}

const std::vector<std::string>& protocolFeatures() {
    static const std::vector<std::string> features = [] {
        std::vector<std::string> all{
            "history",      "log",          "previews",    "previewValues", "states",
            "presence",     "conflation",   "storage",     "progress",      "createLayer",
            "skipped",      "resends",      kPartsFeature, kCompactFeature, kLayerListFeature,
            kAccessFeature, kActionsFeature};
        forEachRequest([&]<class Request>(const Request&) {
            const std::string feature(featureOf<Request>());
            if (!feature.empty() && std::ranges::find(all, feature) == all.end())
                all.push_back(feature);
        });
        return all;
    }();
    return features;
}

std::string encodeControl(const ControlMessage& message) {
    Writer writer;
    std::visit(
        [&](const auto& content) {
            writer("type", std::string(content.kType));
            forEachField(content, writer);
        },
        message);
    return writer.object.dump(-1, ' ', false, Json::error_handler_t::replace);
}

Result<ControlMessage> decodeControl(std::string_view json) {
    if (json.size() > kMaxControlBytes)
        return fail(ErrorCode::MalformedControl, "a control message is too large or too deep");
    return decodeServerControl(json);
}

Result<ControlMessage> decodeServerControl(std::string_view json) {
    if (json.size() > kMaxServerControlBytes || isTooDeep(json))
        return fail(ErrorCode::MalformedControl, "a control message is too large or too deep");
    const Json object = Json::parse(json, nullptr, false);
    if (!object.is_object())
        return fail(ErrorCode::MalformedControl, "a control message is no JSON object");
    const auto type = object.find("type");
    if (type == object.end() || !type->is_string())
        return fail(ErrorCode::MalformedControl, "a control message has no type");
    try {
        return readMessage(type->get_ref<const std::string&>(), object);
    } catch (const Malformed& stopped) {
        return tl::unexpected(stopped.error);
    }
}

}  // namespace usdlive
