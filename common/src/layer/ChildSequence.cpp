// The children of a spec as copy-on-write blocks: one block for short lists, chunks with an index
// for long ones.
#include "usdlive/common/layer/ChildSequence.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "usdlive/common/layer/LayerDocNode.h"

namespace usdlive {

namespace {

constexpr std::size_t kSmall = 16;         // up to here names are searched one by one
constexpr std::size_t kChunkEntries = 64;  // in a chunk of a long list
constexpr std::size_t kShardEntries = 64;  // on average, before the shards are split
constexpr unsigned kLeastSpread = 4;       // bits of the order numbers in the smallest range

std::size_t hashOf(std::string_view name) { return std::hash<std::string_view>{}(name); }

bool orderBelow(const ChildEntry& entry, std::uint64_t order) { return entry.order < order; }

// Grows by half instead of doubling, because there are many lists and most stay short.
void makeRoom(std::vector<ChildEntry>& entries) {
    if (entries.size() == entries.capacity())
        entries.reserve(entries.size() + 1 + entries.size() / 2);
}

}  // namespace

struct ChildSequence::Chunk : Shared {
    std::vector<ChildEntry> entries;  // sorted by order, never empty

    [[nodiscard]] std::vector<ChildEntry>::const_iterator at(std::uint64_t order) const {
        return std::lower_bound(entries.begin(), entries.end(), order, orderBelow);
    }
    [[nodiscard]] std::vector<ChildEntry>::iterator at(std::uint64_t order) {
        return std::lower_bound(entries.begin(), entries.end(), order, orderBelow);
    }
    void insert(ChildEntry entry) {
        makeRoom(entries);
        entries.insert(at(entry.order), std::move(entry));
    }
    ChildEntry take(std::uint64_t order) {
        const auto position = at(order);
        ChildEntry taken = std::move(*position);
        entries.erase(position);
        return taken;
    }
};

// Holds chunks in order, and an index from a name's hash to the order number. Both are split into
// blocks that copies share, so that a change copies one block of each and the tables of references.
struct ChildSequence::Large : Shared {
    struct Slot {
        // The slot holds the orders from `from` up to the next slot's. The first slot also holds
        // all lower ones.
        std::uint64_t from;
        Ref<Chunk> chunk;
    };
    struct Shard : Shared {
        struct Named {
            std::size_t hash;
            std::uint64_t order;
        };
        std::vector<Named> names;
    };

    std::vector<Slot> slots;
    std::vector<Ref<Shard>> shards;  // a power of two, selected by the low bits of the hash
    std::size_t size = 0;

    [[nodiscard]] std::size_t slotOf(std::uint64_t order) const {
        const auto after =
            std::upper_bound(slots.begin(), slots.end(), order,
                             [](std::uint64_t o, const Slot& slot) { return o < slot.from; });
        return after == slots.begin() ? 0 : static_cast<std::size_t>(after - slots.begin()) - 1;
    }

    [[nodiscard]] const ChildEntry* find(std::string_view name) const {
        const std::size_t hash = hashOf(name);
        for (const auto& named : shards[hash & (shards.size() - 1)]->names) {
            if (named.hash != hash) continue;
            const ChildEntry& entry = *slots[slotOf(named.order)].chunk->at(named.order);
            if (entry.name == name) return &entry;
        }
        return nullptr;
    }

    void addName(std::string_view name, std::uint64_t order) {
        if (size > shards.size() * kShardEntries) splitShards();
        const std::size_t hash = hashOf(name);
        shards[hash & (shards.size() - 1)].editable().names.push_back({hash, order});
    }

    void dropName(std::string_view name, std::uint64_t order) {
        auto& names = shards[hashOf(name) & (shards.size() - 1)].editable().names;
        const auto found = std::find_if(names.begin(), names.end(),
                                        [&](const auto& named) { return named.order == order; });
        *found = names.back();
        names.pop_back();
    }

