// The content of a Wavefront .obj file, without anything of OpenUSD.
#pragma once

#include <array>
#include <string>
#include <vector>

namespace usdlive::obj {

using Vec3 = std::array<float, 3>;

/// A corner of a face, as indices from 0. -1: none.
struct Corner {
    int point = 0, texCoord = -1, normal = -1;

    bool operator==(const Corner&) const = default;
};

/// The elements of one object or group, in the order of the file.
struct Part {
    std::string name = {};
    std::vector<int> faceCounts = {};  ///< corners of each face
    std::vector<Corner> corners = {};
    std::vector<int> faceMaterials =
        {};  ///< one for each face: an index of Model::materials; -1: none
    std::vector<int> lineCounts = {};  ///< points of each polyline
    std::vector<int> linePoints = {};
    std::vector<int> points = {};  ///< those of "p" elements

    [[nodiscard]] bool isEmpty() const {
        return faceCounts.empty() && lineCounts.empty() && points.empty();
    }
    bool operator==(const Part&) const = default;
};

struct Model {
    std::vector<Vec3> points;
    std::vector<Vec3> colors;     ///< empty, or one for each point
    std::vector<bool> isColored;  ///< the same: which points of the file have a colour
    std::vector<Vec3> texCoords;  ///< u, v and a third one that is mostly 0
    std::vector<Vec3> normals;
    std::vector<std::string> materials, materialLibraries;
    std::vector<Part> parts;

    bool operator==(const Model&) const = default;
};

}  // namespace usdlive::obj
