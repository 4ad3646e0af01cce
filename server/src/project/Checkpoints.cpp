// Named revisions (CP1, CP2).
#include <algorithm>
#include <utility>

#include "ProjectImpl.h"

namespace usdlive::server {

namespace {

constexpr std::size_t kMaxNameBytes = 200;
constexpr std::size_t kMaxWaiting = 1'000;  // for their revision to be durable, of all sessions

bool isName(const std::string& name) {
    const auto isControl = [](unsigned char byte) { return byte < 0x20 || byte == 0x7f; };
    return !name.empty() && name.size() <= kMaxNameBytes && std::ranges::none_of(name, isControl);
}

}  // namespace

void Project::Impl::createCheckpoint(Session& session, const CreateCheckpoint& request) {
    if (readyCheckpoints_.size() >= kMaxWaiting)
        return close(session, {ErrorCode::MalformedControl, "too many requests at once"});
    if (!isName(request.name))
        return sendError(session,
                         {ErrorCode::InvalidArgument, "a checkpoint's name is 1 to " +
                                                          std::to_string(kMaxNameBytes) +
                                                          " bytes without control characters"},
                         request.request);
    if (executed_ == 0)
        return sendError(
            session,
            {ErrorCode::InvalidArgument, "there is nothing to name yet: nobody has opened a layer"},
            request.request);
    const auto now = std::uint64_t(std::max<std::int64_t>(ports_.clock.wallClockMs(), 0));
    readyCheckpoints_.push_back(
        {session.id, request.request, {request.name, executed_, session.subject.user, now}});
    storeCheckpoints();
}

/// Those whose revision is durable.
void Project::Impl::storeCheckpoints() {
    while (!readyCheckpoints_.empty() &&
           readyCheckpoints_.front().checkpoint.revision <= durable_) {
        const ReadyCheckpoint ready = std::move(readyCheckpoints_.front());
        readyCheckpoints_.pop_front();
        ports_.history.addCheckpoint(ready.session, ready.request, ready.checkpoint);
    }
}

/// Of those that are left: their revision is taken back.
void Project::Impl::loseCheckpoints(const Error& error) {
    storeCheckpoints();
    for (const ReadyCheckpoint& lost : std::exchange(readyCheckpoints_, {}))
        if (Session* session = find(lost.session)) sendError(*session, error, lost.request);
}

void Project::Impl::checkpointAdded(SessionId id, std::uint64_t request,
                                    const Result<Checkpoint>& added) {
    if (added) ports_.activity.happened({"checkpoint made", added->user, {}, added->name});
    Session* session = find(id);
    if (!session || !session->isGreeted()) return;
    if (added)
        send(*session, CheckpointCreated{request, *added});
    else
        sendError(*session, added.error(), request);
}

void Project::Impl::checkpointsRead(SessionId id, std::uint64_t request,
                                    Result<std::vector<Checkpoint>> read) {
    Session* session = find(id);
    if (!session || !session->isGreeted()) return;
    if (!read) return sendError(*session, read.error(), request);
    std::ranges::sort(*read, {}, [](const Checkpoint& one) {
        return std::pair<Revision, const std::string&>(one.revision, one.name);
    });
    send(*session, Checkpoints{request, std::move(*read)});
}

}  // namespace usdlive::server
