// Distributes edits of the delegate layer to the layers of the stack.
#include "usd/layers/Distribution.h"

#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/pcp/layerStack.h>
#include <pxr/usd/sdf/attributeSpec.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/namespaceEdit.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/relationshipSpec.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <ranges>
#include <utility>

#include "usd/content/MappedValue.h"
#include "usd/content/SpecEdits.h"
#include "usdlive/common/usd/SdfLayerStore.h"

namespace usdlive::layers {

using content::composedListOp;
using content::isListOp;
using content::makeSpecLike;
using content::mapped;
using content::moveSpec;
using content::removeSpec;
using content::setListOp;
using pxr::SdfLayerHandle;
using pxr::SdfPath;
using pxr::TfToken;
using pxr::VtValue;

namespace {

// Attributes with more samples are not mirrored. The delegate would have to hold all of them,
// because only the strongest layer with samples counts.
constexpr std::size_t kMaxMirroredSamples = 256;

// References to the schema's tokens, so that they are not looked up at each use.
struct LayerFields {
    const TfToken& value = pxr::SdfFieldKeys->Default;
    const TfToken& samples = pxr::SdfFieldKeys->TimeSamples;
    const TfToken& spline = pxr::SdfFieldKeys->Spline;
    const TfToken& specifier = pxr::SdfFieldKeys->Specifier;
    const TfToken& typeName = pxr::SdfFieldKeys->TypeName;
    const TfToken& custom = pxr::SdfFieldKeys->Custom;
    const TfToken& variability = pxr::SdfFieldKeys->Variability;
};
const LayerFields& names() {
    static const LayerFields all;
    return all;
}

// Returns true for a value whose relative paths would have another meaning in the delegate, which
// has no folder. It is not mirrored.
bool belongsToItsLayer(const TfToken& field, const VtValue& value) {
    static const TfToken clips("clips");
    return field == clips || content::hasAssetPath(value);
}

// Default, samples and spline are one register, the attribute's value.
bool isValue(const TfToken& field) {
    return field == names().value || field == names().samples || field == names().spline;
}

bool isRequiredOfProperties(const TfToken& field) {
    return field == names().typeName || field == names().custom || field == names().variability;
}

bool hasOpinion(const SdfLayerHandle& layer, const SdfPath& path, const TfToken& field) {
    if (field == names().specifier) {
        // `over` states nothing.
        const VtValue specifier = layer->GetField(path, field);
        return specifier.IsHolding<pxr::SdfSpecifier>() &&
               specifier.UncheckedGet<pxr::SdfSpecifier>() != pxr::SdfSpecifierOver;
    }
    if (!isValue(field)) return layer->HasField(path, field);
    return layer->HasField(path, names().value) || layer->HasField(path, names().samples) ||
           layer->HasField(path, names().spline);
}

bool hidesDefault(const SdfLayerHandle& layer, const SdfPath& path) {
    return layer->HasField(path, names().samples) || layer->HasField(path, names().spline);
}

// Returns the time of an existing sample that equals `time` except for rounding.
double sampleNear(const SdfLayerHandle& layer, const SdfPath& path, double time) {
    double lower = 0, upper = 0;
    if (!layer->GetBracketingTimeSamplesForPath(path, time, &lower, &upper)) return time;
    const double tolerance = 1e-9 * std::max(1.0, std::abs(time));
    if (std::abs(lower - time) <= tolerance) return lower;
    return std::abs(upper - time) <= tolerance ? upper : time;
}

void collectKeys(const pxr::VtDictionary& dictionary, const std::string& prefix,
                 std::vector<TfToken>& keys) {
    for (const auto& [key, value] : dictionary)
        if (value.IsHolding<pxr::VtDictionary>() &&
            !value.UncheckedGet<pxr::VtDictionary>().empty())
            collectKeys(value.UncheckedGet<pxr::VtDictionary>(), prefix + key + ":", keys);
        else
            keys.emplace_back(prefix + key);
}

// Combines two lists of names. Prepended names follow those of the weaker list.
VtValue withPrependedAtEnd(const VtValue& stronger, const VtValue& weaker) {
    if (!stronger.IsHolding<pxr::SdfStringListOp>() || !weaker.IsHolding<pxr::SdfStringListOp>())
        return composedListOp(stronger, weaker);
    auto added = stronger.UncheckedGet<pxr::SdfStringListOp>();
    auto both = weaker.UncheckedGet<pxr::SdfStringListOp>();
    auto names = both.IsExplicit() ? both.GetExplicitItems() : both.GetPrependedItems();
    for (const auto& name : added.GetPrependedItems()) {
        std::erase(names, name);
        names.push_back(name);
    }
    both.IsExplicit() ? both.SetExplicitItems(names) : both.SetPrependedItems(names);
    added.SetPrependedItems({});
    return composedListOp(VtValue(added), VtValue(both));
}

bool containsTarget(const SdfPath& path) { return path.ContainsTargetPath(); }

}  // namespace

Distribution::Distribution(LocalStack& stack, const SdfLayerHandle& delegate,
                           const SdfLayerHandle& defaultLayer, DistributionRules& rules,
                           content::Recorder* recorder)
    : stack_(stack), delegate_(delegate), rules_(rules), recorder_(recorder) {
    const auto* own = stack.find(delegate);
    const pxr::SdfLayerOffset toStack = own ? own->toStack : pxr::SdfLayerOffset();
    for (const auto& [layer, offset, ofSession] : stack.layers()) {
        if (layer == delegate) continue;
        targets_.push_back({layer, offset.GetInverse() * toStack, toStack.GetInverse() * offset,
                            rules.whyNotWritable(layer)});
    }
    for (const auto& target : targets_)
        if (target.layer == defaultLayer) default_ = &target;
}

Distribution::~Distribution() = default;

std::vector<RefusedEdit> Distribution::distribute(const DelegateWrites::Taken& taken) {
    for (const auto& edit : taken.namespaceEdits) {
        if (edit.to.IsEmpty())
            remove(edit.from);
        else
            move(edit.from, edit.to);
    }
    plan_.reserve(taken.specs.size());
    for (const auto& spec : taken.specs) planSpec(spec);
    for (const auto& planned : plan_) carryOut(planned);
    for (const auto* spec : linked_) refresh(spec->path, false);
    dropEmpty();
    for (const auto& spec : taken.specs) keepBare(spec);
    for (const auto& spec : taken.specs) dropVariants(spec.path);
    dropEmpty();
    return std::move(refused_);
}

// ------------------------------------------------------------------ namespace

void Distribution::remove(const SdfPath& path) {
    path.IsPropertyPath() ? removeProperty(path) : removePrim(path);
}

// Removes a prim from all layers of the stack, because the user who removes it does not choose a
// layer.
void Distribution::removePrim(const SdfPath& path) {
    const Holders holders = holdersOf(path);
    if (holders.empty()) return;
    if (const auto locked = rules_.whyLocked(path)) return refuse(path, "", "", *locked);
    for (const Target* target : holders)
        if (target->closed)
            return refuse(path, "", target->layer->GetIdentifier(), *target->closed);
    for (const Target* target : holders) {
        record(target->layer, path, true);
        removeSpec(target->layer, path);
    }
}

// Removes only the strongest opinion of a property, or those in the layers that it is linked to.
void Distribution::removeProperty(const SdfPath& path) {
    auto places = placesOf(path);
    if (places.empty()) return;
    if (const auto locked = rules_.whyLocked(path)) return refuse(path, "", "", *locked);
    if (const auto links = rules_.linkedLayers(path); links.empty())
        places.resize(1);
    else
        std::erase_if(places, [&](const Place& place) {
            return std::ranges::find(links, place.target->layer) == links.end();
        });
    for (const auto& [target, there, exists] : places)
        if (target->closed)
            return refuse(path, "", target->layer->GetIdentifier(), *target->closed);
    for (const auto& [target, there, exists] : places) {
        record(target->layer, there, true);
        removeSpec(target->layer, there);
    }
    refresh(path, true);
}

// Usd.NamespaceEditor has moved the spec in all layers already. A direct rename of the delegate's
// spec has not.
void Distribution::move(const SdfPath& from, const SdfPath& to) {
    Holders moving;
    for (const Target* target : holdersOf(from))
        if (!target->layer->HasSpec(to)) moving.push_back(target);
    for (const Target* target : moving) {
        auto why = target->closed ? target->closed : rules_.whyLocked(from);
        if (!why) continue;
        if (delegate_->HasSpec(to)) moveSpec(delegate_, to, from);
        return refuse(from, "", target->layer->GetIdentifier(), *why);
    }
    for (const Target* target : moving) {
        for (const SdfPath& path : {from, to}) record(target->layer, path, true);
        moveSpec(target->layer, from, to);
    }
}

// ------------------------------------------------------------------ finding the layer

Distribution::Holders Distribution::holdersOf(const SdfPath& path) const {
    Holders holders;
    for (const auto& target : targets_)
        if (target.layer->HasSpec(path)) holders.push_back(&target);
    return holders;
}

// Returns the places with the spec, strong to weak: at the path itself, then in selected variants
// of the stack, as far as no other arc is stronger.
std::vector<Distribution::Place> Distribution::placesOf(const SdfPath& path) {
    std::vector<Place> places;
    for (const Target* target : holdersOf(path)) places.push_back({target, path, true});
    const SdfPath prim = path.GetPrimPath();
    if (path.ContainsPrimVariantSelection() || !mayHaveVariants(prim)) return places;
    for (const auto& [site, foreign] : stack_.sites(prim)) {
        const SdfPath there = path.ReplacePrefix(prim, site, false);
        if (foreign) {
            for (const auto& layer : foreign->GetLayers())
                if (layer->HasSpec(there)) return places;
            continue;
        }
        if (there == path) continue;
        for (const auto& target : targets_)
            if (target.layer->HasSpec(there)) places.push_back({&target, there, true});
    }
    return places;
}

std::optional<Distribution::Place> Distribution::strongest(const SdfPath& path,
                                                           const TfToken& field,
                                                           const Holders& holders) {
    for (const Target* target : holders)
        if (hasOpinion(target->layer, path, field)) return Place{target, path, true};
    return strongestInVariants(path, field);
}

bool Distribution::mayHaveVariants(const SdfPath& path) {
    if (path.IsEmpty() || path == SdfPath::AbsoluteRootPath()) return false;
    const auto found = variants_.find(path);
    if (found != variants_.end()) return found->second;
    const auto has = [&](const Target& target) {
        return target.layer->HasField(path, pxr::SdfChildrenKeys->VariantSetChildren);
    };
    const bool any = std::ranges::any_of(targets_, has) || mayHaveVariants(path.GetParentPath());
    return variants_[path] = any;
}

// Local opinions are stronger than those from arcs, and variants are stronger than some of them. An
// edit goes to a variant only if the variant's opinion is the visible one.
std::optional<Distribution::Place> Distribution::strongestInVariants(const SdfPath& path,
                                                                     const TfToken& field) {
    const SdfPath prim = path.GetPrimPath();
    if (path.ContainsPrimVariantSelection() || !mayHaveVariants(prim)) return std::nullopt;
    for (const auto& [site, foreign] : stack_.sites(prim)) {
        const SdfPath there = path.ReplacePrefix(prim, site, false);
        if (foreign) {
            for (const auto& layer : foreign->GetLayers())
                if (hasOpinion(layer, there, field)) return std::nullopt;
            continue;
        }
        if (there == path) continue;
        for (const auto& target : targets_)
            if (hasOpinion(target.layer, there, field)) return Place{&target, there, true};
    }
    return std::nullopt;
}

Distribution::Place Distribution::placeFor(const SdfPath& path, const TfToken& field,
                                           const Holders& holders) {
    if (const auto place = strongest(path, field, holders)) return *place;
    return {holders.empty() ? default_ : holders.front(), path, !holders.empty()};
}

Distribution::Place Distribution::strongestKey(const Spec& spec, const TfToken& field,
                                               const TfToken& keyPath, const Holders& holders) {
    for (const Target* target : holders)
        if (target->layer->HasFieldDictKey(spec.path, field, keyPath))
            return {target, spec.path, true};
    return placeFor(spec.path, field, holders);
}

// ------------------------------------------------------------------ planning

void Distribution::planSpec(const Spec& spec) {
    if (spec.path == SdfPath::AbsoluteRootPath()) return distributeRelocates();
    if (containsTarget(spec.path) || !delegate_->HasSpec(spec.path)) return;
    if (const auto locked = rules_.whyLocked(spec.path)) return refuseLocked(spec, *locked);
    const auto links = rules_.linkedLayers(spec.path);
    if (!links.empty()) return planLinks(spec, links);
    const Holders all = holdersOf(spec.path);
    for (const auto& field : spec.fields) planField(spec, field, all);
}

void Distribution::planField(const Spec& spec, const Field& field, const Holders& holders) {
    if (isRedundant(spec, field, holders)) return;
    const bool parts = !field.whole && field.times.empty();
    if (parts || (field.name != names().value &&
                  delegate_->GetField(spec.path, field.name).IsHolding<pxr::VtDictionary>()))
        return planKeys(spec, field, holders);
    const Place place = placeFor(spec.path, field.name, holders);
    if (place.target) plan_.push_back({&spec, &field, {}, place});
}

void Distribution::planKeys(const Spec& spec, const Field& field, const Holders& holders) {
    std::vector<TfToken> keys = field.keyPaths;
    const VtValue value = delegate_->GetField(spec.path, field.name);
    if (field.whole && value.IsHolding<pxr::VtDictionary>())
        collectKeys(value.UncheckedGet<pxr::VtDictionary>(), "", keys);
    for (const TfToken& key : keys) {
        const Place place = strongestKey(spec, field.name, key, holders);
        if (place.target) plan_.push_back({&spec, &field, key, place});
    }
}

void Distribution::planLinks(const Spec& spec, const std::vector<SdfLayerHandle>& links) {
    const Holders all = holdersOf(spec.path);
    for (const auto& target : targets_) {
        if (std::find(links.begin(), links.end(), target.layer) == links.end()) continue;
        for (const auto& field : spec.fields)
            if (!isRedundant(spec, field, all))
                plan_.push_back({&spec, &field, {}, {&target, spec.path, false}});
    }
    linked_.insert(&spec);
}

void Distribution::carryOut(const Planned& planned) {
    const auto& [spec, field, key, place] = planned;
    if (!spec->created && !delegate_->HasField(spec->path, field->name))
        maybeEmpty_.push_back(spec->path);
    if (place.target->closed) return refuse(*spec, *field, *place.target);
    record(place.target->layer, place.path);
    if (!key.IsEmpty()) return writeKey(planned);
    write(place, *spec, *field);
    if (!linked_.contains(spec)) updateMirror(place, spec->path, field->name);
}

// Returns true for fields that repeat the opinions of other layers, because Usd creates a spec in
// the delegate before it writes to it.
bool Distribution::isRedundant(const Spec& spec, const Field& field, const Holders& holders) const {
    if (!spec.created) return false;
    const auto& name = field.name;
    if (spec.path.IsPropertyPath() && isRequiredOfProperties(name)) {
        if (holders.empty()) return true;  // created with the spec
        if (name != names().typeName) return true;
        return holders.front()->layer->GetField(spec.path, name) ==
               delegate_->GetField(spec.path, name);
    }
    if (name == names().specifier) return !hasOpinion(delegate_, spec.path, name);
    if (name != names().typeName) return false;
    const VtValue mine = delegate_->GetField(spec.path, name);
    for (const Target* target : holders)
        if (target->layer->HasField(spec.path, name))
            return target->layer->GetField(spec.path, name) == mine;
    return mine.IsEmpty();
}

void Distribution::record(const SdfLayerHandle& layer, const SdfPath& path, bool deep) {
    if (!recorder_) return;
    if (deep || !layer->HasSpec(path))
        recorder_->touchWithAncestors(layer, path);
    else
        recorder_->touch(layer, path);
}

bool Distribution::ensure(const Place& place, const SdfPath& source) {
    return place.exists || place.target->layer->HasSpec(place.path) ||
           makeSpecLike(place.target->layer, place.path, delegate_, source);
}

void Distribution::write(const Place& place, const Spec& spec, const Field& field) {
    const auto& layer = place.target->layer;
    const VtValue value = delegate_->GetField(spec.path, field.name);
    if (value.IsEmpty() && !place.exists && !layer->HasSpec(place.path)) return;
    if (!ensure(place, spec.path)) return;
    if (field.name == names().samples && !field.whole) return writeSamples(place, spec, field);
    VtValue result = mapped(value, place.target->toTarget);
    if (field.name != names().value && isListOp(result)) {
        // A list op that mirrored the layer's is complete. A new one is combined with the layer's;
        // AddVariantSet() adds at the end.
        const VtValue present = layer->GetField(place.path, field.name);
        if (!field.existed && field.name == pxr::SdfFieldKeys->VariantSetNames)
            result = withPrependedAtEnd(result, present);
        else if (!field.existed)
            result = composedListOp(result, present);
        return setListOp(layer, place.path, field.name, result);
    }
    if (value.IsEmpty() && isListOp(layer->GetField(place.path, field.name)))
        return setListOp(layer, place.path, field.name, {});
    layer->SetField(place.path, field.name, result);
    if (result.IsHolding<pxr::SdfValueBlock>()) {
        for (const auto& weaker : {names().samples, names().spline})
            if (!delegate_->HasField(spec.path, weaker)) layer->EraseField(place.path, weaker);
    }
}

void Distribution::writeSamples(const Place& place, const Spec& spec, const Field& field) {
    const auto& layer = place.target->layer;
    const auto& times = place.target->toTarget;
    for (const double time : field.times) {
        const double there =
            times.IsIdentity() ? time : sampleNear(layer, place.path, times * time);
        VtValue value;
        if (delegate_->QueryTimeSample(spec.path, time, &value))
            layer->SetTimeSample(place.path, there, mapped(value, times));
        else
            layer->EraseTimeSample(place.path, there);
    }
}

void Distribution::writeKey(const Planned& planned) {
    const auto& [spec, field, key, place] = planned;
    const VtValue mine = delegate_->GetFieldDictValueByKey(spec->path, field->name, key);
    if (mine.IsEmpty() && !place.target->layer->HasSpec(place.path)) return;
    if (ensure(place, spec->path))
        place.target->layer->SetFieldDictValueByKey(place.path, field->name, key,
                                                    mapped(mine, place.target->toTarget));
    if (belongsToItsLayer(field->name, mine))
        delegate_->EraseFieldDictValueByKey(spec->path, field->name, key);
}

// Relocates are metadata of a layer. The namespace editor writes them to the edit target.
void Distribution::distributeRelocates() {
    const auto root = SdfPath::AbsoluteRootPath();
    const TfToken& field = pxr::SdfFieldKeys->LayerRelocates;
    const Place place = placeFor(root, field, holdersOf(root));
    const Target* target =
        place.target && hasOpinion(place.target->layer, root, field) ? place.target : default_;
    if (!target) return;
    if (target->closed) {
        refuse(root, field.GetString(), target->layer->GetIdentifier(), *target->closed);
    } else {
        record(target->layer, root);
        target->layer->SetRelocates(delegate_->GetRelocates());
    }
    delegate_->EraseField(root, field);
}

// Keeps an empty over from `stage.OverridePrim()`, and a property without a value, unless it is
// only the ancestor of a spec that was written elsewhere.
void Distribution::keepBare(const Spec& spec) {
    if (!spec.created || !default_ || !delegate_->HasSpec(spec.path)) return;
    if (!spec.path.IsPropertyPath() && !isBareOver(spec.path)) return;
    if (!holdersOf(spec.path).empty() || rules_.whyLocked(spec.path)) return;
    if (default_->closed) {
        refuse(spec.path, "", default_->layer->GetIdentifier(), *default_->closed);
        return removeSpec(delegate_, spec.path);
    }
    record(default_->layer, spec.path);
    ensure({default_, spec.path, false}, spec.path);
}

bool Distribution::isBareOver(const SdfPath& path) const {
    if (!path.IsPrimPath() || hasOpinion(delegate_, path, names().specifier)) return false;
    const auto prim = delegate_->GetPrimAtPath(path);
    return prim && prim->GetNameChildren().empty() && prim->GetProperties().empty();
}

// ------------------------------------------------------------------ the mirror

// Erases or replaces the delegate's opinion if it differs from the layer's.
void Distribution::updateMirror(const Place& place, const SdfPath& path, const TfToken& field) {
    const auto& layer = place.target->layer;
    if (place.path != path) {
        // The opinion would hide the other variants.
        if (isListOp(delegate_->GetField(path, field))) setListOp(delegate_, path, field, {});
        delegate_->EraseField(path, field);
        maybeEmpty_.push_back(path);
    } else if (belongsToItsLayer(field, delegate_->GetField(path, field))) {
        delegate_->EraseField(path, field);
    } else if (field == names().value) {
        if (hidesDefault(layer, path)) delegate_->EraseField(path, field);
    } else if (field == names().samples || field == names().spline) {
        refreshField(path, field, {place.target});
        if (delegate_->HasField(path, names().value)) delegate_->EraseField(path, names().value);
    } else if (const VtValue mine = delegate_->GetField(path, field); isListOp(mine)) {
        setListOp(delegate_, path, field,
                  mapped(layer->GetField(path, field), place.target->toDelegate));
    }
}

void Distribution::refresh(const SdfPath& path, bool below) {
    if (!delegate_->HasSpec(path) || path == SdfPath::AbsoluteRootPath()) return;
    if (below) {
        std::vector<SdfPath> paths;
        delegate_->Traverse(path, [&](const SdfPath& one) { paths.push_back(one); });
        for (const auto& one : paths)
            if (one != path && !containsTarget(one)) refresh(one, false);
    }
    const Holders all = holdersOf(path);
    if (all.empty()) {
        // The spec mirrors nothing any more, unless a variant's content is below it.
        if (path.IsPropertyPath() || !delegate_->GetPrimAtPath(path) ||
            delegate_->GetPrimAtPath(path)->GetNameChildren().empty())
            removeSpec(delegate_, path);
        return;
    }
    for (const TfToken& field : delegate_->ListFields(path))
        if (!usd::isStructural(field)) refreshField(path, field, all);
}

void Distribution::refreshField(const SdfPath& path, const TfToken& field, const Holders& holders) {
    if (containsTarget(path) || !delegate_->HasField(path, field)) return;
    if (delegate_->GetField(path, field).IsHolding<pxr::VtDictionary>())
        return refreshKeys(path, field, holders);
    const Target* winner = nullptr;
    for (const Target* target : holders)
        if (!winner && hasOpinion(target->layer, path, field)) winner = target;
    const bool required =
        field == names().specifier || (path.IsPropertyPath() && isRequiredOfProperties(field));
    if (!winner || !winner->layer->HasField(path, field)) {
        if (field == names().specifier)
            delegate_->SetField(path, field, pxr::SdfSpecifierOver);
        else if (!required)
            delegate_->EraseField(path, field);
        return;
    }
    const bool tooMuch = field == names().samples &&
                         winner->layer->GetNumTimeSamplesForPath(path) > kMaxMirroredSamples;
    if (tooMuch || (field == names().value && hidesDefault(winner->layer, path)))
        return delegate_->EraseField(path, field);
    const VtValue value = mapped(winner->layer->GetField(path, field), winner->toDelegate);
    if (belongsToItsLayer(field, value))
        delegate_->EraseField(path, field);
    else if (isListOp(value))
        setListOp(delegate_, path, field, value);
    else
        delegate_->SetField(path, field, value);
}

void Distribution::refreshKeys(const SdfPath& path, const TfToken& field, const Holders& holders) {
    std::vector<TfToken> keys;
    collectKeys(delegate_->GetField(path, field).Get<pxr::VtDictionary>(), "", keys);
    for (const TfToken& key : keys) {
        VtValue value;
        for (const Target* target : holders) {
            if (!target->layer->HasFieldDictKey(path, field, key)) continue;
            value =
                mapped(target->layer->GetFieldDictValueByKey(path, field, key), target->toDelegate);
            if (belongsToItsLayer(field, value)) value = VtValue();
            break;
        }
        delegate_->SetFieldDictValueByKey(path, field, key, value);
    }
}

// ------------------------------------------------------------------ opinions to erase

Distribution::Lent Distribution::lend(const SdfPath& path, std::optional<double> time,
                                      const DelegateWrites& writes) {
    Lent lent{path, {}, {}, {}, {}};
    const auto places = placesOf(path);
    if (places.empty() || path == SdfPath::AbsoluteRootPath()) return lent;
    for (const SdfPath& prefix : path.GetPrefixes())
        if (lent.created.IsEmpty() && !delegate_->HasSpec(prefix)) lent.created = prefix;
    if (!lent.created.IsEmpty() &&
        !makeSpecLike(delegate_, path, places.front().target->layer, places.front().path))
        return lent;
    for (const Place& place : places)
        for (const TfToken& field : place.target->layer->ListFields(place.path)) {
            if (!time) {
                lendField(lent, place, field, writes);
            } else if (field == names().samples && !lent.sample &&
                       !delegate_->QueryTimeSample(path, *time)) {
                delegate_->SetTimeSample(path, *time, VtValue(pxr::SdfValueBlock()));
                lent.sample = time;
            }
        }
    return lent;
}

// A block stands for values, which may be large.
void Distribution::lendField(Lent& lent, const Place& place, const TfToken& field,
                             const DelegateWrites& writes) {
    const SdfPath& path = lent.path;
    if (usd::isStructural(field) || field == names().specifier ||
        (path.IsPropertyPath() && isRequiredOfProperties(field)))
        return;
    const bool isTyped = field != names().value && field != names().samples;
    const VtValue value = isTyped ? place.target->layer->GetField(place.path, field) : VtValue();
    if (value.IsHolding<pxr::VtDictionary>())
        return lendKeys(lent, field, value.UncheckedGet<pxr::VtDictionary>());
    if (delegate_->HasField(path, field)) return;
    if (field == names().value)
        delegate_->SetField(path, field, pxr::SdfValueBlock());
    else if (field == names().samples)
        delegate_->SetTimeSample(path, 0.0, VtValue(pxr::SdfValueBlock()));
    else if (isListOp(value))
        setListOp(delegate_, path, field, value);
    else
        delegate_->SetField(path, field, value);
    lent.fields.push_back({field, delegate_->GetField(path, field), writes.has(path, field)});
}

void Distribution::lendKeys(Lent& lent, const TfToken& field, const pxr::VtDictionary& dictionary) {
    const auto mine = delegate_->GetField(lent.path, field).GetWithDefault<pxr::VtDictionary>();
    const auto both = pxr::VtDictionaryOverRecursive(mine, dictionary);
    std::vector<TfToken> keys;
    collectKeys(both, "", keys);
    for (const TfToken& key : keys)
        if (!mine.GetValueAtPath(key.GetString())) lent.keys.emplace_back(field, key);
    delegate_->SetField(lent.path, field, both);
}

void Distribution::takeBack(const Lent& lent, const DelegateWrites& writes) {
    if (lent.sample) delegate_->EraseTimeSample(lent.path, *lent.sample);
    for (const auto& [field, value, written] : lent.fields) {
        const VtValue now = delegate_->GetField(lent.path, field);
        if (written ? now != value : writes.has(lent.path, field)) continue;
        if (isListOp(now)) setListOp(delegate_, lent.path, field, {});
        delegate_->EraseField(lent.path, field);
    }
    for (const auto& [field, key] : lent.keys)
        delegate_->EraseFieldDictValueByKey(lent.path, field, key);
    if (lent.created.IsEmpty()) return;
    bool isWritten = false;
    delegate_->Traverse(lent.created,
                        [&](const SdfPath& path) { isWritten = isWritten || writes.has(path); });
    if (isWritten) return;
    if (lent.created.ContainsPrimVariantSelection()) return dropVariants(lent.created);
    removeSpec(delegate_, lent.created);
}

// ------------------------------------------------------------------ refused edits

void Distribution::refuse(const SdfPath& path, const std::string& field, const std::string& layer,
                          const LayerError& why) {
    refused_.push_back({path, field, layer, why.type, why.text});
}

void Distribution::refuse(const Spec& spec, const Field& field, const Target& target) {
    refuse(spec.path, field.name.GetString(), target.layer->GetIdentifier(), *target.closed);
    takeBack(spec, field);
}

void Distribution::refuseLocked(const Spec& spec, const LayerError& why) {
    const Holders all = holdersOf(spec.path);
    refuse(spec.path, "", all.empty() ? "" : all.front()->layer->GetIdentifier(), why);
    for (const auto& field : spec.fields) takeBack(spec, field);
    maybeEmpty_.push_back(spec.path);
}

void Distribution::takeBack(const Spec& spec, const Field& field) {
    const Holders all = holdersOf(spec.path);
    const bool required = field.name == names().specifier ||
                          (spec.path.IsPropertyPath() && isRequiredOfProperties(field.name));
    if (field.existed || required)
        refreshField(spec.path, field.name, all);
    else
        delegate_->EraseField(spec.path, field.name);
    if (spec.created) maybeEmpty_.push_back(spec.path);
}

// Removes what was written in the context of a variant. A mirror of it would stay when the variant
// or its set is removed from the layers.
void Distribution::dropVariants(const SdfPath& path) {
    SdfPath outermost;
    for (SdfPath at = path; at.ContainsPrimVariantSelection(); at = at.GetParentPath())
        if (at.IsPrimVariantSelectionPath()) outermost = at;
    if (outermost.IsEmpty()) return;
    const SdfPath prim = outermost.GetParentPath();
    const auto set = prim.AppendVariantSelection(outermost.GetVariantSelection().first, "");
    if (!delegate_->HasSpec(set)) return;
    removeSpec(delegate_, set);
    // A layer that received a new set has got its name, too.
    refreshField(prim, pxr::SdfFieldKeys->VariantSetNames, holdersOf(prim));
    maybeEmpty_.push_back(prim);
}

void Distribution::dropEmpty() {
    for (const auto& path : std::exchange(maybeEmpty_, {}) | std::views::reverse) dropEmpty(path);
}

void Distribution::dropEmpty(const SdfPath& path) {
    if (!delegate_->HasSpec(path)) return;
    bool content = false;
    delegate_->Traverse(path, [&](const SdfPath& below) { content = content || below != path; });
    for (const TfToken& field : delegate_->ListFields(path))
        content = content || (!usd::isStructural(field) && field != names().specifier &&
                              !(path.IsPropertyPath() && isRequiredOfProperties(field)) &&
                              !(field == names().typeName && holdersOf(path).empty()));
    if (content) return;
    removeSpec(delegate_, path);
    // Ancestors may have been created for the spec only.
    const SdfPath parent = path.GetParentPath();
    if (isBareOver(parent) && holdersOf(parent).empty()) dropEmpty(parent);
}

}  // namespace usdlive::layers
