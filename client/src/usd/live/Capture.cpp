// Turns the editor's writes into one layer into edits.
#include "usd/live/Capture.h"

#include <pxr/base/gf/matrix4d.h>
#include <pxr/base/tf/diagnostic.h>
#include <pxr/base/tf/stringUtils.h>
#include <pxr/base/tf/type.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <utility>

#include "basics/Placements.h"
#include "usdlive/common/core/Overloaded.h"
#include "usdlive/common/core/Utf8.h"
#include "usdlive/common/layer/FieldParts.h"
#include "usdlive/common/layer/FileRules.h"
#include "usdlive/common/layer/LayerDocNode.h"
#include "usdlive/common/usd/NamedAssets.h"

namespace usdlive::client {

using pxr::SdfPath;
using pxr::SdfSpecType;
using pxr::TF_DIAGNOSTIC_RUNTIME_ERROR_TYPE;  // for TF_RUNTIME_ERROR
using pxr::TfToken;

namespace {

constexpr std::string_view kTimeSamples = "timeSamples";

const TfToken& timeSamplesToken() { return pxr::SdfFieldKeys->TimeSamples; }

const TfToken& fieldOf(ChildList list) {
    switch (list) {
        case ChildList::Prims:
            return pxr::SdfChildrenKeys->PrimChildren;
        case ChildList::Properties:
            return pxr::SdfChildrenKeys->PropertyChildren;
        case ChildList::VariantSets:
            return pxr::SdfChildrenKeys->VariantSetChildren;
        case ChildList::Variants:
            break;
    }
    return pxr::SdfChildrenKeys->VariantChildren;
}

std::optional<ChildList> listOf(const TfToken& field) {
    for (const ChildList list : kChildLists)
        if (field == fieldOf(list)) return list;
    return std::nullopt;
}

// Splits a key path like VtDictionary.
std::vector<std::string> splitKeyPath(const TfToken& keyPath) {
    std::vector<std::string> keys;
    std::string_view rest = keyPath.GetString();
    while (!rest.empty()) {
        const auto colon = std::min(rest.find(':'), rest.size());
        if (colon != 0) keys.emplace_back(rest.substr(0, colon));
        rest.remove_prefix(std::min(colon + 1, rest.size()));
    }
    return keys;
}

const Value* sampleAt(const FieldValue* field, double time) {
    const TimeSamples* samples = field ? field->as<TimeSamples>() : nullptr;
    if (!samples) return nullptr;
    const auto at = samples->samples.find(time);
    return at == samples->samples.end() ? nullptr : &at->second;
}

std::size_t bytesOf(const pxr::VtValue& array) {
    const std::size_t count = array.GetArraySize();
    if (count < Capture::kBigArrayBytes / sizeof(pxr::GfMatrix4d)) return 0;
    return count * std::max(pxr::TfType::Find(array.GetElementTypeid()).GetSizeof(), sizeof(char));
}

}  // namespace

// One call of seal(): updates the working copy to the content of the layer, at the written places.
class Capture::Sealing {
public:
    Sealing(Capture& capture, usd::SdfLayerStore& store, BlobSink& blobs)
        : capture_(capture), store_(store), blobs_(blobs), layer_(store.layer()) {}

    void compareDirty() {
        for (const SdfPath& path : capture_.unclear_) compareSpec(path);
        // Compares lists last, because the comparison above may have created specs.
        for (const auto& [path, spec] : capture_.dirty_)
            if (!doc().has(path.GetString())) compareSpec(path);
        for (const auto& [path, spec] : capture_.dirty_)
            if (doc().has(path.GetString())) compareFields(path, spec);
        for (const auto& [path, spec] : capture_.dirty_)
            for (const ChildList list : kChildLists)
                if (spec.lists[std::size_t(list)] && doc().has(path.GetString()))
                    compareOrder(path, list);
    }

