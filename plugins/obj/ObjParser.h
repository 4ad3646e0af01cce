// Reads the text of a Wavefront .obj file.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <variant>

#include "ObjModel.h"

namespace usdlive::obj {

/// Which statements begin a new part.
enum class Split {
    Automatic,  ///< "o", or "g" in a file without any "o"
    Objects,
    Groups,
    None,
};

struct ParseError {
    std::size_t line = 0;  ///< from 1
    std::string reason;    ///< "'f' needs three or more corners"
};

/// Returns all of the content or an error, never a part. Polygons, lines, points, colours of
/// vertices and names of materials are read; smoothing groups and display attributes are passed
/// over. Free-form geometry and unknown statements are errors. Names that are not UTF-8 have U+FFFD
/// for each wrong byte.
[[nodiscard]] std::variant<Model, ParseError> parse(std::string_view text, Split split = {});

/// Whether the beginning of a file looks like an .obj file: its first statement is one that parse()
/// knows, or there is none.
[[nodiscard]] bool looksLikeObj(std::string_view beginning);

}  // namespace usdlive::obj
