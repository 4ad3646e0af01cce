// Opens layers of the format `edf` by asking data providers for their content.
#include "EdfFileFormat.h"

#include <pxr/base/tf/diagnostic.h>
#include <pxr/base/tf/registryManager.h>
#include <pxr/base/tf/staticTokens.h>
#include <pxr/base/tf/stringUtils.h>
#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/pcp/dynamicFileFormatContext.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/schema.h>

#include <exception>
#include <optional>
#include <utility>

#include "Arguments.h"
#include "SourceData.h"

using namespace pxr;

TF_REGISTRY_FUNCTION(TfType) { SDF_DEFINE_FILE_FORMAT(EdfFileFormat, SdfFileFormat); }

using usdlive::edf::AbandonedCalls;
using usdlive::edf::EdfData;
using usdlive::edf::EdfDataParameters;
using usdlive::edf::EdfDataRefPtr;
using usdlive::edf::IEdfDataProvider;
using usdlive::edf::LateReads;
using usdlive::edf::ReadResult;
using usdlive::edf::SourceData;

namespace {

const TfToken& parametersField() {
    static const TfToken field("EdfDataParameters");
    return field;
}

const SdfPath& dataPath() {
    static const SdfPath path("/Data");
    return path;
}

// The pseudo-root and /Data, which every layer of the format has.
EdfDataRefPtr emptyData() {
    auto data = TfCreateRefPtr(new EdfData);
    const SdfPath& root = SdfPath::AbsoluteRootPath();
    data->CreateSpec(root, SdfSpecTypePseudoRoot);
    data->Set(root, SdfFieldKeys->DefaultPrim, VtValue(dataPath().GetNameToken()));
    data->Set(root, SdfChildrenKeys->PrimChildren,
              VtValue(TfTokenVector{dataPath().GetNameToken()}));
    data->CreateSpec(dataPath(), SdfSpecTypePrim);
    data->Set(dataPath(), SdfFieldKeys->Specifier, VtValue(SdfSpecifierDef));
    return data;
}

// The content of a layer that could not be read: nothing but the reason.
EdfDataRefPtr failedData(const std::string& reason) {
    auto data = TfCreateRefPtr(new EdfData);
    data->CreateSpec(SdfPath::AbsoluteRootPath(), SdfSpecTypePseudoRoot);
    data->Set(SdfPath::AbsoluteRootPath(), SdfFieldKeys->Comment, VtValue(reason));
    data->setSources({{}, false, true});
    return data;
}

// The content of a layer that is being read: empty, and no error yet.
EdfDataRefPtr lateData() {
    const auto data = emptyData();
    data->setSources({{}, false, true});
    return data;
}

// A provider with all that its calls need, also those that nobody waits for any more.
struct ReadingProvider {
    std::unique_ptr<IEdfDataProvider> provider;
    std::string label;
    std::chrono::milliseconds limit;
    AbandonedCalls abandoned;
};

using Call = std::function<bool(ReadingProvider&, SourceData&, std::string& why)>;
enum class Part { All, Children };

// The result of a call, or the reason why there is none.
struct Made {
    std::shared_ptr<SourceData> source;
    std::string reason;
};

Made callProvider(const std::shared_ptr<ReadingProvider>& reading, const SdfPath& root,
                  const SdfDataRefPtr& into, Part part, Call call) {
    const auto isCancelled = std::make_shared<std::atomic<bool>>(false);
    const auto adds =
        part == Part::All ? SourceData::Adds::Everything : SourceData::Adds::ChildrenOnly;
    auto source = std::make_shared<SourceData>(root, adds, into, reading->label, isCancelled);
    auto checked = [reading, source, call = std::move(call)](std::string& why) {
        const bool good = call(*reading, *source, why);
        if (good) source->finish();
        if (source->refusal().empty()) return good;
        why = "it made invalid content: " + source->refusal();
        return false;
    };
    auto reason = usdlive::edf::callGuarded(std::move(checked), reading->limit, isCancelled,
                                            reading->abandoned);
    if (!reason.empty()) return {nullptr, std::move(reason)};
    return {std::move(source), {}};
}

EdfData::Part readChildren(const std::shared_ptr<ReadingProvider>& reading, const SdfPath& prim) {
    const SdfDataRefPtr specs = TfCreateRefPtr(new SdfData);
    const auto [source, reason] =
        callProvider(reading, prim, specs, Part::Children,
                     [prim](ReadingProvider& one, SourceData& into, std::string& why) {
                         return one.provider->ReadChildren(prim, into, why);
                     });
    if (source) return {specs, source->deferred()};
    // A warning, because somebody asks for the children, and there is an answer: none.
    TF_WARN("edf: %s could not read the children of %s: %s", reading->label.c_str(), prim.GetText(),
            reason.c_str());
    return {};
}

}  // namespace

