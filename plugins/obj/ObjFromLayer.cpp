// Makes the text of an .obj file from a layer, and finds what the text would lose.
#include <pxr/base/gf/vec2f.h>
#include <pxr/base/gf/vec3f.h>
#include <pxr/base/vt/array.h>
#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/sdf/path.h>
#include <pxr/usd/sdf/schema.h>
#include <pxr/usd/sdf/types.h>

#include <algorithm>
#include <charconv>
#include <set>
#include <sstream>

#include "ObjLayer.h"
#include "ObjNames.h"
#include "ObjText.h"

namespace usdlive::obj {

using pxr::GfVec3f;
using pxr::SdfFieldKeys;
using pxr::SdfPath;
using pxr::TfToken;
using pxr::VtValue;

namespace {

Vec3 fromGf(const GfVec3f& vector) { return {vector[0], vector[1], vector[2]}; }

std::string at(const SdfPath& path) { return "<" + path.GetString() + ">"; }

/// Thrown at the first thing that cannot be stored, and caught by printLayer().
struct CannotStore {
    std::string problem;
};

/// Values of a primvar or of normals, for every corner of a mesh.
struct PerCorner {
    std::vector<Vec3> values;
    std::vector<int> indices;  ///< one for each corner
};

/// Collects the geometry of a layer. Reads what it knows and passes over the rest: printLayer()
/// finds that in a comparison with the layer that the text gives.
class ModelMaker {
public:
    ModelMaker(const pxr::SdfAbstractData& data, const Options& options)
        : data_(data), root_(SdfPath::AbsoluteRootPath().AppendChild(options.root)) {
        readLibraries();
        auto prims = children(root_);
        // No statement ends the use of a material: prims without any come first.
        std::stable_partition(prims.begin(), prims.end(), [&](const TfToken& name) {
            return !hasMaterial(root_.AppendChild(name));
        });
        for (const auto& name : prims) readPrim(root_.AppendChild(name));
    }

    [[nodiscard]] const Model& model() const { return model_; }
    /// Properties that are stored completely, although they may be read with other indices.
    [[nodiscard]] bool isStored(const SdfPath& property) const {
        return stored_.contains(property);
    }

private:
    template <class T>
    [[nodiscard]] T value(const SdfPath& path, const TfToken& field) const {
        return data_.Get(path, field).GetWithDefault<T>();
    }
    template <class T>
    [[nodiscard]] T attribute(const SdfPath& prim, const char* name) const {
        return value<T>(prim.AppendProperty(TfToken(name)), SdfFieldKeys->Default);
    }
    [[nodiscard]] pxr::TfTokenVector children(const SdfPath& prim) const {
        return value<pxr::TfTokenVector>(prim, pxr::SdfChildrenKeys->PrimChildren);
    }

    void readLibraries() {
        const auto data = value<pxr::VtDictionary>(root_, SdfFieldKeys->CustomData);
        const auto found = data.find(kLibrariesKey);
        if (found == data.end()) return;
        const auto libraries = found->second.GetWithDefault<pxr::VtStringArray>();
        model_.materialLibraries.assign(libraries.begin(), libraries.end());
    }

    // The name in the file: the one for display, if the prim's follows from it.
    [[nodiscard]] std::string nameOf(const SdfPath& prim) const {
        const auto shown = value<std::string>(prim, SdfFieldKeys->DisplayName);
        if (!shown.empty() && asIdentifier(shown) == prim.GetName()) return shown;
        return prim.GetName() == kUnnamed ? std::string() : prim.GetName();
    }

    void readPrim(const SdfPath& prim) {
        const auto type = value<TfToken>(prim, SdfFieldKeys->TypeName);
        if (type == "Mesh")
            readMesh(prim);
        else if (type == "BasisCurves")
            readCurves(prim);
        else if (type == "Points")
            readPoints(prim);
    }

    // Adds the points of a prim to the file; returns the index of the first and their number.
    std::pair<int, int> addPoints(const SdfPath& prim) {
        const auto points = attribute<pxr::VtVec3fArray>(prim, "points");
        const auto colors = attribute<pxr::VtVec3fArray>(prim, "primvars:displayColor");
        const int first = int(model_.points.size());
        if (!colors.empty() || !model_.colors.empty()) {
            model_.colors.resize(model_.points.size(), {1, 1, 1});
            model_.isColored.resize(model_.points.size());
        }
        for (std::size_t at = 0; at < points.size(); ++at) {
            model_.points.push_back(fromGf(points[at]));
            if (model_.colors.empty() && colors.empty()) continue;
            const bool isColored = colors.size() == points.size();
            model_.colors.push_back(isColored ? fromGf(colors[at]) : Vec3{1, 1, 1});
            model_.isColored.push_back(isColored);
        }
        stored_.insert(prim.AppendProperty(TfToken("extent")));
        return {first, int(points.size())};
    }

