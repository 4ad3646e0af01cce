// Composes clip sets and reads their values.
#include "usd/stage/Clips.h"

#include <pxr/base/gf/math.h>
#include <pxr/base/tf/diagnostic.h>
#include <pxr/base/tf/stringUtils.h>
#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/ar/resolver.h>
#include <pxr/usd/ar/resolverContextBinder.h>
#include <pxr/usd/sdf/layerUtils.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/schema.h>
#include <pxr/usd/sdf/timeCode.h>
#include <pxr/usd/sdf/types.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <tuple>
#include <utility>

#include "usd/stage/DepthGuard.h"
#include "usd/stage/Interpolate.h"
#include "usd/stage/Opinions.h"
#include "usdlive/client/usd/stage/ValueSite.h"

namespace usdlive::stage {

using pxr::SdfFieldKeys;
using pxr::SdfPath;
using pxr::VtDictionary;
using pxr::VtValue;

namespace {

constexpr double kEver = std::numeric_limits<double>::max();
// A jump ends this long before the time at which the mapping continues (UsdTimeCode::SafeStep()).
constexpr double kJump = std::numeric_limits<double>::epsilon() * 1e6 * 10 * 2;
// A template is left out if it asks for more files, or for files of later times.
constexpr double kLastFrame = 1e9;
constexpr std::size_t kMostFiles = 100'000;

template <class T>
const T* entry(const VtDictionary& dictionary, const std::string& key) {
    const auto found = dictionary.find(key);
    if (found == dictionary.end() || !found->second.IsHolding<T>()) return nullptr;
    return &found->second.UncheckedGet<T>();
}

void shift(VtDictionary& info, const std::string& key, const pxr::SdfLayerOffset& offset) {
    const auto* times = entry<pxr::VtVec2dArray>(info, key);
    if (!times || offset.IsIdentity()) return;
    pxr::VtVec2dArray shifted = *times;
    for (auto& time : shifted) time[0] = offset * time[0];
    info[key] = VtValue::Take(shifted);
}

// The opinions about one clip set.
struct Composed {
    ClipDefinition anchor;  // only its place is set
    pxr::SdfLayerOffset offset;
    VtDictionary info;
};
using ComposedSets = std::map<std::string, Composed>;

// Adds the opinions of a stronger layer.
void addStronger(const pxr::PcpNodeRef& node, std::size_t layerIndex, VtDictionary info,
                 Composed& set) {
    const ValueSite site{node, layerIndex, node.GetPath()};
    const auto offset = site.layerToStage();
    if (entry<pxr::VtArray<pxr::SdfAssetPath>>(info, "assetPaths") ||
        entry<std::string>(info, "templateAssetPath")) {
        set.anchor.stack = node.GetLayerStack();
        set.anchor.layer = site.layer();
        set.anchor.prim = node.GetPath();
        set.offset = offset;
    }
    shift(info, "active", offset);
    shift(info, "times", offset);
    pxr::VtDictionaryOverRecursive(&info, set.info);
    set.info.swap(info);
}

ComposedSets composeNode(const pxr::PcpNodeRef& node) {
    ComposedSets sets;
    std::vector<std::string> added;
    const auto& layers = node.GetLayerStack()->GetLayers();
    for (std::size_t i = layers.size(); i-- != 0;) {
        VtDictionary clips;
        std::vector<std::string> names;
        if (layers[i]->HasField(node.GetPath(), SdfFieldKeys->Clips, &clips))
            for (auto& [name, info] : clips) {
                if (name.empty() || !info.IsHolding<VtDictionary>()) {
                    TF_WARN("the clip set '%s' of <%s> in @%s@ is not a dictionary with a name",
                            name.c_str(), node.GetPath().GetText(),
                            layers[i]->GetIdentifier().c_str());
                    continue;
                }
                addStronger(node, i, info.UncheckedGet<VtDictionary>(), sets[name]);
                names.push_back(name);
            }
        // A set that a layer describes is added to the list.
        pxr::SdfStringListOp list;
        list.SetAddedItems(names);
        list.ApplyOperations(&added);
        if (!sets.empty() && layers[i]->HasField(node.GetPath(), SdfFieldKeys->ClipSets, &list))
            list.ApplyOperations(&added);
    }
    std::erase_if(
        sets, [&](const auto& set) { return std::ranges::find(added, set.first) == added.end(); });
    for (std::size_t i = 0; i < added.size(); ++i)
        if (const auto set = sets.find(added[i]); set != sets.end()) set->second.anchor.order = i;
    return sets;
}

// A file name with groups of "#" for the whole and the decimal digits of the time.
struct Template {
    std::string folder, arguments;
    std::vector<std::string> parts;
    std::size_t whole = 0, wholeDigits = 0, decimalDigits = 0;