EdfFileFormat::EdfFileFormat()
    : SdfFileFormat(TfToken("edfFileFormat"), TfToken("1.0"), TfToken("usd"), "edf") {}

SdfAbstractDataRefPtr EdfFileFormat::InitData(const FileFormatArguments&) const {
    return emptyData();
}

bool EdfFileFormat::CanRead(const std::string& file) const {
    return GetFileExtension(file) == "edf";
}

// A layer that cannot be read is empty, and so without a default prim: a composition error of each
// payload that uses it. If Read() failed, Pcp would forget what the arguments of the payload depend
// on, and a correction of the metadata would not be followed.
bool EdfFileFormat::Read(SdfLayer* layer, const std::string& resolvedPath,
                         bool metadataOnly) const {
    const auto request = usdlive::edf::requestOf(layer->GetFileFormatArguments());
    std::string reason = request.invalid;
    if (!metadataOnly && layer->GetFileFormatArguments().empty())
        reason = "no payload uses it; references and sublayers pass no parameters";
    std::optional<ReadResult> result = ReadResult{emptyData(), {}};
    // Without a provider nothing is wrong yet: somebody adds the payload first and the metadata
    // next.
    if (!metadataOnly && reason.empty() && !request.dataProviderId.empty()) {
        const bool isAnonymous = SdfLayer::IsAnonymousLayerIdentifier(resolvedPath);
        const EdfDataParameters parameters{request.dataProviderId, request.providerArgs,
                                           isAnonymous ? std::string() : resolvedPath};
        const auto label =
            "@" + layer->GetIdentifier() + "@, provider '" + request.dataProviderId + "'";
        const auto read = [this, parameters, label] { return readBy(parameters, label); };
        auto& reads = LateReads::ofProcess();
        const SdfLayerHandle handle(layer);
        result = reads.read(handle, request.dataProviderId, read);
        if (result) reason = result->reason;
        if (!reason.empty())
            reads.failed(handle, request.dataProviderId, read);
        else if (result)
            reads.succeeded(handle);
    }
    const bool keeps = (!result || !reason.empty()) && sourcesOf(*layer).isRead;
    if (!reason.empty())
        TF_WARN("edf: @%s@ cannot be read, so %s: %s", layer->GetIdentifier().c_str(),
                keeps ? "it keeps its content" : "its payloads are empty", reason.c_str());
    if (keeps) return true;
    const EdfDataRefPtr data = !reason.empty() ? failedData(reason)
                               : result        ? result->data
                                               : lateData();
    // Within a tick of a live client, a thread reads the deferred parts, and a later tick composes
    // them.
    if (!data->IsDetached())
        data->setPostponed([handle = SdfLayerHandle(layer), provider = request.dataProviderId,
                            own = get_pointer(data)] {
            return handle && LateReads::ofProcess().postpone(
                                 handle, provider,
                                 [owned = EdfDataRefPtr(own)] { return ReadResult{owned, {}}; });
        });
    const auto sources = data->sources();
    SdfAbstractDataRefPtr content = data;
    _SetLayerData(layer, content);
    // When a layer is read again, Sdf may copy the difference into the data that the layer has.
    const auto current = _GetLayerData(*layer);
    if (const auto* kept = dynamic_cast<const EdfData*>(get_pointer(current)))
        const_cast<EdfData*>(kept)->setSources(sources);
    layer->SetPermissionToSave(false);
    layer->SetPermissionToEdit(false);
    return true;
}

ReadResult EdfFileFormat::readBy(const EdfDataParameters& parameters,
                                 const std::string& label) const {
    const auto answer = providers_.find(parameters.dataProviderId);
    const auto who = "the provider '" + parameters.dataProviderId +
                     (answer.plugin.empty() ? "'" : "' of the plug-in " + answer.plugin) +
                     " cannot be used: ";
    if (!answer.factory) return {nullptr, who + answer.error};
    auto reading = std::make_shared<ReadingProvider>();
    reading->label = label + " of the plug-in " + answer.plugin;
    reading->limit = answer.limit;
    reading->abandoned = abandonedOf(parameters.dataProviderId);

    // A call that is left alone at the limit keeps `made`.
    const EdfDataRefPtr made = emptyData();
    const auto [source, reason] =
        callProvider(reading, dataPath(), made, Part::All,
                     [parameters, factory = answer.factory](ReadingProvider& one, SourceData& into,
                                                            std::string& why) {
                         // Also for a layer that is opened with arguments of its own.
                         auto composed = parameters;
                         composed.providerArgs = factory->ComposeArguments(parameters.providerArgs);
                         one.provider = factory->New(composed);
                         return one.provider->Read(into, why);
                     });
    if (!source) return {nullptr, who + reason};
    made->defer(source->deferred(),
                [reading](const SdfPath& prim) { return readChildren(reading, prim); });
    made->setSources({source->dependencies(), true, source->mayChange()});
    return {made, {}};
}

