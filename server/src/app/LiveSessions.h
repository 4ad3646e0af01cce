// Requests over HTTP about the live sessions of projects.
#pragma once

#include <boost/asio/io_context.hpp>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "app/AuditLog.h"
#include "app/LiveSessionFolder.h"
#include "app/ProjectReports.h"
#include "app/Projects.h"
#include "app/Workers.h"
#include "transport/HttpServer.h"
#include "transport/Log.h"

namespace usdlive::server {

/// Lists, creates, ends, restores and deletes live sessions, and notes their merges (LV3-LV5, LV7).
/// One request at a time changes a live session. Belongs to the thread that runs `io`.
class LiveSessions {
public:
    /// The user who asks. Without sign-in everybody may do everything, and the name is a claimed
    /// one.
    struct Asking {
        UserName user;
        Role role = Role::Admin;
        std::string peer;
    };
    struct Wanted {
        std::string name, verb;  ///< decoded
        Revision merged = 0;     ///< for `end`: the revision of the main line; 0: none
        Revision from = 0;       ///< for `create`: the revision of the main line; 0: the newest
        LineMergeRecord merge;   ///< for `note-merge`, without its time
        std::size_t known = 0;   ///< for `note-merge`: how many merges the one who asks knows
    };

    /// The other objects must outlive this one.
    LiveSessions(boost::asio::io_context& io, Projects& projects, Workers& workers, AuditLog& audit,
                 Log& log);
    ~LiveSessions();

    /// Answers with all live sessions of a project.
    [[nodiscard]] HttpPage list(const ServedProject& project);
    /// Returns a reply if the request cannot be done, else what does it.
    [[nodiscard]] HttpRoute change(const ServedProject& project, const Wanted& wanted,
                                   const Asking& asking);

private:
    struct Change;
    using ChangePtr = std::shared_ptr<Change>;

    void answerList(const ProjectPlace& place, const std::vector<LiveSessionRecord>& records,
                    const HttpAnswer& answer);
    void create(const ChangePtr& change);
    void open(const ChangePtr& change, const Result<LiveSessionRecord>& record);
    void end(const ChangePtr& change);
    void restore(const ChangePtr& change);
    void remove(const ChangePtr& change);
    void noteMerge(const ChangePtr& change);
    /// Runs `work` on a worker, and `then` with its result on this thread.
    template <class Work, class Then>
    void inBackground(Work work, Then then);
    void finish(const ChangePtr& change, const Result<LiveSessionRecord>& done);

    boost::asio::io_context& io_;
    Projects& projects_;
    AuditLog& audit_;
    Log& log_;
    const std::shared_ptr<WorkerShare> workers_;
    std::set<std::string> changing_;  ///< names of live sessions, as ProjectPlace::name()
    std::shared_ptr<int> life_ = std::make_shared<int>();
};

}  // namespace usdlive::server