    static std::optional<Template> parse(const std::string& text) {
        Template result;
        pxr::SdfLayer::FileFormatArguments arguments;
        std::string path;
        pxr::SdfLayer::SplitIdentifier(text, &path, &arguments);
        result.arguments = text.substr(path.size());
        result.folder = pxr::TfGetPathName(path);
        result.parts = pxr::TfStringTokenize(pxr::TfGetBaseName(path), ".");
        std::vector<std::size_t> groups;
        for (std::size_t i = 0; i < result.parts.size(); ++i)
            if (result.parts[i].find_first_not_of('#') == std::string::npos) groups.push_back(i);
        if (groups.empty() || groups.size() > 2) return std::nullopt;
        if (groups.size() == 2 && groups[1] != groups[0] + 1) return std::nullopt;
        result.whole = groups[0];
        result.wholeDigits = result.parts[groups[0]].size();
        if (groups.size() == 2) result.decimalDigits = result.parts[groups[1]].size();
        return result;
    }

    [[nodiscard]] std::string at(double time) const {
        auto names = parts;
        names[whole] = pxr::TfStringPrintf("%0*d", int(wholeDigits), int(time));
        if (decimalDigits) {
            const auto text = pxr::TfStringPrintf("%.*f", int(decimalDigits), time);
            names[whole + 1] = text.substr(text.find('.') + 1);
        }
        return folder + pxr::TfStringJoin(names, ".");
    }
};

// Finds the files of a template.
void deriveClips(const VtDictionary& info, const pxr::SdfLayerOffset& offset, ClipDefinition& set) {
    const auto* text = entry<std::string>(info, "templateAssetPath");
    const auto* stride = entry<double>(info, "templateStride");
    const auto* first = entry<double>(info, "templateStartTime");
    const auto* last = entry<double>(info, "templateEndTime");
    if (!text || !stride || !first || !last) return;
    const auto* activeOffset = entry<double>(info, "templateActiveOffset");
    const auto name = Template::parse(*text);
    const bool valid = name && *stride > 0 && *first <= *last &&
                       (!activeOffset || std::abs(*activeOffset) <= *stride) &&
                       (*last - *first) / *stride < double(kMostFiles) &&
                       std::max(std::abs(*first), std::abs(*last)) < kLastFrame;
    if (!valid) {
        TF_WARN("the template of the clip set '%s' of <%s> cannot be used: '%s'", set.name.c_str(),
                set.prim.GetText(), text->c_str());
        return;
    }
    const pxr::ArResolverContextBinder binder(set.stack->GetIdentifier().pathResolverContext);
    // Times are counted in whole steps of this, so that a stride with a fraction adds up.
    constexpr double kSteps = 10'000;
    const auto add = [&](double time) { set.times.push_back({time, time}); };
    if (activeOffset) add((*first * kSteps - std::abs(*activeOffset) * kSteps) / kSteps);
    double step = *first * kSteps;
    for (std::size_t i = 0; i < kMostFiles && step <= *last * kSteps;
         ++i, step += *stride * kSteps) {
        const double time = step / kSteps;
        const std::string path = pxr::SdfComputeAssetPathRelativeToLayer(set.layer, name->at(time));
        if (pxr::ArGetResolver().Resolve(path).empty()) continue;
        const double from = activeOffset ? (step + *activeOffset * kSteps) / kSteps : time;
        set.active.push_back({from, double(set.assets.size())});
        set.assets.push_back(pxr::SdfAssetPath(path + name->arguments));
        add(time);
    }
    if (activeOffset) add((*last * kSteps + std::abs(*activeOffset) * kSteps) / kSteps);
    for (auto* times : {&set.times, &set.active})
        for (auto& time : *times) time[0] = offset * time[0];
}

// Returns what is wrong with a set, or an empty text.
std::string problemOf(const ClipDefinition& set) {
    if (set.clipPrim.empty()) return "'primPath' is missing";
    if (std::size_t(std::ranges::count(set.clipPrim, '/')) > kDeepestPath)
        return "'primPath' has too many elements";
    std::string problem;
    if (!SdfPath::IsValidPathString(set.clipPrim, &problem)) return problem;
    const SdfPath prim(set.clipPrim);
    if (!prim.IsAbsolutePath() || !prim.IsPrimPath())
        return "'primPath' is not an absolute path of a prim: " + set.clipPrim;
    for (const auto& asset : set.assets)
        if (asset.GetAssetPath().empty()) return "'assetPaths' has an empty path";
    const auto isFinite = [](const pxr::GfVec2d& one) {
        return std::isfinite(one[0]) && std::isfinite(one[1]);
    };
    if (!std::ranges::all_of(set.active, isFinite) || !std::ranges::all_of(set.times, isFinite))
        return "'active' or 'times' has a time that is not finite";
    std::set<double> starts;
    for (const auto& one : set.active) {
        if (!(one[1] >= 0 && one[1] < double(set.assets.size())))
            return "'active' has an index that is not in 'assetPaths'";
        if (!starts.insert(one[0]).second) return "'active' has a time twice";
    }
    std::map<double, int> seen;
    for (const auto& one : set.times)
        if (++seen[one[0]] > 2) return "'times' has a time of the stage more than twice";
    return {};
}

std::optional<ClipDefinition> defined(const std::string& name, const Composed& composed) {
    ClipDefinition set = composed.anchor;
    const auto& info = composed.info;
    set.name = name;
    if (const auto* manifest = entry<pxr::SdfAssetPath>(info, "manifestAssetPath"))
        set.manifest = *manifest;
    if (const auto* missing = entry<bool>(info, "interpolateMissingClipValues"))
        set.interpolatesMissing = *missing;
    const auto* prim = entry<std::string>(info, "primPath");
    if (!prim) return std::nullopt;
    set.clipPrim = *prim;
    if (const auto* assets = entry<pxr::VtArray<pxr::SdfAssetPath>>(info, "assetPaths")) {
        set.assets = *assets;
        const auto* active = entry<pxr::VtVec2dArray>(info, "active");
        if (!active) return std::nullopt;
        set.active = *active;
        if (const auto* times = entry<pxr::VtVec2dArray>(info, "times")) set.times = *times;
    } else {
        deriveClips(info, composed.offset, set);
    }
    if (const auto problem = problemOf(set); !problem.empty()) {
        TF_WARN("the clip set '%s' of <%s> cannot be used: %s", name.c_str(), set.prim.GetText(),
                problem.c_str());
        return std::nullopt;
    }
    if (set.active.empty()) return std::nullopt;
    return set;
}

std::pair<double, double> around(const std::vector<double>& times, double time) {
    const auto after = std::ranges::lower_bound(times, time);
    if (after == times.end()) return {times.back(), times.back()};
    if (after == times.begin() || *after == time) return {*after, *after};
    return {*std::prev(after), *after};
}

// Time codes in a clip are relative to the time of their sample.
void shiftTimeCodes(VtValue& value, double by) {
    if (value.IsHolding<pxr::SdfTimeCode>()) {
        value = value.UncheckedGet<pxr::SdfTimeCode>() + pxr::SdfTimeCode(by);
    } else if (value.IsHolding<pxr::VtArray<pxr::SdfTimeCode>>()) {
        auto codes = value.UncheckedGet<pxr::VtArray<pxr::SdfTimeCode>>();
        for (auto& code : codes) code = code + pxr::SdfTimeCode(by);
        value = VtValue::Take(codes);
    }
}

}  // namespace

bool operator==(const ClipDefinition& one, const ClipDefinition& other) {
    const auto place = [](const ClipDefinition& set) {
        return std::tuple(get_pointer(set.stack), get_pointer(set.layer), set.prim, set.order);
    };
    const auto facts = [](const ClipDefinition& set) {
        return std::tie(set.name, set.manifest, set.assets, set.clipPrim, set.active, set.times,
                        set.interpolatesMissing);
    };
    return place(one) == place(other) && facts(one) == facts(other);
}

std::vector<ClipDefinition> composeClips(const pxr::PcpPrimIndex& index) {
    const bool none = forEachSite(index, pxr::TfToken(), [](const Site& site) {
        return !site.layer->HasField(site.path, SdfFieldKeys->Clips);
    });
    if (none) return {};
    ComposedSets sets;
    std::map<const pxr::PcpLayerStack*, std::size_t> stacks;  // in the order of strength
    for (const pxr::PcpNodeRef& node : index.GetNodeRange()) {
        if (node.IsInert() || !node.HasSpecs()) continue;
        stacks.try_emplace(get_pointer(node.GetLayerStack()), stacks.size());
        for (auto& [name, stronger] : composeNode(node)) {
            auto& set = sets[name];
            if (!set.anchor.layer) {
                set.anchor = stronger.anchor;
                set.offset = stronger.offset;
            }
            pxr::VtDictionaryOverRecursive(&set.info, stronger.info);
        }
    }
    std::vector<ClipDefinition> definitions;
    for (const auto& [name, set] : sets)
        if (set.anchor.layer)
            if (auto one = defined(name, set)) definitions.push_back(std::move(*one));
    // Sets of different places do not compete; those of one place have the order of its list.
    std::ranges::sort(definitions, {}, [&](const ClipDefinition& set) {
        return std::tuple(stacks.at(get_pointer(set.stack)), set.prim, set.order);
    });
    return definitions;
}

pxr::SdfLayerRefPtr ClipLayers::open(const ClipDefinition& definition,
                                     const std::string& assetPath) {
    const pxr::ArResolverContextBinder binder(
        definition.stack->GetIdentifier().pathResolverContext);
    const auto identifier = pxr::SdfComputeAssetPathRelativeToLayer(definition.layer, assetPath);
    {
        const std::scoped_lock lock(mutex_);
        if (const auto known = layers_.find(identifier); known != layers_.end())
            return known->second;
    }
    const auto opened = openLayer(identifier);
    if (!opened)
        TF_WARN("a clip of <%s> is left out: %s", definition.prim.GetText(),
                opened.error().message.c_str());
    // A set that is composed later tries again.
    if (!opened) return {};
    const std::scoped_lock lock(mutex_);
    known_.insert(get_pointer(*opened));
    return layers_.try_emplace(identifier, *opened).first->second;
}

pxr::SdfLayerHandleSet ClipLayers::open() {
    const std::scoped_lock lock(mutex_);
    pxr::SdfLayerHandleSet all;
    for (const auto& [identifier, layer] : layers_) all.insert(layer);
    return all;
}

void ClipLayers::add(const std::shared_ptr<ClipSet>& set) {
    const std::scoped_lock lock(mutex_);
    // Removes old sets now and then only, because a stage may have many sets.
    if (sets_.size() >= 2 * living_ + 16) {
        std::erase_if(sets_, [](const auto& one) { return one.expired(); });
        living_ = sets_.size();
    }
    sets_.push_back(set);
}

std::vector<std::shared_ptr<ClipSet>> ClipLayers::usersOf(const pxr::SdfLayerHandle& layer) {
    std::vector<std::shared_ptr<ClipSet>> users;
    {
        const std::scoped_lock lock(mutex_);
        if (!known_.contains(get_pointer(layer))) return users;
        for (const auto& one : sets_)
            if (auto set = one.lock()) users.push_back(std::move(set));
    }
    std::erase_if(users, [&](const auto& set) { return !set->uses(layer); });
    return users;
}

ClipSet::ClipSet(ClipDefinition definition, std::shared_ptr<ClipLayers> layers)
    : definition_(std::move(definition)),
      clipPrim_(definition_.clipPrim),
      layers_(std::move(layers)) {
    std::map<double, std::size_t> starts;
    for (const auto& one : definition_.active) starts[one[0]] = std::size_t(one[1]);
    for (const auto& [start, index] : starts) {
        if (!clips_.empty()) clips_.back().end = start;
        clips_.push_back({definition_.assets[index], start, clips_.empty() ? -kEver : start, kEver,
                          std::nullopt});
    }
    for (const auto& one : definition_.times) mappings_.push_back({one[0], one[1], false});
    std::ranges::stable_sort(mappings_, {}, &Mapping::stage);
    for (std::size_t i = 0; i + 1 < mappings_.size(); ++i)
        if (mappings_[i].stage == mappings_[i + 1].stage) {
            mappings_[i].stage -= kJump;
            mappings_[i].jumps = true;
        }
}

bool ClipSet::appliesTo(const pxr::PcpNodeRef& node) const {
    return get_pointer(node.GetLayerStack()) == get_pointer(definition_.stack) &&
           node.GetPath().HasPrefix(definition_.prim);
}

SdfPath ClipSet::inClip(const SdfPath& path) const {
    return path.ReplacePrefix(definition_.prim, clipPrim_);
}

SdfPath ClipSet::fromClip(const SdfPath& path) const {
    return path.HasPrefix(clipPrim_) ? path.ReplacePrefix(clipPrim_, definition_.prim) : SdfPath();
}

pxr::SdfLayerRefPtr ClipSet::layerOf(const Clip& clip) const {
    const std::scoped_lock lock(mutex_);
    if (!clip.layer) clip.layer = layers_->open(definition_, clip.asset.GetAssetPath());
    return *clip.layer;
}

// Returns null if the set names no manifest.
pxr::SdfLayerRefPtr ClipSet::manifest() const {
    if (!definition_.manifest) return {};
    const std::scoped_lock lock(mutex_);
    if (!manifest_) manifest_ = layers_->open(definition_, definition_.manifest->GetAssetPath());
    return *manifest_;
}

// Finds the attributes that have samples in a clip. The first clip says whether they vary.
const std::map<SdfPath, bool>& ClipSet::declared() const {
    const std::scoped_lock lock(mutex_);
    if (declared_) return *declared_;
    declared_.emplace();
    for (const auto& clip : clips_) {
        const auto layer = layerOf(clip);
        if (!layer || !layer->HasSpec(clipPrim_)) continue;
        layer->Traverse(clipPrim_, [&](const SdfPath& path) {
            auto variability = pxr::SdfVariabilityUniform;
            if (path.IsPropertyPath() && layer->GetSpecType(path) == pxr::SdfSpecTypeAttribute &&
                layer->HasField(path, SdfFieldKeys->Variability, &variability) &&
                layer->GetNumTimeSamplesForPath(path) > 0)
                declared_->try_emplace(path, variability == pxr::SdfVariabilityVarying);
        });
    }
    return *declared_;
}

bool ClipSet::uses(const pxr::SdfLayerHandle& layer) const {
    const std::scoped_lock lock(mutex_);
    const auto is = [&](const auto& one) { return one && get_pointer(*one) == get_pointer(layer); };
    return is(manifest_) ||
           std::ranges::any_of(clips_, [&](const Clip& clip) { return is(clip.layer); });
}

bool ClipSet::mayShow(const pxr::SdfLayerHandle& layer, const SdfPath& attribute) const {
    if (!definition_.manifest) return true;
    return get_pointer(manifest()) == get_pointer(layer) || hasValuesOf(attribute);
}

void ClipSet::onLayerChanged() {
    const std::scoped_lock lock(mutex_);
    declared_.reset();
}

bool ClipSet::hasValuesOf(const SdfPath& attribute) const {
    const SdfPath path = inClip(attribute);
    const std::scoped_lock lock(mutex_);
    if (!definition_.manifest) {
        const auto found = declared().find(path);
        return found != declared().end() && found->second;
    }
    const auto layer = manifest();
    auto variability = pxr::SdfVariabilityUniform;
    return layer && layer->HasField(path, SdfFieldKeys->Variability, &variability) &&
           variability == pxr::SdfVariabilityVarying;
}

std::size_t ClipSet::activeAt(double time) const {
    const auto after = std::ranges::upper_bound(clips_, time, {}, &Clip::start);
    return after == clips_.begin() ? 0 : std::size_t(after - clips_.begin()) - 1;
}

// Without interpolation of missing values each clip has values, if only the default of the
// manifest. A block in the manifest at the start of a clip says that the clip has none.
bool ClipSet::contributes(const Clip& clip, const SdfPath& attribute) const {
    if (!definition_.interpolatesMissing) return true;
    const auto named = manifest();
    VtValue block;
    const bool blocked = named &&
                         named->QueryTimeSample(inClip(attribute), clip.authored, &block) &&
                         block.IsHolding<pxr::SdfValueBlock>();
    if (!blocked) {
        const auto layer = layerOf(clip);
        if (layer && layer->GetNumTimeSamplesForPath(inClip(attribute)) > 0) return true;
    }
    return named && named->HasField(inClip(attribute), SdfFieldKeys->Default);
}

// A time outside of the mappings has the time of the first or the last one.
double ClipSet::toClip(double time) const {
    if (mappings_.empty()) return time;
    if (time <= mappings_.front().stage) return mappings_.front().clip;
    if (time >= mappings_.back().stage) return mappings_.back().clip;
    const auto upper = std::ranges::lower_bound(mappings_, time, {}, &Mapping::stage);
    const auto lower = std::prev(upper);
    const double end = upper->jumps ? std::next(upper)->stage : upper->stage;
    if (lower->stage == end || time == lower->stage) return lower->clip;
    if (time == end) return upper->clip;
    return (upper->clip - lower->clip) / (end - lower->stage) * (time - lower->stage) + lower->clip;
}

double ClipSet::toStage(double time, std::size_t segment) const {
    const auto& lower = mappings_[segment];
    const auto& upper = mappings_[segment + 1];
    const double end = upper.jumps ? mappings_[segment + 2].stage : upper.stage;
    if (lower.clip == upper.clip || time == lower.clip) return lower.stage;
    if (time == upper.clip) return end;
    return (end - lower.stage) / (upper.clip - lower.clip) * (time - lower.clip) + lower.stage;
}

// Returns the times of the samples in the layer, also of those at which the clip is not active.
std::vector<double> ClipSet::timesInLayer(const Clip& clip, const SdfPath& attribute) const {
    const auto layer = layerOf(clip);
    if (!layer) return {};
    const auto samples = layer->ListTimeSamplesForPath(inClip(attribute));
    if (mappings_.empty()) return {samples.begin(), samples.end()};
    std::set<double> times;
    for (const double time : samples)
        for (std::size_t i = 0; i + 1 < mappings_.size(); ++i) {
            const auto& lower = mappings_[i];
            const auto& upper = mappings_[i + 1];
            const auto [from, to] = std::minmax(lower.clip, upper.clip);
            if (!lower.jumps && lower.clip != upper.clip && time >= from && time <= to)
                times.insert(toStage(time, i));
        }
    return {times.begin(), times.end()};
}

// Each clip has a sample at its start, and at each time of the mappings.
std::vector<double> ClipSet::timesIn(const Clip& clip, const SdfPath& attribute) const {
    std::set<double> times{clip.authored};
    const auto add = [&](double time) {
        if (clip.isActiveAt(time)) times.insert(time);
    };
    for (const auto& mapping : mappings_) add(mapping.stage);
    for (const double time : timesInLayer(clip, attribute)) add(time);
    return {times.begin(), times.end()};
}

// Returns the sample that a clip shows after its end, as pxr.Usd does: if the nearest samples in
// the layer are after the end, the start of the clip and not its last sample.
double ClipSet::shownAfter(const Clip& clip, const SdfPath& attribute, double time) const {
    std::set<double> near{clip.authored};
    const auto add = [&](const std::vector<double>& times) {
        if (times.empty()) return;
        const auto [lower, upper] = around(times, time);
        for (const double one : {lower, upper})
            if (clip.isActiveAt(one)) near.insert(one);
    };
    std::vector<double> mapped;
    for (const auto& mapping : mappings_) mapped.push_back(mapping.stage);
    add(timesInLayer(clip, attribute));
    add(mapped);
    return *near.rbegin();
}

std::vector<double> ClipSet::timesOf(const SdfPath& attribute) const {
    std::set<double> times;
    for (const auto& clip : clips_)
        if (contributes(clip, attribute)) {
            const auto some = timesIn(clip, attribute);
            times.insert(some.begin(), some.end());
        }
    if (times.empty()) times.insert(clips_.front().authored);
    return {times.begin(), times.end()};
}

bool ClipSet::mightVary(const SdfPath& attribute) const {
    return clips_.size() > 1 || timesIn(clips_.front(), attribute).size() > 1;
}

// Reads the active clip, and others only if it has no values or no later ones.
std::pair<double, double> ClipSet::bracket(const SdfPath& attribute, double time) const {
    std::optional<double> lower, upper;
    const std::size_t active = activeAt(time);
    if (contributes(clips_[active], attribute)) {
        const auto found = around(timesIn(clips_[active], attribute), time);
        lower = found.first;
        if (found.first != found.second || time <= found.second) upper = found.second;
    }
    for (std::size_t i = active; !lower && i-- != 0;)
        if (contributes(clips_[i], attribute)) lower = shownAfter(clips_[i], attribute, time);
    for (std::size_t i = active + 1; !upper && i < clips_.size(); ++i)
        if (contributes(clips_[i], attribute)) upper = clips_[i].start;
    const double only = clips_.front().authored;
    return {lower ? *lower : upper.value_or(only), upper ? *upper : lower.value_or(only)};
}

// Returns the value at the time of a sample. A clip without samples has the default of the
// manifest.
VtValue ClipSet::sample(const SdfPath& attribute, double time, Interpolation interpolation,
                        pxr::SdfLayerRefPtr& layer) const {
    layer = layerOf(clips_[activeAt(time)]);
    const SdfPath path = inClip(attribute);
    const double inLayer = toClip(time);
    VtValue value;
    double lower = 0, upper = 0;
    if (!layer || (!layer->QueryTimeSample(path, inLayer, &value) &&
                   !layer->GetBracketingTimeSamplesForPath(path, inLayer, &lower, &upper))) {
        layer = manifest();
        if (layer) (void)layer->HasField(path, SdfFieldKeys->Default, &value);
        return isBlock(value) ? VtValue() : value;
    }
    if (value.IsEmpty()) {
        (void)layer->QueryTimeSample(path, lower, &value);
        if (interpolation == Interpolation::Linear && !isBlock(value) &&
            !pxr::GfIsClose(lower, upper, kSameTime)) {
            VtValue later;
            (void)layer->QueryTimeSample(path, upper, &later);
            if (!later.IsEmpty() && !isBlock(later))
                value = interpolate(value, later, (inLayer - lower) / (upper - lower));
        }
    }
    if (isBlock(value)) return {};
    shiftTimeCodes(value, time - inLayer);
    return value;
}

VtValue ClipSet::value(const SdfPath& attribute, double time, Interpolation interpolation,
                       pxr::SdfLayerRefPtr& layer) const {
    const auto [from, to] = bracket(attribute, time);
    const VtValue lower = sample(attribute, from, interpolation, layer);
    if (lower.IsEmpty() || interpolation == Interpolation::Held || !canInterpolate(lower) ||
        pxr::GfIsClose(from, to, kSameTime))
        return lower;
    pxr::SdfLayerRefPtr ofUpper;
    const VtValue upper = sample(attribute, to, interpolation, ofUpper);
    return upper.IsEmpty() ? lower : interpolate(lower, upper, (time - from) / (to - from));
}

}  // namespace usdlive::stage
