// Tests who gives way when seats or memory for guests are short (SE16).
#include "transport/Seats.h"

#include <gtest/gtest.h>

#include <optional>
#include <random>
#include <set>
#include <vector>

namespace usdlive::server {

namespace {

using namespace std::chrono_literals;

class SeatsTest : public testing::Test {
protected:
    void limit(std::size_t guests, std::size_t members = 10, std::size_t bytes = 1000) {
        seats_.emplace(Seats::Limits{guests, members, bytes, 500ms});
    }
    /// Seats a connection that notes its name when it has to give way.
    std::unique_ptr<Seat> take(const std::string& address, const std::string& name) {
        auto seat = seats_->take(address, now_);
        seat->giveWayBy([this, name] { gaveWay_.push_back(name); });
        return seat;
    }
    bool makeRoom() { return seats_->makeRoom(now_); }

    Seats::TimePoint now_{};
    std::optional<Seats> seats_;
    std::vector<std::string> gaveWay_;
};

TEST_F(SeatsTest, SE16TheGuestThatIsSilentForTheLongestTimeGivesWay) {
    limit(2);
    const auto first = take("a", "first");
    now_ += 100ms;
    const auto second = take("a", "second");
    EXPECT_FALSE(makeRoom());  // neither is silent for long
    now_ += 600ms;
    first->moved(now_);
    EXPECT_TRUE(makeRoom());
    EXPECT_EQ(gaveWay_, std::vector<std::string>{"second"});
    const auto third = take("a", "third");
    EXPECT_FALSE(makeRoom());
    EXPECT_EQ(seats_->counts().guests, 2u);
    EXPECT_EQ(seats_->counts().gaveWay, 1u);
}

TEST_F(SeatsTest, SE16AGuestOfTheAddressWithTheMostGuestsGivesWay) {
    limit(4);
    const auto lone = take("lone", "lone");
    now_ += 1s;
    std::vector<std::unique_ptr<Seat>> many;
    for (const char* name : {"1", "2", "3"}) many.push_back(take("many", name));
    now_ += 1s;
    for (int newcomer = 0; newcomer < 2; ++newcomer) {
        EXPECT_TRUE(makeRoom());
        many.push_back(take("other" + std::to_string(newcomer), "newcomer"));
    }
    EXPECT_EQ(gaveWay_, (std::vector<std::string>{"1", "2"}));
}

TEST_F(SeatsTest, SE16MembersGiveWayToNobody) {
    limit(1, 1);
    const auto member = take("a", "member");
    EXPECT_TRUE(member->admit());
    now_ += 1h;
    const auto guest = take("a", "guest");
    EXPECT_FALSE(guest->admit());
    EXPECT_FALSE(makeRoom());
    now_ += 1h;
    EXPECT_TRUE(makeRoom());
    EXPECT_EQ(gaveWay_, std::vector<std::string>{"guest"});
    EXPECT_EQ(seats_->counts().members, 1u);
}

TEST_F(SeatsTest, TheGuestThatHoldsTheMostGivesWayWhenMemoryIsShort) {
    limit(10, 10, 1000);
    const auto small = take("a", "small"), large = take("b", "large"), next = take("c", "next");
    large->holds(700);
    small->holds(100);
    next->holds(200);
    EXPECT_TRUE(gaveWay_.empty());
    next->holds(201);
    EXPECT_EQ(gaveWay_, std::vector<std::string>{"large"});
    EXPECT_EQ(seats_->counts().guestBytes, 301u);
    large->holds(5000);  // it is leaving
    EXPECT_EQ(seats_->counts().guestBytes, 301u);
    next->holds(2000);
    EXPECT_EQ(gaveWay_, (std::vector<std::string>{"large", "next"}));
}

TEST_F(SeatsTest, AGuestThatHadToGiveWayBeforeItCouldIsToldLater) {
    limit(1);
    const auto guest = seats_->take("a", now_);
    now_ += 1s;
    EXPECT_TRUE(makeRoom());
    guest->giveWayBy([this] { gaveWay_.push_back("guest"); });
    EXPECT_EQ(gaveWay_.size(), 1u);
    EXPECT_TRUE(guest->admit());  // its hello arrived at the last moment
    EXPECT_EQ(seats_->counts().guests, 0u);
    EXPECT_EQ(seats_->counts().members, 1u);
}

// Random connections: whatever they do, the counts are those of the seats that are left, and a
// newcomer has to wait for at most the patience.
TEST_F(SeatsTest, SE16AlwaysHasRoomAfterTheTimeOfPatience) {
    for (unsigned seed = 0; seed < 200; ++seed) {
        SCOPED_TRACE(seed);
        std::mt19937 random{seed};
        limit(1 + random() % 5, 3, 1000);
        std::vector<std::unique_ptr<Seat>> seats;
        for (int step = 0; step < 200; ++step) {
            now_ += std::chrono::milliseconds(random() % 50);
            Seat* const seat = seats.empty() ? nullptr : seats[random() % seats.size()].get();
            switch (random() % 6) {
                case 0:
                    if (seat) seat->moved(now_);
                    break;
                case 1:
                    if (seat) seat->holds(random() % 500);
                    break;
                case 2:
                    if (seat) (void)seat->admit();
                    break;
                case 3:
                    if (seat) std::swap(seats[random() % seats.size()], seats.back());
                    if (seat) seats.pop_back();
                    break;
                default:
                    if (!makeRoom()) {
                        now_ += 500ms;
                        ASSERT_TRUE(makeRoom());
                    }
                    seats.push_back(take("address" + std::to_string(random() % 3), "one"));
            }
            const auto counts = seats_->counts();
            ASSERT_LE(counts.guestBytes, 1000u);
            ASSERT_LE(counts.members, 3u);
            ASSERT_LE(counts.guests + counts.members, seats.size());
        }
        seats.clear();
        const auto counts = seats_->counts();
        EXPECT_EQ(counts.guests + counts.members + counts.guestBytes, 0u);
    }
}

}  // namespace

}  // namespace usdlive::server
