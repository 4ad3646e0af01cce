// The order of a list of children while it changes.
#pragma once

#include <pxr/base/tf/token.h>

#include <list>
#include <unordered_map>
#include <utility>

namespace usdlive::usd {

/// The order of a list of children while edits change it. The first few changes search the list.
/// Then it gets an index, which takes longer than they do, and each change takes constant time.
class ChildOrder {
public:
    explicit ChildOrder(pxr::TfTokenVector names) : few_(std::move(names)) {}
    ChildOrder(ChildOrder&&) = default;
    /// Moves or adds a child before the child `before`, or to the end if there is none.
    void place(const pxr::TfToken& name, const pxr::TfToken& before);
    void remove(const pxr::TfToken& name);
    void rename(const pxr::TfToken& from, const pxr::TfToken& to);
    [[nodiscard]] pxr::TfTokenVector names() const;

private:
    using Order = std::list<pxr::TfToken>;
    static constexpr int kFew = 8;

    /// Returns whether the list has its index. Counts the change.
    bool isIndexed();
    void placeIndexed(const pxr::TfToken& name, const pxr::TfToken& before);

    pxr::TfTokenVector few_;  // the names until there is an index
    int changes_ = 0;
    Order order_;
    std::unordered_map<pxr::TfToken, Order::iterator, pxr::TfToken::HashFunctor> places_;
};

}  // namespace usdlive::usd
