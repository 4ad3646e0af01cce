// Values of a composed stage as JSON, for StageDump.
#pragma once

#include <pxr/base/vt/value.h>

#include <cstddef>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace usdlive::cli {

class ComposedValue {
public:
    ComposedValue(const std::string& base, std::size_t fold);

    [[nodiscard]] nlohmann::json operator()(const pxr::VtValue& value) const;
    [[nodiscard]] static nlohmann::json number(double value);
    [[nodiscard]] nlohmann::json numbers(const std::vector<double>& values) const;
    /// A path of a file, relative to the base folder if it is in there.
    [[nodiscard]] std::string file(const std::string& path) const;

private:
    std::filesystem::path base_;
    std::size_t fold_;
};

}  // namespace usdlive::cli
