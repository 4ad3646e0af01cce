// Tests how projects share the threads of a lane.
#include "app/WorkerLane.h"

#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <future>
#include <latch>
#include <optional>
#include <random>
#include <stdexcept>

namespace usdlive::server {

namespace {

using namespace std::chrono_literals;

struct CountingLog : Log {
    void write(LogLevel, std::string_view, std::initializer_list<LogField>) override { ++events; }
    std::atomic<int> events = 0;
};

class WorkerLaneTest : public testing::Test {
protected:
    /// Posts a job that ends when release() is called.
    void block(WorkerShare& share) {
        share.post([this, released = released_] {
            ++blocked_;
            blocked_.notify_all();
            released.wait();
        });
    }
    void waitForBlocked(int count) {
        for (int now = blocked_; now != count; now = blocked_) blocked_.wait(now);
    }
    void release() { release_.set_value(); }
    /// Returns whether a job of the share runs to its end now.
    static bool runs(WorkerShare& share, std::chrono::milliseconds time = 20s) {
        const auto done = std::make_shared<std::promise<void>>();
        share.post([done] { done->set_value(); });
        return done->get_future().wait_for(time) == std::future_status::ready;
    }

    CountingLog log_;
    std::promise<void> release_;
    const std::shared_future<void> released_ = release_.get_future().share();
    std::atomic<int> blocked_ = 0;
};

TEST_F(WorkerLaneTest, ABusyProjectLeavesAThreadToTheOthers) {
    for (const std::size_t threads : {2u, 3u, 8u}) {
        SCOPED_TRACE(threads);
        WorkerLane lane({"test", threads}, log_);
        const auto busy = lane.share(), other = lane.share();
        std::promise<void> release;
        const auto released = release.get_future().share();
        for (int job = 0; job < 20; ++job) busy->post([released] { released.wait(); });
        EXPECT_TRUE(runs(*other));
        release.set_value();
    }
}

TEST_F(WorkerLaneTest, EveryProjectRunsAJobWhileThereAreThreads) {
    WorkerLane lane({"test", 4}, log_);
    const auto one = lane.share(), two = lane.share(), three = lane.share(), four = lane.share();
    for (int job = 0; job < 5; ++job)
        for (const auto& share : {one, two, three}) block(*share);
    waitForBlocked(3);
    EXPECT_TRUE(runs(*four));
    EXPECT_EQ(blocked_, 3);
    EXPECT_EQ(lane.threads(), 4u);
    release();
}

TEST_F(WorkerLaneTest, AProjectRunsTwoJobsAtOnce) {
    WorkerLane lane({"test", 8}, log_);
    const auto share = lane.share();
    for (int job = 0; job < 5; ++job) block(*share);
    waitForBlocked(2);
    EXPECT_FALSE(runs(*share, 20ms));
    EXPECT_EQ(blocked_, 2);
    release();
}

TEST_F(WorkerLaneTest, TheNextJobIsOneOfTheProjectThatWaitsLongest) {
    WorkerLane lane({"test", 1}, log_);
    const auto first = lane.share(), second = lane.share(), third = lane.share();
    std::string order;
    std::latch done(7);
    block(*first);
    waitForBlocked(1);
    const auto add = [&](WorkerShare& share, char name) {
        share.post([&order, &done, name] {
            order += name;
            done.count_down();
        });
    };
    for (int job = 0; job < 4; ++job) add(*first, '1');
    for (int job = 0; job < 2; ++job) add(*second, '2');
    add(*third, '3');
    release();
    done.wait();
    EXPECT_EQ(order, "2312111");
}

TEST_F(WorkerLaneTest, StopWaitsForRunningJobsAndDropsTheOthers) {
    WorkerLane lane({"test", 2}, log_);
    const auto share = lane.share(), other = lane.share();
    std::atomic<bool> hasEnded = false, hasRun = false;
    auto token = std::make_shared<int>();
    const std::weak_ptr<int> waiting = token;
    share->post([&] {
        ++blocked_;
        blocked_.notify_all();
        released_.wait();
        std::this_thread::sleep_for(10ms);  // stop() must still wait
        hasEnded = true;
    });
    waitForBlocked(1);
    SerialJobs serial(share);
    for (int job = 0; job < 3; ++job) serial.post([&] { hasRun = true; });
    share->post([&, token = std::move(token)] { hasRun = true; });
    std::thread stopping([&] { share->stop(); });
    while (!waiting.expired()) std::this_thread::yield();
    release();
    stopping.join();
    EXPECT_TRUE(hasEnded);
    share->post([&] { hasRun = true; });
    serial.post([&] { hasRun = true; });
    EXPECT_TRUE(runs(*other));
    EXPECT_FALSE(hasRun);
}

TEST_F(WorkerLaneTest, AJobThatThrowsEndsNothing) {
    WorkerLane lane({"test", 1}, log_);
    const auto share = lane.share();
    SerialJobs serial(share);
    serial.post([] { throw std::runtime_error("a job"); });
    std::promise<void> done;
    serial.post([&] { done.set_value(); });
    done.get_future().wait();
    EXPECT_EQ(log_.events, 1);
    share->stop();
}

// Random jobs of random projects: each runs once, the serial ones in order, and the limits hold.
TEST_F(WorkerLaneTest, EachJobRunsOnceWithinTheLimits) {
    for (unsigned seed = 0; seed < 20; ++seed) {
        SCOPED_TRACE(seed);
        std::mt19937 random{seed};
        const std::size_t threads = 1 + random() % 6;
        constexpr int kProjects = 8, kJobs = 400;
        struct Project {
            std::shared_ptr<WorkerShare> share;
            std::optional<SerialJobs> serial;
            std::atomic<int> running = 0, done = 0;
            int nextSerial = 0, posted = 0, serialPosted = 0;
        };
        std::atomic<int> running = 0;
        std::atomic<bool> isWithin = true;
        WorkerLane lane({"test", threads}, log_);
        std::array<Project, kProjects> projects;
        for (Project& project : projects) {
            project.share = lane.share();
            project.serial.emplace(project.share);
        }
        std::latch done(kJobs);
        for (int job = 0; job < kJobs; ++job) {
            Project& project = projects[random() % kProjects];
            const auto work = [&, pause = random() % 4] {
                if (++project.running > int(WorkerLane::kMostAtOnce) || ++running > int(threads))
                    isWithin = false;
                if (pause == 0) std::this_thread::sleep_for(100us);
                --running;
                --project.running;
                ++project.done;
                done.count_down();
            };
            ++project.posted;
            if (random() % 2)
                project.share->post(work);
            else
                project.serial->post([&, work, number = project.serialPosted++] {
                    if (number != project.nextSerial++) isWithin = false;
                    work();
                });
        }
        done.wait();
        EXPECT_TRUE(isWithin);
        EXPECT_LE(lane.threads(), threads);
        for (Project& project : projects) {
            EXPECT_EQ(project.done, project.posted);
            project.share->stop();
        }
    }
}

}  // namespace

}  // namespace usdlive::server
