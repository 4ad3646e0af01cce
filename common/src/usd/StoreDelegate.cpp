// The state delegate of a layer: writes edits into it and notifies the observer of the editor's
// writes.
#include "StoreDelegate.h"

#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <unordered_set>
#include <utility>

#include "usdlive/common/usd/NamedAssets.h"

namespace usdlive::usd {

namespace {

// Returns the dictionary that a field holds, or an empty one.
pxr::VtDictionary dictionaryIn(pxr::VtValue value) {
    // The field was read from a file of another program, and no plug-in declares it here.
    if (value.IsHolding<pxr::SdfUnregisteredValue>())
        value = pxr::VtValue(value.UncheckedGet<pxr::SdfUnregisteredValue>().GetValue());
    return value.GetWithDefault<pxr::VtDictionary>();
}

}  // namespace

// ------------------------------------------------------------------ waiting fields

void WaitingFields::add(const Field& field, const FieldValue& value, BlobSource& blobs) {
    auto& hashes = hashes_[field];
    forEachBlob(value, [&](const Value& blob) {
        if (!blobs.blob(blob.hash())) hashes.insert(blob.hash());
    });
}

void WaitingFields::remove(const pxr::SdfPath& path, const pxr::TfToken& field) {
    if (!hashes_.empty()) hashes_.erase({path, field});
}

std::set<WaitingFields::Field> WaitingFields::take(const Hash& hash) {
    std::set<Field> fields;
    for (const auto& [field, hashes] : hashes_)
        if (hashes.contains(hash)) fields.insert(field);
    for (const auto& field : fields) hashes_.erase(field);
    return fields;
}

bool WaitingFields::contains(const Hash& hash) const {
    return std::ranges::any_of(hashes_,
                               [&](const auto& entry) { return entry.second.contains(hash); });
}

void WaitingFields::specMoved(const pxr::SdfPath& from, const pxr::SdfPath& to) {
    std::map<Field, std::set<Hash>> moved;
    std::erase_if(hashes_, [&](const auto& entry) {
        const auto& [path, field] = entry.first;
        if (!path.HasPrefix(from)) return false;
        moved.emplace(Field(path.ReplacePrefix(from, to, false), field), entry.second);
        return true;
    });
    hashes_.merge(moved);
}

void WaitingFields::specDeleted(const pxr::SdfPath& path) {
    if (hashes_.empty()) return;
    const std::string deleted = path.GetAsString();
    std::erase_if(hashes_, [&](const auto& entry) {
        return specpath::hasPrefix(entry.first.first.GetAsString(), deleted);
    });
}

// ------------------------------------------------------------------ paths

pxr::SdfPath RecentPaths::operator()(std::string_view path) {
    if (path == "/") return pxr::SdfPath::AbsoluteRootPath();
    std::string scratch;
    const std::string_view parent = specpath::parentView(path, scratch);
    if (parent != text_) {
        text_ = parent;
        parent_ = pxr::SdfPath(text_);
    }
    const PathElement last = specpath::last(path);
    return childOf(parent_, last.list, tokens_(last.name));
}

// ------------------------------------------------------------------ writing

void SdfLayerStore::Delegate::write(const Path& path, const Token& field,
                                    const DecodedField& value) {
    waiting.remove(path, field);
    SetField(path, field, value.value);
    if (value.offsets && data().Get(path, pxr::SdfFieldKeys->SubLayerOffsets) != *value.offsets)
        SetField(path, pxr::SdfFieldKeys->SubLayerOffsets, pxr::VtValue(*value.offsets));
    if (const auto targets = targetsOf(path, field)) renewTargets(path, *targets, value.value);
}

void SdfLayerStore::Delegate::erase(const Path& path, const Token& field) {
    waiting.remove(path, field);
    if (!data().Has(path, field)) return;
    SetField(path, field, pxr::VtValue());
    if (field == pxr::SdfFieldKeys->SubLayers &&
        data().Has(path, pxr::SdfFieldKeys->SubLayerOffsets))
        SetField(path, pxr::SdfFieldKeys->SubLayerOffsets, pxr::VtValue());
    if (const auto targets = targetsOf(path, field)) renewTargets(path, *targets, {});
}

void SdfLayerStore::Delegate::deleteBelow(const Path& path) {
    const auto& keys = pxr::SdfFieldKeys;
    const auto type = data().GetSpecType(path);
    const auto* definition = layer_->GetSchema().GetSpecDefinition(type);
    const auto isOpinion = [&](const Token& field) {
        return !isStructural(field) && !(definition && definition->IsRequiredField(field));
    };
    const auto fields = data().List(path);
    if (path.IsPropertyPath()) {
        const bool isCustom = data().GetAs<bool>(path, keys->Custom, false);
        return DeleteSpec(path, !isCustom && std::ranges::none_of(fields, isOpinion));
    }
    const auto specifier =
        data().GetAs<pxr::SdfSpecifier>(path, keys->Specifier, pxr::SdfSpecifierOver);
    if (type == pxr::SdfSpecTypePrim && pxr::SdfIsDefiningSpecifier(specifier))
        return DeleteSpec(path, false);
    for (const ChildList list : kChildLists) {
        const Token& field = childrenField(list);
        const auto names = data().GetAs<pxr::TfTokenVector>(path, field);
        for (const Token& name : names) deleteBelow(childOf(path, list, name));
        if (!names.empty()) SetField(path, field, pxr::VtValue());
    }
    for (const Token& field : fields)
        if (isOpinion(field)) erase(path, field);
    DeleteSpec(path, true);
}

/// Returns whether `all` has the names `some` in this order, perhaps with others between them.
static bool isInOrderOf(const pxr::TfTokenVector& some, const pxr::TfTokenVector& all) {
    auto next = some.begin();
    for (const auto& name : all)
        if (next != some.end() && *next == name) ++next;
    return next == some.end();
}

// Sdf reports a reordering when a list is replaced by the same names in another order.
void SdfLayerStore::Delegate::setChildren(const Path& parent, ChildList list,
                                          const pxr::TfTokenVector& names) {
    const Token& field = childrenField(list);
    const auto before = data().GetAs<pxr::TfTokenVector>(parent, field);
    if (names == before) return;
    // The usual case, which takes less time than the sets below: children were only removed, or
    // only added.
    if (names.size() != before.size() && !names.empty() &&
        (isInOrderOf(names, before) || isInOrderOf(before, names)))
        return void(SetField(parent, field, pxr::VtValue(names)));
    using TokenSet = std::unordered_set<Token, Token::HashFunctor>;
    const TokenSet old(before.begin(), before.end()), now(names.begin(), names.end());
    const auto isNew = [&](const Token& name) {
        return !old.contains(name) || added.contains(childOf(parent, list, name));
    };
    const auto kept = [&](pxr::TfTokenVector some) {
        std::erase_if(some, [&](const Token& name) { return !now.contains(name) || isNew(name); });
        return some;
    };
    auto between = kept(before);
    const bool reordered = between != kept(names);
    if (reordered && old != now)
        std::ranges::copy_if(names, std::back_inserter(between), isNew);
    else if (!reordered && old == now)
        between = pxr::TfTokenVector(names.begin() + 1, names.end());
    else
        between = before;
    if (between != before) SetField(parent, field, pxr::VtValue(between));
    SetField(parent, field, names.empty() ? pxr::VtValue() : pxr::VtValue(names));
}

void SdfLayerStore::Delegate::append(const Path& parent, ChildList list, const Token& name) {
    added.insert(childOf(parent, list, name));
    const auto found = changing_.find({parent, list});
    if (found != changing_.end()) return found->second.place(name, {});
    const Token& field = childrenField(list);
    if (data().Has(parent, field))
        PushChild(parent, field, name);
    else
        SetField(parent, field, pxr::VtValue(pxr::TfTokenVector{name}));
}

ChildOrder& SdfLayerStore::Delegate::changing(const Path& parent, ChildList list) {
    const auto found = changing_.find({parent, list});
    if (found != changing_.end()) return found->second;
    ChildOrder order(data().GetAs<pxr::TfTokenVector>(parent, childrenField(list)));
    return changing_.emplace(ChildListOf(parent, list), std::move(order)).first->second;
}

pxr::VtDictionary& SdfLayerStore::Delegate::changingKeys(const Path& path, const Token& field) {
    if (!isOf(keys_, path, field)) {
        writeParts();
        keys_ = {path, field, dictionaryIn(data().Get(path, field))};
    }
    return keys_->content;
}

bool SdfLayerStore::Delegate::hasKey(const Path& path, const Token& field,
                                     const std::vector<std::string>& keys) const {
    if (isOf(keys_, path, field)) return keys_->content.GetValueAtPath(keys);
    return dictionaryIn(data().Get(path, field)).GetValueAtPath(keys);
}

std::optional<FieldValue>& SdfLayerStore::Delegate::changingParts(const Path& path,
                                                                  const Token& field) {
    if (isOf(parts_, path, field)) return parts_->content;
    writeParts();
    ScratchBlobs scratch(blobs);
    const auto present = readField(data(), path, field, scratch);
    // An unsupported value has another form than the part, which replaces it.
    const auto content = present ? *present : std::nullopt;
    return parts_.emplace(ChangingParts{path, field, std::move(scratch), content, content}).content;
}

void SdfLayerStore::Delegate::writeParts() {
    if (auto keys = std::exchange(keys_, std::nullopt))
        SetField(keys->path, keys->field,
                 keys->content.empty() ? pxr::VtValue() : pxr::VtValue::Take(keys->content));
    auto parts = std::exchange(parts_, std::nullopt);
    if (!parts || parts->content == parts->before) return;
    if (!parts->content) return erase(parts->path, parts->field);
    const auto decoded = decodeField(parts->path, parts->field, *parts->content, parts->blobs);
    if (decoded)
        write(parts->path, parts->field, *decoded);
    else
        waiting.add({parts->path, parts->field}, *parts->content, blobs);
}

void SdfLayerStore::Delegate::place() {
    isInBlock = false;
    if (!layer_) return;
    const pxr::SdfChangeBlock block;
    const Applying applying(*this);
    writeParts();
    for (const auto& [where, order] : std::exchange(changing_, {}))
        setChildren(where.first, where.second, order.names());
}

void SdfLayerStore::Delegate::placeBelow(const Path& path) {
    auto changed = changing_.lower_bound({path, ChildList()});
    while (changed != changing_.end() &&
           specpath::hasPrefix(changed->first.first.GetString(), path.GetString())) {
        const auto [where, order] = std::move(*changed);
        changed = changing_.erase(changed);
        setChildren(where.first, where.second, order.names());
    }
}

Result<void> SdfLayerStore::Delegate::set(const Path& path, const Token& field,
                                          const FieldValue& value) {
    auto decoded = decodeField(path, field, value, blobs);
    if (decoded) {
        write(path, field, *decoded);
        return {};
    }
    if (decoded.error().code != ErrorCode::BlobNotFound) return tl::unexpected(decoded.error());
    waiting.remove(path, field);  // drops the value that the field waited for
    waiting.add({path, field}, value, blobs);
    return {};
}

std::optional<TargetFields> SdfLayerStore::Delegate::targetsOf(const Path& path,
                                                               const Token& field) const {
    const auto& keys = pxr::SdfFieldKeys;
    if (field != keys->TargetPaths && field != keys->ConnectionPaths) return std::nullopt;
    return targetFields(kind(path), field);
}

// Updates the specs of targets, as Sdf's own list editors do after such a list op was set.
void SdfLayerStore::Delegate::renewTargets(const Path& path, const TargetFields& fields,
                                           const pxr::VtValue& value) {
    const auto wanted = targetsIn(value);
    const auto present = data().Get(path, fields.children).GetWithDefault<pxr::SdfPathVector>();
    const std::unordered_set<Path, Path::Hash> stay(wanted.begin(), wanted.end());
    const std::unordered_set<Path, Path::Hash> are(present.begin(), present.end());
    for (const Path& target : present)
        if (!stay.contains(target)) DeleteSpec(path.AppendTarget(target), true);
    for (const Path& target : wanted)
        if (!are.contains(target)) CreateSpec(path.AppendTarget(target), fields.childType, true);
    if (wanted != present)
        SetField(path, fields.children, wanted.empty() ? pxr::VtValue() : pxr::VtValue(wanted));
}

// ------------------------------------------------------------------ hooks

void SdfLayerStore::Delegate::notifyField(const Path& path, const Token& field) {
    auto* observer = observerOf(path);
    if (!observer) return;
    if (!isStructural(field)) return observer->fieldChanged(path, field);
    if (field == pxr::SdfFieldKeys->SubLayerOffsets)
        return observer->fieldChanged(path, pxr::SdfFieldKeys->SubLayers);
    notifyChildren(path, field, false);
}

void SdfLayerStore::Delegate::notifyArray(const Path& path, const Token& field,
                                          std::optional<double> time, const pxr::VtValue& value) {
    if (!value.IsArrayValued()) return;
    if (auto* observer = observerOf(path)) observer->arrayWritten(path, field, time, value);
}
void SdfLayerStore::Delegate::notifyArray(const Path& path, const Token& field,
                                          std::optional<double> time, const ConstValue& value) {
    pxr::VtValue taken;
    if (observerOf(path) && value.GetValue(&taken)) notifyArray(path, field, time, taken);
}

void SdfLayerStore::Delegate::notifyClips(const Path& path, const Token& field,
                                          const pxr::VtValue& value) {
    if (!namesClips(field.GetString())) return;
    if (auto* observer = observerOf(path)) observer->clipsWritten(value);
}
void SdfLayerStore::Delegate::notifyClips(const Path& path, const Token& field,
                                          const ConstValue& value) {
    pxr::VtValue taken;
    if (namesClips(field.GetString()) && value.GetValue(&taken)) notifyClips(path, field, taken);
}

void SdfLayerStore::Delegate::notifyLayers(const Path& path, const Token& field,
                                           const pxr::VtValue& value) {
    auto* observer = namesLayers(field.GetString()) ? observerOf(path) : nullptr;
    if (!observer) return;
    std::set<std::string> before, named;
    addNamedAssets(data().Get(path, field), before);
    addNamedAssets(value, named);
    std::erase_if(named, [&](const std::string& asset) { return before.contains(asset); });
    if (!named.empty()) observer->layersNamed(named);
}
void SdfLayerStore::Delegate::notifyLayers(const Path& path, const Token& field,
                                           const ConstValue& value) {
    pxr::VtValue taken;
    if (namesLayers(field.GetString()) && value.GetValue(&taken)) notifyLayers(path, field, taken);
}

void SdfLayerStore::Delegate::notifyChildren(const Path& parent, const Token& field,
                                             bool appended) {
    auto* observer = observerOf(parent);
    const bool ofModel = std::ranges::any_of(
        kChildLists, [&](ChildList list) { return childrenField(list) == field; });
    if (observer && ofModel) observer->childrenChanged(parent, field, appended);
}

void SdfLayerStore::Delegate::_OnSetLayer(const pxr::SdfLayerHandle& layer) {
    Base::_OnSetLayer(layer);
    layer_ = layer;
    pxr::TfNotice::Revoke(changedKey_);
    if (layer)
        changedKey_ =
            pxr::TfNotice::Register(pxr::TfCreateWeakPtr(this), &Delegate::onLayerChanged, layer);
}

void SdfLayerStore::Delegate::_OnSetField(const Path& path, const Token& field,
                                          const pxr::VtValue& value) {
    Base::_OnSetField(path, field, value);
    notifyArray(path, field, std::nullopt, value);
    notifyClips(path, field, value);
    notifyLayers(path, field, value);
    notifyField(path, field);
}
void SdfLayerStore::Delegate::_OnSetField(const Path& path, const Token& field,
                                          const ConstValue& value) {
    Base::_OnSetField(path, field, value);
    notifyArray(path, field, std::nullopt, value);
    notifyClips(path, field, value);
    notifyLayers(path, field, value);
    notifyField(path, field);
}

void SdfLayerStore::Delegate::_OnSetFieldDictValueByKey(const Path& path, const Token& field,
                                                        const Token& key,
                                                        const pxr::VtValue& value) {
    Base::_OnSetFieldDictValueByKey(path, field, key, value);
    notifyClips(path, field, value);
    if (auto* observer = observerOf(path)) observer->dictionaryKeyChanged(path, field, key);
}
void SdfLayerStore::Delegate::_OnSetFieldDictValueByKey(const Path& path, const Token& field,
                                                        const Token& key, const ConstValue& value) {
    Base::_OnSetFieldDictValueByKey(path, field, key, value);
    notifyClips(path, field, value);
    if (auto* observer = observerOf(path)) observer->dictionaryKeyChanged(path, field, key);
}

void SdfLayerStore::Delegate::_OnSetTimeSample(const Path& path, double time,
                                               const pxr::VtValue& value) {
    Base::_OnSetTimeSample(path, time, value);
    notifyArray(path, pxr::SdfFieldKeys->TimeSamples, time, value);
    if (auto* observer = observerOf(path)) observer->timeSampleChanged(path, time);
}
void SdfLayerStore::Delegate::_OnSetTimeSample(const Path& path, double time,
                                               const ConstValue& value) {
    Base::_OnSetTimeSample(path, time, value);
    notifyArray(path, pxr::SdfFieldKeys->TimeSamples, time, value);
    if (auto* observer = observerOf(path)) observer->timeSampleChanged(path, time);
}

void SdfLayerStore::Delegate::_OnCreateSpec(const Path& path, pxr::SdfSpecType type, bool inert) {
    Base::_OnCreateSpec(path, type, inert);
    auto* observer = observerOf(path);
    if (observer && specKind(type)) observer->specCreated(path, type);
}

void SdfLayerStore::Delegate::_OnDeleteSpec(const Path& path, bool inert) {
    Base::_OnDeleteSpec(path, inert);
    waiting.specDeleted(path);
    auto* observer = observerOf(path);
    if (observer && kind(path)) observer->specDeleted(path);
}

void SdfLayerStore::Delegate::_OnMoveSpec(const Path& from, const Path& to) {
    Base::_OnMoveSpec(from, to);
    waiting.specMoved(from, to);
    auto* observer = observerOf(from);
    if (observer && kind(from)) observer->specMoved(from, to);
}

void SdfLayerStore::Delegate::_OnPushChild(const Path& parent, const Token& field,
                                           const Token& child) {
    Base::_OnPushChild(parent, field, child);
    notifyChildren(parent, field, true);
}
void SdfLayerStore::Delegate::_OnPushChild(const Path& parent, const Token& field,
                                           const Path& child) {
    Base::_OnPushChild(parent, field, child);
    notifyChildren(parent, field, true);
}
void SdfLayerStore::Delegate::_OnPopChild(const Path& parent, const Token& field,
                                          const Token& child) {
    Base::_OnPopChild(parent, field, child);
    notifyChildren(parent, field, false);
}
void SdfLayerStore::Delegate::_OnPopChild(const Path& parent, const Token& field,
                                          const Path& child) {
    Base::_OnPopChild(parent, field, child);
    notifyChildren(parent, field, false);
}

}  // namespace usdlive::usd
