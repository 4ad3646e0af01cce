// Decides whose work a project does next.
#pragma once

#include <chrono>
#include <cstddef>
#include <deque>
#include <map>
#include <optional>
#include <string>

#include "project/ports/Outbox.h"  // SessionId

namespace usdlive::server {

/// Whose work it is (SE23). Nobody can choose their group: a signed-in user, or the address of a
/// connection. A name that a client only claims divides the share of its group.
struct Party {
    std::string group;
    std::string name;
    auto operator<=>(const Party&) const = default;
};

/// Shares the time of a project's strand among the parties that have work (SE23).
///
/// A party is *light* while it uses less of the strand than kLightLoad divided by the number of
/// active groups, and of active parties in its group. Work of a light party never waits for that of
/// others. The other, *heavy* parties take turns: the one that has used the least is next. While a
/// light party is active, a pause follows each of their turns, so that together they use at most
/// kHeavyLoad. Without one the strand never pauses while work waits.
///
/// A plain value: the caller passes the time and measures the work. It does one turn at a time, of
/// about kTurn.
class FairTurns {
public:
    using Duration = std::chrono::nanoseconds;
    using Time = std::chrono::steady_clock::time_point;

    static constexpr double kLightLoad = 0.5;
    static constexpr double kHeavyLoad = 0.2;
    static constexpr Duration kTurn = std::chrono::microseconds(200);
    /// The longest pause after one turn, however long that was.
    static constexpr Duration kLongestPause = std::chrono::milliseconds(250);
    /// A party is active for this long after its last work.
    static constexpr Duration kActive = std::chrono::seconds(2);
    /// The time over which the use of a party is averaged.
    static constexpr Duration kMemory = std::chrono::milliseconds(250);

    /// The commits that wait for the store.
    enum class Store {
        Free,  ///< few enough that the next commit does not wait for them
        Busy,  ///< more: heavy parties wait while a light one is active
        Full   ///< everybody waits
    };

    /// Returns whether new work of a session of `party`, none of whose work waits, is done at once.
    [[nodiscard]] bool mayGo(const Party& party, Store store, Time now);
    /// The next work of the session waits, behind that of other sessions of its party. Call it at
    /// most once until next() returns the session.
    void wait(SessionId session, const Party& party);
    /// The session has ended.
    void forget(SessionId session);
    /// Returns the session whose work is done now, and forgets that it waited; nothing if nobody
    /// waits, or everybody has to until due() or until the store has changed.
    [[nodiscard]] std::optional<SessionId> next(Store store, Time now);
    /// Returns when next() may return a session, if only time is missing.
    [[nodiscard]] std::optional<Time> due(Store store, Time now);
    /// Work of the party has taken this time. It may be called without a turn.
    void spent(const Party& party, Duration time, Time now);

    [[nodiscard]] bool isWaiting(SessionId session) const { return sessions_.contains(session); }
    [[nodiscard]] bool isEmpty() const { return sessions_.empty(); }

private:
    /// A use that is forgotten slowly, in nanoseconds.
    struct Use {
        double amount = 0;
        Time at{};
        [[nodiscard]] double now(Time time) const;
        void add(Duration time, Time now);
    };
    struct Account {
        Use use;
        std::optional<Time> lastWork;  ///< nothing: not active
        std::deque<SessionId> waiting;
    };
    struct Group {
        Use use;
        std::map<std::string, Account> accounts;
        std::size_t active = 0;  ///< accounts
    };

    void removeIdle(Time now);
    [[nodiscard]] bool isLight(const Group& group, const Account& account, Time now) const;
    /// Returns whether an active party is light.
    [[nodiscard]] bool isSomebodyLight(Time now) const;
    [[nodiscard]] bool heavyMayGo(Store store, Time now) const {
        return store == Store::Free && now >= heavyFrom_;
    }

    std::map<std::string, Group> groups_;
    std::size_t activeGroups_ = 0;
    std::map<SessionId, Party> sessions_;  // that wait
    Time heavyFrom_{};                     // the end of the pause
    Time removed_{};                       // idle accounts
};

}  // namespace usdlive::server
