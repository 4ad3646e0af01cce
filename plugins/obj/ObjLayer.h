// The content of a layer from that of an .obj file, and the other way round.
#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/usd/sdf/data.h>
#include <pxr/usd/sdf/fileFormat.h>

#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "ObjModel.h"
#include "ObjParser.h"

namespace usdlive::obj {

/// The arguments of the format: "chair.obj:SDF_FORMAT_ARGS:upAxis=Z&split=groups". They say what a
/// file of this format leaves open.
struct Options {
    pxr::TfToken upAxis{"Y"};             ///< "upAxis": Y or Z
    std::optional<double> metersPerUnit;  ///< "metersPerUnit"
    Split split = Split::Automatic;       ///< "split": automatic, objects, groups or none
    pxr::TfToken root{"Model"};           ///< "root": the name of the root prim

    /// An error: the sentence that says which argument is wrong.
    [[nodiscard]] static std::variant<Options, std::string> from(
        const pxr::SdfFileFormat::FileFormatArguments& arguments);
};

/// Metadata of the layer only, as for a file without content.
[[nodiscard]] pxr::SdfAbstractDataRefPtr makeMetadata(const Options& options);

/// The layer of a model. Adds sentences on what it leaves out to `warnings`.
[[nodiscard]] pxr::SdfAbstractDataRefPtr makeLayer(const Model& model, const Options& options,
                                                   std::vector<std::string>& warnings);

/// The result of printLayer().
struct Printed {
    std::string text;
    std::string problem;  ///< the first thing that cannot be stored; empty: none
};
/// The text from which the same layer is read again, with `comment` at its beginning. The order of
/// prims and properties may change, and texture coordinates and normals get other indices.
[[nodiscard]] Printed printLayer(const pxr::SdfAbstractDataConstPtr& data, const Options& options,
                                 const std::string& comment);

}  // namespace usdlive::obj