    void splitShards() {
        const std::size_t count = shards.size();
        std::vector<Ref<Shard>> split;
        for (std::size_t i = 0; i < 2 * count; ++i) split.emplace_back(new Shard);
        for (const auto& shard : shards)
            for (const auto& named : shard->names)
                split[named.hash & (2 * count - 1)].editable().names.push_back(named);
        shards = std::move(split);
    }

    void insert(ChildEntry entry) {
        ++size;
        addName(entry.name, entry.order);
        std::size_t at = slotOf(entry.order);
        if (slots[at].chunk->entries.size() >= kChunkEntries) at = makeRoomIn(at, entry.order);
        slots[at].chunk.editable().insert(std::move(entry));
    }

    // Splits a full chunk, or adds one after the last. Returns the index of the slot for `order`.
    std::size_t makeRoomIn(std::size_t at, std::uint64_t order) {
        const bool append = at + 1 == slots.size() && slots[at].chunk->entries.back().order < order;
        Ref<Chunk> upper(new Chunk);
        auto& moved = upper.editable().entries;
        moved.reserve(kChunkEntries);
        std::uint64_t from = order;
        if (!append) {
            auto& entries = slots[at].chunk.editable().entries;
            const auto middle = entries.begin() + static_cast<std::ptrdiff_t>(entries.size() / 2);
            from = middle->order;
            moved.assign(std::make_move_iterator(middle), std::make_move_iterator(entries.end()));
            entries.erase(middle, entries.end());
        }
        slots.insert(slots.begin() + static_cast<std::ptrdiff_t>(at) + 1, {from, upper});
        return order >= from ? at + 1 : at;
    }

    using Position = std::pair<std::size_t, std::size_t>;  // slot and index in its chunk

    [[nodiscard]] std::vector<Position> positions(std::uint64_t from, std::uint64_t last) const {
        std::vector<Position> found;
        for (std::size_t slot = slotOf(from); slot < slots.size(); ++slot) {
            const Chunk& chunk = *slots[slot].chunk;
            for (auto entry = chunk.at(from); entry != chunk.entries.end(); ++entry) {
                if (entry->order > last) return found;
                found.emplace_back(slot, entry - chunk.entries.begin());
            }
        }
        return found;
    }

    // Gives new order numbers to the entries around `order`, so that there is room between them.
    // Takes the smallest aligned range of 2^n numbers with at most 2^(n/2) entries. So placing many
    // entries at one place renumbers O(log size) entries for each (Bender et al., "Two Simplified
    // Algorithms for Maintaining Order in a List").
    void spread(std::uint64_t order) {
        unsigned bits = kLeastSpread;
        const auto from = [&] { return order >> bits << bits; };
        const auto length = [&] { return std::uint64_t{1} << bits; };
        auto spread = positions(from(), from() + length() - 1);
        while (spread.size() > std::size_t{1} << (bits / 2)) {
            ++bits;
            spread = positions(from(), from() + length() - 1);
        }
        for (const auto& [slot, index] : spread) {
            const ChildEntry& entry = slots[slot].chunk->entries[index];
            dropName(entry.name, entry.order);
        }
        std::uint64_t next = from();
        for (const auto& [slot, index] : spread) {
            ChildEntry& entry = slots[slot].chunk.editable().entries[index];
            entry.order = next += length() / (spread.size() + 1);
            addName(entry.name, entry.order);
        }
        const std::size_t end = std::min(spread.back().first + 2, slots.size());
        for (std::size_t slot = spread.front().first; slot < end; ++slot)
            slots[slot].from = slots[slot].chunk->entries.front().order;
    }

