// Passes the messages of sessions to the parts that handle them.
#include <utility>

#include "ProjectImpl.h"
#include "usdlive/common/core/Overloaded.h"

namespace usdlive::server {

void Project::Impl::connected(SessionId id) {
    Session& session = sessions_.add(id);
    if (sessions_.size() > options_.maxSessions)
        sessions_.close(session, {ErrorCode::TooManySessions,
                                  "the project has " + std::to_string(options_.maxSessions) +
                                      " sessions, which is the limit"});
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
                   [&](BlobFrame& part) { values_.receive(session, std::move(part)); },
                   [&](auto&) {
                       sessions_.close(session, {ErrorCode::UnknownFrame,
                                                 "a frame of a kind that only the server sends"});
                   },
               },
               *frame);
}

void Project::Impl::receiveControl(Session& session, const std::string& json) {
    const auto message = decodeControl(json);
    if (!message) return sessions_.close(session, message.error());
    const auto* hello = std::get_if<Hello>(&*message);
    if (hello && session.isGreeted())
        return sessions_.close(session, {ErrorCode::SecondHello, "a second hello"});
    if (hello) return greeting_.greet(session, *hello);
    if (!session.isGreeted())
        return sessions_.close(session, {ErrorCode::NotGreeted, "the first frame was not a hello"});
    receive(session, *message);
}

void Project::Impl::receive(Session& session, const ControlMessage& message) {
    std::visit(Overloaded{
                   [&](const OpenLayer& request) { openings_.open(session, request); },
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
