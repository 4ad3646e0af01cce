// Prints the statements of an .obj file.
#include "ObjText.h"

#include <charconv>
#include <cstdint>
#include <sstream>

namespace usdlive::obj {

namespace {

class Printer {
public:
    explicit Printer(const Model& model) : model_(model) {}

    std::string run(const std::string& comment) {
        std::istringstream lines(comment);
        for (std::string line; std::getline(lines, line);) text_ += "# " + line + '\n';
        for (const auto& library : model_.materialLibraries) text_ += "mtllib " + library + '\n';
        for (std::size_t at = 0; at < model_.points.size(); ++at) printPoint(at);
        // The third number of texture coordinates is optional.
        for (const auto& [u, v, w] : model_.texCoords) {
            text_ += "vt";
            print(u);
            print(v);
            if (w != 0) print(w);
            text_ += '\n';
        }
        for (const auto& normal : model_.normals) printVector("vn", normal);
        for (const auto& part : model_.parts) printPart(part);
        return std::move(text_);
    }

private:
    void print(float number) {
        char digits[32];
        const auto end = std::to_chars(digits, digits + sizeof digits, number).ptr;
        text_ += ' ';
        text_.append(digits, end);
    }
    void print(int index) {
        text_ += ' ';
        text_ += std::to_string(std::int64_t(index) + 1);
    }

    void printVector(const char* keyword, const Vec3& vector) {
        text_ += keyword;
        for (const float number : vector) print(number);
        text_ += '\n';
    }

    void printPoint(std::size_t at) {
        text_ += 'v';
        for (const float number : model_.points[at]) print(number);
        if (!model_.colors.empty() && model_.isColored[at])
            for (const float number : model_.colors[at]) print(number);
        text_ += '\n';
    }

    void printPart(const Part& part) {
        if (!part.name.empty()) text_ += "o " + part.name + '\n';
        std::size_t next = 0;
        for (std::size_t face = 0; face < part.faceCounts.size(); ++face) {
            useMaterial(part.faceMaterials[face]);
            text_ += 'f';
            for (int corner = 0; corner < part.faceCounts[face]; ++corner)
                printCorner(part.corners[next++]);
            text_ += '\n';
        }
        next = 0;
        for (const int count : part.lineCounts) {
            text_ += 'l';
            for (int point = 0; point < count; ++point) print(part.linePoints[next++]);
            text_ += '\n';
        }
        for (const int point : part.points) {
            text_ += 'p';
            print(point);
            text_ += '\n';
        }
    }

    void printCorner(const Corner& corner) {
        print(corner.point);
        if (corner.texCoord < 0 && corner.normal < 0) return;
        text_ += '/';
        if (corner.texCoord >= 0) text_ += std::to_string(std::int64_t(corner.texCoord) + 1);
        if (corner.normal >= 0) text_ += '/' + std::to_string(std::int64_t(corner.normal) + 1);
    }

    void useMaterial(int material) {
        if (material == material_ || material < 0)
            return;  // no statement ends the use of a material
        material_ = material;
        text_ += "usemtl " + model_.materials[std::size_t(material)] + '\n';
    }

    const Model& model_;
    std::string text_;
    int material_ = -1;
};

}  // namespace

std::string print(const Model& model, const std::string& comment) {
    return Printer(model).run(comment);
}

}  // namespace usdlive::obj
