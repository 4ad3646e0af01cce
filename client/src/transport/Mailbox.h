#pragma once

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "usdlive/client/transport/Connection.h"

namespace usdlive::client {

/// What a connection's thread and its owner share, with the mutex that guards it.
class Mailbox {
public:
    using Happening = Connection::Happening;

    // What leaves in one message, unless a single buffer is larger.
    static constexpr std::size_t kBatchBytes = 1024 * 1024;
    // Not fetched by poll(): above it reading pauses, the server hears of it, and in the end one of
    // the two gives the connection up; the session resumes.
    static constexpr std::size_t kMaxInboxBytes = 1024 * 1024 * 1024;
    // Not taken by the server: above it the connection is given up; the session resumes.
    static constexpr std::size_t kMaxOutboxBytes = 1024 * 1024 * 1024;

    explicit Mailbox(Connection::Brings brings) : brings_(brings) {}

    // --- the network's thread ---

    std::uint64_t opened() {
        reader_.emplace();
        const std::lock_guard lock(mutex_);
        clearOutbox();
        open_ = ++generation_;
        inbox_.push_back({Connection::Opened{}, generation_});
        arrived_.notify_all();
        return generation_;
    }
    void lost(Error reason) {
        const std::lock_guard lock(mutex_);
        clearOutbox();
        open_.reset();
        // Failed attempts that nobody looks at do not pile up: the latest says enough.
        if (!inbox_.empty() && std::holds_alternative<Connection::Lost>(inbox_.back().happening))
            inbox_.pop_back();
        inbox_.push_back({Connection::Lost{std::move(reason)}, generation_});
        arrived_.notify_all();
    }
    // False: full, wait before reading on.
    [[nodiscard]] bool message(SharedBytes bytes) {
        std::size_t size = bytes->size();
        Connection::Message message;
        if (brings_ == Connection::Brings::Frames) {
            ReceivedMessage content = read(*bytes);
            size = content.bytes;
            message.content = std::move(content);
        } else {
            message.content = std::move(bytes);
        }
        const std::lock_guard lock(mutex_);
        inboxBytes_ += size;
        inbox_.push_back({std::move(message), generation_, size});
        arrived_.notify_all();
        return inboxBytes_ < kMaxInboxBytes;
    }
    [[nodiscard]] bool hasRoom() const {
        const std::lock_guard lock(mutex_);
        return inboxBytes_ < kMaxInboxBytes / 2;
    }
    // What leaves in the next message; counted as queued until written().
    [[nodiscard]] std::vector<SharedBytes> takeBatch() {
        const std::lock_guard lock(mutex_);
        std::vector<SharedBytes> batch;
        std::size_t bytes = 0;
        while (!outbox_.empty() &&
               (batch.empty() || bytes + outbox_.front()->size() <= kBatchBytes)) {
            bytes += outbox_.front()->size();
            batch.push_back(std::move(outbox_.front()));
            outbox_.pop_front();
        }
        return batch;
    }
    void written(std::size_t bytes) {
        const std::lock_guard lock(mutex_);
        outboxBytes_ -= std::min(bytes, outboxBytes_);
    }

    // --- the owner's thread ---

    enum class Queued { Dropped, Yes, Full };
    // Frames are for the connection whose Opened the owner has fetched, never for a newer one: it
    // would get them before its hello.
    [[nodiscard]] Queued queue(SharedBytes frames) {
        const std::lock_guard lock(mutex_);
        if (!open_ || *open_ != seen_) return Queued::Dropped;
        if (outboxBytes_ + frames->size() > kMaxOutboxBytes) return Queued::Full;
        outboxBytes_ += frames->size();
        outbox_.push_back(std::move(frames));
        return Queued::Yes;
    }
    [[nodiscard]] std::vector<Happening> fetch(std::size_t most, bool& madeRoom) {
        const std::lock_guard lock(mutex_);
        const bool wasFull = inboxBytes_ >= kMaxInboxBytes / 2;
        std::vector<Happening> fetched;
        while (!inbox_.empty() && fetched.size() < most) {
            auto& [happening, generation, bytes] = inbox_.front();
            inboxBytes_ -= bytes;
            if (std::holds_alternative<Connection::Opened>(happening)) seen_ = generation;
            fetched.push_back(std::move(happening));
            inbox_.pop_front();
        }
        madeRoom = wasFull && inboxBytes_ < kMaxInboxBytes / 2;
        return fetched;
    }
    [[nodiscard]] bool wait(std::chrono::milliseconds time) {
        std::unique_lock lock(mutex_);
        return arrived_.wait_for(lock, time, [this] { return !inbox_.empty(); });
    }
    [[nodiscard]] std::size_t outboxBytes() const {
        const std::lock_guard lock(mutex_);
        return outboxBytes_;
    }
    // The generation the owner takes for open.
    [[nodiscard]] std::uint64_t seen() const {
        const std::lock_guard lock(mutex_);
        return seen_;
    }

private:
    struct Entry {
        Happening happening;
        std::uint64_t generation;
        std::size_t bytes = 0;  // about what it takes in memory
    };

    // What is thrown here would end the connection's thread and tell nobody.
    ReceivedMessage read(ByteView message) {
        try {
            return reader_->read(message);
        } catch (const std::exception& fault) {
            ReceivedMessage failed;
            failed.frames.emplace_back(fail(
                ErrorCode::Internal, std::string("a message cannot be read: ") + fault.what()));
            return failed;
        }
    }

    void clearOutbox() {
        outbox_.clear();
        outboxBytes_ = 0;
    }

    // The network's thread's.
    const Connection::Brings brings_;
    std::optional<MessageReader> reader_{std::in_place};  // of the present connection

    mutable std::mutex mutex_;
    std::condition_variable arrived_;
    std::deque<Entry> inbox_;
    std::size_t inboxBytes_ = 0;
    std::deque<SharedBytes> outbox_;
    std::size_t outboxBytes_ = 0;  // with the batch that is being written
    std::uint64_t generation_ = 0;
    std::optional<std::uint64_t> open_;
    std::uint64_t seen_ = 0;
};

}  // namespace usdlive::client
