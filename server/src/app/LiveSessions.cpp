// Does what requests ask for with live sessions.
#include "app/LiveSessions.h"

#include <algorithm>
#include <boost/asio/post.hpp>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

namespace usdlive::server {

namespace asio = boost::asio;

namespace {

using Json = nlohmann::json;

constexpr unsigned kBadWish = 400, kForbidden = 403, kNoSuchSession = 404, kNotAsItIs = 409,
                   kServedLater = 503, kNoSpace = 507;

HttpReply sentence(unsigned status, const std::string& text) {
    return {"text/plain", text + "\n", status};
}

HttpReply json(const Json& content) {
    return {"application/json",
            content.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n"};
}

Json jsonOf(const LiveSessionRecord& record) {
    Json merges = Json::array();
    for (const LineMergeRecord& one : record.merges)
        merges.push_back({{"target", one.isIntoMain ? "main" : "session"},
                          {"from", one.from},
                          {"into", one.into},
                          {"client", one.client.value},
                          {"age", std::max<std::int64_t>(auditTime() - one.timeMs, 0)}});
    return {{"name", record.name},     {"creator", record.creator.value},
            {"time", record.timeMs},   {"revision", record.revision},
            {"begin", record.begin},   {"ended", record.isEnded},
            {"merged", record.merged}, {"merges", merges}};
}

unsigned statusOf(ErrorCode code) {
    switch (code) {
        case ErrorCode::InvalidArgument:
        case ErrorCode::HistoryReplaced:
        case ErrorCode::TransactionTooLarge:
            return kNotAsItIs;
        case ErrorCode::LayerNotFound:
            return kNoSuchSession;
        case ErrorCode::StorageFull:
            return kNoSpace;
        default:
            return kServedLater;
    }
}

/// Error: InvalidArgument or LayerNotFound says what to do.
Result<LiveSessionRecord> recordOf(const LiveSessionFolder& folder, const std::string& name,
                                   bool isEnded) {
    for (LiveSessionRecord& one : folder.list()) {
        if (one.name != name) continue;
        if (one.isEnded == isEnded) return std::move(one);
        return fail(ErrorCode::InvalidArgument,
                    isEnded ? "the live session " + name + " is in use: end it first"
                            : "the live session " + name + " was ended already");
    }
    return fail(ErrorCode::LayerNotFound, "the project has no live session " + name);
}

/// Writes whether a live session is ended. `merged`: see LiveSessionRecord; 0: as it was.
Result<LiveSessionRecord> rewritten(const LiveSessionFolder& folder, const std::string& name,
                                    bool isEnded, Revision merged) {
    auto record = recordOf(folder, name, !isEnded);
    if (!record) return record;
    record->isEnded = isEnded;
    if (merged > 0) record->merged = merged;
    if (auto written = folder.write(*record); !written) return tl::unexpected(written.error());
    return record;
}

/// Notes a merge that is about to be committed. Error: InvalidArgument if another one was noted
/// meanwhile, or too many.
Result<LiveSessionRecord> withMerge(const LiveSessionFolder& folder,
                                    const LiveSessions::Wanted& wanted) {
    auto record = recordOf(folder, wanted.name, false);
    if (!record) return record;
    if (record->merges.size() != wanted.known)
        return fail(ErrorCode::InvalidArgument,
                    "somebody else has merged or updated the live "
                    "session " +
                        wanted.name + " meanwhile; try again");
    if (record->merges.size() >= LiveSessionFolder::kMostMerges)
        return fail(ErrorCode::InvalidArgument, "the live session " + wanted.name +
                                                    " was merged and updated " +
                                                    std::to_string(LiveSessionFolder::kMostMerges) +
                                                    " times; end it, and create another one");
    record->merges.push_back(wanted.merge);
    record->merges.back().timeMs = auditTime();
    if (auto written = folder.write(*record); !written) return tl::unexpected(written.error());
    return record;
}

}  // namespace

struct LiveSessions::Change {
    ProjectPlace place;  // that of the live session
    LiveSessionFolder folder;
    Wanted wanted;
    Asking asking;
    HttpAnswer answer;
};

LiveSessions::LiveSessions(asio::io_context& io, Projects& projects, Workers& workers,
                           AuditLog& audit, Log& log)
    : io_(io), projects_(projects), audit_(audit), log_(log), workers_(workers.history.share()) {}

LiveSessions::~LiveSessions() { life_.reset(); }

template <class Work, class Then>
void LiveSessions::inBackground(Work work, Then then) {
    workers_->post([io = &io_, weak = std::weak_ptr(life_), work = std::move(work),
                    then = std::move(then)]() mutable {
        asio::post(*io, [weak, then = std::move(then), done = work()]() mutable {
            if (!weak.expired()) then(std::move(done));
        });
    });
}

HttpPage LiveSessions::list(const ServedProject& project) {
    return [this, place = project.place()](const HttpAnswer& answer) {
        inBackground([folder = LiveSessionFolder(place.folder)] { return folder.list(); },
                     [this, place, answer](const std::vector<LiveSessionRecord>& records) {
                         answerList(place, records, answer);
                     });
    };
}

void LiveSessions::answerList(const ProjectPlace& place,
                              const std::vector<LiveSessionRecord>& records,
                              const HttpAnswer& answer) {
    Json all = Json::array();
    std::vector<ServedProject*> served;
    for (const LiveSessionRecord& record : records) {
        Json one = jsonOf(record);
        ProjectPlace its = place;
        its.liveSession = record.name;
        one["project"] = its.name();
        ServedProject* const project = projects_.find(its.name());
        const auto status = project ? project->status() : ServedProject::Status();
        one["served"] = status.state == ServedProject::State::Serving;
        one["users"] = Json::array();
        if (one["served"]) served.push_back(project);
        if (status.error) one["error"] = project->texts()(*status.error).message;
        all.push_back(std::move(one));
    }
    gatherReports(io_, served, false,
                  [all = std::move(all), place, answer](const ProjectReports& reports) mutable {
                      std::map<std::string, Json> users;
                      for (const auto& [name, report] : reports)
                          for (const UserName& user : report.users)
                              users[name].push_back(user.value);
                      for (Json& one : all)
                          if (const auto found = users.find(one["project"]); found != users.end())
                              one["users"] = std::move(found->second);
                      answer(json({{"project", place.project}, {"sessions", all}}));
                  });
}

HttpRoute LiveSessions::change(const ServedProject& project, const Wanted& wanted,
                               const Asking& asking) {
    using Do = void (LiveSessions::*)(const ChangePtr&);
    const Do run = wanted.verb == "create"       ? &LiveSessions::create
                   : wanted.verb == "end"        ? &LiveSessions::end
                   : wanted.verb == "restore"    ? &LiveSessions::restore
                   : wanted.verb == "delete"     ? &LiveSessions::remove
                   : wanted.verb == "note-merge" ? &LiveSessions::noteMerge
                                                 : nullptr;
    if (!run) return sentence(kNoSuchSession, "a live session cannot " + wanted.verb);
    if (const auto valid = LiveSessionFolder::checkName(wanted.name); !valid)
        return sentence(kBadWish, valid.error().message);
    if (asking.role < Role::Editor)
        return sentence(kForbidden, asking.user.value + " is a " +
                                        std::string(kRoleNames[std::size_t(asking.role)]) +
                                        " here; an editor can " + wanted.verb + " live sessions");
    ProjectPlace place = project.place();
    place.liveSession = wanted.name;
    const auto change = std::make_shared<Change>(
        Change{place, LiveSessionFolder(place.folder), wanted, asking, {}});
    return HttpAction{[this, change, run](const HttpAnswer& answer) {
        change->answer = answer;
        if (changing_.insert(change->place.name()).second) return (this->*run)(change);
        answer(sentence(kNotAsItIs, "somebody changes this live session; try again"));
    }};
}

void LiveSessions::create(const ChangePtr& change) {
    LiveSessionRecord wanted;
    wanted.name = change->wanted.name;
    wanted.creator = change->asking.user;
    wanted.timeMs = auditTime();
    wanted.revision = change->wanted.from;
    ServedProject* const project = projects_.find(change->place.project);
    if (!project) return finish(change, fail(ErrorCode::ShuttingDown, "the project was closed"));
    project->branch(wanted, [this, weak = std::weak_ptr(life_), io = &io_,
                             change](Result<LiveSessionRecord> made) {
        asio::post(*io, [this, weak, change, made = std::move(made)] {
            if (!weak.expired()) open(change, made);
        });
    });
}

/// Serves a live session that is on the disk.
void LiveSessions::open(const ChangePtr& change, const Result<LiveSessionRecord>& record) {
    const ServedProject* const project = projects_.find(change->place.project);
    if (!record || !project) return finish(change, record);
    projects_.openLiveSession(*project, change->wanted.name,
                              [this, change, record](const Result<void>& opened) {
                                  if (opened) return finish(change, record);
                                  finish(change, tl::unexpected(opened.error()));
                              });
}

void LiveSessions::end(const ChangePtr& change) {
    inBackground(
        [change] {
            return rewritten(change->folder, change->wanted.name, true, change->wanted.merged);
        },
        [this, change](const Result<LiveSessionRecord>& ended) {
            if (!ended) return finish(change, ended);
            projects_.closeLiveSession(change->place.name(),
                                       [this, change, ended] { finish(change, ended); });
        });
}

void LiveSessions::restore(const ChangePtr& change) {
    inBackground(
        [change] { return rewritten(change->folder, change->wanted.name, false, 0); },
        [this, change](const Result<LiveSessionRecord>& restored) { open(change, restored); });
}

void LiveSessions::remove(const ChangePtr& change) {
    inBackground(
        [change]() -> Result<LiveSessionRecord> {
            auto record = recordOf(change->folder, change->wanted.name, true);
            if (!record) return record;
            const Asking& asking = change->asking;
            if (asking.role < Role::Admin && asking.user != record->creator)
                return fail(ErrorCode::InvalidArgument,
                            "only " + record->creator.value +
                                ", who has created it, and administrators can delete the live "
                                "session " +
                                record->name);
            if (auto removed = change->folder.remove(record->name); !removed)
                return tl::unexpected(removed.error());
            return record;
        },
        [this, change](const Result<LiveSessionRecord>& removed) { finish(change, removed); });
}

void LiveSessions::noteMerge(const ChangePtr& change) {
    inBackground([change] { return withMerge(change->folder, change->wanted); },
                 [this, change](const Result<LiveSessionRecord>& noted) { finish(change, noted); });
}

void LiveSessions::finish(const ChangePtr& change, const Result<LiveSessionRecord>& done) {
    changing_.erase(change->place.name());
    const auto& [place, folder, wanted, asking, answer] = *change;
    if (!done) {
        log_.write(LogLevel::Warning, "live session not changed",
                   {{"project", place.project},
                    {"session", wanted.name},
                    {"verb", wanted.verb},
                    {"error", done.error().message}});
        return answer(sentence(statusOf(done.error().code), done.error().message));
    }
    const char* const event = wanted.verb == "create"    ? "live session created"
                              : wanted.verb == "end"     ? "live session ended"
                              : wanted.verb == "restore" ? "live session restored"
                              : wanted.verb == "delete"  ? "live session deleted"
                              : wanted.merge.isIntoMain  ? "live session merged"
                                                         : "live session updated";
    log_.write(LogLevel::Info, event,
               {{"project", place.project}, {"session", wanted.name}, {"user", asking.user.value}});
    audit_.record({.event = event,
                   .user = asking.user.value,
                   .from = asking.peer,
                   .project = place.project,
                   .detail = wanted.name});
    Json reply = jsonOf(*done);
    reply["project"] = place.name();
    answer(json(reply));
}

}  // namespace usdlive::server
