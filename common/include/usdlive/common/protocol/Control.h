// Control messages: JSON objects with a member "type" (kType) and one member for each field.
// Unknown members are ignored; unknown types are answered with `malformedControl`. Requests and
// their answers are in Requests.h.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <variant>
#include <vector>

#include "usdlive/common/core/Hash.h"
#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"
#include "usdlive/common/core/StoreId.h"
#include "usdlive/common/protocol/Fields.h"
#include "usdlive/common/protocol/Requests.h"

namespace usdlive {

/// Client: its token, before the hello of a session whose request could not carry it (AC13).
struct ShowToken {
    static constexpr std::string_view kType = "showToken";
    std::string token;  ///< never logged or shown
    USDLIVE_FIELDS(token)
    bool operator==(const ShowToken&) const = default;
};

/// Client: its first message.
struct Hello {
    static constexpr std::string_view kType = "hello";
    int protocol = 0;        ///< newest version that the client speaks
    int oldestProtocol = 0;  ///< oldest version that it speaks
    std::vector<std::string> features;
    ClientId client;
    UserName user;
    std::string application;
    std::optional<Hash> secret =
        {};  ///< `client` is its hash (ID5). Never sent on, logged or shown
    /// Set when resuming: the revision that the client has applied, and the chain hash there.
    struct Resume {
        Epoch epoch = 0;
        Revision revision = 0;
        Hash hash;
        std::optional<StoreId> store = {};  ///< the identity of the client's history (ID1)
        /// Set if own transactions may be unanswered that were sent at this older revision (M14).
        std::optional<Revision> unansweredSince = {};
        USDLIVE_FIELDS(epoch, revision, hash, store, unansweredSince)
        bool operator==(const Resume&) const = default;
    };
    std::optional<Resume> resume;
    /// When resuming: the layers that the client has open.
    std::optional<std::vector<LayerId>> open;
    USDLIVE_FIELDS(protocol, oldestProtocol, features, client, user, application, secret, resume,
                   open)
    bool operator==(const Hello&) const = default;
};
struct LayerInfo {
    LayerId layer;
    USDLIVE_FIELDS(layer)
    bool operator==(const LayerInfo&) const = default;
};
/// An access rule as a user is sent it (AC8). An empty list means all.
struct SentRule {
    std::uint64_t number = 0;  ///< its place among the rules of the project, from 1
    bool allows = false;
    std::vector<std::string> users;  ///< the user, or nobody
    std::vector<std::string> roles;
    std::vector<std::string> groups;                       ///< those of the user
    std::vector<std::string> layers, paths;                ///< globs
    std::vector<std::string> kinds;                        ///< kinds of opinion (AC7)
    std::optional<std::vector<std::string>> actions = {};  ///< if it names some (AC11)
    USDLIVE_FIELDS(number, allows, users, roles, groups, layers, paths, kinds, actions)
    bool operator==(const SentRule&) const = default;
};
/// Server: the access rules that concern the user have changed. Feature `access`.
struct AccessChanged {
    static constexpr std::string_view kType = "accessChanged";
    std::vector<SentRule> rules;
    USDLIVE_FIELDS(rules)
    bool operator==(const AccessChanged&) const = default;
};
inline constexpr const char* kAccessFeature = "access";
/// A client that knows that a rule can be about actions only (AC8).
inline constexpr const char* kActionsFeature = "actions";
/// Server: the answer to Hello. Afterwards the server sends every commit after `revision`; to a
/// resumed session every commit after Hello::resume.revision, also those up to `revision`.
struct Welcome {
    static constexpr std::string_view kType = "welcome";
    int protocol = 0;
    std::vector<std::string> features;
    std::string project;
    Epoch epoch = 0;
    Revision revision = 0;  ///< the newest durable one
    Hash hash;              ///< chain hash at `revision`
    /// False if Hello::resume was absent or impossible (an ErrorMessage before this one says why):
    /// the client drops the confirmed content of its layers and opens them again.
    bool resumed = false;
    std::vector<LayerInfo> layers;  ///< empty with the feature `layerList`
    std::uint64_t maxFrameBytes = 0;
    std::uint64_t maxBlobBytes = 0;
    std::optional<bool> administrator = {};  ///< locks do not apply to administrators (LK1)
    std::optional<Revision> base = {};       ///< commits up to this one were replaced (CH4)
    /// Limit of a transaction in parts (FR8).
    std::optional<std::uint64_t> maxTransactionBytes = {};
    std::optional<StoreId> store = {};     ///< the identity of the project's store (ID1)
    std::optional<std::string> role = {};  ///< the user's role (AC3)
    /// The access rules that concern the user (AC8). Feature `access`.
    std::optional<std::vector<SentRule>> rules = {};
    USDLIVE_FIELDS(protocol, features, project, epoch, revision, hash, resumed, layers,
                   maxFrameBytes, maxBlobBytes, administrator, base, maxTransactionBytes, store,
                   role, rules)
    bool operator==(const Welcome&) const = default;
};
/// Server: names that were added to the project's layers, or removed from them. Those of a
/// session's first list, which is empty at first, come before its Welcome. Feature `layerList`
/// (SE9).
struct LayerList {
    static constexpr std::string_view kType = "layerList";
    std::vector<LayerId> added;
    std::vector<LayerId> removed;
    USDLIVE_FIELDS(added, removed)
    bool operator==(const LayerList&) const = default;
};
inline constexpr const char* kLayerListFeature = "layerList";
/// Server: all layers of the project, for sessions without the feature `layerList`. Sent when they
/// differ from the last message about them.
struct ProjectLayers {
    static constexpr std::string_view kType = "projectLayers";
    std::vector<LayerInfo> layers;
    USDLIVE_FIELDS(layers)
    bool operator==(const ProjectLayers&) const = default;
};
/// Client: layers that it has open, besides those of Hello::open. Feature `layerList` (SE2).
struct KeepLayers {
    static constexpr std::string_view kType = "keepLayers";
    std::vector<LayerId> layers;
    USDLIVE_FIELDS(layers)
    bool operator==(const KeepLayers&) const = default;
};
/// Client: it does not need the layer any more.
struct CloseLayer {
    static constexpr std::string_view kType = "closeLayer";
    LayerId layer;
    USDLIVE_FIELDS(layer)
    bool operator==(const CloseLayer&) const = default;
};
/// Client: asks for a big value from `offset` on. Blob frames with this hash answer it.
struct RequestBlob {
    static constexpr std::string_view kType = "requestBlob";
    Hash hash;
    std::uint64_t offset = 0;
    USDLIVE_FIELDS(hash, offset)
    bool operator==(const RequestBlob&) const = default;
};
/// Server: an uploaded big value is complete and durable; transactions may name it.
struct BlobStored {
    static constexpr std::string_view kType = "blobStored";
    Hash hash;
    USDLIVE_FIELDS(hash)
    bool operator==(const BlobStored&) const = default;
};
/// Server: a transaction that was sent twice is committed already (M9).
struct AlreadyCommitted {
    static constexpr std::string_view kType = "alreadyCommitted";
    std::uint64_t sequence = 0;
    Revision revision = 0;
    USDLIVE_FIELDS(sequence, revision)
    bool operator==(const AlreadyCommitted&) const = default;
};
/// Server: the progress of a request that takes long (PG1). Feature `progress`.
struct RequestProgress {
    static constexpr std::string_view kType = "requestProgress";
    std::uint64_t request = 0;
    std::string task;  ///< "import", "save"
    LayerId layer;     ///< the one in work
    std::uint64_t done = 0;
    std::uint64_t total = 0;  ///< 0: unknown
    USDLIVE_FIELDS(request, task, layer, done, total)
    bool operator==(const RequestProgress&) const = default;
};
/// The state of a layer, apart from its content. Feature `states`.
struct LayerState {
    LayerId layer;
    /// The newest revision that had changed the layer when the server sent this; 0: unknown.
    Revision revision = 0;
    Revision saved = 0;          ///< the revision in its file; 0: unknown
    bool dirty = false;          ///< it differs from its file
    bool outdated = false;       ///< somebody else has changed its file
    bool globallyMuted = false;  ///< on the stages of a layer that somebody has open
    bool writable = true;        ///< the server may write its file
    std::string owner;           ///< owner of its file; empty: unknown
    bool locked = false;
    UserName holder;                ///< holder of the lock; empty: the lock names nobody
    std::uint64_t lockedAtMs = 0;   ///< since 1970, by the holder's clock; 0: unknown
    std::vector<UserName> editors;  ///< users who have it open, sorted, each once
    USDLIVE_FIELDS(layer, revision, saved, dirty, outdated, globallyMuted, writable, owner, locked,
                   holder, lockedAtMs, editors)
    bool operator==(const LayerState&) const = default;
};
/// Server: the states that changed. After the welcome: all that differ from a default LayerState.
struct LayerStates {
    static constexpr std::string_view kType = "layerStates";
    std::vector<LayerState> layers;
    USDLIVE_FIELDS(layers)
    bool operator==(const LayerStates&) const = default;
};

/// The selection, camera and time of a user. Feature `presence`. Never stored.
struct Presence {
    ClientId client;  ///< the server sets this and the next two
    UserName user;
    std::string application;
    std::vector<std::string> selection;  ///< paths
    std::vector<double> camera;          ///< a matrix of 16 numbers, by rows; or empty
    std::optional<double> time;          ///< time code
    std::string editTarget;              ///< a layer; or empty
    std::string data;                    ///< free text, for example JSON, for other applications
    USDLIVE_FIELDS(client, user, application, selection, camera, time, editTarget, data)
    bool operator==(const Presence&) const = default;
};
/// Client: its presence, at most kPresencesPerSecond times a second. It repeats an unchanged one
/// every kPresenceRepeatMs. The server drops a presence that was not sent for kPresenceTimeMs.
struct ShowPresence {
    static constexpr std::string_view kType = "showPresence";
    Presence presence;
    USDLIVE_FIELDS(presence)
    bool operator==(const ShowPresence&) const = default;
};
inline constexpr int kPresencesPerSecond = 20;
inline constexpr std::int64_t kPresenceRepeatMs = 1'000;
inline constexpr std::int64_t kPresenceTimeMs = 3'000;
/// Server: changed presences of other clients, and clients whose presence has ended.
struct Presences {
    static constexpr std::string_view kType = "presences";
    std::vector<Presence> shown;
    std::vector<ClientId> gone;
    USDLIVE_FIELDS(shown, gone)
    bool operator==(const Presences&) const = default;
};

/// Server: an error. `closing`: it ends the connection. `request`: the request that it answers.
struct ErrorMessage {
    static constexpr std::string_view kType = "errorMessage";
    std::string code;  ///< a code of errors.json
    std::string message;
    bool closing = false;
    std::optional<std::uint64_t> request;
    std::optional<Hash> blob;
    USDLIVE_FIELDS(code, message, closing, request, blob)
    bool operator==(const ErrorMessage&) const = default;
};

/// The error that a message carries. A code that this build does not know becomes Internal.
[[nodiscard]] Error toError(const ErrorMessage& message);

/// All messages: those of `Variant`, then each request of AnyRequest and its answer.
template <class Variant, class Requests>
struct WithRequests;
template <class... Messages, class... Requests>
struct WithRequests<std::variant<Messages...>, std::variant<Requests...>> {
    using Type = std::variant<Messages..., Requests..., typename Requests::Answer...>;
};
using ControlMessage =
    WithRequests<std::variant<ShowToken, Hello, Welcome, LayerList, ProjectLayers, OpenLayer,
                              LayerOpened, KeepLayers, CloseLayer, RequestBlob, BlobStored,
                              AlreadyCommitted, RequestProgress, RequestLog, LogBegin, LogEnd,
                              LayerStates, ShowPresence, Presences, AccessChanged, ErrorMessage>,
                 AnyRequest>::Type;

/// The features of this build, as hello and welcome name them: those of requests, and others.
[[nodiscard]] const std::vector<std::string>& protocolFeatures();

[[nodiscard]] std::string encodeControl(const ControlMessage& message);
/// MalformedControl says what is missing or wrong. Nesting and lengths are bounded.
[[nodiscard]] Result<ControlMessage> decodeControl(std::string_view json);

}  // namespace usdlive
