// Gives seats to connections, and takes them back from guests that keep others out.
#include "transport/Seats.h"

#include <algorithm>
#include <iterator>
#include <utility>

namespace usdlive::server {

bool Seats::makeRoom(TimePoint now) {
    const std::lock_guard lock(table_->mutex);
    return table_->seats.used() < table_->limits.guests || table_->letOneGo(now);
}

bool Seats::letOneGo(TimePoint now) {
    const std::lock_guard lock(table_->mutex);
    return table_->letOneGo(now);
}

std::unique_ptr<Seat> Seats::take(const std::string& address, TimePoint now) {
    const std::lock_guard lock(table_->mutex);
    table_->seats.take(address, 1);
    table_->guests.push_back({address, now, {}, false});
    return std::unique_ptr<Seat>(new Seat(table_, std::prev(table_->guests.end())));
}

Seats::Counts Seats::counts() const {
    const std::lock_guard lock(table_->mutex);
    return {table_->seats.used(), table_->members, table_->bytes.used(), table_->gaveWay};
}

bool Seats::Table::letOneGo(TimePoint now) {
    Guest* chosen = nullptr;
    for (Guest& guest : guests) {
        if (guest.isLeaving || now - guest.moved < limits.patience) continue;
        const auto order = [&](const Guest& one) {
            return std::pair(seats.of(one.address), now - one.moved);
        };
        if (!chosen || order(guest) > order(*chosen)) chosen = &guest;
    }
    if (chosen) letGo(*chosen);
    return chosen != nullptr;
}

void Seats::Table::uncount(Guest& guest) {
    if (guest.isLeaving) return;
    seats.giveBack(guest.address, 1);
    bytes.giveBackAll(&guest);
}

void Seats::Table::letGo(Guest& guest) {
    uncount(guest);
    guest.isLeaving = true;
    ++gaveWay;
    if (const auto giveWay = std::exchange(guest.giveWay, nullptr)) giveWay();
}

Seat::~Seat() {
    const std::lock_guard lock(table_->mutex);
    if (isMember_) {
        --table_->members;
    } else {
        table_->uncount(*guest_);
        table_->guests.erase(guest_);
    }
}

void Seat::giveWayBy(std::function<void()> giveWay) {
    const std::lock_guard lock(table_->mutex);
    if (isMember_) return;
    if (guest_->isLeaving && giveWay) return giveWay();  // it was told before it could be called
    guest_->giveWay = std::move(giveWay);
}

void Seat::moved(Seats::TimePoint now) {
    const std::lock_guard lock(table_->mutex);
    if (!isMember_) guest_->moved = now;
}

void Seat::holds(std::size_t bytes) {
    Seats::Table& table = *table_;
    const std::lock_guard lock(table.mutex);
    if (isMember_ || guest_->isLeaving) return;
    table.bytes.set(&*guest_, bytes);
    while (const auto guest = table.bytes.givesWay(&*guest_)) table.letGo(**guest);
}

bool Seat::admit() {
    Seats::Table& table = *table_;
    const std::lock_guard lock(table.mutex);
    if (isMember_) return true;
    if (table.members >= table.limits.members) return false;
    table.uncount(*guest_);
    table.guests.erase(guest_);
    ++table.members;
    return isMember_ = true;
}

}  // namespace usdlive::server
