// Makes the specs of a layer from the content of an .obj file.
#include <pxr/base/gf/vec2f.h>
#include <pxr/base/gf/vec3f.h>
#include <pxr/base/tf/stringUtils.h>
#include <pxr/base/vt/array.h>
#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/sdf/path.h>
#include <pxr/usd/sdf/schema.h>
#include <pxr/usd/sdf/types.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "ObjLayer.h"
#include "ObjNames.h"

namespace usdlive::obj {

using pxr::GfVec2f;
using pxr::GfVec3f;
using pxr::SdfFieldKeys;
using pxr::SdfPath;
using pxr::TfToken;
using pxr::VtValue;

namespace {

GfVec3f toGf(const Vec3& vector) { return {vector[0], vector[1], vector[2]}; }

pxr::VtIntArray toVt(const std::vector<int>& values) { return {values.begin(), values.end()}; }

// Creates specs in plain data, children in the order they are added.
class DataBuilder {
public:
    void set(const SdfPath& path, const TfToken& field, const VtValue& value) {
        data_->Set(path, field, value);
    }
    SdfPath prim(const SdfPath& parent, const TfToken& name, const char* type) {
        const SdfPath path = parent.AppendChild(name);
        data_->CreateSpec(path, pxr::SdfSpecTypePrim);
        set(path, SdfFieldKeys->Specifier, VtValue(pxr::SdfSpecifierDef));
        set(path, SdfFieldKeys->TypeName, VtValue(TfToken(type)));
        addChild(parent, pxr::SdfChildrenKeys->PrimChildren, name);
        return path;
    }
    SdfPath attribute(const SdfPath& prim, const char* name, const pxr::SdfValueTypeName& type,
                      const VtValue& value,
                      pxr::SdfVariability variability = pxr::SdfVariabilityVarying) {
        const SdfPath path = property(prim, name, pxr::SdfSpecTypeAttribute, variability);
        set(path, SdfFieldKeys->TypeName, VtValue(type.GetAsToken()));
        set(path, SdfFieldKeys->Default, value);
        return path;
    }
    SdfPath token(const SdfPath& prim, const char* name, const char* value) {
        return attribute(prim, name, pxr::SdfValueTypeNames->Token, VtValue(TfToken(value)),
                         pxr::SdfVariabilityUniform);
    }
    void relationship(const SdfPath& prim, const char* name, const SdfPath& target) {
        const SdfPath path =
            property(prim, name, pxr::SdfSpecTypeRelationship, pxr::SdfVariabilityUniform);
        set(path, SdfFieldKeys->TargetPaths, VtValue(pxr::SdfPathListOp::CreateExplicit({target})));
    }
    [[nodiscard]] const pxr::SdfAbstractDataRefPtr& data() const { return data_; }

private:
    SdfPath property(const SdfPath& prim, const char* name, pxr::SdfSpecType type,
                     pxr::SdfVariability variability) {
        const TfToken token(name);
        const SdfPath path = prim.AppendProperty(token);
        data_->CreateSpec(path, type);
        set(path, SdfFieldKeys->Custom, VtValue(false));
        set(path, SdfFieldKeys->Variability, VtValue(variability));
        addChild(prim, pxr::SdfChildrenKeys->PropertyChildren, token);
        return path;
    }
    void addChild(const SdfPath& parent, const TfToken& field, const TfToken& name) {
        VtValue value = data_->Get(parent, field);
        data_->Erase(parent, field);  // so that the list is not copied
        pxr::TfTokenVector names;
        if (!value.IsEmpty()) value.Swap(names);
        names.push_back(name);
        set(parent, field, VtValue::Take(names));
    }

    // OpenUSD creates the data: the layout of SdfData is not the same with every compiler.
    pxr::SdfAbstractDataRefPtr data_ =
        pxr::SdfFileFormat::FindById(pxr::TfToken("usda"))->InitData({});
};

// Gives the elements of one part indices of their own. Its memory is used again for every part, so
// that many small parts of a large file cost no more than their size.
class Compactor {
public:
    explicit Compactor(std::size_t count) : own_(count, -1) {}