    Part& addPart(const SdfPath& prim) {
        model_.parts.push_back({.name = nameOf(prim)});
        return model_.parts.back();
    }

    void readPoints(const SdfPath& prim) {
        const auto [first, count] = addPoints(prim);
        Part& part = addPart(prim);
        for (int at = 0; at < count; ++at) part.points.push_back(first + at);
    }

    void readCurves(const SdfPath& prim) {
        const auto [first, count] = addPoints(prim);
        const auto counts = attribute<pxr::VtIntArray>(prim, "curveVertexCounts");
        checkCounts(prim, "curveVertexCounts", counts, 2, count, "points");
        Part& part = addPart(prim);
        part.lineCounts.assign(counts.begin(), counts.end());
        for (int at = 0; at < count; ++at) part.linePoints.push_back(first + at);
    }

    static void checkCounts(const SdfPath& prim, const char* name, const pxr::VtIntArray& counts,
                            int least, std::int64_t expected, const char* what) {
        std::int64_t sum = 0;
        for (const int count : counts) {
            if (count < least)
                throw CannotStore{at(prim) + ": '" + name + "' has " + std::to_string(count)};
            sum += count;
        }
        if (sum != expected)
            throw CannotStore{at(prim) + ": the sum of '" + name + "' is " + std::to_string(sum) +
                              ", and there are " + std::to_string(expected) + " " + what};
    }

    void readMesh(const SdfPath& prim) {
        const auto [first, count] = addPoints(prim);
        const auto counts = attribute<pxr::VtIntArray>(prim, "faceVertexCounts");
        const auto indices = attribute<pxr::VtIntArray>(prim, "faceVertexIndices");
        checkCounts(prim, "faceVertexCounts", counts, 3, std::int64_t(indices.size()), "corners");
        if (attribute<TfToken>(prim, "subdivisionScheme") != "none")
            throw CannotStore{at(prim) +
                              " is a subdivision surface: 'subdivisionScheme' is not none"};
        Part& part = addPart(prim);
        part.faceCounts.assign(counts.begin(), counts.end());
        for (const int index : indices) {
            if (index < 0 || index >= count)
                throw CannotStore{at(prim) + ": 'faceVertexIndices' has " + std::to_string(index) +
                                  ", and there are " + std::to_string(count) + " points"};
            part.corners.push_back({.point = first + index});
        }
        addToCorners(part, prim, {"primvars:st"}, model_.texCoords, &Corner::texCoord);
        addToCorners(part, prim, {"primvars:normals", "normals"}, model_.normals, &Corner::normal);
        readMaterials(prim, part);
    }

    // Stores the first attribute of these names that has a value.
    void addToCorners(Part& part, const SdfPath& prim, std::initializer_list<const char*> names,
                      std::vector<Vec3>& into, int Corner::* member) {
        for (const char* name : names) {
            const SdfPath path = prim.AppendProperty(TfToken(name));
            if (!data_.HasSpec(path)) continue;
            const auto found = perCorner(part, path);
            const int first = int(into.size());
            into.insert(into.end(), found.values.begin(), found.values.end());
            for (std::size_t at = 0; at < part.corners.size(); ++at)
                part.corners[at].*member = first + found.indices[at];
            return;
        }
    }

    [[nodiscard]] std::vector<Vec3> vectors(const SdfPath& attribute) const {
        const VtValue value = data_.Get(attribute, SdfFieldKeys->Default);
        std::vector<Vec3> vectors;
        if (value.IsHolding<pxr::VtVec3fArray>())
            for (const auto& vector : value.UncheckedGet<pxr::VtVec3fArray>())
                vectors.push_back(fromGf(vector));
        else if (value.IsHolding<pxr::VtVec2fArray>())
            for (const auto& vector : value.UncheckedGet<pxr::VtVec2fArray>())
                vectors.push_back({vector[0], vector[1], 0});
        return vectors;
    }

