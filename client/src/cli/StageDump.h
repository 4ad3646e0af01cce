// A composed stage as JSON, in the format "stage-dump/1" that other implementations print too.
#pragma once

#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "usdlive/client/usd/stage/Stage.h"

namespace usdlive::cli {

struct DumpOptions {
    std::string base;       ///< file paths are relative to this folder and begin with "$BASE/"
    std::size_t fold = 64;  ///< longer arrays are printed as their number of elements and a SHA-256
};

/// Everything that a stage shows, with instance proxies. Numbers that JSON does not have are the
/// texts "nan", "inf" and "-inf"; vectors and matrices are nested lists, quaternions end with the
/// real part.
[[nodiscard]] nlohmann::json dumpStage(const stage::Stage& stage, const DumpOptions& options);

}  // namespace usdlive::cli
