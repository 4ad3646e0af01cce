// The file format `edf`: its payloads get their content from data providers.
#pragma once

#include <pxr/usd/pcp/dynamicFileFormatInterface.h>
#include <pxr/usd/sdf/fileFormat.h>

#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>

#include "EdfData.h"
#include "GuardedCall.h"
#include "LateReads.h"
#include "ProviderRegistry.h"
#include "usdlive/edf/DataProvider.h"

/// Reads `x.edf` for the arguments that are composed from a prim's `EdfDataParameters`. The content
/// of the file is not used; an anonymous layer with the extension does as well. Layers cannot be
/// edited, saved or written.
///
/// In the global namespace, because the name of the class is the name of the type in plugInfo.json.
class EdfFileFormat final : public pxr::SdfFileFormat, public pxr::PcpDynamicFileFormatInterface {
public:
    EdfFileFormat();
    ~EdfFileFormat() override = default;

    pxr::SdfAbstractDataRefPtr InitData(const FileFormatArguments& args) const override;
    bool CanRead(const std::string& file) const override;
    bool Read(pxr::SdfLayer* layer, const std::string& resolvedPath,
              bool metadataOnly) const override;
    // The text of ExportToString() and of a spec, as usda.
    bool WriteToString(const pxr::SdfLayer& layer, std::string* text,
                       const std::string& comment) const override;
    bool WriteToStream(const pxr::SdfSpecHandle& spec, std::ostream& out,
                       std::size_t indent) const override;
    std::set<std::string> GetExternalAssetDependencies(const pxr::SdfLayer& layer) const override;

    void ComposeFieldsForFileFormatArguments(const std::string& assetPath,
                                             const pxr::PcpDynamicFileFormatContext& context,
                                             FileFormatArguments* args,
                                             pxr::VtValue* dependencyContextData) const override;
    bool CanFieldChangeAffectFileFormatArguments(
        const pxr::TfToken& field, const pxr::VtValue& oldValue, const pxr::VtValue& newValue,
        const pxr::VtValue& dependencyContextData) const override;
    bool CanAttributeDefaultValueChangeAffectFileFormatArguments(
        const pxr::TfToken&, const pxr::VtValue&, const pxr::VtValue&,
        const pxr::VtValue&) const override {
        return false;
    }

protected:
    bool _ShouldSkipAnonymousReload() const override { return false; }
    bool _ShouldReadAnonymousLayers() const override { return true; }
    pxr::SdfLayer* _InstantiateNewLayer(const pxr::SdfFileFormatConstPtr& format,
                                        const std::string& identifier, const std::string& realPath,
                                        const pxr::ArAssetInfo& info,
                                        const FileFormatArguments& args) const override;
    bool _ReadDetached(pxr::SdfLayer* layer, const std::string& resolvedPath,
                       bool metadataOnly) const override;

private:
    [[nodiscard]] static usdlive::edf::EdfData::Sources sourcesOf(const pxr::SdfLayer& layer);
    [[nodiscard]] usdlive::edf::ReadResult readBy(const usdlive::edf::EdfDataParameters& parameters,
                                                  const std::string& label) const;
    [[nodiscard]] usdlive::edf::AbandonedCalls abandonedOf(const std::string& provider) const;

    mutable usdlive::edf::ProviderRegistry providers_;
    mutable std::mutex mutex_;  // guards abandoned_
    mutable std::map<std::string, usdlive::edf::AbandonedCalls> abandoned_;
};