    PerCorner perCorner(const Part& part, const SdfPath& path) {
        PerCorner found{vectors(path), {}};
        const SdfPath indicesPath = path.ReplaceName(TfToken(path.GetName() + ":indices"));
        const auto indices = value<pxr::VtIntArray>(indicesPath, SdfFieldKeys->Default);
        const auto interpolation = value<TfToken>(path, kInterpolation);
        const int firstPoint = int(model_.points.size()) - pointsOf(path.GetPrimPath());
        std::size_t corner = 0;
        for (std::size_t face = 0; face < part.faceCounts.size(); ++face)
            for (int side = 0; side < part.faceCounts[face]; ++side, ++corner) {
                std::size_t index = 0;  // constant, also without an opinion
                if (interpolation == "faceVarying") index = corner;
                if (interpolation == "uniform") index = face;
                if (interpolation == "vertex" || interpolation == "varying")
                    index = std::size_t(part.corners[corner].point - firstPoint);
                if (!indices.empty())
                    index =
                        index < indices.size() ? std::size_t(indices[index]) : found.values.size();
                if (index >= found.values.size())
                    throw CannotStore{at(path) + " has too few values or indices for its mesh"};
                found.indices.push_back(int(index));
            }
        if (path.GetName() == "normals" && interpolation.IsEmpty())
            throw CannotStore{at(path) + " has no interpolation"};
        stored_.insert(path);
        stored_.insert(indicesPath);
        return found;
    }
    [[nodiscard]] int pointsOf(const SdfPath& prim) const {
        return int(attribute<pxr::VtVec3fArray>(prim, "points").size());
    }

    [[nodiscard]] bool hasMaterial(const SdfPath& prim) const {
        const TfToken binding("material:binding");
        return data_.HasSpec(prim.AppendProperty(binding)) ||
               std::ranges::any_of(children(prim), [&](const TfToken& name) {
                   return data_.HasSpec(prim.AppendChild(name).AppendProperty(binding));
               });
    }

    // The material that a prim is bound to; -1: none.
    int materialOf(const SdfPath& prim) {
        const auto targets = value<pxr::SdfPathListOp>(
            prim.AppendProperty(TfToken("material:binding")), SdfFieldKeys->TargetPaths);
        const auto& items = targets.GetExplicitItems();
        if (items.size() != 1 || !data_.HasSpec(items[0])) return -1;
        const auto [known, isNew] = materials_.try_emplace(items[0], int(model_.materials.size()));
        if (isNew) {
            const std::string name = nameOf(items[0]);
            model_.materials.push_back(name.empty() ? items[0].GetName() : name);
        }
        return known->second;
    }

    void readMaterials(const SdfPath& prim, Part& part) {
        part.faceMaterials.assign(part.faceCounts.size(), materialOf(prim));
        for (const auto& name : children(prim)) {
            const SdfPath subset = prim.AppendChild(name);
            const int material = materialOf(subset);
            for (const int face : attribute<pxr::VtIntArray>(subset, "indices")) {
                if (face < 0 || std::size_t(face) >= part.faceMaterials.size())
                    throw CannotStore{at(subset) + ": 'indices' has " + std::to_string(face) +
                                      ", and there are " + std::to_string(part.faceCounts.size()) +
                                      " faces"};
                part.faceMaterials[std::size_t(face)] = material;
            }
        }
    }

    const pxr::SdfAbstractData& data_;
    const SdfPath root_;
    Model model_;
    std::map<SdfPath, int> materials_;
    std::set<SdfPath> stored_;
};

/// Finds the first spec or field of a layer that is not in the layer that is read back.
class LossFinder final : public pxr::SdfAbstractDataSpecVisitor {
public:
    LossFinder(const ModelMaker& maker, const pxr::SdfAbstractData& readBack)
        : maker_(maker), readBack_(readBack) {}

    bool VisitSpec(const pxr::SdfAbstractData& data, const SdfPath& path) override {
        const auto type = data.GetSpecType(path);
        // Their values are fields of the properties.
        if (type == pxr::SdfSpecTypeConnection || type == pxr::SdfSpecTypeRelationshipTarget)
            return true;
        const bool isStored = maker_.isStored(path);
        if (!isStored && readBack_.GetSpecType(path) != type) {
            if (problem_.empty() || path < problemPath_) {
                problemPath_ = path;
                problem_ = at(path) + " cannot be stored: " + reason(data, path);
            }
            return true;
        }
        for (const auto& field : data.List(path))
            if (!isKept(data, path, field, isStored) && (problem_.empty() || path < problemPath_)) {
                problemPath_ = path;
                problem_ = "'" + field.GetString() + "' of " + at(path) +
                           " cannot be stored: " + difference(data, path, field);
            }
        return true;
    }
    void Done(const pxr::SdfAbstractData&) override {}

