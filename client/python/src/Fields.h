// Protocol structs (USDLIVE_FIELDS) to Python and back. In Python the names are in snake_case, and
// times are in seconds: `timeMs` is `time`.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <optional>
#include <string>
#include <type_traits>
#include <vector>

#include "Errors.h"
#include "usdlive/common/core/Hash.h"
#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/LayerPath.h"
#include "usdlive/common/protocol/Fields.h"

namespace usdlive {

[[nodiscard]] inline bool isTime(std::string_view field) { return field.ends_with("Ms"); }

/// "lockedAtMs" is "locked_at".
[[nodiscard]] inline std::string pythonName(std::string_view field) {
    if (isTime(field)) field.remove_suffix(2);
    std::string name;
    for (const char letter : field) {
        if (letter >= 'A' && letter <= 'Z')
            name += {'_', char(letter - 'A' + 'a')};
        else
            name += letter;
    }
    return name;
}

[[nodiscard]] inline nanobind::object toPython(const std::string& text) {
    return nanobind::str(text.data(), text.size());
}
template <class Tag>
[[nodiscard]] nanobind::object toPython(const Id<Tag>& id) {
    return toPython(id.value);
}
template <class T>
    requires std::is_arithmetic_v<T>
[[nodiscard]] nanobind::object toPython(T value) {
    return nanobind::cast(value);
}
template <class T>
[[nodiscard]] nanobind::object toPython(const std::optional<T>& value);
template <class T>
[[nodiscard]] nanobind::object toPython(const std::vector<T>& values);
template <HasFields T>
[[nodiscard]] nanobind::object toPython(const T& message);

/// Adds the fields of `message`.
template <HasFields T>
void putFields(nanobind::dict& into, const T& message) {
    forEachField(message, [&](std::string_view name, const auto& value) {
        using Value = std::remove_cvref_t<decltype(value)>;
        if constexpr (std::is_same_v<Value, std::uint64_t>)
            into[pythonName(name).c_str()] =
                isTime(name) ? toPython(double(value) / 1000.0) : toPython(value);
        else
            into[pythonName(name).c_str()] = toPython(value);
    });
}

template <class T>
nanobind::object toPython(const std::optional<T>& value) {
    return value ? toPython(*value) : nanobind::none();
}
template <class T>
nanobind::object toPython(const std::vector<T>& values) {
    nanobind::list list;
    for (const T& value : values) list.append(toPython(value));
    return nanobind::tuple(list);
}
template <HasFields T>
nanobind::object toPython(const T& message) {
    nanobind::dict dictionary;
    putFields(dictionary, message);
    return dictionary;
}

template <class T>
void fromPython(nanobind::handle object, T& value) {
    value = nanobind::cast<T>(object);
}
inline void fromPython(nanobind::handle object, LayerId& layer) {
    layer = orRaise(parseLayerId(nanobind::cast<std::string>(object)));
}
inline void fromPython(nanobind::handle object, Hash& hash) {
    const auto found = hashFromHex(nanobind::cast<std::string>(object));
    if (!found) raise({ErrorCode::InvalidArgument, "a hash has 64 hexadecimal digits"});
    hash = *found;
}
template <class T>
void fromPython(nanobind::handle object, std::vector<T>& values) {
    for (const nanobind::handle one : object) fromPython(one, values.emplace_back());
}
template <class T>
void fromPython(nanobind::handle object, std::optional<T>& value) {
    if (!object.is_none()) fromPython(object, value.emplace());
}

/// Sets fields of a request; those that are not given keep their value. `invalidArgument` for one
/// that it does not have or that has another type.
template <HasFields T>
void setFields(T& request, const nanobind::dict& given) {
    std::size_t known = 0;
    forEachField(request, [&](std::string_view name, auto& value) {
        const std::string key = pythonName(name);
        if (name == "request" || !given.contains(key.c_str())) return;
        ++known;
        try {
            fromPython(given[key.c_str()], value);
        } catch (const nanobind::cast_error&) {
            raise({ErrorCode::InvalidArgument,
                   std::string(T::kType) + ": '" + key + "' has the wrong type"});
        }
    });
    if (known == given.size()) return;
    raise({ErrorCode::InvalidArgument,
           std::string(T::kType) + " has not all of these fields: " +
               nanobind::cast<std::string>(nanobind::str(nanobind::list(given.keys())))});
}

}  // namespace usdlive