    // Writes of other threads can occur at any time: every remaining difference is theirs.
    void refuseForeign() {
        const Error reason{ErrorCode::InvalidArgument,
                           "was edited by another thread than the one that uses the connection. "
                           "The edits are reverted; make them on that thread"};
        const auto present = usd::readLayer(layer_, blobs_);
        if (!present) {
            lose(SdfPath::AbsoluteRootPath(), {}, present.error(), {});
            return;
        }
        std::vector<AuthoredEdit> edits;
        for (auto& [path, action] : difference(doc(), *present))
            edits.push_back({capture_.layer_, path, std::move(action)});
        if (edits.empty()) return;
        for (const auto& [path, action] : difference(*present, doc()))
            static_cast<void>(store_.apply(path, action));
        lose(SdfPath::AbsoluteRootPath(), {}, reason, std::move(edits));
    }

private:
    [[nodiscard]] LayerDoc& doc() { return *capture_.working_; }
    [[nodiscard]] SdfSpecType typeInLayer(const SdfPath& path) const {
        return layer_->GetSpecType(path);
    }

    // Returns whether the spec was created since the last seal().
    [[nodiscard]] bool isNew(const SdfPath& path) const {
        return capture_.working_->idsAlong(path.GetString()).back() >= capture_.firstNew_;
    }

    void lose(const SdfPath& path, const std::string& field, const Error& reason,
              std::vector<AuthoredEdit> edits) {
        std::string message = capture_.layer_.value + " <" + path.GetString() + ">";
        if (!field.empty()) message += " " + field;
        message += ": " + reason.message;
        capture_.lost_.push_back(
            {path.GetString(), field, {reason.code, std::move(message)}, std::move(edits)});
    }
    [[nodiscard]] AuthoredEdit authored(const SdfPath& path, EditAction action) const {
        return {capture_.layer_, path.GetString(), std::move(action)};
    }
    // Returns the layer's field as an edit; nothing if it cannot be expressed.
    [[nodiscard]] std::vector<AuthoredEdit> written(const SdfPath& path, const TfToken& field) {
        std::vector<AuthoredEdit> edits;
        const auto present = store_.read(path, field, blobs_);
        if (!present) return edits;
        const FieldValue* wanted = *present ? &**present : nullptr;
        const FieldValue* held = doc().field(path.GetString(), field.GetString());
        for (auto& action : fieldDifference(field.GetString(), held, wanted))
            edits.push_back(authored(path, std::move(action)));
        return edits;
    }
    void collect(const SdfPath& path, std::vector<AuthoredEdit>& edits) {
        const auto kind = usd::specKind(typeInLayer(path));
        if (!kind) return;
        edits.push_back(authored(path, CreateSpec{*kind}));
        for (const TfToken& field : layer_->ListFields(path))
            if (!usd::isStructural(field))
                for (auto& edit : written(path, field)) edits.push_back(std::move(edit));
        for (const ChildList list : kChildLists)
            for (const auto& name : childrenInLayer(path, list))
                collect(childPath(path, list, name), edits);
    }

