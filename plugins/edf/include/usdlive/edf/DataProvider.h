// The interface between the file format `edf` and its data providers. This header is all that a
// provider needs from here: a provider links OpenUSD only, and its library is found by its
// plugInfo.json.
#pragma once

#include <pxr/base/arch/export.h>
#include <pxr/base/tf/registryManager.h>
#include <pxr/base/tf/token.h>
#include <pxr/base/tf/type.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/path.h>
#include <pxr/usd/sdf/types.h>

#include <map>
#include <memory>
#include <string>

namespace usdlive::edf {

// The version of this interface. A provider that was built with another version is refused with an
// error.
inline namespace v1 {

/// The arguments of a provider, by key.
using EdfArguments = std::map<std::string, std::string>;

/// The request of a payload.
struct EdfDataParameters {
    std::string dataProviderId;
    EdfArguments providerArgs;
    /// The resolved path of the payload's asset, for paths relative to it. Empty for an anonymous
    /// layer.
    std::string assetPath;
};

/// The content that a provider writes: prims below `/Data`, which exists already and is the
/// default prim.
///
/// Used by one thread at a time, during the call that passes it. A call returns false when it
/// refuses its arguments (no such parent, a name that is no identifier or is used, an unknown
/// field, a value of another type, too much content). Then the read fails as a whole, with the
/// first refusal as its cause, so a provider need not check.
class ARCH_EXPORT_TYPE IEdfSourceData {
public:
    virtual ~IEdfSourceData() = default;

    /// Creates the prim `parent/name`. Children keep the order of their creation.
    virtual bool CreatePrim(const pxr::SdfPath& parent, const std::string& name,
                            pxr::SdfSpecifier specifier, const pxr::TfToken& typeName) = 0;
    /// Creates an attribute of a prim created before. Without a default value if `value` is empty.
    virtual bool CreateAttribute(const pxr::SdfPath& prim, const pxr::TfToken& name,
                                 const pxr::SdfValueTypeName& typeName,
                                 pxr::SdfVariability variability, const pxr::VtValue& value) = 0;
    virtual bool CreateRelationship(const pxr::SdfPath& prim, const pxr::TfToken& name,
                                    const pxr::SdfPathVector& targets) = 0;
    /// Sets metadata of a prim or property, as Sdf stores it: `apiSchemas` is an SdfTokenListOp,
    /// `references` an SdfReferenceListOp, `timeSamples` an SdfTimeSampleMap.
    virtual bool SetField(const pxr::SdfPath& path, const pxr::TfToken& field,
                          const pxr::VtValue& value) = 0;

    virtual bool HasField(const pxr::SdfPath& path, const pxr::TfToken& field) const = 0;
    virtual bool HasAttribute(const pxr::SdfPath& attribute) const = 0;

    /// Says that IEdfDataProvider::ReadChildren reads the children of this prim when they are first
    /// needed.
    virtual bool DeferChildren(const pxr::SdfPath& prim) = 0;
    /// Names a file that the content was read from. `Reload` reads the layer again when that file
    /// has changed.
    virtual void AddDependency(const std::string& resolvedPath) = 0;
    /// Says that the content may change without a change of such a file. `Reload` always reads it
    /// again.
    virtual void SetMayChange() = 0;
    /// Posts a warning that names the payload and the provider, for a part that is left out.
    virtual void Warn(const std::string& text) = 0;
    /// True when nobody waits for the result any more. A provider that waits or loops asks now and
    /// then.
    [[nodiscard]] virtual bool IsCancelled() const = 0;
};

/// Reads the content of one payload.
///
/// One object exists for each layer, that is for each different set of arguments. `Read` is called
/// once, on a thread of the file format. `ReadChildren` is called later, at most once for each
/// deferred prim, and for different prims from several threads at the same time. Composition waits
/// for these calls, up to the time limit of the provider (60 seconds, or `timeLimitSeconds` in its
/// plugInfo.json). At the limit the payload is an error, and the call's data is dropped whenever it
/// ends. In the tick of an editor that is connected with usdlive, composition does not wait: a
/// thread makes all calls for a layer, and a later tick composes the content.
///
/// A call fails by returning false with the cause in `why`, or with an exception that derives from
/// std::exception. It must not use the layer or a stage that it is read for: their threads wait for
/// it.
class ARCH_EXPORT_TYPE IEdfDataProvider {
public:
    virtual ~IEdfDataProvider() = default;

    virtual bool Read(IEdfSourceData& data, std::string& why) = 0;
    /// Creates the children of `prim`, which `data` cannot see otherwise.
    virtual bool ReadChildren(const pxr::SdfPath& /*prim*/, IEdfSourceData& /*data*/,
                              std::string& /*why*/) {
        return true;
    }
};

/// Creates the providers of one plug-in. EDF_DEFINE_DATAPROVIDER defines one.
class ARCH_EXPORT_TYPE EdfDataProviderFactoryBase : public pxr::TfType::FactoryBase {
public:
    [[nodiscard]] virtual std::unique_ptr<IEdfDataProvider> New(
        const EdfDataParameters& parameters) const = 0;
    /// Translates the arguments of the metadata to those that identify the content.
    [[nodiscard]] virtual EdfArguments ComposeArguments(const EdfArguments& metadata) const = 0;
};

/// Calls `Provider(parameters)`, and `Provider::ComposeArguments(metadata)` if there is such a
/// static function.
///
/// Payloads whose composed arguments are equal share one layer, so a provider clamps, fills in
/// defaults and removes what does not matter. The function is called often, by several threads, and
/// must be quick: no files, no network. For its own result it returns the same. An exception is an
/// error of the payload.
template <class Provider>
class EdfDataProviderFactory final : public EdfDataProviderFactoryBase {
public:
    std::unique_ptr<IEdfDataProvider> New(const EdfDataParameters& parameters) const override {
        return std::make_unique<Provider>(parameters);
    }
    EdfArguments ComposeArguments(const EdfArguments& metadata) const override {
        if constexpr (requires { Provider::ComposeArguments(metadata); })
            return Provider::ComposeArguments(metadata);
        else
            return metadata;
    }
};

}  // namespace v1
}  // namespace usdlive::edf

/// Registers a class as the type `name` of the plug-in's plugInfo.json. Once for each source file,
/// outside of any namespace, in a library that is compiled with MFB_ALT_PACKAGE_NAME defined as the
/// plug-in's name.
#define EDF_DEFINE_DATAPROVIDER(Provider, name)                                              \
    namespace usdlive_edf_registration {                                                     \
    using namespace pxr;                                                                     \
    TF_REGISTRY_FUNCTION(TfType) {                                                           \
        const TfType type = TfType::Declare(name, {TfType::Declare("IEdfDataProvider")});    \
        type.SetFactory(std::make_unique<usdlive::edf::EdfDataProviderFactory<Provider>>()); \
    }                                                                                        \
    }                                                                                        \
    static_assert(true)