    // Replaces indices of the file by those of the part; returns the file's, in its order.
    std::vector<int> compact(std::vector<int>& indices) {
        std::vector<int> used;
        for (const int index : indices) {
            int& own = own_[std::size_t(index)];
            if (own < 0) {
                own = 0;
                used.push_back(index);
            }
        }
        std::ranges::sort(used);
        for (std::size_t at = 0; at < used.size(); ++at) own_[std::size_t(used[at])] = int(at);
        for (int& index : indices) index = own_[std::size_t(index)];
        for (const int index : used) own_[std::size_t(index)] = -1;
        return used;
    }

private:
    std::vector<int> own_;
};

class LayerMaker {
public:
    LayerMaker(const Model& model, const Options& options, std::vector<std::string>& warnings)
        : model_(model),
          warnings_(warnings),
          points_(model.points.size()),
          texCoords_(model.texCoords.size()),
          normals_(model.normals.size()) {
        setMetadata(options);
        if (model.points.empty()) return;
        build_.set(SdfPath::AbsoluteRootPath(), SdfFieldKeys->DefaultPrim, VtValue(options.root));
        root_ = build_.prim(SdfPath::AbsoluteRootPath(), options.root, "Xform");
        build_.set(root_, SdfFieldKeys->Kind, VtValue(TfToken("component")));
        setLibraries();
        nameMaterials();
        for (const auto& part : model.parts) addPart(part);
        if (model.parts.empty()) addCloud();
        addMaterials();
    }

    [[nodiscard]] pxr::SdfAbstractDataRefPtr data() const { return build_.data(); }

private:
    void setMetadata(const Options& options) {
        const SdfPath& layer = SdfPath::AbsoluteRootPath();
        build_.set(layer, TfToken("upAxis"), VtValue(options.upAxis));
        if (options.metersPerUnit)
            build_.set(layer, TfToken("metersPerUnit"), VtValue(*options.metersPerUnit));
    }

    void setLibraries() {
        if (model_.materialLibraries.empty()) return;
        pxr::VtDictionary data;
        data[kLibrariesKey] = VtValue(
            pxr::VtStringArray(model_.materialLibraries.begin(), model_.materialLibraries.end()));
        build_.set(root_, SdfFieldKeys->CustomData, VtValue(data));
    }

    // The name of a prim; the one of the file is kept for display where it is no identifier.
    SdfPath namedPrim(const SdfPath& parent, const std::string& name, Names& taken,
                      const char* type) {
        const SdfPath path = build_.prim(parent, taken.add(name), type);
        if (path.GetName() != name) build_.set(path, SdfFieldKeys->DisplayName, VtValue(name));
        return path;
    }

    // Files may name materials that no face uses.
    void nameMaterials() {
        std::vector<bool> isUsed(model_.materials.size());
        for (const auto& part : model_.parts)
            for (const int material : part.faceMaterials)
                if (material >= 0) isUsed[std::size_t(material)] = true;
        materialNames_.resize(model_.materials.size());
        for (std::size_t at = 0; at < isUsed.size(); ++at)
            if (isUsed[at]) materialNames_[at] = takenMaterials_.add(model_.materials[at]);
        hasMaterials_ = std::ranges::find(isUsed, true) != isUsed.end();
        if (hasMaterials_) (void)partNames_.add(kMaterials);
    }
    [[nodiscard]] SdfPath materialPath(int material) const {
        return root_.AppendChild(TfToken(kMaterials))
            .AppendChild(materialNames_[std::size_t(material)]);
    }
    void addMaterials() {
        if (!hasMaterials_) return;
        const SdfPath scope = build_.prim(root_, TfToken(kMaterials), "Scope");
        for (std::size_t at = 0; at < materialNames_.size(); ++at) {
            if (materialNames_[at].IsEmpty()) continue;
            const SdfPath path = build_.prim(scope, materialNames_[at], "Material");
            if (path.GetName() != model_.materials[at])
                build_.set(path, SdfFieldKeys->DisplayName, VtValue(model_.materials[at]));
        }
    }

    void addPart(const Part& part) {
        const std::string name = part.name.empty() ? kUnnamed : part.name;
        const bool isMesh = !part.faceCounts.empty(), hasLines = !part.lineCounts.empty();
        if (isMesh) addMesh(part, name);
        if (hasLines) addLines(part, isMesh ? name + "_lines" : name);
        if (!part.points.empty())
            addPoints(part.points, isMesh || hasLines ? name + "_points" : name);
    }

