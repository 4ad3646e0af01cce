// Tests the groups in which the storage thread appends commits.
#include "app/StorageThread.h"

#include <gtest/gtest.h>

#include <condition_variable>

#include "storage/MemoryCommitStore.h"
#include "unit/server/storage/TestCommits.h"

namespace usdlive::server {

namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

struct NoLog : Log {
    void write(LogLevel, std::string_view, std::initializer_list<LogField>) override {}
};

/// Records the groups that a StorageThread appends, and when.
class Groups {
public:
    struct Group {
        Revision upTo = 0;
        Clock::time_point time;
    };

    StorageThread::Events events() {
        return {
            .appended =
                [this](Revision upTo) {
                    const std::lock_guard lock(mutex_);
                    groups_.push_back({upTo, Clock::now()});
                    changed_.notify_all();
                },
            .failed = [](const Error& error, const CommitStore::Head&) { FAIL() << error.message; },
            .closed = [] { FAIL() << "closed"; },
            .measured = [](std::size_t, std::chrono::nanoseconds) {},
        };
    }
    std::vector<Group> waitFor(std::size_t count) {
        std::unique_lock lock(mutex_);
        EXPECT_TRUE(changed_.wait_for(lock, 30s, [&] { return groups_.size() >= count; }));
        return groups_;
    }

private:
    std::mutex mutex_;
    std::condition_variable changed_;
    std::vector<Group> groups_;
};

class StorageThreadTest : public testing::Test {
protected:
    void start(std::chrono::milliseconds interval) {
        ASSERT_TRUE(store_.open());
        thread_.emplace(store_, interval, log_);
        thread_->start(groups_.events());
    }
    void append() {
        thread_->append(commits_.next(layer_, "/P" + std::to_string(commits_.head.revision),
                                      CreateSpec{SpecKind::Prim}));
    }

    const LayerId layer_{"a.usda"};
    test::TestCommits commits_;
    SharedStore store_{
        [] { return Result<std::unique_ptr<CommitStore>>(createMemoryCommitStore()); }};
    NoLog log_;
    Groups groups_;
    std::optional<StorageThread> thread_;
};

TEST_F(StorageThreadTest, ASingleWriterDoesNotWait) {
    start(1h);
    append();
    EXPECT_EQ(groups_.waitFor(1)[0].upTo, 1u);
}

TEST_F(StorageThreadTest, CommitsWithinTheIntervalAreOneGroup) {
    start(200ms);
    append();
    groups_.waitFor(1);
    append();
    append();
    append();
    const auto groups = groups_.waitFor(2);
    EXPECT_EQ(groups[1].upTo, 4u);
    EXPECT_GE(groups[1].time - groups[0].time, 150ms);
}

TEST_F(StorageThreadTest, FlushAndStopDoNotWait) {
    start(1h);
    append();
    groups_.waitFor(1);
    append();
    thread_->flush([] {});
    EXPECT_EQ(groups_.waitFor(2)[1].upTo, 2u);
    append();
    thread_->stop();
    EXPECT_EQ(groups_.waitFor(3)[2].upTo, 3u);
}

TEST_F(StorageThreadTest, AFullGroupDoesNotWait) {
    start(1h);
    append();
    groups_.waitFor(1);
    std::vector<Edit> edits;
    for (int i = 0; i < 50'000; ++i)
        edits.push_back({layer_, {"/Prim" + std::to_string(i), {}}, CreateSpec{SpecKind::Prim}});
    thread_->append(commits_.next(std::move(edits)));
    EXPECT_EQ(groups_.waitFor(2)[1].upTo, 2u);
}

}  // namespace
}  // namespace usdlive::server
