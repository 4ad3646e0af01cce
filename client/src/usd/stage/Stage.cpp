// Implements the public functions of Stage on top of StageState.
#include "usdlive/client/usd/stage/Stage.h"

#include <pxr/base/tf/enum.h>
#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/pcp/layerStack.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>

#include "usd/stage/Opinions.h"
#include "usd/stage/StageState.h"
#include "usdlive/client/usd/schema/SchemaRegistry.h"

namespace usdlive::stage {

using pxr::SdfPath;
using pxr::TfToken;

namespace {

std::shared_ptr<const schema::SchemaRegistry> schemasOfProcess() {
    static const auto schemas = std::make_shared<const schema::SchemaRegistry>();
    return schemas;
}

// Names the session layer like UsdStage.
pxr::SdfLayerRefPtr createSession(const pxr::SdfLayerRefPtr& root) {
    const std::string name = pxr::SdfLayer::GetDisplayNameFromIdentifier(root->GetIdentifier());
    return pxr::SdfLayer::CreateAnonymous(name.substr(0, name.rfind('.')) + "-session.usda");
}

StageOptions complete(StageOptions options) {
    if (!options.schemas) options.schemas = schemasOfProcess();
    return options;
}

// Returns the time of the session layer, even if it is muted, else that of the root layer. `old` is
// the field's name in files of early versions.
double timeOf(const StageState& state, const TfToken& field, const TfToken& old) {
    for (const auto& layer : {state.sessionLayer, state.rootLayer})
        for (const auto& name : {field, old})
            if (double time = 0; layer->HasField(SdfPath::AbsoluteRootPath(), name, &time))
                return time;
    return 0;
}

std::string typeOf(pxr::PcpErrorType type) {
    // OpenUSD 26.8 registers no name for it.
    if (type == pxr::PcpErrorType_ArcToProhibitedChild) return "ArcToProhibitedChild";
    const std::string name = pxr::TfEnum::GetName(type);
    return name.substr(name.rfind('_') + 1);
}

bool visitBelow(const Prim& prim, const PrimPredicate& predicate,
                const std::function<bool(const Prim&)>& visit) {
    for (const auto& child : prim.children(predicate))
        if (visit(child)) visitBelow(child, predicate, visit);
    return true;
}

}  // namespace

Result<std::unique_ptr<Stage>> Stage::open(const std::string& rootFile, StageOptions options) {
    const auto layer = openLayer(rootFile);
    if (!layer) return tl::unexpected(layer.error());
    return std::make_unique<Stage>(*layer, nullptr, std::move(options));
}

Stage::Stage(const pxr::SdfLayerRefPtr& root, const pxr::SdfLayerRefPtr& session,
             StageOptions options)
    : state_(std::make_unique<StageState>(*this, root, session ? session : createSession(root),
                                          complete(std::move(options)))) {}

Stage::~Stage() = default;

pxr::SdfLayerHandle Stage::rootLayer() const { return state_->rootLayer; }
pxr::SdfLayerHandle Stage::sessionLayer() const { return state_->sessionLayer; }

pxr::SdfLayerRefPtrVector Stage::localLayers() const {
    return state_->composition.localLayers().GetLayers();
}

bool Stage::hasLocalLayer(const pxr::SdfLayerHandle& layer) const {
    return state_->composition.localLayers().HasLayer(layer);
}

pxr::SdfLayerHandleSet Stage::usedLayers() const {
    auto layers = state_->composition.cache().GetUsedLayers();
    layers.merge(state_->clipLayers->open());
    return layers;
}

Composition& Stage::composition() const { return state_->composition; }
const schema::SchemaRegistry& Stage::schemas() const { return *state_->schemas; }

Prim Stage::pseudoRoot() const { return state_->prim(SdfPath::AbsoluteRootPath()); }
Prim Stage::prim(const SdfPath& path) const { return state_->prim(path); }

Property Stage::property(const SdfPath& path) const {
    if (!path.IsPrimPropertyPath()) return {};
    const Prim owner = prim(path.GetPrimPath());
    return owner ? owner.property(path.GetNameToken()) : Property();
}

std::vector<Prim> Stage::traverse(const PrimPredicate& predicate) const {
    std::vector<Prim> prims;
    traverse(predicate, [&](const Prim& prim) {
        prims.push_back(prim);
        return true;
    });
    return prims;
}

void Stage::traverse(const PrimPredicate& predicate,
                     const std::function<bool(const Prim&)>& visit) const {
    visitBelow(pseudoRoot(), predicate, visit);
}

Prim Stage::defaultPrim() const {
    const SdfPath path = state_->rootLayer->GetDefaultPrimAsPath();
    return path.IsPrimPath() ? prim(path) : Prim();
}

std::vector<Prim> Stage::prototypes() const {
    std::vector<Prim> prims;
    for (const auto& prototype : state_->prototypes.all())
        prims.push_back(state_->prim(prototype->path));
    return prims;
}

std::vector<Prim> Stage::instances(const Prim& prototype) const {
    std::vector<Prim> prims;
    const auto* found = state_->prototypes.at(prototype.path());
    if (!found) return prims;
    for (const auto& path : found->instances) {
        const auto* around = state_->prototypes.around(path);
        const auto at = around ? path.ReplacePrefix(around->source, around->path) : path;
        if (auto one = state_->prim(at)) prims.push_back(std::move(one));
    }
    return prims;
}

pxr::VtValue Stage::metadata(const TfToken& field) const {
    const auto& definition = pxr::SdfSchema::GetInstance();
    if (!definition.IsValidFieldForSpec(field, pxr::SdfSpecTypePseudoRoot)) return {};
    auto value = pseudoRoot().metadata(field);
    const auto& fallback = definition.GetFallback(field);
    if (value.IsEmpty()) return fallback;
    if (value.IsHolding<pxr::VtDictionary>() && fallback.IsHolding<pxr::VtDictionary>())
        return pxr::VtValue(pxr::VtDictionaryOverRecursive(
            value.UncheckedGet<pxr::VtDictionary>(), fallback.UncheckedGet<pxr::VtDictionary>()));
    return value;
}

bool Stage::hasTimeRange() const {
    const auto has = [](const pxr::SdfLayer& layer) {
        const auto hasField = [&](const TfToken& field) {
            return layer.HasField(SdfPath::AbsoluteRootPath(), field);
        };
        return (hasField(pxr::SdfFieldKeys->StartTimeCode) &&
                hasField(pxr::SdfFieldKeys->EndTimeCode)) ||
               (hasField(pxr::SdfFieldKeys->StartFrame) && hasField(pxr::SdfFieldKeys->EndFrame));
    };
    return has(*state_->rootLayer) || has(*state_->sessionLayer);
}

double Stage::startTime() const {
    return timeOf(*state_, pxr::SdfFieldKeys->StartTimeCode, pxr::SdfFieldKeys->StartFrame);
}

double Stage::endTime() const {
    return timeOf(*state_, pxr::SdfFieldKeys->EndTimeCode, pxr::SdfFieldKeys->EndFrame);
}

std::vector<CompositionError> Stage::errors() const {
    std::vector<CompositionError> errors;
    const auto add = [&](const pxr::PcpErrorVector& found) {
        for (const auto& error : found) {
            errors.push_back({typeOf(error->errorType), error->rootSite.path, error->ToString()});
        }
    };
    const auto& cache = state_->composition.cache();
    cache.ForEachPrimIndex([&](const pxr::PcpPrimIndex& index) { add(index.GetLocalErrors()); });
    cache.ForEachLayerStack(
        [&](const pxr::PcpLayerStackPtr& stack) { add(stack->GetLocalErrors()); });
    cache.ForEachPrimIndex([&](const pxr::PcpPrimIndex& index) {
        if (index.GetPath().GetPathElementCount() < StageState::kDeepest) return;
        errors.push_back({"NamespaceTooDeep", index.GetPath(),
                          "what is below <" + index.GetPath().GetAsString() +
                              "> is not composed: the prim has too many ancestors"});
    });
    for (const auto& [type, prim, message] : state_->composition.depthProblems())
        errors.push_back({type, prim, message});
    std::ranges::stable_sort(errors, {}, [](const CompositionError& one) {
        return std::pair(one.prim.GetAsString(), one.type);
    });
    return errors;
}

const LoadRules& Stage::loadRules() const { return state_->load; }
void Stage::setLoadRules(const LoadRules& rules) { state_->setLoadRules(rules); }

void Stage::load(const SdfPath& prim, LoadRules::Rule rule) {
    LoadRules rules = state_->load;
    rules.set(prim, rule);
    state_->setLoadRules(rules);
}

const PopulationMask& Stage::mask() const { return state_->mask; }
void Stage::setMask(const PopulationMask& mask) { state_->setMask(mask); }
const std::vector<std::string>& Stage::mutedLayers() const { return state_->muted; }
void Stage::setMutedLayers(const std::vector<std::string>& identifiers) {
    state_->setMuted(identifiers);
}

const EditTarget& Stage::editTarget() const { return state_->target; }
void Stage::setEditTarget(const EditTarget& target) { state_->target = target; }

EditTarget Stage::editTargetFor(const pxr::SdfLayerHandle& layer) const {
    const auto* offset = state_->composition.localLayers().GetLayerOffsetForLayer(layer);
    return EditTarget(layer, offset ? *offset : pxr::SdfLayerOffset());
}

Stage::Subscription Stage::subscribe(Listener listener) {
    return state_->subscribe(std::move(listener));
}

std::size_t Stage::primsUpdated() const { return state_->primsUpdated; }

}  // namespace usdlive::stage
