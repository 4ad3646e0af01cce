// Records writes to the delegate layer.
#include "usd/layers/DelegateWrites.h"

#include <pxr/base/vt/dictionary.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/abstractData.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <utility>

#include "usdlive/common/usd/SdfLayerStore.h"

namespace usdlive::layers {

namespace {

// Collects the key paths of `before` that `after` does not have, joined by ':'.
void collectErased(const pxr::VtDictionary& before, const pxr::VtValue& after,
                   const std::string& prefix, std::vector<pxr::TfToken>& erased) {
    static const pxr::VtDictionary none;
    const auto& left =
        after.IsHolding<pxr::VtDictionary>() ? after.UncheckedGet<pxr::VtDictionary>() : none;
    for (const auto& [key, value] : before) {
        const auto found = left.find(key);
        const pxr::VtValue now = found == left.end() ? pxr::VtValue() : found->second;
        if (value.IsHolding<pxr::VtDictionary>())
            collectErased(value.UncheckedGet<pxr::VtDictionary>(), now, prefix + key + ":", erased);
        else if (now.IsEmpty())
            erased.emplace_back(prefix + key);
    }
}

}  // namespace

DelegateWrites::Taken DelegateWrites::take() {
    Taken taken{std::exchange(namespaceEdits_, {}), std::exchange(specs_, {})};
    std::erase_if(taken.specs, [](const Spec& spec) { return spec.path.IsEmpty(); });
    index_.clear();
    return taken;
}

void DelegateWrites::contentReplaced() {
    if (ignoring_) return;
    (void)take();
    const auto layer = _GetLayer();
    layer->Traverse(Path::AbsoluteRootPath(), [&](const Path& path) {
        spec(path).created = path != Path::AbsoluteRootPath();
        for (const Token& name : layer->ListFields(path))
            if (isNoted(path, name)) {
                auto& noted = field(path, name);
                noted.whole = true;
                noted.existed = false;
            }
    });
}

bool DelegateWrites::has(const Path& path, const Token& field) const {
    const auto spec = index_.find(path);
    return spec != index_.end() &&
           std::ranges::any_of(specs_[spec->second].fields,
                               [&](const Field& one) { return one.name == field; });
}

bool DelegateWrites::isNoted(const Path& path, const Token& field) const {
    if (ignoring_ || path.ContainsTargetPath()) return false;
    if (path == Path::AbsoluteRootPath()) return field == pxr::SdfFieldKeys->LayerRelocates;
    return field == pxr::SdfFieldKeys->Default || !usd::isStructural(field);
}

DelegateWrites::Spec& DelegateWrites::spec(const Path& path) {
    const auto [entry, inserted] = index_.try_emplace(path, specs_.size());
    if (inserted) specs_.push_back({path, false, {}});
    return specs_[entry->second];
}

DelegateWrites::Field& DelegateWrites::field(const Path& path, const Token& name) {
    auto& fields = spec(path).fields;
    for (auto& field : fields)
        if (field.name == name) return field;
    fields.push_back({name, _GetLayerData()->Has(path, name), false, {}, {}});
    return fields.back();
}

void DelegateWrites::noteField(const Path& path, const Token& name, const pxr::VtValue& value) {
    if (!isNoted(path, name)) return;
    auto& noted = field(path, name);
    if (noted.existed && name != pxr::SdfFieldKeys->Default) {
        pxr::VtValue before;
        if (_GetLayerData()->Has(path, name, &before) && before.IsHolding<pxr::VtDictionary>())
            collectErased(before.UncheckedGet<pxr::VtDictionary>(), value, "", noted.keyPaths);
    }
    noted.whole = true;
}

void DelegateWrites::noteKey(const Path& path, const Token& name, const Token& keyPath) {
    if (!isNoted(path, name)) return;
    auto& keys = field(path, name).keyPaths;
    if (std::ranges::find(keys, keyPath) == keys.end()) keys.push_back(keyPath);
}

void DelegateWrites::noteTime(const Path& path, double time) {
    if (ignoring_) return;
    auto& times = field(path, pxr::SdfFieldKeys->TimeSamples).times;
    // A drag sets the same time repeatedly. The caller of take() removes the remaining duplicates.
    if (times.empty() || times.back() != time) times.push_back(time);
}

void DelegateWrites::forgetBelow(const Path& path) {
    std::erase_if(index_, [&](const auto& entry) {
        if (!entry.first.HasPrefix(path)) return false;
        specs_[entry.second].path = Path();
        return true;
    });
}

void DelegateWrites::_OnSetField(const Path& path, const Token& field, const pxr::VtValue& value) {
    Base::_OnSetField(path, field, value);
    noteField(path, field, value);
}
void DelegateWrites::_OnSetField(const Path& path, const Token& field, const Const& value) {
    Base::_OnSetField(path, field, value);
    if (field == pxr::SdfFieldKeys->Default) return noteField(path, field, {});
    pxr::VtValue held;
    if (value.GetValue(&held)) noteField(path, field, held);
}
void DelegateWrites::_OnSetFieldDictValueByKey(const Path& path, const Token& field,
                                               const Token& keyPath, const pxr::VtValue& value) {
    Base::_OnSetFieldDictValueByKey(path, field, keyPath, value);
    noteKey(path, field, keyPath);
}
void DelegateWrites::_OnSetFieldDictValueByKey(const Path& path, const Token& field,
                                               const Token& keyPath, const Const& value) {
    Base::_OnSetFieldDictValueByKey(path, field, keyPath, value);
    noteKey(path, field, keyPath);
}
void DelegateWrites::_OnSetTimeSample(const Path& path, double time, const pxr::VtValue& value) {
    Base::_OnSetTimeSample(path, time, value);
    noteTime(path, time);
}
void DelegateWrites::_OnSetTimeSample(const Path& path, double time, const Const& value) {
    Base::_OnSetTimeSample(path, time, value);
    noteTime(path, time);
}
void DelegateWrites::_OnCreateSpec(const Path& path, pxr::SdfSpecType type, bool inert) {
    Base::_OnCreateSpec(path, type, inert);
    if (!ignoring_ && !path.ContainsTargetPath()) spec(path).created = true;
}

void DelegateWrites::_OnDeleteSpec(const Path& path, bool inert) {
    Base::_OnDeleteSpec(path, inert);
    if (ignoring_ || path.ContainsTargetPath()) return;
    forgetBelow(path);
    // Prims without opinions are also removed by Sdf itself, so their removal is not an edit.
    if (!inert || path.IsPropertyPath()) namespaceEdits_.push_back({path, {}});
}

void DelegateWrites::_OnMoveSpec(const Path& from, const Path& to) {
    Base::_OnMoveSpec(from, to);
    if (ignoring_) return;
    std::vector<std::size_t> moved;
    std::erase_if(index_, [&](const auto& entry) {
        if (!entry.first.HasPrefix(from)) return false;
        moved.push_back(entry.second);
        return true;
    });
    for (const std::size_t at : moved) {
        specs_[at].path = specs_[at].path.ReplacePrefix(from, to, false);
        index_[specs_[at].path] = at;
    }
    namespaceEdits_.push_back({from, to});
}

}  // namespace usdlive::layers
