#include "usdlive/common/protocol/Control.h"

#include <array>
#include <cmath>
#include <concepts>
#include <nlohmann/json.hpp>
#include <type_traits>

#include "usdlive/common/core/LayerPath.h"

namespace usdlive {

namespace {

using Json = nlohmann::json;

constexpr std::size_t kMaxControlBytes = 16 * 1024 * 1024;  // a welcome lists all layers
constexpr std::size_t kMaxTextBytes = 64 * 1024;
constexpr std::size_t kMaxIdBytes = 256;
constexpr int kMaxDepth = 16;

struct Malformed {
    Error error;
};
[[noreturn]] void stop(std::string message) {
    throw Malformed{{ErrorCode::MalformedControl, std::move(message)}};
}

template <class Message, class T>
concept Is = std::same_as<std::remove_const_t<Message>, T>;

// The members of each message, said once for both ways: `io` is a Writer or a Reader.
void members(auto& io, Is<Hello> auto& message) {
    io("protocol", message.protocol);
    io("oldestProtocol", message.oldestProtocol);
    io("features", message.features);
    io("client", message.client);
    io("user", message.user);
    io("application", message.application);
    io("resume", message.resume);
    io("open", message.open);
}
void members(auto& io, Is<Hello::Resume> auto& message) {
    io("epoch", message.epoch);
    io("revision", message.revision);
    io("hash", message.hash);
}
void members(auto& io, Is<LayerInfo> auto& message) { io("layer", message.layer); }
void members(auto& io, Is<Welcome> auto& message) {
    io("protocol", message.protocol);
    io("features", message.features);
    io("project", message.project);
    io("epoch", message.epoch);
    io("revision", message.revision);
    io("hash", message.hash);
    io("resumed", message.resumed);
    io("layers", message.layers);
    io("maxFrameBytes", message.maxFrameBytes);
    io("maxBlobBytes", message.maxBlobBytes);
    io("administrator", message.administrator);
    io("base", message.base);
    io("maxTransactionBytes", message.maxTransactionBytes);
}
void members(auto& io, Is<ProjectLayers> auto& message) { io("layers", message.layers); }
void members(auto& io, Is<OpenLayer> auto& message) {
    io("request", message.request);
    io("layer", message.layer);
    io("revision", message.revision);
}
void members(auto& io, Is<LayerOpened> auto& message) {
    io("request", message.request);
    io("layer", message.layer);
    io("revision", message.revision);
    io("specs", message.specs);
}
void members(auto& io, Is<CloseLayer> auto& message) { io("layer", message.layer); }
void members(auto& io, Is<RequestBlob> auto& message) {
    io("hash", message.hash);
    io("offset", message.offset);
}
void members(auto& io, Is<BlobStored> auto& message) { io("hash", message.hash); }
void members(auto& io, Is<AlreadyCommitted> auto& message) {
    io("sequence", message.sequence);
    io("revision", message.revision);
}
void members(auto& io, Is<CreateLayer> auto& message) {
    io("request", message.request);
    io("layer", message.layer);
}
void members(auto& io, Is<LayerCreated> auto& message) {
    io("request", message.request);
    io("layer", message.layer);
}
void members(auto& io, Is<ListSkipped> auto& message) { io("request", message.request); }
void members(auto& io, Is<SkippedFile> auto& message) {
    io("path", message.path);
    io("reason", message.reason);
}
void members(auto& io, Is<SkippedFiles> auto& message) {
    io("request", message.request);
    io("count", message.count);
    io("files", message.files);
}
void members(auto& io, Is<RequestProgress> auto& message) {
    io("request", message.request);
    io("task", message.task);
    io("layer", message.layer);
    io("done", message.done);
    io("total", message.total);
}
void members(auto& io, Is<SaveLayers> auto& message) {
    io("request", message.request);
    io("layers", message.layers);
    io("force", message.force);
}
void members(auto& io, Is<ReloadLayers> auto& message) {
    io("request", message.request);
    io("layers", message.layers);
}
void members(auto& io, Is<LayersSaved::Failure> auto& message) {
    io("layer", message.layer);
    io("code", message.code);
    io("message", message.message);
}
void members(auto& io, Is<LayersSaved> auto& message) {
    io("request", message.request);
    io("revision", message.revision);
    io("saved", message.saved);
    io("failed", message.failed);
}
void members(auto& io, Is<LayersReloaded> auto& message) {
    io("request", message.request);
    io("revision", message.revision);
    io("reloaded", message.reloaded);
    io("failed", message.failed);
}
void members(auto& io, Is<RequestLog> auto& message) {
    io("request", message.request);
    io("from", message.from);
    io("to", message.to);
}
void members(auto& io, Is<LogBegin> auto& message) { io("request", message.request); }
void members(auto& io, Is<LogEnd> auto& message) { io("request", message.request); }
void members(auto& io, Is<Checkpoint> auto& message) {
    io("name", message.name);
    io("revision", message.revision);
    io("user", message.user);
    io("timeMs", message.timeMs);
}
void members(auto& io, Is<CreateCheckpoint> auto& message) {
    io("request", message.request);
    io("name", message.name);
}
void members(auto& io, Is<CheckpointCreated> auto& message) {
    io("request", message.request);
    io("checkpoint", message.checkpoint);
}
void members(auto& io, Is<ListCheckpoints> auto& message) { io("request", message.request); }
void members(auto& io, Is<Checkpoints> auto& message) {
    io("request", message.request);
    io("checkpoints", message.checkpoints);
}
void members(auto& io, Is<CompactHistory> auto& message) {
    io("request", message.request);
    io("days", message.days);
}
void members(auto& io, Is<HistoryCompacted> auto& message) {
    io("request", message.request);
    io("base", message.base);
    io("replaced", message.replaced);
    io("bytesBefore", message.bytesBefore);
    io("bytesAfter", message.bytesAfter);
    io("keptFor", message.keptFor);
}
void members(auto& io, Is<RequestStorage> auto& message) { io("request", message.request); }
void members(auto& io, Is<LayerStorage> auto& message) {
    io("layer", message.layer);
    io("commits", message.commits);
    io("log", message.log);
    io("base", message.base);
    io("snapshots", message.snapshots);
    io("blobs", message.blobs);
    io("blobBytes", message.blobBytes);
}
void members(auto& io, Is<Storage> auto& message) {
    io("request", message.request);
    io("revision", message.revision);
    io("base", message.base);
    io("oldestMs", message.oldestMs);
    io("log", message.log);
    io("clients", message.clients);
    io("records", message.records);
    io("bases", message.bases);
    io("snapshots", message.snapshots);
    io("blobs", message.blobs);
    io("blobBytes", message.blobBytes);
    io("free", message.free);
    io("layers", message.layers);
}
void members(auto& io, Is<LayerState> auto& message) {
    io("layer", message.layer);
    io("revision", message.revision);
    io("saved", message.saved);
    io("dirty", message.dirty);
    io("outdated", message.outdated);
    io("globallyMuted", message.globallyMuted);
    io("writable", message.writable);
    io("owner", message.owner);
    io("locked", message.locked);
    io("holder", message.holder);
    io("lockedAtMs", message.lockedAtMs);
    io("editors", message.editors);
}
void members(auto& io, Is<LayerStates> auto& message) { io("layers", message.layers); }
void members(auto& io, Is<Presence> auto& message) {
    io("client", message.client);
    io("user", message.user);
    io("application", message.application);
    io("selection", message.selection);
    io("camera", message.camera);
    io("time", message.time);
    io("editTarget", message.editTarget);
    io("data", message.data);
}
void members(auto& io, Is<ShowPresence> auto& message) { io("presence", message.presence); }
void members(auto& io, Is<Presences> auto& message) {
    io("shown", message.shown);
    io("gone", message.gone);
}
void members(auto& io, Is<ErrorMessage> auto& message) {
    io("code", message.code);
    io("message", message.message);
    io("closing", message.closing);
    io("request", message.request);
    io("blob", message.blob);
}

constexpr std::array<const char*, std::variant_size_v<ControlMessage>> kTypes{
    "hello",          "welcome",          "projectLayers",     "openLayer",        "layerOpened",
    "closeLayer",     "requestBlob",      "blobStored",        "alreadyCommitted", "saveLayers",
    "layersSaved",    "reloadLayers",     "layersReloaded",    "requestLog",       "logBegin",
    "logEnd",         "createCheckpoint", "checkpointCreated", "listCheckpoints",  "checkpoints",
    "compactHistory", "historyCompacted", "requestStorage",    "storage",          "layerStates",
    "showPresence",   "presences",        "errorMessage",      "createLayer",      "layerCreated",
    "listSkipped",    "skippedFiles",     "requestProgress"};

class Writer {
public:
    template <class T>
    void operator()(const char* name, const T& value) {
        object[name] = write(value);
    }
    template <class T>
    void operator()(const char* name, const std::optional<T>& value) {
        if (value) object[name] = write(*value);
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
        requires std::is_aggregate_v<T>
    static Json write(const T& message) {
        Writer writer;
        members(writer, message);
        return std::move(writer.object);
    }
};

class Reader {
public:
    explicit Reader(const Json& object) : object_(object) {}