    // Resets the layer's field, or a part of it, to the content of the working copy.
    void giveUp(const SdfPath& path, const TfToken& field, Error reason) {
        auto edits = written(path, field);
        if (edits.empty())
            edits = keptAsText(path, field.GetString(), layer_->GetField(path, field), reason);
        lose(path, field.GetString(), reason, std::move(edits));
        const FieldValue* held = doc().field(path.GetString(), field.GetString());
        const EditAction back = held ? EditAction(SetField{field, {}, *held, ValueType::None})
                                     : EditAction(EraseField{field, {}});
        static_cast<void>(store_.apply(path.GetString(), back));
    }
    // Returns an edit that keeps a value which no edit can express: its text, as custom data of the
    // spec. Adds the beginning of the text to the reason.
    [[nodiscard]] std::vector<AuthoredEdit> keptAsText(const SdfPath& path,
                                                       const std::string& field,
                                                       const pxr::VtValue& value, Error& reason) {
        constexpr std::size_t kMostText = 1'000;
        const std::string text = pxr::TfStringify(value);
        reason.message += ". It was: " + text.substr(0, kMostText);
        if (text.size() > kMostText)
            reason.message += "... The lost work has all of it, in the custom data of the spec";
        auto kept = usd::encodeLeaf(pxr::VtValue(text), blobs_);
        if (!kept) return {};
        const auto& data = path == SdfPath::AbsoluteRootPath() ? pxr::SdfFieldKeys->CustomLayerData
                                                               : pxr::SdfFieldKeys->CustomData;
        return {authored(path, SetField{data.GetString(), DictionaryKey{{"lost", field}},
                                        std::move(*kept), ValueType::None})};
    }
    void giveUpSample(const SdfPath& path, double time, Error reason) {
        pxr::VtValue present;
        std::vector<AuthoredEdit> edits;
        const std::string what = std::string(kTimeSamples) + " at " + std::to_string(time);
        if (layer_->QueryTimeSample(path, time, &present)) {
            if (auto value = usd::encodeLeaf(present, blobs_))
                edits.push_back(authored(path, SetField{std::string(kTimeSamples), SampleTime{time},
                                                        std::move(*value), ValueType::None}));
            else
                edits = keptAsText(path, what, present, reason);
        }
        lose(path, what, reason, std::move(edits));
        const Value* held = sampleAt(doc().field(path.GetString(), kTimeSamples), time);
        const std::string field(kTimeSamples);
        const EditAction back =
            held ? EditAction(SetField{field, SampleTime{time}, *held, ValueType::None})
                 : EditAction(EraseField{field, SampleTime{time}});
        static_cast<void>(store_.apply(path.GetString(), back));
    }
    void giveUpSpec(const SdfPath& path, const Error& reason) {
        std::vector<AuthoredEdit> edits;
        collect(path, edits);
        lose(path, {}, reason, std::move(edits));
        static_cast<void>(store_.apply(path.GetString(), DeleteSpec{}));
    }

    void compareFields(const SdfPath& path, const DirtySpec& spec) {
        // The type comes first, because other fields must fit it.
        const TfToken& typeName = pxr::SdfFieldKeys->TypeName;
        if (spec.fields.contains(typeName)) compareField(path, typeName);
        for (const auto& [field, dirty] : spec.fields) {
            if (field == typeName) continue;
            if (dirty.whole) {
                compareField(path, field);
                continue;
            }
            for (const TfToken& keyPath : dirty.keyPaths) compareKey(path, field, keyPath);
            for (const double time : dirty.times) compareSample(path, time);
        }
    }

    void compareField(const SdfPath& path, const TfToken& field) {
        const auto present = store_.read(path, field, blobs_);
        if (!present) {
            giveUp(path, field, present.error());
            return;
        }
        const FieldValue* held = doc().field(path.GetString(), field.GetString());
        const FieldValue* wanted = *present ? &**present : nullptr;
        if (wanted && !(held && *held == *wanted) && saysNothing(field.GetString(), *wanted)) {
            static_cast<void>(store_.apply(path.GetString(), EraseField{field, {}}));  // ED10
            wanted = nullptr;
        }
        // M13: in a spec that this transaction creates, parts that others write are kept.
        const bool whole = !held && wanted && !wanted->as<Value>() && isNew(path);
        for (auto& action : whole ? fieldDifference(field.GetString(), held, wanted)
                                  : authoredParts(field.GetString(), held, wanted)) {
            const auto recorded = capture_.record(path.GetString(), std::move(action));
            if (recorded) continue;
            if (field == pxr::SdfFieldKeys->TypeName && !held &&
                doc().kind(path.GetString()) == SpecKind::Attribute) {
                giveUpSpec(path, recorded.error());  // an attribute without a type is not possible
                static_cast<void>(capture_.record(path.GetString(), DeleteSpec{}));
            } else {
                giveUp(path, field, recorded.error());
            }
            return;
        }
    }

