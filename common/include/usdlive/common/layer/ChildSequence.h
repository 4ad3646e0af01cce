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

/// A child as its parent holds it. The name stands here and not in the node, so that a rename or
/// move leaves the node as it is.
struct ChildEntry {
    std::string name;
    std::uint64_t order = 0;  // sorts it among its siblings
    Ref<LayerDoc::Node> node;
};

/// The children of one list of a spec, in order, found by name. Copies share what neither changes:
/// a short list is one block, a long one many, so that neither 1 nor 100,000 children cost much to
/// copy.
///
/// Entries are addressed by their order numbers, which stay when others come and go.
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
    /// nullptr when there is none. Valid until the sequence is changed.
    [[nodiscard]] const ChildEntry* find(std::string_view name) const;
    [[nodiscard]] const ChildEntry* first() const;
    [[nodiscard]] const ChildEntry* last() const;
    /// The one after; nullptr after the last.
    [[nodiscard]] const ChildEntry* next(std::uint64_t order) const;

    template <class Visitor>
    void forEach(const Visitor& visit) const {
        for (std::size_t i = 0; i < blocks(); ++i)
            for (const ChildEntry& entry : block(i)) visit(entry);
    }
    /// A place in the sequence, from the first entry on, while it is not changed.
    struct Cursor {
        std::size_t block = 0, index = 0;
    };
    /// The entry there, and on; nullptr after the last.
    [[nodiscard]] const ChildEntry* next(Cursor& cursor) const {
        for (; cursor.block < blocks(); ++cursor.block, cursor.index = 0)
            if (const auto& entries = block(cursor.block); cursor.index < entries.size())
                return &entries[cursor.index++];
        return nullptr;
    }
    [[nodiscard]] std::vector<const ChildEntry*> entries() const;
    /// Those that stand in no block shared with `other`; all the others are in both.
    [[nodiscard]] std::vector<const ChildEntry*> entriesNotSharedWith(
        const ChildSequence& other) const;
    /// All of `wanted` are here; do they follow each other as they do there?
    [[nodiscard]] bool isInOrderOf(const ChildSequence& wanted) const;

    // The following need an order number that is there, and a name that is not.

    /// The child's node, for changing.
    [[nodiscard]] LayerDoc::Node& editableNode(std::uint64_t order);
    struct Placed {
        std::uint64_t order;
        bool renumbered;  // all order numbers of the list are new
    };
    Placed append(std::string name, Ref<LayerDoc::Node> node);
    /// Puts it before the one of order `before`, or last.
    Placed place(std::uint64_t order, std::optional<std::uint64_t> before);
    Ref<LayerDoc::Node> remove(std::uint64_t order);
    void rename(std::uint64_t order, std::string name);

    [[nodiscard]] bool hasOrder(std::uint64_t order) const;
    /// Precondition: neither the name nor the order number is there.
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
