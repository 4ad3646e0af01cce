// Finds texts that are nested too deeply for OpenUSD.
#pragma once

#include <pxr/usd/ar/resolvedPath.h>

#include <string>

namespace usdlive::usd {

/// Returns why a file would fill the stack of OpenUSD's text parser, which ends the process: the
/// line and the limits. Empty if it would not, or if the file is no text or cannot be read. Reads
/// the whole file.
[[nodiscard]] std::string whyTooDeep(const pxr::ArResolvedPath& file);

}  // namespace usdlive::usd