    // Reads only this sample, because an attribute may have many thousands.
    void compareSample(const SdfPath& path, double time) {
        pxr::VtValue present;
        const Value* held = sampleAt(doc().field(path.GetString(), kTimeSamples), time);
        const std::string field(kTimeSamples);
        if (!layer_->QueryTimeSample(path, time, &present)) {
            if (held) recordSample(path, time, EraseField{field, SampleTime{time}});
            return;
        }
        auto value = usd::encodeLeaf(present, blobs_);
        if (!value) {
            giveUpSample(path, time, value.error());
            return;
        }
        if (held && *held == *value) return;
        recordSample(path, time,
                     SetField{field, SampleTime{time}, std::move(*value), ValueType::None});
    }
    void recordSample(const SdfPath& path, double time, EditAction action) {
        const auto recorded = capture_.record(path.GetString(), std::move(action));
        if (!recorded) giveUpSample(path, time, recorded.error());
    }

    void compareKey(const SdfPath& path, const TfToken& field, const TfToken& keyPath) {
        const auto keys = splitKeyPath(keyPath);
        if (keys.empty()) {
            compareField(path, field);
            return;
        }
        if (!compareKeys(path, field, keyPath, keys) || keys.size() == 1) return;
        // Setting a nested key may have replaced a value at a shorter key path. Erasing one may
        // have erased dictionaries that became empty.
        compareKeys(path, field, TfToken(keys.front()), {keys.front()});
    }
    bool compareKeys(const SdfPath& path, const TfToken& field, const TfToken& keyPath,
                     const std::vector<std::string>& keys) {
        const FieldValue* whole = doc().field(path.GetString(), field.GetString());
        const auto* held = entryAt(whole ? whole->as<Dictionary>() : nullptr, keys);
        const pxr::VtValue present = layer_->GetFieldDictValueByKey(path, field, keyPath);
        std::optional<FieldValue> from, to;
        if (held) std::visit([&](const auto& entry) { from = entry; }, *held);
        if (!present.IsEmpty()) {
            auto value = usd::encodeValue(present, blobs_);
            if (!value) {
                giveUp(path, field, value.error());
                return false;
            }
            to = std::move(*value);
        }
        for (EditAction& action :
             authoredParts(field.GetString(), from ? &*from : nullptr, to ? &*to : nullptr)) {
            std::visit(
                Overloaded{[&](SetField& set) { prepend(keys, set.part); },
                           [&](EraseField& erase) { prepend(keys, erase.part); }, [](auto&) {}},
                action);
            const auto recorded = capture_.record(path.GetString(), std::move(action));
            if (recorded) continue;
            giveUp(path, field, recorded.error());
            return false;
        }
        return true;
    }
    // Extends `part`, a part of the entry at `keys`, to a part of the field.
    static void prepend(const std::vector<std::string>& keys, FieldPart& part) {
        DictionaryKey whole{keys};
        if (const auto* below = std::get_if<DictionaryKey>(&part))
            whole.path.insert(whole.path.end(), below->path.begin(), below->path.end());
        part = std::move(whole);
    }

    void compareOrder(const SdfPath& parent, ChildList list) {
        const auto wanted = childrenInLayer(parent, list);
        auto held = doc().children(parent.GetString(), list);
        if (held == wanted) return;
        if (!std::is_permutation(held.begin(), held.end(), wanted.begin(), wanted.end())) {
            compareChildren(parent, list, held, wanted);
            held = doc().children(parent.GetString(), list);
            if (!std::is_permutation(held.begin(), held.end(), wanted.begin(), wanted.end()))
                return;
        }
        for (const auto& [name, before] : placements(held, wanted)) {
            const auto path = specpath::child(parent.GetString(), list, name);
            const auto recorded = capture_.record(path, PlaceSpec{before});
            if (!recorded)
                lose(parent, fieldOf(list), recorded.error(),
                     {{capture_.layer_, path, PlaceSpec{before}}});
        }
    }

