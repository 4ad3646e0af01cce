// A value on the heap that behaves like the value itself.
#pragma once

#include <memory>
#include <utility>

namespace usdlive {

/// Keeps a T on the heap, so that its owner stays small. For a variant with one large, rare
/// alternative. Copies and compares like T itself. A moved-from Box may only be assigned to or
/// destroyed.
template <class T>
class Box {
public:
    Box() : value_(std::make_unique<T>()) {}
    // NOLINT: converts like T itself
    Box(T value) : value_(std::make_unique<T>(std::move(value))) {}
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