AbandonedCalls EdfFileFormat::abandonedOf(const std::string& provider) const {
    const std::lock_guard lock(mutex_);
    auto& calls = abandoned_[provider];
    if (!calls) calls = std::make_shared<std::atomic<int>>(0);
    return calls;
}

bool EdfFileFormat::_ReadDetached(SdfLayer* layer, const std::string& resolvedPath,
                                  bool metadataOnly) const {
    return _ReadAndCopyLayerDataToMemory(layer, resolvedPath, metadataOnly);
}

bool EdfFileFormat::WriteToString(const SdfLayer& layer, std::string* text,
                                  const std::string& comment) const {
    return FindById(TfToken("usda"))->WriteToString(layer, text, comment);
}

bool EdfFileFormat::WriteToStream(const SdfSpecHandle& spec, std::ostream& out,
                                  std::size_t indent) const {
    return FindById(TfToken("usda"))->WriteToStream(spec, out, indent);
}

EdfData::Sources EdfFileFormat::sourcesOf(const SdfLayer& layer) {
    const auto data = _GetLayerData(layer);
    const auto* own = dynamic_cast<const EdfData*>(get_pointer(data));
    return own ? own->sources() : EdfData::Sources();
}

// Sdf reads the identifier of an anonymous layer as a format for printf. It has made that of a new
// one itself; all others are texts of the scene.
pxr::SdfLayer* EdfFileFormat::_InstantiateNewLayer(const pxr::SdfFileFormatConstPtr& format,
                                                   const std::string& identifier,
                                                   const std::string& realPath,
                                                   const pxr::ArAssetInfo& info,
                                                   const FileFormatArguments& args) const {
    const bool isText =
        SdfLayer::IsAnonymousLayerIdentifier(identifier) && !identifier.starts_with("anon:%p");
    return SdfFileFormat::_InstantiateNewLayer(
        format, isText ? pxr::TfStringReplace(identifier, "%", "%%") : identifier, realPath, info,
        args);
}

// Sdf reads a layer again if its file or one of these has changed. A new name counts as a change.
std::set<std::string> EdfFileFormat::GetExternalAssetDependencies(const SdfLayer& layer) const {
    static std::atomic<unsigned> number = 0;
    auto sources = sourcesOf(layer);
    if (sources.mayChange) sources.files.insert("edf-source-" + std::to_string(++number));
    return std::move(sources.files);
}

void EdfFileFormat::ComposeFieldsForFileFormatArguments(const std::string&,
                                                        const PcpDynamicFileFormatContext& context,
                                                        FileFormatArguments* args,
                                                        VtValue* dependencyContextData) const {
    VtValue value;
    VtDictionary metadata;
    if (context.ComposeValue(parametersField(), &value) && value.IsHolding<VtDictionary>())
        metadata = value.UncheckedGet<VtDictionary>();
    auto request = usdlive::edf::requestOf(metadata);
    if (request.invalid.empty() && !request.dataProviderId.empty()) {
        const auto answer = providers_.find(request.dataProviderId);
        try {
            if (answer.factory)
                request.providerArgs = answer.factory->ComposeArguments(request.providerArgs);
        } catch (const std::exception& error) {
            request.invalid = "the provider '" + request.dataProviderId + "' of the plug-in " +
                              answer.plugin + " refuses its arguments: " + error.what();
        }
    }
    usdlive::edf::addTo(*args, request);
    *dependencyContextData = VtValue(metadata);
}

bool EdfFileFormat::CanFieldChangeAffectFileFormatArguments(
    const TfToken& field, const VtValue& oldValue, const VtValue& newValue,
    const VtValue& dependencyContextData) const {
    if (field != parametersField() || !dependencyContextData.IsHolding<VtDictionary>()) return true;
    return usdlive::edf::canChangeRequest(oldValue, newValue,
                                          dependencyContextData.UncheckedGet<VtDictionary>());
}

// For a client library in the same process, which finds the functions by their names
// (client/src/usd/assets/DynamicPayloads.h). A change of their meaning changes the number.
#define USDLIVE_EDF_EXPORT extern "C" __attribute__((visibility("default")))
USDLIVE_EDF_EXPORT void usdliveEdfBeginTick1() { LateReads::ofProcess().beginTick(); }
USDLIVE_EDF_EXPORT void usdliveEdfEndTick1() { LateReads::ofProcess().endTick(); }
USDLIVE_EDF_EXPORT void usdliveEdfReloadArrived1() { LateReads::ofProcess().reloadArrived(); }
#undef USDLIVE_EDF_EXPORT
