// Resolves attribute values in the order of UsdStage: nodes of the prim index from strong to weak;
// in each node the layers from strong to weak; in each layer time samples, then a spline, then a
// default, then the value clips that the layer names.
#include "usdlive/client/usd/stage/AttributeQuery.h"

#include <pxr/base/gf/math.h>
#include <pxr/base/ts/spline.h>
#include <pxr/base/vt/valueComposeOver.h>
#include <pxr/usd/pcp/layerStack.h>
#include <pxr/usd/sdf/composeTimeSampleSeries.h>
#include <pxr/usd/sdf/schema.h>
#include <pxr/usd/sdf/types.h>

#include <algorithm>
#include <typeinfo>
#include <utility>

#include "usd/content/MappedValue.h"
#include "usd/stage/Clips.h"
#include "usd/stage/Interpolate.h"

namespace usdlive::stage {

using pxr::SdfFieldKeys;
using pxr::SdfTimeSampleMap;
using pxr::VtValue;

namespace {

struct Bracket {
    double lower = 0, upper = 0;
};

Bracket bracketOf(const SdfTimeSampleMap& samples, double time) {
    const auto after = samples.lower_bound(time);
    if (after == samples.end()) return {samples.rbegin()->first, samples.rbegin()->first};
    if (after == samples.begin() || after->first == time) return {after->first, after->first};
    return {std::prev(after)->first, after->first};
}

bool canCompose(const VtValue& value) {
    return !value.IsEmpty() && pxr::VtValueCanComposeOver(value);
}

// Among samples that are whole arrays there may be array edits, so all samples are checked.
bool showsWeaker(const VtValue& value, const VtValue& samples) {
    if (!samples.IsHolding<SdfTimeSampleMap>()) return canCompose(value);
    for (const auto& [time, sample] : samples.UncheckedGet<SdfTimeSampleMap>()) {
        if (canCompose(sample)) return true;
        if (!isBlock(sample) && !sample.IsArrayValued()) return false;
    }
    return false;
}

// Returns true if weaker opinions show through samples that stay on disk. Only the types are read:
// arrays may be edits, and every path expression may refer to a weaker one.
bool samplesCompose(const pxr::SdfLayer& layer, const pxr::SdfPath& path) {
    const auto type = layer.GetFieldAs<pxr::TfToken>(path, SdfFieldKeys->TypeName);
    if (!type.GetString().ends_with("[]") &&
        type != pxr::SdfValueTypeNames->PathExpression.GetAsToken())
        return false;
    const std::type_info* last = nullptr;
    for (const double time : layer.ListTimeSamplesForPath(path)) {
        const std::type_info& held = layer.QueryTimeSampleTypeid(path, time);
        if (last && held == *last) continue;
        if (pxr::VtValueTypeCanComposeOver(held)) return true;
        last = &held;
    }
    return false;
}

// Composes a value over the next weaker one. A block below ends the composition: the stronger value
// is then composed over the background.
VtValue over(const VtValue& stronger, const VtValue& weaker) {
    if (!canCompose(stronger)) return stronger;
    return pxr::VtValueComposeOver(stronger, isBlock(weaker) ? VtValue(pxr::VtBackground) : weaker);
}

// Opinions of one attribute that are composed over each other, from strong to weak. The result is a
// constant or samples.
class Layered {
public:
    Layered(VtValue value, SdfTimeSampleMap samples)
        : value_(std::move(value)), samples_(std::move(samples)) {}

    [[nodiscard]] const VtValue& value() const { return value_; }
    [[nodiscard]] const SdfTimeSampleMap& samples() const { return samples_; }

    /// Returns true if weaker opinions can still change the result.
    [[nodiscard]] bool isOpen() const {
        if (samples_.empty()) return canCompose(value_);
        return std::ranges::any_of(samples_,
                                   [](const auto& sample) { return canCompose(sample.second); });
    }

    void layOver(const VtValue& weaker) {
        value_ = over(value_, weaker);
        for (auto& [time, value] : samples_) value = over(value, weaker);
    }

