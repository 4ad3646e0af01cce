#pragma once

#include <boost/asio/thread_pool.hpp>

namespace usdlive::server {

/// The threads that block for the project, by how long somebody may have to wait for them.
struct WorkerLanes {
    /// Layers that the store has, commits for who resumes, parts of big values, what transports
    /// send: quick, and people wait for it.
    boost::asio::thread_pool joins{2};
    /// Imports, saves and whatever else reads and writes the project's files.
    boost::asio::thread_pool files{2};
    /// Layers as they were, checkpoints; snapshots, which nobody waits for.
    boost::asio::thread_pool history{2};

    /// Ends what is at work and drops the rest.
    void stop() {
        for (boost::asio::thread_pool* lane : {&joins, &files, &history}) lane->stop();
        for (boost::asio::thread_pool* lane : {&joins, &files, &history}) lane->join();
    }
};

}  // namespace usdlive::server