    void addCloud() {
        std::vector<int> all(model_.points.size());
        for (std::size_t at = 0; at < all.size(); ++at) all[at] = int(at);
        addPoints(all, kUnnamed);
    }

    void setPositions(const SdfPath& prim, const std::vector<int>& indices) {
        pxr::VtVec3fArray positions(indices.size());
        GfVec3f low(std::numeric_limits<float>::max()), high(-std::numeric_limits<float>::max());
        for (std::size_t at = 0; at < indices.size(); ++at) {
            const GfVec3f point = toGf(model_.points[std::size_t(indices[at])]);
            positions[at] = point;
            for (int axis = 0; axis < 3; ++axis) {
                low[axis] = std::min(low[axis], point[axis]);
                high[axis] = std::max(high[axis], point[axis]);
            }
        }
        build_.attribute(prim, "points", pxr::SdfValueTypeNames->Point3fArray,
                         VtValue::Take(positions));
        build_.attribute(prim, "extent", pxr::SdfValueTypeNames->Float3Array,
                         VtValue(pxr::VtVec3fArray{low, high}));
        setColors(prim, indices);
    }

    void setColors(const SdfPath& prim, const std::vector<int>& indices) {
        if (model_.colors.empty()) return;
        const auto colored = std::ranges::count_if(
            indices, [&](int index) { return model_.isColored[std::size_t(index)]; });
        if (colored == 0) return;
        if (std::size_t(colored) != indices.size()) return leaveOut(prim, "colour", "points");
        pxr::VtVec3fArray colors(indices.size());
        for (std::size_t at = 0; at < indices.size(); ++at)
            colors[at] = toGf(model_.colors[std::size_t(indices[at])]);
        const SdfPath path =
            build_.attribute(prim, "primvars:displayColor", pxr::SdfValueTypeNames->Color3fArray,
                             VtValue::Take(colors));
        build_.set(path, kInterpolation, VtValue(TfToken("vertex")));
    }

    void leaveOut(const SdfPath& prim, const char* what, const char* where) {
        warnings_.push_back("<" + prim.GetString() + "> has no " + what + "s: some of its " +
                            where + " have no " + what);
    }

    void addLines(const Part& part, const std::string& name) {
        const SdfPath prim = namedPrim(root_, name, partNames_, "BasisCurves");
        build_.token(prim, "type", "linear");
        build_.attribute(prim, "curveVertexCounts", pxr::SdfValueTypeNames->IntArray,
                         VtValue(toVt(part.lineCounts)));
        setPositions(prim, part.linePoints);
    }

    void addPoints(const std::vector<int>& indices, const std::string& name) {
        setPositions(namedPrim(root_, name, partNames_, "Points"), indices);
    }

    void addMesh(const Part& part, const std::string& name) {
        const SdfPath prim = namedPrim(root_, name, partNames_, "Mesh");
        build_.token(prim, "subdivisionScheme", "none");
        build_.attribute(prim, "faceVertexCounts", pxr::SdfValueTypeNames->IntArray,
                         VtValue(toVt(part.faceCounts)));
        auto points = indicesOf(part, &Corner::point);
        const auto used = points_.compact(points);
        build_.attribute(prim, "faceVertexIndices", pxr::SdfValueTypeNames->IntArray,
                         VtValue(toVt(points)));
        setPositions(prim, used);
        setTexCoords(prim, part);
        setNormals(prim, part);
        setMaterials(prim, part);
    }

    static std::vector<int> indicesOf(const Part& part, int Corner::* member) {
        std::vector<int> indices(part.corners.size());
        for (std::size_t at = 0; at < indices.size(); ++at) indices[at] = part.corners[at].*member;
        return indices;
    }

    // Whether all corners have such an index.
    bool areComplete(const SdfPath& prim, const std::vector<int>& indices, const char* what) {
        const auto missing = std::ranges::count(indices, -1);
        if (missing > 0 && std::size_t(missing) < indices.size()) leaveOut(prim, what, "corners");
        return missing == 0;
    }

    void setIndexed(const SdfPath& prim, const std::string& name, const pxr::SdfValueTypeName& type,
                    const VtValue& values, const std::vector<int>& indices) {
        const SdfPath path = build_.attribute(prim, name.c_str(), type, values);
        build_.set(path, kInterpolation, VtValue(TfToken("faceVarying")));
        build_.attribute(prim, (name + ":indices").c_str(), pxr::SdfValueTypeNames->IntArray,
                         VtValue(toVt(indices)));
    }

