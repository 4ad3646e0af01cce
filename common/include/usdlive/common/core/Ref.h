// A counted reference for copy-on-write structures.
#pragma once

#include <atomic>
#include <cstdint>
#include <utility>

namespace usdlive {

/// Counts the references to a block. A copy of a block starts without references.
struct Shared {
    Shared() = default;
    Shared(const Shared&) {}
    Shared& operator=(const Shared&) = delete;

    mutable std::atomic<std::uint32_t> sharers{0};
};

/// A counted reference to a block (derived from Shared) of a copy-on-write structure. Several
/// threads may share a block, each through references of its own. A block is changed through
/// editable() only.
template <class T>
class Ref {
public:
    Ref() = default;
    explicit Ref(T* block) : block_(block) { share(); }
    Ref(const Ref& other) : block_(other.block_) { share(); }
    Ref(Ref&& other) noexcept : block_(std::exchange(other.block_, nullptr)) {}
    Ref& operator=(Ref other) noexcept {
        std::swap(block_, other.block_);
        return *this;
    }
    ~Ref() {
        // Acquire-release: the thread that deletes the block sees the writes of all others.
        if (block_ && block_->sharers.fetch_sub(1, std::memory_order_acq_rel) == 1) delete block_;
    }

    [[nodiscard]] const T* get() const { return block_; }
    const T& operator*() const { return *block_; }
    const T* operator->() const { return block_; }
    explicit operator bool() const { return block_ != nullptr; }

    /// Returns the block for changes. Copies it first if others share it.
    [[nodiscard]] T& editable() {
        if (block_->sharers.load(std::memory_order_acquire) != 1) *this = Ref(new T(*block_));
        return *block_;
    }

private:
    void share() {
        if (block_) block_->sharers.fetch_add(1, std::memory_order_relaxed);
    }

    T* block_ = nullptr;
};

}  // namespace usdlive