    template <class T>
    void operator()(const char* name, T& value) {
        const auto member = object_.find(name);
        if (member == object_.end()) stop(std::string("member '") + name + "' is missing");
        read(name, *member, value);
    }
    template <class T>
    void operator()(const char* name, std::optional<T>& value) {
        const auto member = object_.find(name);
        if (member != object_.end() && !member->is_null()) read(name, *member, value.emplace(T{}));
    }

private:
    [[noreturn]] static void wrong(const char* name) {
        stop(std::string("member '") + name + "' is not what it has to be");
    }
    static const std::string& text(const char* name, const Json& json, std::size_t maxBytes) {
        if (!json.is_string()) wrong(name);
        const auto& text = json.get_ref<const std::string&>();
        if (text.size() > maxBytes) stop(std::string("member '") + name + "' is too long");
        return text;
    }
    static void read(const char* name, const Json& json, bool& value) {
        if (!json.is_boolean()) wrong(name);
        value = json.get<bool>();
    }
    static void read(const char* name, const Json& json, int& value) {
        if (!json.is_number_unsigned() || json.get<std::uint64_t>() > 1'000'000) wrong(name);
        value = json.get<int>();
    }
    static void read(const char* name, const Json& json, std::uint64_t& value) {
        if (!json.is_number_unsigned()) wrong(name);
        value = json.get<std::uint64_t>();
    }
    static void read(const char* name, const Json& json, double& value) {
        if (!json.is_number()) wrong(name);
        value = json.get<double>();
        if (!std::isfinite(value)) wrong(name);
    }
    static void read(const char* name, const Json& json, std::string& value) {
        value = text(name, json, kMaxTextBytes);
    }
    template <class Tag>
    static void read(const char* name, const Json& json, Id<Tag>& value) {
        value.value = text(name, json, kMaxIdBytes);
    }
    static void read(const char* name, const Json& json, LayerId& value) {
        auto layer = parseLayerId(text(name, json, kMaxTextBytes));
        if (!layer) throw Malformed{layer.error()};
        value = std::move(*layer);
    }
    static void read(const char* name, const Json& json, Hash& value) {
        const auto hash = hashFromHex(text(name, json, kMaxTextBytes));
        if (!hash) wrong(name);
        value = *hash;
    }
    template <class T>
    static void read(const char* name, const Json& json, std::vector<T>& values) {
        if (!json.is_array()) wrong(name);
        for (const Json& element : json) read(name, element, values.emplace_back());
    }
    template <class T>
        requires std::is_aggregate_v<T>
    static void read(const char* name, const Json& json, T& message) {
        if (!json.is_object()) wrong(name);
        Reader reader(json);
        members(reader, message);
    }

    const Json& object_;
};

/// The parser takes memory by the level, so depth is bounded before it is asked.
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
        stop("a message of the unknown type '" + type.substr(0, 64) + "'");
    } else {
        if (type != kTypes[index]) return readMessage<index + 1>(type, object);
        std::variant_alternative_t<index, ControlMessage> message;
        Reader reader(object);
        members(reader, message);
        return message;
    }
}

}  // namespace

std::string encodeControl(const ControlMessage& message) {
    Writer writer;
    writer("type", std::string(kTypes[message.index()]));
    std::visit([&](const auto& content) { members(writer, content); }, message);
    return writer.object.dump(-1, ' ', false, Json::error_handler_t::replace);
}

Result<ControlMessage> decodeControl(std::string_view json) {
    if (json.size() > kMaxControlBytes || isTooDeep(json))
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
