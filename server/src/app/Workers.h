// The lanes of workers: of the process, and a project's shares of them.
#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <thread>

#include "app/WorkerLane.h"

namespace usdlive::server {

/// The threads of the process for blocking work, grouped by how long it may take. The groups do not
/// wait for each other.
class Workers {
public:
    /// Throws ThreadRefused. `log` must outlive this object.
    explicit Workers(Log& log)
        : joins({"joins", most()}, log),
          files({"files", most()}, log),
          history({"history", most()}, log),
          downloads({"downloads", most()}, log),
          keeper({"keeper", kKeepers, kKeeperNice}, log) {}

    /// Quick work that users wait for: stored layers, commits for resuming sessions, parts of big
    /// values, and the sources of transports.
    WorkerLane joins;
    /// Imports, saves and other work with the files of projects.
    WorkerLane files;
    /// Layers at old revisions, checkpoints, and snapshots, which no user waits for.
    WorkerLane history;
    /// Parts of files that are downloaded over HTTP.
    WorkerLane downloads;
    /// Jobs without a waiting user that read a whole history. They have a low priority.
    WorkerLane keeper;

private:
    static constexpr std::size_t kKeepers = 4;
    static constexpr int kKeeperNice = 10;
    /// Also on a small machine a few projects whose disk does not answer delay no other.
    static std::size_t most() {
        constexpr std::size_t kLeast = 8, kMost = 32;
        return std::clamp(std::size_t(std::thread::hardware_concurrency()), kLeast, kMost);
    }
};

/// A project's shares of the workers.
struct WorkerShares {
    explicit WorkerShares(Workers& workers)
        : joins(workers.joins.share()),
          files(workers.files.share()),
          history(workers.history.share()),
          downloads(workers.downloads.share()),
          keeper(workers.keeper.share()) {}

    std::shared_ptr<WorkerShare> joins, files, history;
    /// Replies that are being sent keep a weak pointer to `downloads`, because they may outlast the
    /// project.
    std::shared_ptr<WorkerShare> downloads, keeper;

    /// Finishes running jobs and drops the rest.
    void stop() {
        for (const auto& share : {joins, files, history, downloads, keeper}) share->stop();
    }
};

}  // namespace usdlive::server
