// Handles the messages of sessions in fair turns.
#include "app/SessionWork.h"

#include <algorithm>
#include <boost/asio/post.hpp>
#include <ctime>
#include <optional>
#include <utility>

#include "usdlive/common/core/ByteStream.h"

namespace usdlive::server {

namespace {

using std::chrono::steady_clock;

// A turn ends between two pieces of this many frames, or of this many bytes.
constexpr int kPieceFrames = 8;
constexpr std::size_t kPieceBytes = 64 * 1024;
// The pause between measurements of the thread's time, and the weight of the newest one.
constexpr FairTurns::Duration kMeasurePause = std::chrono::milliseconds(10);
constexpr double kNewShare = 0.2;
constexpr double kMostFactor = 50;

FairTurns::Duration threadTime() {
    timespec time{};
    ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return std::chrono::seconds(time.tv_sec) + std::chrono::nanoseconds(time.tv_nsec);
}

/// Returns the size of the first frames, of at least one. Bytes that are no whole frame stay
/// together with those after them: the project refuses them.
std::size_t pieceOf(ByteView frames) {
    std::size_t size = 0;
    for (int count = 0; count < kPieceFrames && size < kPieceBytes && size < frames.size();
         ++count) {
        ByteReader reader(frames.subspan(size));
        const std::uint32_t length = reader.u32();
        reader.take(length);
        if (reader.failed()) return size > 0 ? size : frames.size();
        size = frames.size() - reader.left();
    }
    return size;
}

}  // namespace

SessionWork::SessionWork(boost::asio::io_context& io, Calls calls)
    : io_(io), calls_(std::move(calls)), timer_(io) {}

void SessionWork::received(SessionId session, ByteView message) {
    if (message.empty()) return calls_.handle(session, message);  // an error of the client
    if (entries_.contains(session) ||
        !turns_.mayGo(calls_.partyOf(session), calls_.store(), steady_clock::now()))
        return keep(session, message);
    const std::size_t done = work(session, message);
    if (done < message.size()) keep(session, message.subspan(done));
}

void SessionWork::keep(SessionId session, ByteView frames) {
    Entry& entry = entries_[session];
    entry.message.insert(entry.message.end(), frames.begin(), frames.end());
    setReading(session);
    waitForTurn(session);
}

void SessionWork::waitForTurn(SessionId session) {
    const Entry& entry = entries_.at(session);
    if (entry.isHeld || entry.message.empty() || turns_.isWaiting(session)) return;
    turns_.wait(session, calls_.partyOf(session));
    runSoon();
}

void SessionWork::setHeld(SessionId session, bool held) {
    if (held) {
        entries_[session].isHeld = true;
        turns_.forget(session);
        return setReading(session);
    }
    const auto found = entries_.find(session);
    if (found == entries_.end() || !std::exchange(found->second.isHeld, false)) return;
    if (found->second.message.empty()) return setReading(session);
    waitForTurn(session);
}

/// Sets what the session's connection does, and forgets a session about which nothing is to be
/// remembered.
void SessionWork::setReading(SessionId session) {
    Entry& entry = entries_.at(session);
    const bool reading = entry.message.empty() && !entry.isHeld;
    const bool changes = entry.isReading != reading;
    entry.isReading = reading;
    if (reading) entries_.erase(session);
    if (changes) calls_.setReading(session, reading);
}

void SessionWork::closed(SessionId session) {
    turns_.forget(session);
    entries_.erase(session);
    if (working_ == session) working_.reset();
}

/// Handles frames until the turn or the session ends. Returns the bytes of those that need not be
/// handled any more.
std::size_t SessionWork::work(SessionId session, ByteView frames) {
    const Party party = calls_.partyOf(session);
    const auto begin = steady_clock::now();
    std::size_t done = 0;
    auto now = begin;
    working_ = session;
    do {
        const std::size_t size = pieceOf(frames.subspan(done));
        calls_.handle(session, frames.subspan(done, size));
        done += size;
        now = steady_clock::now();
        if (!working_) break;
        const auto entry = entries_.find(session);
        if (entry != entries_.end() && entry->second.isHeld) break;
    } while (done < frames.size() && now - begin < FairTurns::kTurn &&
             calls_.store() != FairTurns::Store::Full);
    measure(now - begin, now);
    spent(party, std::chrono::duration_cast<FairTurns::Duration>((now - begin) * factor_), now);
    return std::exchange(working_, std::nullopt) ? done : frames.size();
}

/// Measures how much work of the thread follows from a moment of handling messages, while there is
/// much to do. In quiet times the thread mostly does other things.
void SessionWork::measure(FairTurns::Duration handled, FairTurns::Time now) {
    handled_ += handled;
    if (now - measuredAt_ < kMeasurePause) return;
    const auto worked = threadTime() - threadTime_;
    if (now - measuredAt_ < 4 * kMeasurePause && handled_.count() > 0) {
        const double found = double(worked.count()) / double(handled_.count());
        factor_ += kNewShare * (std::clamp(found, 1.0, kMostFactor) - factor_);
    }
    threadTime_ += worked;
    measuredAt_ = now;
    handled_ = {};
}

void SessionWork::spent(SessionId session, FairTurns::Duration time) {
    spent(calls_.partyOf(session), time, steady_clock::now());
}

/// A session of which nobody is known must not be a party beside its own user's.
void SessionWork::spent(const Party& party, FairTurns::Duration time, FairTurns::Time now) {
    if (!party.group.empty()) turns_.spent(party, time, now);
}

// ---- turns

void SessionWork::runSoon() {
    if (turns_.isEmpty() || std::exchange(isRunning_, true)) return;
    boost::asio::post(io_, [this] {
        isRunning_ = false;
        run();
    });
}

/// Does one turn. The event loop looks at the connections before the next one.
void SessionWork::run() {
    const auto now = steady_clock::now();
    const auto store = calls_.store();
    if (const auto session = turns_.next(store, now)) {
        turnOf(*session);
        return runSoon();
    }
    const auto due = turns_.due(store, now);
    if (!due) return;
    timer_.expires_at(*due);
    timer_.async_wait([this](const boost::system::error_code& error) {
        if (!error) runSoon();
    });
}

void SessionWork::turnOf(SessionId session) {
    // Taken out, because a call may change the entries.
    Bytes message = std::exchange(entries_.at(session).message, {});
    const std::size_t at = std::exchange(entries_.at(session).at, 0);
    std::size_t done = message.size();
    try {
        done = at + work(session, ByteView(message).subspan(at));
    } catch (const std::exception& fault) {
        calls_.failed(session, fault);
    }
    if (done < message.size()) {
        Entry& entry = entries_[session];
        entry.message = std::move(message);
        entry.at = done;
        return waitForTurn(session);
    }
    if (entries_.contains(session)) setReading(session);
}

}  // namespace usdlive::server
