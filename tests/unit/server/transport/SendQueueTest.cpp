// Tests the queue of frames for a session.
#include "transport/SendQueue.h"

#include <gmock/gmock.h>

using namespace usdlive;
using namespace usdlive::server;
using testing::ElementsAre;
using testing::IsEmpty;

namespace {

SharedBytes ofSize(std::size_t size) { return std::make_shared<const Bytes>(size); }

TEST(SendQueue, GivesAllThatFitsInOrder) {
    SendQueue queue;
    const SharedBytes first = ofSize(3), second = ofSize(4);
    queue.push(first);
    queue.push(second);
    EXPECT_EQ(queue.bytes(), 7u);

    std::vector<SharedBytes> taken{ofSize(1)};
    queue.take(7, taken);
    EXPECT_THAT(taken, ElementsAre(first, second));
    EXPECT_TRUE(queue.empty());
    EXPECT_EQ(queue.bytes(), 0u);
}

TEST(SendQueue, GivesWholeEntriesUpToTheLimit) {
    SendQueue queue;
    const std::vector<SharedBytes> entries{ofSize(3), ofSize(4), ofSize(5)};
    for (const auto& entry : entries) queue.push(entry);

    std::vector<SharedBytes> taken;
    queue.take(8, taken);
    EXPECT_THAT(taken, ElementsAre(entries[0], entries[1]));
    EXPECT_EQ(queue.bytes(), 5u);
    queue.take(8, taken);
    EXPECT_THAT(taken, ElementsAre(entries[2]));
}

TEST(SendQueue, GivesOneEntryThatIsLargerThanTheLimit) {
    SendQueue queue;
    const std::vector<SharedBytes> entries{ofSize(100), ofSize(1)};
    for (const auto& entry : entries) queue.push(entry);

    std::vector<SharedBytes> taken;
    queue.take(10, taken);
    EXPECT_THAT(taken, ElementsAre(entries[0]));
    queue.clear();
    queue.take(10, taken);
    EXPECT_THAT(taken, IsEmpty());
}

}  // namespace
