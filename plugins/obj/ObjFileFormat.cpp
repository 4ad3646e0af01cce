// Reads and writes .obj files through the asset resolver, and reports errors to OpenUSD.
#include "ObjFileFormat.h"

#include <pxr/base/tf/diagnostic.h>
#include <pxr/base/tf/registryManager.h>
#include <pxr/base/tf/type.h>
#include <pxr/usd/ar/asset.h>
#include <pxr/usd/ar/resolvedPath.h>
#include <pxr/usd/ar/resolver.h>
#include <pxr/usd/ar/writableAsset.h>
#include <pxr/usd/sdf/layer.h>

#include <algorithm>
#include <string_view>

#include "ObjLayer.h"
#include "ObjParser.h"

using namespace pxr;  // the macros of OpenUSD expect its names

namespace usdlive::obj {

namespace {

const pxr::TfToken kFormatId("usdliveObj");

/// The bytes of an asset. Keeps the buffer that they are in.
struct Bytes {
    std::shared_ptr<const char> buffer;
    std::size_t size = 0;

    explicit operator bool() const { return buffer != nullptr; }
    [[nodiscard]] std::string_view text() const { return {buffer.get(), size}; }
};

Bytes read(const std::string& path) {
    const auto asset = pxr::ArGetResolver().OpenAsset(pxr::ArResolvedPath(path));
    if (!asset) return {};
    const std::size_t size = asset->GetSize();
    // An empty file has no buffer.
    if (size == 0) return {std::shared_ptr<const char>(std::shared_ptr<void>(), ""), 0};
    return {asset->GetBuffer(), size};
}

pxr::SdfFileFormatConstPtr textFormat() {
    return pxr::SdfFileFormat::FindById(pxr::TfToken("usda"));
}

}  // namespace

ObjFileFormat::ObjFileFormat()
    : SdfFileFormat(kFormatId, pxr::TfToken("1.0"), pxr::TfToken("usd"), "obj") {}

ObjFileFormat::~ObjFileFormat() = default;

bool ObjFileFormat::CanRead(const std::string& file) const {
    constexpr std::size_t kBeginning = 4096;
    const Bytes bytes = read(file);
    return bytes && looksLikeObj(bytes.text().substr(0, kBeginning));
}

bool ObjFileFormat::Read(pxr::SdfLayer* layer, const std::string& resolvedPath,
                         bool metadataOnly) const {
    const auto fail = [&](const std::string& reason) {
        TF_RUNTIME_ERROR("cannot read %s: %s", resolvedPath.c_str(), reason.c_str());
        return false;
    };
    const auto options = Options::from(layer->GetFileFormatArguments());
    if (const auto* problem = std::get_if<std::string>(&options)) return fail(*problem);
    const Bytes bytes = read(resolvedPath);
    if (!bytes) return fail("the file cannot be opened");
    pxr::SdfAbstractDataRefPtr data;
    if (metadataOnly) {
        data = makeMetadata(std::get<Options>(options));
    } else {
        const auto parsed = parse(bytes.text(), std::get<Options>(options).split);
        if (const auto* error = std::get_if<ParseError>(&parsed)) {
            TF_RUNTIME_ERROR("cannot read %s, line %zu: %s", resolvedPath.c_str(), error->line,
                             error->reason.c_str());
            return false;
        }
        std::vector<std::string> warnings;
        data = makeLayer(std::get<Model>(parsed), std::get<Options>(options), warnings);
        for (const auto& warning : warnings)
            TF_WARN("%s: %s", resolvedPath.c_str(), warning.c_str());
    }
    _SetLayerData(layer, data);
    return true;
}

bool ObjFileFormat::WriteToFile(const pxr::SdfLayer& layer, const std::string& filePath,
                                const std::string& comment,
                                const FileFormatArguments& arguments) const {
    const auto fail = [&](const std::string& reason) {
        TF_RUNTIME_ERROR("cannot write %s: %s", filePath.c_str(), reason.c_str());
        return false;
    };
    const auto options = Options::from(arguments);
    if (const auto* problem = std::get_if<std::string>(&options)) return fail(*problem);
    const auto printed = printLayer(_GetLayerData(layer), std::get<Options>(options), comment);
    if (!printed.problem.empty()) return fail(printed.problem);
    // The file is replaced by close(), and stays what it was if anything fails before.
    const auto asset = pxr::ArGetResolver().OpenAssetForWrite(pxr::ArResolvedPath(filePath),
                                                              pxr::ArResolver::WriteMode::Replace);
    if (!asset) return fail("the file cannot be opened for writing");
    const auto& text = printed.text;
    if (asset->Write(text.data(), text.size(), 0) != text.size() || !asset->Close())
        return fail("the file cannot be written");
    return true;
}

bool ObjFileFormat::ReadFromString(pxr::SdfLayer* layer, const std::string& text) const {
    return textFormat()->ReadFromString(layer, text);
}

bool ObjFileFormat::WriteToString(const pxr::SdfLayer& layer, std::string* text,
                                  const std::string& comment) const {
    return textFormat()->WriteToString(layer, text, comment);
}

bool ObjFileFormat::WriteToStream(const pxr::SdfSpecHandle& spec, std::ostream& out,
                                  std::size_t indent) const {
    return textFormat()->WriteToStream(spec, out, indent);
}

}  // namespace usdlive::obj

TF_REGISTRY_FUNCTION(TfType) { SDF_DEFINE_FILE_FORMAT(usdlive::obj::ObjFileFormat, SdfFileFormat); }
