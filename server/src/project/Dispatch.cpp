// Passes the messages of sessions to the parts that handle them.
#include <algorithm>
#include <map>
#include <utility>

#include "project/ProjectImpl.h"
#include "usdlive/common/core/Overloaded.h"
#include "usdlive/common/protocol/CheckedControl.h"

namespace usdlive::server {

void Project::Impl::connected(SessionId id, std::optional<SignedIn> user,
                              const std::string& address) {
    Session& session = sessions_.add(id);
    session.subject.proof = std::move(user);
    if (session.subject.proof || !address.empty())
        session.share = shareOf(session.subject, address);
}

void Project::Impl::rolesChanged(const std::function<Role(const SignedIn&)>& roleOf) {
    for (auto& [id, session] : sessions_.all()) {
        const auto& proof = session.subject.proof;
        if (!proof || session.isClosing()) continue;
        const Role role = roleOf(*proof);
        if (role == proof->role) continue;
        activity_->record({"role changed", proof->user, {}, std::string(nameOf(role))});
        sessions_.close(
            session,
            role == Role::None
                ? Error{ErrorCode::SignInRequired,
                        "the access of " + proof->user.value + " to this project was ended"}
                : Error{ErrorCode::ShuttingDown, "the role of " + proof->user.value + " is now " +
                                                     std::string(nameOf(role))});
    }
}

void Project::Impl::setRules(std::shared_ptr<const AccessRules> rules) {
    std::map<SessionId, std::vector<SentRule>> before;
    for (const auto& [id, session] : sessions_.all())
        if (session.isGreeted()) before.emplace(id, access_.rulesOf(session));
    access_.setRules(std::move(rules));
    for (const auto& [id, session] : sessions_.all()) {
        const auto known = before.find(id);
        if (known == before.end() || !session.features.contains(kAccessFeature)) continue;
        AccessChanged message{access_.rulesOf(session)};
        if (message.rules != known->second) sessions_.send(session, message);
    }
}

bool Project::Impl::endSignIns(std::int64_t now) {
    bool willEnd = false;
    for (auto& [id, session] : sessions_.all()) {
        const auto& proof = session.subject.proof;
        const auto end = proof ? proof->end() : std::nullopt;
        if (!end || session.isClosing()) continue;
        if (now < *end) {
            willEnd = true;
            continue;
        }
        activity_->record({"sign-in ended", proof->user, {}, {}});
        const char* const next = proof->issued
                                     ? " has ended. It is renewed when the program connects again; "
                                       "if that fails, run `usdlive login HOST:PORT`"
                                     : " has ended. `usdlive user token` prints another one";
        sessions_.close(session, {ErrorCode::SignInRequired,
                                  (proof->issued ? "the sign-in of " : "the token of ") +
                                      proof->user.value + next});
    }
    return willEnd;
}

void Project::Impl::disconnected(SessionId id) {
    const Session* session = sessions_.find(id);
    if (session && session->wasGreeted)
        activity_->record({"user left", session->subject.user, {}, session->application});
    sessions_.remove(id);
}

void Project::Impl::received(SessionId id, ByteView message) {
    Session* session = sessions_.find(id);
    if (!session || session->isClosing()) return;
    const auto frames = splitMessage(message, options_.maxFrameBytes);
    if (!frames) return sessions_.close(*session, frames.error());
    for (const ByteView frame : *frames) receiveFrame(id, frame);
}

void Project::Impl::receiveFrame(SessionId id, ByteView bytes) {
    Session* found = sessions_.find(id);
    if (!found || found->isClosing() || greeting_.hold(*found, bytes)) return;
    Session& session = *found;
    if (isCompact(bytes)) return receiveCompact(session, bytes);
    auto frame = decodeFrame(bytes);
    if (!frame) return sessions_.close(session, frame.error());
    const auto* control = std::get_if<ControlFrame>(&*frame);
    if (control) return receiveControl(session, control->json);
    if (!session.isGreeted())
        return sessions_.close(session, {ErrorCode::NotGreeted, "the first frame was not a hello"});
    std::visit(Overloaded{
                   [&](SubmitFrame& submitted) {
                       submissions_.receive(session, std::move(submitted), bytes.size());
                   },
                   [&](PreviewFrame& preview) {
                       gestures_.receive(session, std::move(preview), bytes.size());
                   },
                   [&](BlobFrame& part) {
                       if (const auto denied = access_.toBigValue(session.subject))
                           return sessions_.sendError(session, *denied, {}, part.hash);
                       values_.receive(session, std::move(part));
                   },
                   [&](auto&) {
                       sessions_.close(session, {ErrorCode::UnknownFrame,
                                                 "a frame of a kind that only the server sends"});
                   },
               },
               *frame);
}

/// FR20.
void Project::Impl::receiveCompact(Session& session, ByteView bytes) {
    if (!session.features.contains(kCompactFeature))
        return sessions_.close(session, {ErrorCode::UnknownFrame,
                                         "a compact frame in a session without this feature"});
    auto content = session.compact.read(bytes);
    if (!content) return sessions_.close(session, content.error());
    std::visit(Overloaded{
                   [](std::monostate) {},
                   [&](SubmitFrame& submitted) {
                       submitted.transaction.id.client = session.client;
                       const std::uint64_t size = leastFrameBytes(submitted.transaction.edits);
                       submissions_.receive(session, std::move(submitted),
                                            std::max<std::uint64_t>(bytes.size(), size));
                   },
                   [&](PreviewFrame& preview) {
                       gestures_.receive(session, std::move(preview), bytes.size());
                   },
                   [&](auto&) {
                       sessions_.close(session, {ErrorCode::UnknownFrame,
                                                 "a frame of a kind that only the server sends"});
                   },
               },
               *content);
}

void Project::Impl::receiveControl(Session& session, const std::string& json) {
    if (auto fits = checkClientControl(json); !fits) return sessions_.close(session, fits.error());
    const auto message = decodeControl(json);
    if (!message) return sessions_.close(session, message.error());
    const auto* hello = std::get_if<Hello>(&*message);
    if (hello && session.isGreeted())
        return sessions_.close(session, {ErrorCode::SecondHello, "a second hello"});
    if (hello) return greeting_.greet(session, *hello);
    if (!session.isGreeted())
        return sessions_.close(session, {ErrorCode::NotGreeted, "the first frame was not a hello"});
    constexpr std::size_t kRequestBytes = 256;  // in addition to its content
    const auto request = requestOf(*message);
    if (request && !sessions_.takeForRequest(session, *request, json.size() + kRequestBytes))
        return;
    receive(session, *message);
}

void Project::Impl::receive(Session& session, const ControlMessage& message) {
    std::visit(Overloaded{
                   [&](const ShowToken&) {
                       sessions_.close(session, {ErrorCode::MalformedControl,
                                                 "showToken is the first message of a session that "
                                                 "was requested with its subprotocol"});
                   },
                   [&](const OpenLayer& request) { openings_.open(session, request); },
                   [&](const KeepLayers& kept) { greeting_.keepOpen(session, kept.layers); },
                   [&](const CloseLayer& request) { sessions_.closeLayer(session, request.layer); },
                   [&](const ShowPresence& shown) { presences_.show(session, shown.presence); },
                   [&](const RequestBlob& request) { values_.request(session, request); },
                   [&](const SaveLayers& request) { saves_.request(session, request); },
                   [&](const ReloadLayers& request) { reloads_.request(session, request); },
                   [&](const RequestLog& request) { catchup_.sendLog(session, request); },
                   [&](const CreateLayer& request) { newLayers_.create(session, request); },
                   [&](const UploadFile& request) { newFiles_.upload(session, request); },
                   [&](const ListSkipped& request) { newLayers_.listSkipped(session, request); },
                   [&](const CreateCheckpoint& request) { checkpoints_.create(session, request); },
                   [&](const ListCheckpoints& request) { checkpoints_.list(session, request); },
                   [&](const CompactHistory& request) { compaction_.request(session, request); },
                   [&](const RequestStorage& request) { compaction_.measure(session, request); },
                   [&]<class Message>(const Message&) {
                       static_assert(!IsRequest<Message>, "every request needs its meaning here");
                       sessions_.close(session, {ErrorCode::MalformedControl,
                                                 "a message of a type that only the server sends"});
                   },
               },
               message);
}

}  // namespace usdlive::server
