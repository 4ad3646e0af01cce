// The rows of a table as placements of assets.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace usdlive::edf::table {

struct Placement {
    std::string name;   ///< a name of a prim, different from all others
    std::string asset;  ///< empty for a place without an asset
    std::string prim;   ///< the prim of the asset; empty for its default prim
    std::array<double, 3> translate{0, 0, 0}, rotate{0, 0, 0}, scale{1, 1, 1};
    std::vector<std::pair<std::string, std::string>>
        other;  ///< columns without a meaning here, by attribute
};

struct Placements {
    std::vector<Placement> rows;
    std::string error;  ///< names the line and the column; empty if all could be read
};

/// Reads a table in UTF-8 whose first row names the columns: `asset` is needed; `name`, `prim`, `x
/// y z`, `rotateX rotateY rotateZ` (degrees), `scale` or `scaleX scaleY scaleZ` are known. Others
/// become attributes `table:COLUMN`.
[[nodiscard]] Placements readPlacements(std::string_view csv);

}  // namespace usdlive::edf::table
