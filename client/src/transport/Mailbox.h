// The data that a connection's thread and its owner share.
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

#include "transport/Connection.h"
#include "usdlive/common/transport/BulkWindow.h"

namespace usdlive::client {

/// Messages and state shared by a connection's thread and its owner, with their mutex.
class Mailbox {
public:
    using Happening = Connection::Happening;

    // The size limit of one sent message, unless a single buffer is larger. What is queued later
    // waits for the whole message.
    static constexpr std::size_t kBatchBytes = 64 * 1024;
    // The limit for messages not fetched by poll(). Above it reading pauses, which the server
    // notices. In the end one side drops the connection, and the session resumes later.
    static constexpr std::size_t kMaxInboxBytes = 1024 * 1024 * 1024;
    // The limit for messages not taken by the server. Above it the connection is dropped, and the
    // session resumes later.
    static constexpr std::size_t kMaxOutboxBytes = 1024 * 1024 * 1024;

    explicit Mailbox(Connection::Brings brings) : brings_(brings) {}

    // --- the network's thread ---

    std::uint64_t opened() {
        reader_.emplace(reader_->takeBegun());
        const std::lock_guard lock(mutex_);
        clearOutbox();
        open_ = ++generation_;
        inbox_.push_back({Connection::Opened{}, generation_});
        arrived_.notify_all();
        return generation_;
    }
    void lost(Error reason) {
        const std::lock_guard lock(mutex_);
        std::size_t unconfirmed = window_.outstanding();
        clearOutbox();
        open_.reset();
        // Keeps only the latest failed attempt that was not fetched.
        if (!inbox_.empty())
            if (auto* before = std::get_if<Connection::Lost>(&inbox_.back().happening)) {
                unconfirmed += before->unconfirmed;
                inbox_.pop_back();
            }
        inbox_.push_back({Connection::Lost{std::move(reason), unconfirmed}, generation_});
        arrived_.notify_all();
    }
    // Returns false if the inbox is full; wait before reading more.
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
    // Returns the buffers of the next message. They count as queued until written().
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
        window_.sent(bytes);
    }
    [[nodiscard]] bool wantsMark() const {
        const std::lock_guard lock(mutex_);
        return window_.wantsMark();
    }
    // Returns the number of a mark after what was written, for acknowledged().
    std::uint64_t mark() {
        const std::lock_guard lock(mutex_);
        return window_.mark(std::chrono::steady_clock::now());
    }
    void acknowledged(std::uint64_t mark) {
        const std::lock_guard lock(mutex_);
        window_.acknowledged(mark, std::chrono::steady_clock::now());
    }

    // --- the owner's thread ---

    enum class Queued { Dropped, Yes, Full };
    // Queues frames for the connection whose Opened the owner has fetched. A newer connection would
    // receive them before its hello, so they are dropped then.
    [[nodiscard]] Queued queue(SharedBytes frames) {
        const std::lock_guard lock(mutex_);
        if (!open_ || *open_ != seen_) {
            dropped_ += frames->size();
            return Queued::Dropped;
        }
        if (outboxBytes_ + frames->size() > kMaxOutboxBytes) return Queued::Full;
        outboxBytes_ += frames->size();
        window_.queued(frames->size());
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
            if (auto* lost = std::get_if<Connection::Lost>(&happening))
                lost->unconfirmed += std::exchange(dropped_, 0);
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
    [[nodiscard]] std::size_t bulkBytes() const {
        const std::lock_guard lock(mutex_);
        return window_.partBytes();
    }
    // The generation of the connection that the owner considers open.
    [[nodiscard]] std::uint64_t seen() const {
        const std::lock_guard lock(mutex_);
        return seen_;
    }

private:
    struct Entry {
        Happening happening;
        std::uint64_t generation;
        std::size_t bytes = 0;  // estimated memory
    };

    // Turns exceptions into errors, because they would end the connection's thread silently.
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
        window_ = {};
    }

    // Used by the network thread only.
    const Connection::Brings brings_;
    std::optional<MessageReader> reader_{std::in_place};  // for the current connection

    mutable std::mutex mutex_;
    std::condition_variable arrived_;
    std::deque<Entry> inbox_;
    std::size_t inboxBytes_ = 0;
    std::deque<SharedBytes> outbox_;
    std::size_t outboxBytes_ = 0;  // includes the batch that is being written
    BulkWindow window_;            // belongs to the current connection
    std::size_t dropped_ = 0;      // bytes that were queued after the loss of the connection
    std::uint64_t generation_ = 0;
    std::optional<std::uint64_t> open_;
    std::uint64_t seen_ = 0;
};

}  // namespace usdlive::client
