// Decides whose work a project does next.
#include "app/FairTurns.h"

#include <algorithm>
#include <cmath>
#include <tuple>

namespace usdlive::server {

namespace {

// The pause between removals of accounts that are not active any more.
constexpr FairTurns::Duration kRemovalPause = std::chrono::milliseconds(50);

double nanoseconds(FairTurns::Duration time) { return double(time.count()); }

}  // namespace

double FairTurns::Use::now(Time time) const {
    return amount * std::exp(-nanoseconds(std::max(time - at, Duration(0))) / nanoseconds(kMemory));
}

void FairTurns::Use::add(Duration time, Time now) {
    amount = this->now(now) + nanoseconds(time);
    at = now;
}

bool FairTurns::isLight(const Group& group, const Account& account, Time now) const {
    const double parties = double(std::max<std::size_t>(activeGroups_, 1)) *
                           double(std::max<std::size_t>(group.active, 1));
    return account.use.now(now) <= nanoseconds(kMemory) * kLightLoad / parties;
}

bool FairTurns::isSomebodyLight(Time now) const {
    return std::ranges::any_of(groups_, [&](const auto& entry) {
        const Group& group = entry.second;
        return std::ranges::any_of(group.accounts, [&](const auto& one) {
            return one.second.lastWork && isLight(group, one.second, now);
        });
    });
}

bool FairTurns::mayGo(const Party& party, Store store, Time now) {
    removeIdle(now);
    if (store == Store::Full) return false;
    const auto group = groups_.find(party.group);
    if (group == groups_.end()) return true;
    const auto account = group->second.accounts.find(party.name);
    if (account == group->second.accounts.end()) return true;
    if (!account->second.waiting.empty()) return false;  // a turn of its other sessions
    if (isLight(group->second, account->second, now)) return true;
    return sessions_.empty() && (heavyMayGo(store, now) || !isSomebodyLight(now));
}

void FairTurns::wait(SessionId session, const Party& party) {
    sessions_[session] = party;
    groups_[party.group].accounts[party.name].waiting.push_back(session);
}

void FairTurns::forget(SessionId session) {
    const auto found = sessions_.extract(session);
    if (found.empty()) return;
    const Party& party = found.mapped();
    std::erase(groups_.at(party.group).accounts.at(party.name).waiting, session);
}

std::optional<SessionId> FairTurns::next(Store store, Time now) {
    removeIdle(now);
    if (sessions_.empty() || store == Store::Full) return std::nullopt;
    const bool heavyWait = !heavyMayGo(store, now) && isSomebodyLight(now);
    Account* best = nullptr;
    std::tuple<bool, double, double> least;
    for (auto& [id, group] : groups_) {
        const double groupUse = group.use.now(now);
        for (auto& [name, account] : group.accounts) {
            if (account.waiting.empty()) continue;
            const bool heavy = !isLight(group, account, now);
            if (heavy && heavyWait) continue;
            const std::tuple use{heavy, groupUse, account.use.now(now)};
            if (best && use >= least) continue;
            best = &account;
            least = use;
        }
    }
    if (!best) return std::nullopt;
    const SessionId session = best->waiting.front();
    best->waiting.pop_front();
    sessions_.erase(session);
    return session;
}

std::optional<FairTurns::Time> FairTurns::due(Store store, Time now) {
    if (sessions_.empty() || store != Store::Free) return std::nullopt;
    return std::max(now, heavyFrom_);
}

void FairTurns::spent(const Party& party, Duration time, Time now) {
    Group& group = groups_[party.group];
    Account& account = group.accounts[party.name];
    if (!account.lastWork && group.active++ == 0) ++activeGroups_;
    account.lastWork = now;
    group.use.add(time, now);
    account.use.add(time, now);
    removeIdle(now);
    if (isLight(group, account, now) || !isSomebodyLight(now)) return;
    const auto pause = Duration(std::int64_t(nanoseconds(time) * (1 / kHeavyLoad - 1)));
    heavyFrom_ = std::max(heavyFrom_, now + std::min(pause, kLongestPause));
}

void FairTurns::removeIdle(Time now) {
    if (now < removed_ + kRemovalPause) return;
    removed_ = now;
    activeGroups_ = 0;
    for (auto group = groups_.begin(); group != groups_.end();) {
        std::size_t active = 0;
        for (auto& [name, account] : group->second.accounts) {
            if (account.lastWork && now - *account.lastWork >= kActive) account.lastWork.reset();
            if (account.lastWork) ++active;
        }
        std::erase_if(group->second.accounts, [](const auto& entry) {
            return !entry.second.lastWork && entry.second.waiting.empty();
        });
        group->second.active = active;
        if (active > 0) ++activeGroups_;
        group = group->second.accounts.empty() ? groups_.erase(group) : std::next(group);
    }
}

}  // namespace usdlive::server
