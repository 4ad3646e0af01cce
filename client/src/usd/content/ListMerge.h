// Undoes changes of lists item by item.
#pragma once

#include <pxr/base/vt/value.h>

#include <algorithm>
#include <optional>
#include <vector>

namespace usdlive::content {

/// Undoes the change from `before` to `after` in a list that others have changed to `present`:
/// removes added items, and inserts removed ones behind the items that they followed. Restores the
/// order of the remaining items if others have not changed it.
template <class Item>
std::vector<Item> undoneList(const std::vector<Item>& present, const std::vector<Item>& after,
                             const std::vector<Item>& before) {
    const auto has = [](const auto& list, const Item& item) {
        return std::ranges::find(list, item) != list.end();
    };
    std::vector<Item> common, kept, order;
    for (const Item& item : after)
        if (has(before, item)) common.push_back(item);
    for (const Item& item : present)
        if (!has(after, item) || has(before, item)) kept.push_back(item);
    for (const Item& item : before)
        if (has(after, item)) order.push_back(item);

    std::vector<Item> shared;
    std::ranges::copy_if(kept, std::back_inserter(shared),
                         [&](const Item& item) { return has(common, item); });
    if (shared == common && order.size() == common.size()) {
        auto next = order.begin();
        for (Item& item : kept)
            if (has(common, item)) item = *next++;
    }
    for (std::size_t i = 0; i < before.size(); ++i) {
        if (has(after, before[i]) || has(kept, before[i])) continue;
        auto place = kept.begin();
        for (std::size_t earlier = i; earlier-- > 0 && place == kept.begin();)
            if (const auto at = std::ranges::find(kept, before[earlier]); at != kept.end())
                place = at + 1;
        kept.insert(place, before[i]);
    }
    return kept;
}

/// Does the same for the value of a field: sublayers and list ops. Returns nothing for other
/// values, and if only one of the list ops is explicit.
[[nodiscard]] std::optional<pxr::VtValue> undoneList(const pxr::VtValue& present,
                                                     const pxr::VtValue& after,
                                                     const pxr::VtValue& before);

}  // namespace usdlive::content
