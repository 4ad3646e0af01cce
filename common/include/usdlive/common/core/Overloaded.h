// Combines lambdas for std::visit.
#pragma once

namespace usdlive {

/// Combines several lambdas into one function object, for std::visit.
template <class... Functions>
struct Overloaded : Functions... {
    using Functions::operator()...;
};
// Clang before version 17 does not deduce the arguments of an aggregate with base classes.
template <class... Functions>
Overloaded(Functions...) -> Overloaded<Functions...>;

}  // namespace usdlive
