#pragma once

namespace usdlive {

/// One function of several lambdas, for std::visit.
template <class... Functions>
struct Overloaded : Functions... {
    using Functions::operator()...;
};
// Clang deduces nothing for an aggregate with bases before version 17.
template <class... Functions>
Overloaded(Functions...) -> Overloaded<Functions...>;

}  // namespace usdlive
