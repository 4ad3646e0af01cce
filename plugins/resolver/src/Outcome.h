// A value, or the reason why there is none.
#pragma once

#include <string>
#include <utility>
#include <variant>

namespace usdlive::resolver {

/// Why something failed: a cause that can follow "cannot open ...: ".
struct Failure {
    std::string cause;
    unsigned status = 0;  ///< the HTTP status; 0: there was no answer
};

/// A value or a failure.
template <class T>
class [[nodiscard]] Outcome {
public:
    Outcome(T value) : content_(std::move(value)) {}
    Outcome(Failure failure) : content_(std::move(failure)) {}
    explicit operator bool() const { return content_.index() == 0; }
    T& operator*() { return std::get<0>(content_); }
    const T& operator*() const { return std::get<0>(content_); }
    T* operator->() { return &std::get<0>(content_); }
    const T* operator->() const { return &std::get<0>(content_); }
    [[nodiscard]] const Failure& failure() const { return std::get<1>(content_); }

private:
    std::variant<T, Failure> content_;
};

}  // namespace usdlive::resolver