    [[nodiscard]] std::vector<std::string> childrenInLayer(const SdfPath& parent,
                                                           ChildList list) const {
        std::vector<std::string> names;
        for (const TfToken& name :
             layer_->GetFieldAs<std::vector<TfToken>>(parent, fieldOf(list), {}))
            names.push_back(name.GetString());
        return names;
    }

    [[nodiscard]] static SdfPath childPath(const SdfPath& parent, ChildList list,
                                           const std::string& name) {
        return SdfPath(specpath::child(parent.GetString(), list, name));
    }

    void compareChildren(const SdfPath& parent, ChildList list,
                         const std::vector<std::string>& held,
                         const std::vector<std::string>& wanted) {
        const std::set<std::string> stay(wanted.begin(), wanted.end());
        for (const auto& name : held)
            if (!stay.contains(name))
                static_cast<void>(
                    capture_.record(specpath::child(parent.GetString(), list, name), DeleteSpec{}));
        const std::set<std::string> known(held.begin(), held.end());
        for (const auto& name : wanted)
            if (!known.contains(name)) compareSpec(childPath(parent, list, name));
    }

    // Compares a spec with its fields and everything below it.
    void compareSpec(const SdfPath& path) {
        const std::string text = path.GetString();
        const auto kind = usd::specKind(typeInLayer(path));
        const auto held = doc().kind(text);
        if (held && held != kind) static_cast<void>(capture_.record(text, DeleteSpec{}));
        if (!kind) return;
        if (held != kind) {
            if (const auto created = capture_.record(text, CreateSpec{*kind}); !created) {
                createFailed(path, created.error());
                return;
            }
        }
        compareAllFields(path);
        for (const ChildList list : kChildLists) compareList(path, list);
    }

    // The parent may be missing, too. Its comparison then includes this spec.
    void createFailed(const SdfPath& path, const Error& reason) {
        const SdfPath parent = path.GetParentPath();
        if (reason.code == ErrorCode::SpecNotFound && !parent.IsEmpty() &&
            !doc().has(parent.GetString()) && usd::specKind(typeInLayer(parent))) {
            compareSpec(parent);
            return;
        }
        giveUpSpec(path, reason);
    }

    void compareAllFields(const SdfPath& path) {
        std::set<TfToken> fields;
        for (const TfToken& field : layer_->ListFields(path))
            if (!usd::isStructural(field)) fields.insert(field);
        for (const auto& name : doc().fieldNames(path.GetString())) fields.insert(TfToken(name));
        const TfToken& typeName = pxr::SdfFieldKeys->TypeName;  // the other fields must fit it
        if (fields.erase(typeName)) compareField(path, typeName);
        for (const TfToken& field : fields) compareField(path, field);
    }

    void compareList(const SdfPath& parent, ChildList list) {
        const auto wanted = childrenInLayer(parent, list);
        const auto held = doc().children(parent.GetString(), list);
        const std::set<std::string> known(held.begin(), held.end());
        compareOrder(parent, list);
        for (const auto& name : wanted)
            if (known.contains(name)) compareSpec(childPath(parent, list, name));
    }

