// The order of a list of children while it changes.
#include "usdlive/common/usd/ChildOrder.h"

#include <algorithm>

namespace usdlive::usd {

bool ChildOrder::isIndexed() {
    if (changes_ > kFew) return true;
    if (++changes_ <= kFew) return false;
    for (const auto& name : std::exchange(few_, {})) placeIndexed(name, {});
    return true;
}

pxr::TfTokenVector ChildOrder::names() const {
    return changes_ > kFew ? pxr::TfTokenVector(order_.begin(), order_.end()) : few_;
}

void ChildOrder::place(const pxr::TfToken& name, const pxr::TfToken& before) {
    if (isIndexed()) return placeIndexed(name, before);
    const auto own = std::ranges::find(few_, name);
    if (own != few_.end() && name == before) return;
    if (own != few_.end()) few_.erase(own);
    few_.insert(std::ranges::find(few_, before), name);
}

void ChildOrder::placeIndexed(const pxr::TfToken& name, const pxr::TfToken& before) {
    const auto [own, isNew] = places_.try_emplace(name);
    if (isNew) own->second = order_.insert(order_.end(), name);
    const auto next = places_.find(before);
    order_.splice(next == places_.end() ? order_.end() : next->second, order_, own->second);
}

void ChildOrder::remove(const pxr::TfToken& name) {
    if (!isIndexed())
        std::erase(few_, name);
    else if (const auto place = places_.extract(name))
        order_.erase(place.mapped());
}

void ChildOrder::rename(const pxr::TfToken& from, const pxr::TfToken& to) {
    if (!isIndexed()) {
        std::ranges::replace(few_, from, to);
        return;
    }
    auto place = places_.extract(from);
    if (!place) return;
    *place.mapped() = place.key() = to;
    places_.insert(std::move(place));
}

}  // namespace usdlive::usd
