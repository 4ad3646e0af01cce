// The strand of a project and the return path of its blocking work.
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <utility>

#include "app/Intake.h"
#include "project/Project.h"

namespace usdlive::server {

/// Returns the result of `work`, or its exception as an error.
template <class Work>
auto resultOf(Work& work) -> decltype(work()) {
    try {
        return work();
    } catch (const std::exception& fault) {
        return fail(ErrorCode::Internal, fault.what());
    }
}

/// A project on its strand, the network thread, and the return path for blocking work. Drops
/// results that were requested by a project that has since been replaced.
class ProjectStrand {
public:
    /// `fault` is called when the project throws outside a session's message.
    ProjectStrand(boost::asio::io_context& network, Intake& intake,
                  std::function<void(const std::exception&)> fault)
        : network_(network), intake_(intake), fault_(std::move(fault)) {}

    // Call these on the network thread.
    /// Returns nullptr while the project is being created again.
    [[nodiscard]] Project* project() const { return project_.get(); }
    void set(std::unique_ptr<Project> project) { project_ = std::move(project); }
    /// Removes the project. Results that it requested are dropped.
    void reset() {
        project_.reset();
        ++generation_;
    }
    /// Calls `function(Project&)` if there is a project.
    template <class Function>
    void use(Function&& function) {
        try {
            if (project_) function(*project_);
        } catch (const std::exception& fault) {
            fault_(fault);
        }
    }
    /// Runs `work()`, which returns a Result, as a job of `workers`, a WorkerShare or SerialJobs,
    /// then calls `function(Project&, result)` here. Counts as `bytes` of the session's share until
    /// then.
    template <class Jobs, class Work, class Function>
    void inBackground(Jobs& workers, SessionId session, std::size_t bytes, Work work,
                      Function function) {
        intake_.begin(session, bytes);
        workers.post([this, session, bytes, generation = generation_, work = std::move(work),
                      function = std::move(function)]() mutable {
            const auto begin = std::chrono::steady_clock::now();
            auto result = resultOf(work);
            const auto time = std::chrono::steady_clock::now() - begin;
            boost::asio::post(
                network_, [this, session, bytes, time, generation, function = std::move(function),
                           result = std::move(result)]() mutable {
                    intake_.end(session, bytes, time);
                    if (generation != generation_) return;
                    use([&](Project& project) { function(project, std::move(result)); });
                });
        });
    }

    /// Calls `function(Project&)` on the network thread, with the project of that moment. May be
    /// called from any thread.
    template <class Function>
    void post(Function function) {
        boost::asio::post(network_,
                          [this, function = std::move(function)]() mutable { use(function); });
    }

private:
    boost::asio::io_context& network_;
    Intake& intake_;
    const std::function<void(const std::exception&)> fault_;
    std::unique_ptr<Project> project_;
    std::uint64_t generation_ = 0;
};

}  // namespace usdlive::server