    void layOver(SdfTimeSampleMap weaker) {
        if (samples_.empty()) {
            for (auto& [time, value] : weaker) value = over(value_, value);
            samples_ = std::move(weaker);
            return;
        }
        SdfTimeSampleMap result;
        pxr::SdfComposeTimeSampleSeries(
            samples_.begin(), samples_.end(), weaker.begin(), weaker.end(),
            [](const auto& sample) { return sample->first; },
            [](const auto& sample) { return sample->second; },
            [](const VtValue& one, const VtValue& other) -> std::optional<VtValue> {
                if (!canCompose(one)) return std::nullopt;
                return over(one, other);
            },
            [&](const VtValue& value, double time) { result[time] = value; });
        samples_ = std::move(result);
    }

    void close() { layOver(VtValue(pxr::VtBackground)); }

private:
    VtValue value_;
    SdfTimeSampleMap samples_;
};

VtValue evaluated(const pxr::TsSpline& spline, double time) {
    VtValue value;
    return spline.Eval(time, &value) ? value : VtValue();
}

}  // namespace

AttributeQuery::AttributeQuery(const pxr::PcpPrimIndex& prim, const pxr::TfToken& attribute,
                               const schema::PropertyDefinition* definition,
                               Interpolation interpolation, AssetPaths assetPaths,
                               std::shared_ptr<const ClipSets> clips)
    : prim_(&prim),
      attribute_(attribute),
      definition_(definition),
      interpolation_(interpolation),
      assetPaths_(assetPaths),
      clips_(std::move(clips)) {}

AttributeQuery::Cursor AttributeQuery::begin() const {
    return {prim_->GetNodeRange().first, 0, false, false};
}

AttributeQuery::Source AttributeQuery::fallback(bool blocked) const {
    Source found;
    found.blocked = blocked;
    if (!definition_ || definition_->fallback.IsEmpty()) return found;
    found.source = ValueSource::Fallback;
    found.value = definition_->fallback;
    return found;
}

bool AttributeQuery::hasClips(const pxr::PcpNodeRef& node) const {
    return clips_ &&
           std::ranges::any_of(*clips_, [&](const auto& set) { return set->appliesTo(node); });
}

// Returns the strongest source at or after the cursor, and moves the cursor behind it. Clips may
// have values in a node without specs.
AttributeQuery::Source AttributeQuery::next(Cursor& cursor, bool withTimes) const {
    const auto end = prim_->GetNodeRange().second;
    for (; cursor.node != end; ++cursor.node, cursor.layerIndex = 0) {
        const pxr::PcpNodeRef node = *cursor.node;
        if (node.IsInert()) continue;
        const bool withClips = withTimes && !cursor.animationBlocked && hasClips(node);
        if (!node.HasSpecs() && !withClips) continue;
        const std::size_t layers = node.GetLayerStack()->GetLayers().size();
        Source found;
        if (cursor.layerIndex < layers || cursor.clipsAreNext)
            found.site = {node, 0, node.GetPath().AppendProperty(attribute_)};
        while (cursor.layerIndex < layers || cursor.clipsAreNext) {
            if (!cursor.clipsAreNext) {
                found.site.layerIndex = cursor.layerIndex++;
                cursor.clipsAreNext = withClips;
                if (node.HasSpecs() && findInLayer(cursor, withTimes, found)) return found;
            }
            if (std::exchange(cursor.clipsAreNext, false) && findInClips(cursor, found))
                return found;
        }
    }
    return fallback(false);
}

bool AttributeQuery::findInClips(const Cursor& cursor, Source& found) const {
    if (cursor.animationBlocked) return false;
    found.site.layerIndex = cursor.layerIndex - 1;
    for (const auto& set : *clips_) {
        if (!set->appliesTo(found.site.node) ||
            get_pointer(set->definition().layer) != get_pointer(found.site.layer()) ||
            !set->hasValuesOf(found.site.path))
            continue;
        found.source = ValueSource::ValueClips;
        found.clips = set;
        return true;
    }
    return false;
}

bool AttributeQuery::findInLayer(Cursor& cursor, bool withTimes, Source& found) const {
    const auto& layer = found.site.layer();
    const auto& path = found.site.path;
    if (withTimes && !cursor.animationBlocked) {
        if (!layer->HasSpec(path)) return false;
        if (layer->GetNumTimeSamplesForPath(path) > 0) {
            found.source = ValueSource::TimeSamples;
            found.toStage = found.site.layerToStage();
            if (!layer->StreamsData() || samplesCompose(*layer, path))
                (void)layer->HasField(path, SdfFieldKeys->TimeSamples, &found.samples);
            return true;
        }
        if (layer->HasField(path, SdfFieldKeys->Spline, &found.value)) {
            found.source = ValueSource::Spline;
            found.toStage = found.site.layerToStage();
            return true;
        }
    }
    if (!layer->HasField(path, SdfFieldKeys->Default, &found.value)) return false;
    if (found.value.IsHolding<pxr::SdfValueBlock>()) {
        found = fallback(true);
        return true;
    }
    if (found.value.IsHolding<pxr::SdfAnimationBlock>()) {
        cursor.animationBlocked = true;
        return false;
    }
    found.source = ValueSource::Default;
    found.value = toStage(found.value, found.site, assetPaths_);
    return true;
}

const AttributeQuery::Source& AttributeQuery::timed() const {
    if (!timed_) {
        Cursor cursor = begin();
        timed_ = next(cursor, true);
        (void)composeWeaker(*timed_, cursor, true);
    }
    return *timed_;
}

// A block means that there is no value, not even the fallback. An exception is a block below a
// stronger animation block: UsdStage then returns the fallback.
VtValue AttributeQuery::getDefault() const {
    Cursor cursor = begin();
    Source found = next(cursor, false);
    if (found.blocked) return cursor.animationBlocked ? found.value : VtValue();
    return composeWeaker(found, cursor, false) ? found.value : VtValue();
}

// Composes array edits and path expressions over the weaker opinions, sample by sample. Returns
// false if a block hides the value.
bool AttributeQuery::composeWeaker(Source& strongest, Cursor& cursor, bool withTimes) const {
    if (!showsWeaker(strongest.value, strongest.samples)) return true;
    bool blocked = false;
    const bool sampled = strongest.source == ValueSource::TimeSamples;
    Layered layered(strongest.value, sampled ? samplesOnStage(strongest) : SdfTimeSampleMap());
    for (Source weaker = strongest; weaker.source > ValueSource::Fallback && layered.isOpen();) {
        weaker = next(cursor, withTimes);
        blocked = weaker.blocked && !cursor.animationBlocked;
        if (weaker.blocked) break;
        if (weaker.source == ValueSource::TimeSamples)
            layered.layOver(samplesOnStage(weaker));
        else if (weaker.source != ValueSource::Spline && !weaker.value.IsEmpty())
            layered.layOver(weaker.value);
    }
    layered.close();
    strongest.value = layered.value();
    strongest.samples = layered.samples().empty() ? VtValue() : VtValue(layered.samples());
    strongest.onStage = true;
    return !blocked;
}

SdfTimeSampleMap AttributeQuery::samplesOnStage(const Source& source) const {
    SdfTimeSampleMap samples;
    const auto& layer = source.site.layer();
    for (const double time : layer->ListTimeSamplesForPath(source.site.path)) {
        VtValue value;
        (void)layer->QueryTimeSample(source.site.path, time, &value);
        samples[source.toStage * time] = toStage(value, source.site, assetPaths_);
    }
    return samples;
}

VtValue AttributeQuery::get(double time) const {
    const Source& source = timed();
    if (source.onStage) return source.samples.IsEmpty() ? source.value : sampleAt(source, time);
    if (source.source == ValueSource::TimeSamples) return sampleAt(source, time);
    if (source.source == ValueSource::ValueClips) return clipAt(source, time);
    if (source.source != ValueSource::Spline) return source.value;
    const auto& spline = source.value.UncheckedGet<pxr::TsSpline>();
    return toStage(evaluated(spline, source.toStage.GetInverse() * time), source.site);
}

VtValue AttributeQuery::clipAt(const Source& source, double time) const {
    ValueSite site = source.site;
    const auto value = source.clips->value(site.path, time, interpolation_, site.clip);
    return site.clip ? toStage(value, site, assetPaths_) : value;
}

VtValue AttributeQuery::sampleAt(const Source& source, double time) const {
    const auto& layer = source.site.layer();
    const auto& path = source.site.path;
    const bool inMemory = source.samples.IsHolding<SdfTimeSampleMap>();
    const auto read = [&](double at) {
        VtValue value;
        if (inMemory)
            value = source.samples.UncheckedGet<SdfTimeSampleMap>().at(at);
        else
            (void)layer->QueryTimeSample(path, at, &value);
        if (isBlock(value)) return VtValue();
        return source.onStage ? value : toStage(value, source.site, assetPaths_);
    };
    const bool sameTimes = source.onStage || source.toStage.IsIdentity();
    const double inLayer = sameTimes ? time : source.toStage.GetInverse() * time;
    Bracket bracket;
    if (inMemory)
        bracket = bracketOf(source.samples.UncheckedGet<SdfTimeSampleMap>(), inLayer);
    else if (!layer->GetBracketingTimeSamplesForPath(path, inLayer, &bracket.lower, &bracket.upper))
        return {};

    const VtValue lower = read(bracket.lower);
    const bool isOne = pxr::GfIsClose(bracket.lower, bracket.upper, kSameTime);
    if (isOne || lower.IsEmpty() || interpolation_ == Interpolation::Held || !canInterpolate(lower))
        return lower;
    const VtValue upper = read(bracket.upper);
    if (upper.IsEmpty()) return lower;
    if (!sameTimes) bracket = {source.toStage * bracket.lower, source.toStage * bracket.upper};
    const double fraction = (time - bracket.lower) / (bracket.upper - bracket.lower);
    return interpolate(lower, upper, fraction);
}

pxr::TsSpline AttributeQuery::spline() const {
    const Source& found = timed();
    if (found.source != ValueSource::Spline) return {};
    return content::mapped(found.value, found.toStage).UncheckedGet<pxr::TsSpline>();
}

bool AttributeQuery::hasAuthoredDefault() const {
    Cursor cursor = begin();
    const Source found = next(cursor, false);
    return found.blocked || cursor.animationBlocked || found.source == ValueSource::Default;
}

bool AttributeQuery::mightBeTimeVarying() const {
    if (const auto& clips = timed().clips) return clips->mightVary(timed().site.path);
    return hasSpline() || numTimeSamples() > 1 || (timed().onStage && numTimeSamples() > 0);
}

std::vector<double> AttributeQuery::timeSamples() const {
    const Source& found = timed();
    if (found.clips) return found.clips->timesOf(found.site.path);
    std::vector<double> times;
    if (found.samples.IsHolding<SdfTimeSampleMap>()) {
        for (const auto& [time, value] : found.samples.UncheckedGet<SdfTimeSampleMap>())
            times.push_back(time);
    } else if (found.source == ValueSource::TimeSamples) {
        const auto all = found.site.layer()->ListTimeSamplesForPath(found.site.path);
        times.assign(all.begin(), all.end());
    }
    if (!found.onStage && !found.toStage.IsIdentity())
        for (double& time : times) time = found.toStage * time;
    return times;
}

std::size_t AttributeQuery::numTimeSamples() const {
    const Source& found = timed();
    if (found.clips) return found.clips->timesOf(found.site.path).size();
    if (found.samples.IsHolding<SdfTimeSampleMap>())
        return found.samples.UncheckedGet<SdfTimeSampleMap>().size();
    if (found.source != ValueSource::TimeSamples) return 0;
    return found.site.layer()->GetNumTimeSamplesForPath(found.site.path);
}

const ValueSite* AttributeQuery::site() const {
    const Source& found = timed();
    return found.source > ValueSource::Fallback ? &found.site : nullptr;
}

}  // namespace usdlive::stage
