// The seats of connections: of guests and of members.
#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <string>

#include "usdlive/common/core/Budget.h"

namespace usdlive::server {

class Seat;

/// Limits what connections take of the process, from their first byte on.
///
/// A connection is a guest until its client has said hello; HTTP requests stay guests. When no seat
/// is free for another guest, one that made no progress for `patience` gives way: of the address
/// with the most guests, the one that made none for the longest time. So connections that send
/// nothing keep nobody out. When guests together hold more than `guestBytes`, the one that holds
/// the most gives way. May be used by any thread.
class Seats {
public:
    using TimePoint = std::chrono::steady_clock::time_point;
    struct Limits {
        std::size_t guests = 1'000;
        std::size_t members = 1'000;
        /// Received data that is kept, such as the part of a message that has arrived.
        std::size_t guestBytes = std::size_t(64) << 20;
        std::chrono::milliseconds patience{1'000};
    };
    struct Counts {
        std::size_t guests = 0, members = 0, guestBytes = 0;
        std::size_t gaveWay = 0;  ///< since the start
    };

    explicit Seats(Limits limits) : table_(std::make_shared<Table>(limits)) {}

    /// Returns whether another guest can take a seat. If none is free, lets a guest give way.
    [[nodiscard]] bool makeRoom(TimePoint now);
    /// Lets a guest give way, if one may. Call it when the system has no descriptor left.
    bool letOneGo(TimePoint now);
    /// Seats a guest, also if there is no room.
    [[nodiscard]] std::unique_ptr<Seat> take(const std::string& address, TimePoint now);
    [[nodiscard]] Counts counts() const;

private:
    friend class Seat;
    struct Guest {
        std::string address;
        TimePoint moved;
        std::function<void()> giveWay;
        bool isLeaving = false;  // was told to give way; does not count any more
    };
    struct Table {
        explicit Table(const Limits& limits) : limits(limits) {}

        mutable std::mutex mutex;  // guards all members, except `limits`
        const Limits limits;
        std::list<Guest> guests;  // without members
        // Without guests that are leaving.
        Budget<std::string> seats{{.all = limits.guests}};  // by address
        Budget<Guest*> bytes{{.all = limits.guestBytes}};
        std::size_t members = 0, gaveWay = 0;

        bool letOneGo(TimePoint now);
        void letGo(Guest& guest);
        void uncount(Guest& guest);
    };

    const std::shared_ptr<Table> table_;
};

/// The seat of one connection, until it is destroyed.
class Seat {
public:
    ~Seat();
    Seat(const Seat&) = delete;
    Seat& operator=(const Seat&) = delete;

    /// Sets how the connection gives way: `giveWay` is called at most once, on any thread, and must
    /// not use the seat. It is not called after giveWayBy(nullptr) or admit().
    void giveWayBy(std::function<void()> giveWay);
    /// The guest made progress.
    void moved(Seats::TimePoint now);
    /// The guest keeps this much received data. The largest guest gives way if that is too much.
    void holds(std::size_t bytes);
    /// Makes the guest a member, also if it was told to give way. Returns false, and changes
    /// nothing, if all seats of members are taken.
    [[nodiscard]] bool admit();

private:
    friend class Seats;
    Seat(std::shared_ptr<Seats::Table> table, std::list<Seats::Guest>::iterator guest)
        : table_(std::move(table)), guest_(guest) {}

    const std::shared_ptr<Seats::Table> table_;
    std::list<Seats::Guest>::iterator guest_;
    bool isMember_ = false;
};

}  // namespace usdlive::server
