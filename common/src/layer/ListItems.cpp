// Keeps the items of a list op's list in order, and finds them.
#include "usdlive/common/layer/ListItems.h"

#include <algorithm>
#include <string_view>
#include <unordered_set>

#include "usdlive/common/core/ByteStream.h"

namespace usdlive {

namespace {

constexpr std::size_t kShort = 16;  // Items are always searched one by one up to here.
constexpr int kUnindexedChanges = 8;

// Returns the asset path of a sublayer, as itemKey().
std::string_view assetOf(const Value& subLayer) { return ByteReader(subLayer.bytes()).text(); }

std::string_view keyOf(const Value& item) {
    if (item.type() == ValueType::SubLayer) return assetOf(item);
    if (item.isBlob()) return {};
    const ByteView bytes = item.bytes();
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

using Linked = std::list<Value>::iterator;
const Value& valueOf(const Value& value) { return value; }
const Value& valueOf(const Linked& linked) { return *linked; }

struct KeyHash {
    using is_transparent = void;
    std::size_t operator()(const auto& item) const {
        return std::hash<std::string_view>{}(keyOf(valueOf(item)));
    }
};
struct SameKey {
    using is_transparent = void;
    bool operator()(const auto& left, const auto& right) const {
        return sameItem(valueOf(left), valueOf(right));
    }
};

}  // namespace

bool sameItem(const Value& left, const Value& right) {
    if (left.type() != right.type()) return false;
    return left.type() == ValueType::SubLayer ? assetOf(left) == assetOf(right) : left == right;
}

// A list without equal items.
struct ListItems::Indexed {
    std::list<Value> order;
    std::unordered_set<Linked, KeyHash, SameKey> places;

    [[nodiscard]] Linked find(const Value& item) {
        const auto found = places.find(item);
        return found == places.end() ? order.end() : *found;
    }
    /// Returns false, and leaves the list as it is, if there is the same item.
    bool append(const Value& item) {
        const bool isNew = places.insert(order.insert(order.end(), item)).second;
        if (!isNew) order.pop_back();
        return isNew;
    }
};

struct ListItems::Content {
    std::vector<Value> items;  // empty if there is an index
    int changes = 0;           // made in `items`
    std::unique_ptr<Indexed> index;
};

ListItems::ListItems(std::vector<Value> items) {
    if (!items.empty()) content().items = std::move(items);
}
ListItems::ListItems() = default;
ListItems::ListItems(ListItems&&) noexcept = default;
ListItems& ListItems::operator=(ListItems&&) noexcept = default;
ListItems::~ListItems() = default;

ListItems::Content& ListItems::content() {
    if (!content_) content_ = std::make_unique<Content>();
    return *content_;
}

ListItems::Indexed* ListItems::indexed() {
    Content& content = this->content();
    if (content.index || content.items.size() <= kShort || ++content.changes <= kUnindexedChanges)
        return content.index.get();
    content.changes = 0;
    auto index = std::make_unique<Indexed>();
    index->places.reserve(content.items.size());
    for (const Value& item : content.items)
        if (!index->append(item)) return nullptr;
    content.items = {};
    return (content.index = std::move(index)).get();
}

ListItems::Iterator ListItems::begin() const {
    if (!content_) return {};
    return content_->index ? Iterator(content_->index->order.cbegin())
                           : Iterator(content_->items.data());
}

ListItems::Iterator ListItems::end() const {
    if (!content_) return {};
    return content_->index ? Iterator(content_->index->order.cend())
                           : Iterator(content_->items.data() + content_->items.size());
}

std::size_t ListItems::size() const {
    if (!content_) return 0;
    return content_->index ? content_->index->order.size() : content_->items.size();
}

std::vector<Value> ListItems::values() const {
    if (!content_) return {};
    return content_->index ? std::vector<Value>(begin(), end()) : content_->items;
}

bool operator==(const ListItems& left, const ListItems& right) {
    return left.size() == right.size() && std::equal(left.begin(), left.end(), right.begin());
}

ListItems::Iterator ListItems::find(const Value& item) const {
    if (content_ && content_->index) return Iterator(content_->index->find(item));
    return std::find_if(begin(), end(), [&](const Value& other) { return sameItem(item, other); });
}

bool ListItems::isPlaced(const Value& item, const std::optional<Value>& before) const {
    const auto at = find(item);
    if (at == end() || *at != item) return false;
    const auto next = std::next(at);
    const auto same = [&](const Value& other) { return sameItem(item, other); };
    if (!content_->index && std::any_of(next, end(), same)) return false;
    if (before && sameItem(*before, item)) return true;
    return next == (before ? find(*before) : end());
}

void ListItems::push_back(Value item) {
    Content& content = this->content();
    if (content.index) content = {values(), 0, nullptr};
    content.items.push_back(std::move(item));
}

void ListItems::place(const Value& item, const std::optional<Value>& before) {
    if (Indexed* const index = indexed()) {
        const auto at = index->find(item);
        if (at == index->order.end())
            index->append(item);
        else
            *at = item;
        if (before && sameItem(*before, item)) return;
        const auto own = at == index->order.end() ? std::prev(at) : at;
        const auto next = before ? index->find(*before) : index->order.end();
        return index->order.splice(next, index->order, own);
    }
    auto& items = content_->items;
    const auto same = [](const Value& wanted) {
        return [&wanted](const Value& other) { return sameItem(wanted, other); };
    };
    const auto at = std::ranges::find_if(items, same(item));
    if (before && sameItem(*before, item) && at != items.end()) {
        *at = item;
        return;
    }
    std::erase_if(items, same(item));
    items.insert(before ? std::ranges::find_if(items, same(*before)) : items.end(), item);
}

void ListItems::remove(const Value& item) {
    if (!content_) return;
    if (Indexed* const index = indexed()) {
        const auto found = index->places.find(item);
        if (found == index->places.end()) return;
        const Linked linked = *found;
        index->places.erase(found);
        index->order.erase(linked);
        return;
    }
    std::erase_if(content_->items, [&](const Value& other) { return sameItem(item, other); });
}

}  // namespace usdlive