    [[nodiscard]] const std::string& problem() const { return problem_; }

private:
    bool isKept(const pxr::SdfAbstractData& data, const SdfPath& path, const TfToken& field,
                bool isStored) const {
        if (field == pxr::SdfChildrenKeys->PrimChildren ||
            field == pxr::SdfChildrenKeys->PropertyChildren ||
            field == pxr::SdfChildrenKeys->RelationshipTargetChildren)
            return true;
        // They are lines at the beginning of the file.
        if (path == SdfPath::AbsoluteRootPath() &&
            (field == SdfFieldKeys->Comment || field == SdfFieldKeys->Documentation))
            return true;
        if (isStored)
            return field == SdfFieldKeys->Default || field == SdfFieldKeys->TypeName ||
                   field == SdfFieldKeys->Custom || field == SdfFieldKeys->Variability ||
                   field == kInterpolation;
        return data.Get(path, field) == readBack_.Get(path, field);
    }

    std::string reason(const pxr::SdfAbstractData& data, const SdfPath& path) const {
        if (!path.IsPrimPath()) return "the format has nothing like it";
        const auto type = data.Get(path, SdfFieldKeys->TypeName).GetWithDefault<TfToken>();
        return "a file has one root prim with meshes, linear curves, points and used materials, "
               "and no " +
               (type.IsEmpty() ? std::string("such prim") : "'" + type.GetString() + "' there");
    }

    std::string difference(const pxr::SdfAbstractData& data, const SdfPath& path,
                           const TfToken& field) const {
        const VtValue found = readBack_.Get(path, field);
        if (found.IsEmpty()) return "the format has nothing like it";
        std::ostringstream texts[2];
        texts[0] << data.Get(path, field);
        texts[1] << found;
        constexpr std::size_t kShown = 60;
        if (texts[0].str().size() > kShown || texts[1].str().size() > kShown)
            return "it would be read as another value";
        return texts[0].str() + " would be read as " + texts[1].str();
    }

    const ModelMaker& maker_;
    const pxr::SdfAbstractData& readBack_;
    SdfPath problemPath_;
    std::string problem_;
};

std::string commentOf(const pxr::SdfAbstractData& data, const std::string& comment) {
    std::string all = comment;
    for (const auto& field : {SdfFieldKeys->Comment, SdfFieldKeys->Documentation}) {
        const auto text =
            data.Get(SdfPath::AbsoluteRootPath(), field).GetWithDefault<std::string>();
        if (!text.empty() && text != comment) all += (all.empty() ? "" : "\n") + text;
    }
    return all;
}

}  // namespace

std::variant<Options, std::string> Options::from(
    const pxr::SdfFileFormat::FileFormatArguments& arguments) {
    Options options;
    const auto find = [&](const char* name) -> const std::string* {
        const auto found = arguments.find(name);
        return found == arguments.end() ? nullptr : &found->second;
    };
    if (const auto* axis = find("upAxis")) {
        if (*axis != "Y" && *axis != "Z")
            return "the argument 'upAxis' is Y or Z, not '" + *axis + "'";
        options.upAxis = TfToken(*axis);
    }
    if (const auto* meters = find("metersPerUnit")) {
        double number = 0;
        const char* end = meters->data() + meters->size();
        const auto [last, problem] = std::from_chars(meters->data(), end, number);
        if (problem != std::errc() || last != end || !(number > 0) || number > 1e30)
            return "the argument 'metersPerUnit' is a positive number, not '" + *meters + "'";
        options.metersPerUnit = number;
    }
    if (const auto* split = find("split")) {
        static const std::map<std::string, Split> known{{"automatic", Split::Automatic},
                                                        {"objects", Split::Objects},
                                                        {"groups", Split::Groups},
                                                        {"none", Split::None}};
        const auto found = known.find(*split);
        if (found == known.end())
            return "the argument 'split' is automatic, objects, groups or none, not '" + *split +
                   "'";
        options.split = found->second;
    }
    if (const auto* root = find("root")) {
        if (!SdfPath::IsValidIdentifier(*root))
            return "the argument 'root' is the name of a prim, not '" + *root + "'";
        options.root = TfToken(*root);
    }
    return options;
}

Printed printLayer(const pxr::SdfAbstractDataConstPtr& data, const Options& options,
                   const std::string& comment) {
    try {
        const ModelMaker maker(*data, options);
        std::string text = print(maker.model(), commentOf(*data, comment));
        const auto parsed = parse(text, options.split);
        if (const auto* error = std::get_if<ParseError>(&parsed))
            return {{}, "it has something that the format cannot have: " + error->reason};
        std::vector<std::string> warnings;
        const auto readBack = makeLayer(std::get<Model>(parsed), options, warnings);
        LossFinder finder(maker, *readBack);
        data->VisitSpecs(&finder);
        return {std::move(text), finder.problem()};
    } catch (const CannotStore& cannot) {
        return {{}, cannot.problem};
    }
}

}  // namespace usdlive::obj
