// The threads for a project's blocking work.
#pragma once

#include <array>
#include <boost/asio/thread_pool.hpp>
#include <memory>

namespace usdlive::server {

/// The threads for a project's blocking work, grouped by how long it may take.
struct WorkerLanes {
    /// Quick work that users wait for: stored layers, commits for resuming sessions, parts of big
    /// values, and the sources of transports.
    boost::asio::thread_pool joins{2};
    /// Imports, saves and other work with the project's files.
    boost::asio::thread_pool files{2};
    /// Layers at old revisions, checkpoints, and snapshots, which no user waits for.
    boost::asio::thread_pool history{2};

    /// Parts of files that are downloaded over HTTP. Downloads keep a weak pointer, because they
    /// may outlast the project.
    std::shared_ptr<boost::asio::thread_pool> downloads =
        std::make_shared<boost::asio::thread_pool>(2);

    /// Finishes running jobs and drops the rest.
    void stop() {
        const std::array all{&joins, &files, &history, downloads.get()};
        for (boost::asio::thread_pool* lane : all) lane->stop();
        for (boost::asio::thread_pool* lane : all) lane->join();
    }
};

}  // namespace usdlive::server