    void setTexCoords(const SdfPath& prim, const Part& part) {
        auto indices = indicesOf(part, &Corner::texCoord);
        if (!areComplete(prim, indices, "texture coordinate")) return;
        const auto used = texCoords_.compact(indices);
        const auto third = [&](int index) { return model_.texCoords[std::size_t(index)][2] != 0; };
        if (std::ranges::any_of(used, third)) {
            pxr::VtVec3fArray values(used.size());
            for (std::size_t at = 0; at < used.size(); ++at)
                values[at] = toGf(model_.texCoords[std::size_t(used[at])]);
            setIndexed(prim, "primvars:st", pxr::SdfValueTypeNames->TexCoord3fArray,
                       VtValue::Take(values), indices);
            return;
        }
        pxr::VtVec2fArray values(used.size());
        for (std::size_t at = 0; at < used.size(); ++at) {
            const auto& value = model_.texCoords[std::size_t(used[at])];
            values[at] = GfVec2f(value[0], value[1]);
        }
        setIndexed(prim, "primvars:st", pxr::SdfValueTypeNames->TexCoord2fArray,
                   VtValue::Take(values), indices);
    }

    void setNormals(const SdfPath& prim, const Part& part) {
        auto indices = indicesOf(part, &Corner::normal);
        if (!areComplete(prim, indices, "normal")) return;
        const auto used = normals_.compact(indices);
        pxr::VtVec3fArray values(used.size());
        for (std::size_t at = 0; at < used.size(); ++at)
            values[at] = toGf(model_.normals[std::size_t(used[at])]);
        setIndexed(prim, "primvars:normals", pxr::SdfValueTypeNames->Normal3fArray,
                   VtValue::Take(values), indices);
    }

    // One material binds the mesh, several bind subsets of its faces.
    void setMaterials(const SdfPath& prim, const Part& part) {
        std::vector<int> order;
        std::vector<pxr::VtIntArray> faces;
        std::map<int, std::size_t> slots;
        for (std::size_t face = 0; face < part.faceMaterials.size(); ++face) {
            const int material = part.faceMaterials[face];
            if (material < 0) continue;
            const auto [slot, isNew] = slots.try_emplace(material, order.size());
            if (isNew) {
                order.push_back(material);
                faces.emplace_back();
            }
            faces[slot->second].push_back(int(face));
        }
        if (order.empty()) return;
        if (order.size() == 1 && faces[0].size() == part.faceCounts.size())
            return bind(prim, order[0]);
        build_.token(prim, "subsetFamily:materialBind:familyType", "nonOverlapping");
        for (std::size_t at = 0; at < order.size(); ++at) {
            const SdfPath subset =
                build_.prim(prim, materialNames_[std::size_t(order[at])], "GeomSubset");
            build_.token(subset, "elementType", "face");
            build_.token(subset, "familyName", "materialBind");
            build_.attribute(subset, "indices", pxr::SdfValueTypeNames->IntArray,
                             VtValue::Take(faces[at]));
            bind(subset, order[at]);
        }
    }

    void bind(const SdfPath& prim, int material) {
        pxr::SdfTokenListOp schemas;
        schemas.SetPrependedItems({TfToken("MaterialBindingAPI")});
        build_.set(prim, TfToken("apiSchemas"), VtValue(schemas));
        build_.relationship(prim, "material:binding", materialPath(material));
    }

    const Model& model_;
    std::vector<std::string>& warnings_;
    DataBuilder build_;
    SdfPath root_;
    Names partNames_, takenMaterials_;
    pxr::TfTokenVector materialNames_;  // empty: not used
    bool hasMaterials_ = false;
    Compactor points_, texCoords_, normals_;
};

}  // namespace

pxr::SdfAbstractDataRefPtr makeMetadata(const Options& options) {
    const Model empty;
    std::vector<std::string> none;
    auto data = LayerMaker(empty, options, none).data();
    data->Set(SdfPath::AbsoluteRootPath(), SdfFieldKeys->DefaultPrim, VtValue(options.root));
    return data;
}

pxr::SdfAbstractDataRefPtr makeLayer(const Model& model, const Options& options,
                                     std::vector<std::string>& warnings) {
    return LayerMaker(model, options, warnings).data();
}

}  // namespace usdlive::obj