    ChildEntry take(std::uint64_t order) {
        const std::size_t at = slotOf(order);
        ChildEntry taken = slots[at].chunk.editable().take(order);
        dropName(taken.name, order);
        if (slots[at].chunk->entries.empty() && slots.size() > 1)
            slots.erase(slots.begin() + static_cast<std::ptrdiff_t>(at));
        --size;
        return taken;
    }
};

ChildSequence::ChildSequence() = default;
ChildSequence::ChildSequence(const ChildSequence&) = default;
ChildSequence::ChildSequence(ChildSequence&&) noexcept = default;
ChildSequence& ChildSequence::operator=(ChildSequence other) noexcept {
    std::swap(small_, other.small_);
    std::swap(large_, other.large_);
    return *this;
}
ChildSequence::~ChildSequence() = default;

std::size_t ChildSequence::size() const {
    if (large_) return large_->size;
    return small_ ? small_->entries.size() : 0;
}

std::size_t ChildSequence::blocks() const {
    return large_ ? large_->slots.size() : std::size_t{small_ ? 1U : 0U};
}

const std::vector<ChildEntry>& ChildSequence::block(std::size_t index) const {
    return large_ ? large_->slots[index].chunk->entries : small_->entries;
}

const ChildEntry* ChildSequence::find(std::string_view name) const {
    if (large_) return large_->find(name);
    if (!small_) return nullptr;
    for (const ChildEntry& entry : small_->entries)
        if (entry.name == name) return &entry;
    return nullptr;
}

const ChildEntry* ChildSequence::first() const { return size() ? &block(0).front() : nullptr; }

const ChildEntry* ChildSequence::last() const {
    return size() ? &block(blocks() - 1).back() : nullptr;
}

const ChildEntry* ChildSequence::next(std::uint64_t order) const {
    const std::size_t slot = large_ ? large_->slotOf(order) : 0;
    const auto& entries = block(slot);
    const auto after = std::lower_bound(entries.begin(), entries.end(), order + 1, orderBelow);
    if (after != entries.end()) return &*after;
    return slot + 1 < blocks() ? &block(slot + 1).front() : nullptr;
}

const ChildEntry* ChildSequence::at(std::uint64_t order) const {
    const Chunk& chunk = large_ ? *large_->slots[large_->slotOf(order)].chunk : *small_;
    return &*chunk.at(order);
}

std::vector<const ChildEntry*> ChildSequence::entries() const {
    std::vector<const ChildEntry*> all;
    all.reserve(size());
    forEach([&](const ChildEntry& entry) { all.push_back(&entry); });
    return all;
}

std::vector<const ChildEntry*> ChildSequence::entriesNotSharedWith(
    const ChildSequence& other) const {
    std::vector<const ChildEntry*> own;
    std::size_t theirs = 0;
    for (std::size_t i = 0; i < blocks(); ++i) {
        const auto& entries = block(i);
        while (theirs < other.blocks() && other.block(theirs).front().order < entries.front().order)
            ++theirs;
        if (theirs < other.blocks() && &other.block(theirs) == &entries) continue;
        for (const ChildEntry& entry : entries) own.push_back(&entry);
    }
    return own;
}

bool ChildSequence::isInOrderOf(const ChildSequence& wanted) const {
    std::size_t theirBlock = 0;
    std::size_t theirs = 0;  // index in the block of `other`
    for (std::size_t i = 0; i < blocks(); ++i) {
        if (theirBlock == wanted.blocks()) return true;
        if (theirs == 0 && &wanted.block(theirBlock) == &block(i)) {
            ++theirBlock;
            continue;
        }
        for (const ChildEntry& entry : block(i)) {
            if (theirBlock == wanted.blocks()) return true;
            if (entry.name == wanted.block(theirBlock)[theirs].name) {
                if (++theirs < wanted.block(theirBlock).size()) continue;
                theirs = 0;
                ++theirBlock;
            } else if (wanted.find(entry.name)) {
                return false;
            }
        }
    }
    return true;
}

ChildEntry& ChildSequence::editable(std::uint64_t order) {
    if (!large_) return *small_.editable().at(order);
    Large& large = large_.editable();
    return *large.slots[large.slotOf(order)].chunk.editable().at(order);
}

LayerDoc::Node& ChildSequence::editableNode(std::uint64_t order) {
    return editable(order).node.editable();
}

void ChildSequence::insert(ChildEntry entry) {
    if (large_) return large_.editable().insert(std::move(entry));
    if (!small_) small_ = Ref<Chunk>(new Chunk);
    Chunk& chunk = small_.editable();
    chunk.insert(std::move(entry));
    if (chunk.entries.size() > kSmall) fill(std::move(chunk.entries));
}

ChildEntry ChildSequence::take(std::uint64_t order) {
    if (large_) {
        if (size() > 1) return large_.editable().take(order);
        ChildEntry taken = *at(order);
        large_ = {};
        return taken;
    }
    ChildEntry taken = small_.editable().take(order);
    if (small_->entries.empty()) small_ = {};
    return taken;
}

void ChildSequence::fill(std::vector<ChildEntry> sorted) {
    small_ = {};
    large_ = {};
    if (sorted.empty()) return;
    if (sorted.size() <= kSmall) {
        small_ = Ref<Chunk>(new Chunk);
        sorted.shrink_to_fit();
        small_.editable().entries = std::move(sorted);
        return;
    }
    large_ = Ref<Large>(new Large);
    Large& large = large_.editable();
    large.shards.emplace_back(new Large::Shard);
    Ref<Chunk> chunk(new Chunk);
    large.slots.push_back({sorted.front().order, chunk});
    chunk = {};
    for (auto& entry : sorted) large.insert(std::move(entry));
}

void ChildSequence::renumber() {
    std::vector<ChildEntry> all;
    all.reserve(size());
    forEach([&](const ChildEntry& entry) { all.push_back(entry); });
    std::uint64_t order = 0;
    for (auto& entry : all) entry.order = order += kOrderStep;
    fill(std::move(all));
}

ChildSequence::Placed ChildSequence::append(std::string name, Ref<LayerDoc::Node> node) {
    constexpr auto kHighest = std::numeric_limits<std::uint64_t>::max() - kOrderStep;
    const bool full = size() && last()->order >= kHighest;
    if (full) renumber();
    const std::uint64_t order = (size() ? last()->order : 0) + kOrderStep;
    insert({std::move(name), order, std::move(node)});
    return {order, full};
}

ChildSequence::Placed ChildSequence::place(std::uint64_t order,
                                           std::optional<std::uint64_t> before) {
    ChildEntry entry = take(order);
    if (!before) {
        const Placed placed = append(std::move(entry.name), std::move(entry.node));
        return placed;
    }
    const auto predecessor = [&]() -> std::uint64_t {
        const std::size_t slot = large_ ? large_->slotOf(*before) : 0;
        const auto& entries = block(slot);
        const auto at = std::lower_bound(entries.begin(), entries.end(), *before, orderBelow);
        if (at != entries.begin()) return std::prev(at)->order;
        return slot ? block(slot - 1).back().order : 0;
    };
    std::uint64_t low = predecessor();
    const bool full = *before - low < 2;
    if (full) {
        const std::string successor = at(*before)->name;
        if (large_)
            large_.editable().spread(*before);
        else
            renumber();
        before = find(successor)->order;
        low = predecessor();
    }
    entry.order = low + (*before - low) / 2;
    const std::uint64_t placed = entry.order;
    insert(std::move(entry));
    return {placed, full};
}

Ref<LayerDoc::Node> ChildSequence::remove(std::uint64_t order) { return take(order).node; }

void ChildSequence::rename(std::uint64_t order, std::string name) {
    ChildEntry& entry = editable(order);
    if (large_) {
        Large& large = large_.editable();
        large.dropName(entry.name, order);
        large.addName(name, order);
    }
    entry.name = std::move(name);
}

bool ChildSequence::hasOrder(std::uint64_t order) const {
    if (!size()) return false;
    const auto& entries = block(large_ ? large_->slotOf(order) : 0);
    const auto found = std::lower_bound(entries.begin(), entries.end(), order, orderBelow);
    return found != entries.end() && found->order == order;
}

}  // namespace usdlive
