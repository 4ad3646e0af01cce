// The live sessions of a project, for programs.
#include "usdlive/client/lines/ProjectSessions.h"

#include <utility>

#include "lines/LineLink.h"
#include "lines/SessionMerge.h"
#include "link/Destination.h"

namespace usdlive::client {

namespace {

constexpr double kCheckpointConnectMs = 10'000;

}  // namespace

struct ProjectSessions::Place {
    ServerAddress server;
    UserName user;

    [[nodiscard]] SessionInfo info(const ListedLiveSession& one) const {
        SessionInfo info{one.name,      liveSessionAddress(server, one.name).url(),
                         {one.creator}, one.timeMs,
                         one.revision,  one.isEnded,
                         one.merged,    one.error};
        for (const std::string& user : one.users) info.users.push_back({user});
        return info;
    }
    [[nodiscard]] Result<SessionInfo> change(const std::string& name, std::string_view verb,
                                             Revision revision = 0) const {
        return changeLiveSession(server, name, verb, user, kSessionRequestTime, revision)
            .map([&](const ListedLiveSession& one) { return info(one); });
    }
    [[nodiscard]] Result<Revision> revisionOf(const std::string& checkpoint) const {
        const auto link = LineLink::connect(server, user, kCheckpointConnectMs);
        if (!link) return tl::unexpected(link.error());
        const auto all = (*link)->ask(ListCheckpoints{});
        if (!all) return tl::unexpected(all.error());
        for (const Checkpoint& one : all->checkpoints)
            if (one.name == checkpoint) return one.revision;
        return fail(ErrorCode::InvalidArgument,
                    "the project has no checkpoint \"" + checkpoint + "\"");
    }
    [[nodiscard]] Result<SessionMerged> merge(SessionMerge::Target target, const std::string& name,
                                              const SessionMergeOptions& options) const {
        SessionMerge merging({server, name, user, target, options});
        auto merged = merging.run();
        if (!merged || options.isDryRun) return merged;
        if (merged->undecided > 0)
            return tl::unexpected(undecidedConflicts(
                merged->undecided, "A dry run lists the conflicts; say which line counts"));
        if (target == SessionMerge::Target::Session || options.isKept) return merged;
        if (auto ended = merging.end(); !ended) return tl::unexpected(ended.error());
        return merged;
    }
};

Result<ProjectSessions> ProjectSessions::at(const std::string& address, const std::string& user,
                                            const std::string& token) {
    auto found = destinationOf(address, user, token);
    if (!found) return tl::unexpected(found.error());
    return ProjectSessions(std::make_shared<const Place>(
        Place{mainLineAddress(found->address), std::move(found->user)}));
}

Result<std::vector<SessionInfo>> ProjectSessions::list() const {
    const auto all = listLiveSessions(place_->server, kSessionRequestTime);
    if (!all) return tl::unexpected(all.error());
    std::vector<SessionInfo> infos;
    for (const ListedLiveSession& one : *all) infos.push_back(place_->info(one));
    return infos;
}

Result<SessionInfo> ProjectSessions::create(const std::string& name, Revision from) const {
    return place_->change(name, "create", from);
}

Result<SessionInfo> ProjectSessions::createFrom(const std::string& name,
                                                const std::string& checkpoint) const {
    const auto revision = place_->revisionOf(checkpoint);
    if (!revision) return tl::unexpected(revision.error());
    return create(name, *revision);
}

Result<SessionInfo> ProjectSessions::end(const std::string& name) const {
    return place_->change(name, "end");
}

Result<SessionInfo> ProjectSessions::restore(const std::string& name) const {
    return place_->change(name, "restore");
}

Result<SessionInfo> ProjectSessions::remove(const std::string& name) const {
    return place_->change(name, "delete");
}

Result<SessionMerged> ProjectSessions::merge(const std::string& name,
                                             const SessionMergeOptions& options) const {
    return place_->merge(SessionMerge::Target::Main, name, options);
}

Result<SessionMerged> ProjectSessions::update(const std::string& name,
                                              const SessionMergeOptions& options) const {
    return place_->merge(SessionMerge::Target::Session, name, options);
}

}  // namespace usdlive::client
