// Converts errors to Python exceptions.
#pragma once

#include <nanobind/nanobind.h>

#include <utility>

#include "usdlive/common/core/Result.h"

namespace usdlive {

/// Sets usdlive.Error(code, message) as the current exception of the interpreter.
void setError(const Error& error);

/// Raises the error as a Python exception.
[[noreturn]] inline void raise(const Error& error) {
    setError(error);
    throw nanobind::python_error();
}

template <class T>
T orRaise(Result<T> result) {
    if (!result) raise(result.error());
    return std::move(*result);
}

}  // namespace usdlive
