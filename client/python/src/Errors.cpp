// Converts errors of the C++ client to the package's exception.
#include "Errors.h"

#include <nanobind/stl/string.h>

#include <string>

namespace nb = nanobind;

namespace usdlive {

void setError(const Error& error) {
    const nb::object type = nb::module_::import_("usdlive._errors").attr("Error");
    const nb::object value = type(std::string(errorName(error.code)), error.message);
    PyErr_SetObject(type.ptr(), value.ptr());
}

}  // namespace usdlive
