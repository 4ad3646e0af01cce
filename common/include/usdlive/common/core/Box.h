#pragma once

#include <memory>
#include <utility>

namespace usdlive {

/// A value of T that stands on the heap, so that what holds it stays small: a variant of which T is
/// the large and rare alternative. Copies, compares and holds a T like T itself; one that was moved
/// from may only be assigned to or destroyed.
template <class T>
class Box {
public:
    Box() : value_(std::make_unique<T>()) {}
    Box(T value) : value_(std::make_unique<T>(std::move(value))) {}  // NOLINT: as T itself
    Box(const Box& other) : Box(*other) {}
    Box(Box&&) noexcept = default;
    Box& operator=(const Box& other) { return *this = Box(other); }
    Box& operator=(Box&&) noexcept = default;
    ~Box() = default;

    [[nodiscard]] const T& operator*() const { return *value_; }
    [[nodiscard]] T& operator*() { return *value_; }
    friend bool operator==(const Box& left, const Box& right) { return *left == *right; }

private:
    std::unique_ptr<T> value_;
};

}  // namespace usdlive
