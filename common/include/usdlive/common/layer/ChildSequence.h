// The ordered children of a spec.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "usdlive/common/core/Ref.h"
#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive {

/// A child in the list of its parent. The parent's list holds the name, so that a rename or move
/// does not change the node.
struct ChildEntry {
    std::string name;
    std::uint64_t order = 0;  // its position among its siblings
    Ref<LayerDoc::Node> node;
};

/// The children in one list of a spec, in order, with a lookup by name. Copies share all blocks
/// that neither of them changes. A short list is one block and a long one has many, so that a copy
/// is cheap for 1 child and for 100,000.
///
/// Entries are addressed by their order numbers, which stay the same when other entries are added
/// or removed.
class ChildSequence {
public:
    static constexpr std::uint64_t kOrderStep = std::uint64_t{1} << 20;

    ChildSequence();
    ChildSequence(const ChildSequence&);
    ChildSequence(ChildSequence&&) noexcept;
    ChildSequence& operator=(ChildSequence) noexcept;
    ~ChildSequence();

    [[nodiscard]] std::size_t size() const;
    [[nodiscard]] bool sharesAll(const ChildSequence& other) const {
        return small_.get() == other.small_.get() && large_.get() == other.large_.get();
    }
    /// Returns nullptr if there is no such child. The pointer is valid until the sequence changes.
    [[nodiscard]] const ChildEntry* find(std::string_view name) const;
    [[nodiscard]] const ChildEntry* first() const;
    [[nodiscard]] const ChildEntry* last() const;
    /// Returns the entry after `order`, or nullptr after the last.
    [[nodiscard]] const ChildEntry* next(std::uint64_t order) const;

    template <class Visitor>
    void forEach(const Visitor& visit) const {
        for (std::size_t i = 0; i < blocks(); ++i)
            for (const ChildEntry& entry : block(i)) visit(entry);
    }
    /// A position for iterating from the first entry on. Valid until the sequence changes.
    struct Cursor {
        std::size_t block = 0, index = 0;
    };
    /// Returns the entry at the cursor and advances it. Returns nullptr after the last.
    [[nodiscard]] const ChildEntry* next(Cursor& cursor) const {
        for (; cursor.block < blocks(); ++cursor.block, cursor.index = 0)
            if (const auto& entries = block(cursor.block); cursor.index < entries.size())
                return &entries[cursor.index++];
        return nullptr;
    }
    [[nodiscard]] std::vector<const ChildEntry*> entries() const;
    /// Returns the entries that are in no block shared with `other`. All other entries are in both
    /// sequences.
    [[nodiscard]] std::vector<const ChildEntry*> entriesNotSharedWith(
        const ChildSequence& other) const;
    /// Returns true if the entries have the same order as in `wanted`. Precondition: this sequence
    /// holds all entries of `wanted`.
    [[nodiscard]] bool isInOrderOf(const ChildSequence& wanted) const;

    // Preconditions of the following: the order number exists and the name does not.

    /// Returns the child's node for changes.
    [[nodiscard]] LayerDoc::Node& editableNode(std::uint64_t order);
    struct Placed {
        std::uint64_t order;
        bool renumbered;  // the whole list got new order numbers
    };
    Placed append(std::string name, Ref<LayerDoc::Node> node);
    /// Moves the entry before the entry with order `before`, or to the end.
    Placed place(std::uint64_t order, std::optional<std::uint64_t> before);
    Ref<LayerDoc::Node> remove(std::uint64_t order);
    void rename(std::uint64_t order, std::string name);

    [[nodiscard]] bool hasOrder(std::uint64_t order) const;
    /// Precondition: neither the name nor the order number exists.
    void insert(ChildEntry entry);

private:
    struct Chunk;
    struct Large;

    [[nodiscard]] std::size_t blocks() const;
    [[nodiscard]] const std::vector<ChildEntry>& block(std::size_t index) const;
    [[nodiscard]] const ChildEntry* at(std::uint64_t order) const;
    [[nodiscard]] ChildEntry& editable(std::uint64_t order);
    ChildEntry take(std::uint64_t order);
    void renumber();
    void fill(std::vector<ChildEntry> sorted);

    // At most one is set: `small_` up to kSmall children, then `large_`.
    Ref<Chunk> small_;
    Ref<Large> large_;
};

}  // namespace usdlive
