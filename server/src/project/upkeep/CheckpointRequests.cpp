// Stores checkpoints and lists them.
#include "project/upkeep/CheckpointRequests.h"

#include <algorithm>
#include <utility>

#include "usdlive/common/protocol/Requests.h"

namespace usdlive::server {

namespace {

// A user may make so many checkpoints at once, and one more after each pause.
constexpr std::int64_t kMostCheckpoints = 1'000, kCheckpointPauseMs = 6'000;

bool isName(const std::string& name) {
    const auto isControl = [](unsigned char byte) { return byte < 0x20 || byte == 0x7f; };
    return !name.empty() && name.size() <= kMaxCheckpointNameBytes &&
           std::ranges::none_of(name, isControl);
}

}  // namespace

std::optional<Error> CheckpointRequests::objection(const Session& session,
                                                   const std::string& name) const {
    if (!isName(name))
        return Error{ErrorCode::InvalidArgument, "a checkpoint's name is 1 to " +
                                                     std::to_string(kMaxCheckpointNameBytes) +
                                                     " bytes without control characters"};
    if (auto denied = access_->toAction(session.subject, ProjectAction::Checkpoint, {},
                                        "create the checkpoint " + name))
        return denied;
    if (line_->executed() == 0)
        return Error{ErrorCode::InvalidArgument,
                     "the project has no commit yet: open a layer first"};
    return std::nullopt;
}

bool CheckpointRequests::takeAllowance(const std::string& share) {
    const std::int64_t now = clock_->steadyMs();
    const auto [found, isNew] = allowances_.try_emplace(share, Allowance{kMostCheckpoints, now});
    Allowance& allowance = found->second;
    const std::int64_t pauses = (now - allowance.grownMs) / kCheckpointPauseMs;
    allowance.left = std::min(allowance.left + pauses, kMostCheckpoints);
    allowance.grownMs += pauses * kCheckpointPauseMs;
    if (allowance.left == 0) return false;
    --allowance.left;
    return true;
}

void CheckpointRequests::create(Session& session, const CreateCheckpoint& request) {
    auto error = objection(session, request.name);
    if (!error && !takeAllowance(session.share))
        error = Error{ErrorCode::TooManyRequests,
                      session.subject.user.value + " has made " + std::to_string(kMostCheckpoints) +
                          " checkpoints in a short time; try again in " +
                          std::to_string(kCheckpointPauseMs / 1'000) + " s"};
    if (error) {
        activity_->record({"checkpoint refused", session.subject.user, {}, error->message});
        return sessions_->sendError(session, *error, request.request);
    }
    const auto now = std::uint64_t(std::max<std::int64_t>(time_->nowMs(), 0));
    pending_.push_back({session.id,
                        request.request,
                        {request.name, line_->executed(), session.subject.user, now}});
    becameDurable(line_->durable());
}

void CheckpointRequests::list(const Session& session, const ListCheckpoints& request) {
    history_->readCheckpoints(session.id, request.request);
}

void CheckpointRequests::becameDurable(Revision upTo) {
    while (!pending_.empty() && pending_.front().checkpoint.revision <= upTo) {
        const Pending pending = std::move(pending_.front());
        pending_.pop_front();
        history_->addCheckpoint(pending.session, pending.request, pending.checkpoint);
    }
}

void CheckpointRequests::rolledBack(const Error& error, const LostCommits& /*lost*/) {
    becameDurable(line_->durable());
    for (const Pending& lost : std::exchange(pending_, {}))
        if (const Session* session = sessions_->greeted(lost.session))
            sessions_->sendError(*session, error, lost.request);
}

void CheckpointRequests::added(SessionId id, std::uint64_t request,
                               const Result<Checkpoint>& added) {
    if (added) activity_->record({"checkpoint made", added->user, {}, added->name});
    const Session* session = sessions_->greeted(id);
    if (!session) return;
    if (added)
        sessions_->send(*session, CheckpointCreated{request, *added});
    else
        sessions_->sendError(*session, added.error(), request);
}

void CheckpointRequests::listed(SessionId id, std::uint64_t request,
                                Result<std::vector<Checkpoint>> read) {
    const Session* session = sessions_->greeted(id);
    if (!session) return;
    if (!read) return sessions_->sendError(*session, read.error(), request);
    std::ranges::sort(*read, {}, [](const Checkpoint& one) {
        return std::pair<Revision, const std::string&>(one.revision, one.name);
    });
    sessions_->send(*session, Checkpoints{request, std::move(*read)});
}

}  // namespace usdlive::server