    Capture& capture_;
    usd::SdfLayerStore& store_;
    BlobSink& blobs_;
    const pxr::SdfLayerHandle layer_;
};

Capture::Capture(LayerId layer, std::function<const LayerDoc*()> view, std::function<void()> begun,
                 Named clips, Named layers)
    : layer_(std::move(layer)),
      view_(std::move(view)),
      begun_(std::move(begun)),
      clips_(std::move(clips)),
      layers_(std::move(layers)) {}

bool Capture::hasWrites() const { return working_.has_value() || foreign_; }

Capture::Sealed Capture::seal(usd::SdfLayerStore& store, BlobSink& blobs) {
    if (!hasWrites()) return {};
    begin();
    Sealing sealing(*this, store, blobs);
    sealing.compareDirty();
    if (foreign_.exchange(false)) sealing.refuseForeign();
    Sealed sealed{std::move(edits_), std::move(lost_)};
    discard();
    return sealed;
}

void Capture::discard() {
    working_.reset();
    edits_.clear();
    dirty_.clear();
    unclear_.clear();
    lost_.clear();
    bigArrays_.clear();
}

void Capture::contentReplaced() {
    begin();
    unclear_ = {SdfPath::AbsoluteRootPath()};
}

void Capture::begin() {
    if (working_) return;
    const LayerDoc* shown = view_();
    working_ = shown ? *shown : LayerDoc();
    firstNew_ = working_->nextId();
    begun_();
}

Result<void> Capture::record(std::string_view path, EditAction action) {
    if (auto proper = checkForFile(*working_, path, action); !proper) return proper;
    const auto applied = working_->apply(path, action);
    if (!applied) return tl::unexpected(applied.error());
    if (applied->changed || concernsPlace(action))
        edits_.push_back({layer_, std::string(path), std::move(action)});
    return {};
}

// The only function that other threads call.
bool Capture::isForeign() {
    if (std::this_thread::get_id() == thread_) return false;
    if (!foreign_.exchange(true)) begun_();
    TF_RUNTIME_ERROR(
        "%s is live and was edited by another thread than the one that uses its connection. The "
        "edit "
        "is reverted: make it on that thread",
        layer_.value.c_str());
    return true;
}

void Capture::specCreated(const SdfPath& path, SdfSpecType type) {
    // Sdf has specs for targets and connections, which have no content of their own.
    if (path.IsTargetPath() || isForeign()) return;
    begin();
    const auto kind = usd::specKind(type);
    if (!kind || path.ContainsTargetPath()) {
        noteForeign(path, {}, "a spec of this kind");
        return;
    }
    if (working_->kind(path.GetString()) == kind) return;
    if (!record(path.GetString(), CreateSpec{*kind})) unclear_.insert(path);
}

void Capture::specDeleted(const SdfPath& path) {
    if (path.ContainsTargetPath() || isForeign()) return;
    begin();
    forgetBelow(path);
    const std::string text = path.GetString();
    if (!working_->has(text)) return;
    if (!dropBelow(text)) {
        static_cast<void>(record(text, DeleteSpec{}));
        return;
    }
    // Created and deleted since the last seal(), so nothing is sent.
    static_cast<void>(working_->apply(text, DeleteSpec{}));
}

// Removes the last edits while they concern specs that are deleted with `path`. Returns whether the
// creation of `path` was among them.
bool Capture::dropBelow(std::string_view path) {
    while (!edits_.empty()) {
        const AuthoredEdit& last = edits_.back();
        const bool created = std::holds_alternative<CreateSpec>(last.action);
        if (!created && !std::holds_alternative<DeleteSpec>(last.action)) return false;
        if (!specpath::hasPrefix(last.path, path)) return false;
        const bool self = last.path == path;
        if (self && !created) return false;
        edits_.pop_back();
        if (self) return true;
    }
    return false;
}

void Capture::specMoved(const SdfPath& from, const SdfPath& to) {
    if (from.ContainsTargetPath() || to.ContainsTargetPath() || isForeign()) return;
    begin();
    carry(from, to);
    const MoveSpec move{{to.GetParentPath().GetString(), std::nullopt}, to.GetName()};
    if (record(from.GetString(), move)) return;
    unclear_.insert(from);
    unclear_.insert(to);
}

void Capture::placeMoved(const SdfPath& from, const SdfPath& to) {
    if (from.ContainsTargetPath() || to.ContainsTargetPath() || isForeign()) return;
    begin();
    // A spec that is there now stays.
    if (working_->has(from.GetString())) return;
    const EditAction action =
        to.IsEmpty()
            ? EditAction(DeleteSpec{true})
            : EditAction(MoveSpec{{to.GetParentPath().GetString(), {}}, to.GetName(), true});
    static_cast<void>(record(from.GetString(), action));
}

void Capture::childrenChanged(const SdfPath& parent, const TfToken& field, bool appended) {
    const auto list = listOf(field);
    if (!list || appended || parent.ContainsTargetPath() || isForeign()) return;
    begin();
    dirty_[parent].lists[std::size_t(*list)] = true;
}

void Capture::fieldChanged(const SdfPath& path, const TfToken& field) {
    if (usd::isStructural(field) || isForeign()) return;
    begin();
    if (path.ContainsTargetPath()) {
        noteForeign(path, field, "a field of a target");
        return;
    }
    DirtyField& dirty = dirty_[path].fields[field];
    dirty = {};
    dirty.whole = true;
}

void Capture::dictionaryKeyChanged(const SdfPath& path, const TfToken& field,
                                   const TfToken& keyPath) {
    if (path.ContainsTargetPath()) {
        fieldChanged(path, field);
        return;
    }
    if (isForeign()) return;
    begin();
    DirtyField& dirty = dirty_[path].fields[field];
    if (!dirty.whole) dirty.keyPaths.insert(keyPath);
}

void Capture::timeSampleChanged(const SdfPath& path, double time) {
    if (path.ContainsTargetPath()) {
        fieldChanged(path, timeSamplesToken());
        return;
    }
    if (isForeign()) return;
    begin();
    DirtyField& dirty = dirty_[path].fields[timeSamplesToken()];
    if (!dirty.whole) dirty.times.insert(time);
}

void Capture::arrayWritten(const SdfPath& path, const TfToken& field, std::optional<double> time,
                           const pxr::VtValue& array) {
    if (std::this_thread::get_id() != thread_ || path.ContainsTargetPath()) return;
    Register written(path, field, time);
    if (bytesOf(array) >= kBigArrayBytes)
        bigArrays_[std::move(written)] = array;
    else if (!bigArrays_.empty())
        bigArrays_.erase(written);
}

void Capture::clipsWritten(const pxr::VtValue& value) {
    if (std::this_thread::get_id() != thread_) return;  // will be reverted
    std::set<std::string> assets;
    usd::addNamedAssets(value, assets);
    if (!assets.empty()) clips_(assets);
}

void Capture::layersNamed(const std::set<std::string>& assets) {
    if (std::this_thread::get_id() == thread_) layers_(assets);
}

void Capture::appendBigArrays(std::vector<pxr::VtValue>& arrays) const {
    for (const auto& entry : bigArrays_) arrays.push_back(entry.second);
}

void Capture::noteForeign(const SdfPath& path, const std::string& field, const std::string& what) {
    const std::string where = layer_.value + " <" + path.GetString() + ">" +
                              (field.empty() ? std::string() : " " + field);
    lost_.push_back({path.GetString(),
                     field,
                     {ErrorCode::UnsupportedValue, where + ": " + what + " cannot be shared"},
                     {}});
}

void Capture::forgetBelow(const SdfPath& path) {
    auto dirty = dirty_.lower_bound(path);
    while (dirty != dirty_.end() && dirty->first.HasPrefix(path)) dirty = dirty_.erase(dirty);
    auto unclear = unclear_.lower_bound(path);
    while (unclear != unclear_.end() && unclear->HasPrefix(path)) unclear = unclear_.erase(unclear);
}

void Capture::carry(const SdfPath& from, const SdfPath& to) {
    std::vector<std::pair<SdfPath, DirtySpec>> moved;
    auto dirty = dirty_.lower_bound(from);
    while (dirty != dirty_.end() && dirty->first.HasPrefix(from)) {
        moved.emplace_back(dirty->first.ReplacePrefix(from, to, false), std::move(dirty->second));
        dirty = dirty_.erase(dirty);
    }
    std::vector<SdfPath> movedUnclear;
    auto unclear = unclear_.lower_bound(from);
    while (unclear != unclear_.end() && unclear->HasPrefix(from)) {
        movedUnclear.push_back(unclear->ReplacePrefix(from, to, false));
        unclear = unclear_.erase(unclear);
    }
    for (auto& [path, spec] : moved) dirty_[path] = std::move(spec);
    unclear_.insert(movedUnclear.begin(), movedUnclear.end());
}

}  // namespace usdlive::client
