// Keeps the values that were used last.
#pragma once

#include <algorithm>
#include <cstddef>
#include <list>
#include <utility>

namespace usdlive::server {

/// Keeps the values that were used last, up to a number of bytes. For some thousand values at most.
/// Not thread-safe.
template <class Key, class Value>
class LastUsed {
public:
    explicit LastUsed(std::size_t mostBytes) : mostBytes_(mostBytes) {}

    /// Returns nullptr if the value is not kept. Valid until the next call.
    [[nodiscard]] const Value* find(const Key& key) {
        const auto found = std::ranges::find(entries_, key, &Entry::key);
        if (found == entries_.end()) return nullptr;
        entries_.splice(entries_.begin(), entries_, found);
        return &found->value;
    }
    /// Adds a value that takes `bytes`, and drops others. Precondition: find() returns nullptr.
    void add(Key key, Value value, std::size_t bytes) {
        entries_.push_front({std::move(key), std::move(value), bytes});
        std::size_t kept = 0;
        const auto dropped = std::ranges::find_if(
            entries_, [&](const Entry& entry) { return (kept += entry.bytes) > mostBytes_; });
        entries_.erase(dropped, entries_.end());
    }

private:
    struct Entry {
        Key key;
        Value value;
        std::size_t bytes;
    };
    const std::size_t mostBytes_;
    std::list<Entry> entries_;  // the one that was used last is the first
};

}  // namespace usdlive::server
