// The items of one list of a list op.
#pragma once

#include <compare>
#include <cstddef>
#include <initializer_list>
#include <iterator>
#include <list>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "usdlive/common/layer/Value.h"

namespace usdlive {

/// Returns true if both are the same item of a list (itemKey).
[[nodiscard]] bool sameItem(const Value& left, const Value& right);

/// Items in order. The first few changes of a long list search it. Then it gets an index, which
/// takes longer than they do, and each change takes constant time. A copy has no index.
class ListItems {
public:
    class Iterator;
    using value_type = Value;
    using const_iterator = Iterator;
    using iterator = Iterator;

    ListItems();
    ListItems(std::vector<Value> items);  // NOLINT: converts from its content
    ListItems(std::initializer_list<Value> items) : ListItems(std::vector<Value>(items)) {}
    ListItems(const ListItems& other) : ListItems(other.values()) {}
    ListItems(ListItems&& other) noexcept;
    ListItems& operator=(const ListItems& other) { return *this = ListItems(other); }
    ListItems& operator=(ListItems&& other) noexcept;
    ~ListItems();

    [[nodiscard]] Iterator begin() const;
    [[nodiscard]] Iterator end() const;
    [[nodiscard]] std::size_t size() const;
    [[nodiscard]] bool empty() const { return size() == 0; }
    [[nodiscard]] std::vector<Value> values() const;
    friend bool operator==(const ListItems& left, const ListItems& right);

    /// Returns the first item that is the same as `item`, or end().
    [[nodiscard]] Iterator find(const Value& item) const;
    /// Returns true if place() would change nothing.
    [[nodiscard]] bool isPlaced(const Value& item, const std::optional<Value>& before) const;

    /// Adds an item at the end, without a look at the others.
    void push_back(Value item);
    template <class... Arguments>
    void emplace_back(Arguments&&... arguments) {
        push_back(Value(std::forward<Arguments>(arguments)...));
    }
    /// Moves or adds an item before the item `before`, or to the end if that one is not there. If
    /// `before` is the same item, it stays where it is. Removes all others that are the same.
    void place(const Value& item, const std::optional<Value>& before);
    /// Removes all items that are the same as `item`.
    void remove(const Value& item);

private:
    struct Content;
    struct Indexed;

    /// Returns the index if the list has or gets one, otherwise nullptr. Counts the change.
    Indexed* indexed();
    Content& content();

    std::unique_ptr<Content> content_;  // nullptr while there are no items
};

class ListItems::Iterator {
public:
    using iterator_category = std::bidirectional_iterator_tag;
    using value_type = Value;
    using difference_type = std::ptrdiff_t;
    using pointer = const Value*;
    using reference = const Value&;

    Iterator() = default;
    explicit Iterator(const Value* item) : item_(item) {}
    explicit Iterator(std::list<Value>::const_iterator linked) : linked_(linked), links_(true) {}

    reference operator*() const { return links_ ? *linked_ : *item_; }
    pointer operator->() const { return &**this; }
    Iterator& operator++() {
        links_ ? void(++linked_) : void(++item_);
        return *this;
    }
    Iterator& operator--() {
        links_ ? void(--linked_) : void(--item_);
        return *this;
    }
    Iterator operator++(int) { return std::exchange(*this, std::next(*this)); }
    Iterator operator--(int) { return std::exchange(*this, std::prev(*this)); }
    friend bool operator==(const Iterator&, const Iterator&) = default;

private:
    const Value* item_ = nullptr;
    std::list<Value>::const_iterator linked_;  // used for a list with an index
    bool links_ = false;
};

}  // namespace usdlive
