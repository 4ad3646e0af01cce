// The file format that OpenUSD calls for .obj files.
#pragma once

#include <pxr/usd/sdf/fileFormat.h>

#include <string>

namespace usdlive::obj {

/// Wavefront .obj files as layers: see README.md.
class ObjFileFormat : public pxr::SdfFileFormat {
public:
    bool CanRead(const std::string& file) const override;
    bool Read(pxr::SdfLayer* layer, const std::string& resolvedPath,
              bool metadataOnly) const override;
    bool WriteToFile(const pxr::SdfLayer& layer, const std::string& filePath,
                     const std::string& comment,
                     const FileFormatArguments& arguments) const override;

    /// The text of a layer is .usda, as with other formats that are not USD's text.
    bool ReadFromString(pxr::SdfLayer* layer, const std::string& text) const override;
    bool WriteToString(const pxr::SdfLayer& layer, std::string* text,
                       const std::string& comment) const override;
    bool WriteToStream(const pxr::SdfSpecHandle& spec, std::ostream& out,
                       std::size_t indent) const override;

protected:
    friend class pxr::Sdf_FileFormatFactory<ObjFileFormat>;
    ObjFileFormat();
    ~ObjFileFormat() override;
};

}  // namespace usdlive::obj
