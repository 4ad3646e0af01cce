// Writes the text of a Wavefront .obj file.
#pragma once

#include <string>

#include "ObjModel.h"

namespace usdlive::obj {

/// A text from which parse() makes the same model again, with numbers in full precision. `comment`
/// becomes lines with "#" at its beginning. Parts need different names without control characters.
[[nodiscard]] std::string print(const Model& model, const std::string& comment = {});

}  // namespace usdlive::obj
