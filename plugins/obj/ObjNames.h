// Names that the reader and the writer of layers share.
#pragma once

#include <pxr/base/tf/stringUtils.h>
#include <pxr/base/tf/token.h>
#include <pxr/usd/sdf/path.h>

#include <map>
#include <set>
#include <string>

namespace usdlive::obj {

inline const std::string kMaterials = "Materials";  ///< the scope of the materials
inline const std::string kUnnamed = "default";      ///< elements before any "o" and "g"
inline const std::string kLibrariesKey = "objMaterialLibraries";  ///< "mtllib", in customData
inline const pxr::TfToken kInterpolation("interpolation");

[[nodiscard]] inline std::string asIdentifier(const std::string& name) {
    return pxr::SdfPath::IsValidIdentifier(name) ? name : pxr::TfMakeValidIdentifier(name);
}

/// The names of siblings: identifiers, each once.
class Names {
public:
    [[nodiscard]] pxr::TfToken add(const std::string& name) {
        const std::string base = asIdentifier(name);
        std::string own = base;
        while (!taken_.insert(own).second)
            own = base + '_' + std::to_string(++last_[base]);  // does not try a number twice
        return pxr::TfToken(own);
    }

private:
    std::set<std::string> taken_;
    std::map<std::string, int> last_;
};

}  // namespace usdlive::obj
