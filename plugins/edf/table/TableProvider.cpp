// The provider `table`: places the assets that a CSV file lists.
//
// providerArgs:
//   table         the file, relative to the payload's asset. Placements.h describes its columns.
//   instanceable  "true" (default): what is placed is instanced; "false": each placement can be
//   edited below
#include <pxr/base/gf/vec3d.h>
#include <pxr/base/gf/vec3f.h>
#include <pxr/base/vt/array.h>
#include <pxr/usd/ar/asset.h>
#include <pxr/usd/ar/resolvedPath.h>
#include <pxr/usd/ar/resolver.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/reference.h>
#include <pxr/usd/sdf/schema.h>

#include <memory>
#include <stdexcept>

#include "Placements.h"
#include "usdlive/edf/DataProvider.h"

namespace {

using pxr::SdfPath;
using pxr::TfToken;
using pxr::VtValue;
using usdlive::edf::EdfArguments;
using usdlive::edf::EdfDataParameters;
using usdlive::edf::IEdfSourceData;
using usdlive::edf::table::Placement;

constexpr std::size_t kMaxTableBytes = 64u << 20;

std::string argument(const EdfArguments& arguments, const char* name, const char* otherwise) {
    const auto found = arguments.find(name);
    return found == arguments.end() ? otherwise : found->second;
}

bool isOn(const EdfArguments& arguments, const char* name, const char* otherwise) {
    const auto text = argument(arguments, name, otherwise);
    if (text == "true" || text == "1") return true;
    if (text == "false" || text == "0") return false;
    throw std::invalid_argument(std::string(name) + " is '" + text + "'; it must be true or false");
}

class TableProvider final : public usdlive::edf::IEdfDataProvider {
public:
    explicit TableProvider(EdfDataParameters parameters) : parameters_(std::move(parameters)) {}

    static EdfArguments ComposeArguments(const EdfArguments& metadata) {
        return {{"table", argument(metadata, "table", "")},
                {"instanceable", isOn(metadata, "instanceable", "true") ? "true" : "false"}};
    }

    bool Read(IEdfSourceData& data, std::string& why) override {
        std::string text;
        if (!open(data, text, why)) return false;
        const auto placements = usdlive::edf::table::readPlacements(text);
        if (!placements.error.empty()) {
            why = argument(parameters_.providerArgs, "table", "") + ", " + placements.error;
            return false;
        }
        const SdfPath root("/Data");
        data.SetField(root, pxr::SdfFieldKeys->TypeName, VtValue(xform_));
        for (const auto& row : placements.rows) create(data, root, row);
        return true;
    }

private:
    bool open(IEdfSourceData& data, std::string& text, std::string& why) const {
        const auto name = argument(parameters_.providerArgs, "table", "");
        if (name.empty()) {
            why = "the argument 'table' names no file";
            return false;
        }
        auto& resolver = pxr::ArGetResolver();
        const auto identifier =
            resolver.CreateIdentifier(name, pxr::ArResolvedPath(parameters_.assetPath));
        const auto resolved = resolver.Resolve(identifier);
        const auto asset = resolved ? resolver.OpenAsset(resolved) : nullptr;
        if (!asset) {
            why = "there is no table " + identifier;
            return false;
        }
        data.AddDependency(resolved.GetPathString());
        if (asset->GetSize() > kMaxTableBytes) {
            why = "the table " + identifier + " is larger than 64 MiB";
            return false;
        }
        text.resize(asset->GetSize());
        if (asset->Read(text.data(), text.size(), 0) == text.size()) return true;
        why = "the table " + identifier + " could not be read";
        return false;
    }

    void create(IEdfSourceData& data, const SdfPath& root, const Placement& row) const {
        const SdfPath path = root.AppendChild(TfToken(row.name));
        data.CreatePrim(root, row.name, pxr::SdfSpecifierDef, xform_);
        if (!row.asset.empty()) {
            const auto prim = row.prim.empty() ? SdfPath() : SdfPath(row.prim);
            data.SetField(
                path, pxr::SdfFieldKeys->References,
                VtValue(pxr::SdfReferenceListOp::Create({pxr::SdfReference(row.asset, prim)})));
            if (isInstanceable_)
                data.SetField(path, pxr::SdfFieldKeys->Instanceable, VtValue(true));
        }
        const auto add = [&](const TfToken& name, const pxr::SdfValueTypeName& type,
                             VtValue value) {
            data.CreateAttribute(path, name, type, pxr::SdfVariabilityVarying, value);
        };
        const auto& [x, y, z] = row.translate;
        const auto& [rx, ry, rz] = row.rotate;
        const auto& [sx, sy, sz] = row.scale;
        add(translate_, pxr::SdfValueTypeNames->Double3, VtValue(pxr::GfVec3d(x, y, z)));
        add(rotate_, pxr::SdfValueTypeNames->Float3,
            VtValue(pxr::GfVec3f(float(rx), float(ry), float(rz))));
        add(scale_, pxr::SdfValueTypeNames->Float3,
            VtValue(pxr::GfVec3f(float(sx), float(sy), float(sz))));
        data.CreateAttribute(path, order_, pxr::SdfValueTypeNames->TokenArray,
                             pxr::SdfVariabilityUniform,
                             VtValue(pxr::VtTokenArray{translate_, rotate_, scale_}));
        for (const auto& [attribute, cell] : row.other) {
            data.CreateAttribute(path, TfToken(attribute), pxr::SdfValueTypeNames->String,
                                 pxr::SdfVariabilityUniform, VtValue(cell));
            data.SetField(path.AppendProperty(TfToken(attribute)), pxr::SdfFieldKeys->Custom,
                          VtValue(true));
        }
    }

    const EdfDataParameters parameters_;
    const bool isInstanceable_ = isOn(parameters_.providerArgs, "instanceable", "true");
    const TfToken xform_{"Xform"}, translate_{"xformOp:translate"}, rotate_{"xformOp:rotateXYZ"},
        scale_{"xformOp:scale"}, order_{"xformOpOrder"};
};

}  // namespace

EDF_DEFINE_DATAPROVIDER(TableProvider, "EdfTableProvider");
