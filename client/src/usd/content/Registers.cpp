// Reads, compares and writes the registers of a layer.
#include "usdlive/client/usd/content/Registers.h"

#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/sdf/proxyTypes.h>
#include <pxr/usd/sdf/schema.h>
#include <pxr/usd/sdf/types.h>

#include <set>
#include <span>

#include "usd/content/SpecEdits.h"
#include "usdlive/common/layer/NoBlobs.h"
#include "usdlive/common/usd/ValueCodec.h"

namespace usdlive::content {

using pxr::SdfLayerHandle;
using pxr::SdfPath;
using pxr::TfToken;
using pxr::VtDictionary;
using pxr::VtValue;

namespace {

using Keys = std::vector<std::string>;
using Parts = std::map<Part, VtValue>;

Sublayers sublayersOf(const SdfLayerHandle& layer) {
    const std::vector<std::string> paths = layer->GetSubLayerPaths();
    Sublayers sublayers;
    for (std::size_t i = 0; i < paths.size(); ++i)
        sublayers.push_back({paths[i], layer->GetSubLayerOffset(int(i))});
    return sublayers;
}

void writeSublayers(const SdfLayerHandle& layer, const Sublayers& sublayers) {
    std::vector<std::string> paths;
    for (const auto& sublayer : sublayers) paths.push_back(sublayer.path);
    layer->SetSubLayerPaths(paths);
    for (int i = 0; i < int(sublayers.size()); ++i)
        if (const auto& offset = sublayers[std::size_t(i)].offset;
            layer->GetSubLayerOffset(i) != offset)
            layer->SetSubLayerOffset(offset, i);
}

VtValue readField(const SdfLayerHandle& layer, const SdfPath& path, const TfToken& field) {
    if (field != pxr::SdfFieldKeys->SubLayers) return layer->GetField(path, field);
    return layer->HasField(path, field) ? VtValue(sublayersOf(layer)) : VtValue();
}

// An empty dictionary inside another one counts as an entry.
void flatten(const VtDictionary& dictionary, Keys& keys, Parts& parts) {
    for (const auto& [key, value] : dictionary) {
        keys.push_back(key);
        const bool isGroup =
            value.IsHolding<VtDictionary>() && !value.UncheckedGet<VtDictionary>().empty();
        if (isGroup)
            flatten(value.UncheckedGet<VtDictionary>(), keys, parts);
        else
            parts.emplace(keys, value);
        keys.pop_back();
    }
}

Parts partsOf(const VtValue& value) {
    Parts parts;
    if (value.IsHolding<pxr::SdfTimeSampleMap>()) {
        for (const auto& [time, sample] : value.UncheckedGet<pxr::SdfTimeSampleMap>())
            parts.emplace(time, sample);
    } else if (value.IsHolding<VtDictionary>()) {
        Keys keys;
        flatten(value.UncheckedGet<VtDictionary>(), keys, parts);
    } else if (value.IsHolding<pxr::SdfVariantSelectionMap>()) {
        for (const auto& [set, variant] : value.UncheckedGet<pxr::SdfVariantSelectionMap>())
            parts.emplace(Keys{set}, VtValue(variant));
    } else if (value.IsHolding<pxr::SdfRelocatesMap>()) {
        for (const auto& [from, to] : value.UncheckedGet<pxr::SdfRelocatesMap>())
            parts.emplace(Keys{from.GetString()}, VtValue(to));
    } else if (!value.IsEmpty()) {
        parts.emplace(std::monostate(), value);
    }
    return parts;
}

// Also erases a dictionary that loses its last entry.
void setKey(VtDictionary& dictionary, std::span<const std::string> keys, const VtValue& value) {
    if (keys.size() > 1) {
        auto inner = dictionary[keys.front()].GetWithDefault<VtDictionary>();
        setKey(inner, keys.subspan(1), value);
        if (inner.empty())
            dictionary.erase(keys.front());
        else
            dictionary[keys.front()] = VtValue::Take(inner);
    } else if (value.IsEmpty()) {
        dictionary.erase(keys.front());
    } else {
        dictionary[keys.front()] = value;
    }
}

template <class Map>
void setEntry(Map& map, const typename Map::key_type& key, const VtValue& value) {
    map.erase(key);
    if (!value.IsEmpty()) map.emplace(key, value.Get<typename Map::mapped_type>());
}

template <class Map, class Change>
void changeMap(const SdfLayerHandle& layer, const SdfPath& path, const TfToken& field,
               const Change& change) {
    auto map = layer->GetField(path, field).GetWithDefault<Map>();
    change(map);
    if (map.empty())
        layer->EraseField(path, field);
    else
        layer->SetField(path, field, VtValue::Take(map));
}

void writeKey(const SdfLayerHandle& layer, const SdfPath& path, const TfToken& field,
              const Keys& keys, const VtValue& value) {
    if (field == pxr::SdfFieldKeys->VariantSelection)
        changeMap<pxr::SdfVariantSelectionMap>(
            layer, path, field, [&](auto& map) { setEntry(map, keys.front(), value); });
    else if (field == pxr::SdfFieldKeys->Relocates)
        changeMap<pxr::SdfRelocatesMap>(
            layer, path, field, [&](auto& map) { setEntry(map, SdfPath(keys.front()), value); });
    else
        changeMap<VtDictionary>(layer, path, field,
                                [&](auto& dictionary) { setKey(dictionary, keys, value); });
}

void writeField(const SdfLayerHandle& layer, const SdfPath& path, const TfToken& field,
                const VtValue& value) {
    if (field == pxr::SdfFieldKeys->SubLayers)
        writeSublayers(layer, value.GetWithDefault<Sublayers>());
    else if (field == pxr::SdfFieldKeys->TargetPaths || field == pxr::SdfFieldKeys->ConnectionPaths)
        setListOp(layer, path, field, value);
    else if (value.IsEmpty())
        layer->EraseField(path, field);
    else
        layer->SetField(path, field, value);
}

const VtValue& valueIn(const auto& map, const auto& key) {
    static const VtValue absent;
    const auto found = map.find(key);
    return found == map.end() ? absent : found->second;
}

void addChanges(const SdfPath& path, const TfToken& field, const VtValue& before,
                const VtValue& after, std::vector<Change>& changes) {
    const Parts old = partsOf(before), now = partsOf(after);
    std::set<Part> parts;
    for (const auto& [part, value] : old) parts.insert(part);
    for (const auto& [part, value] : now) parts.insert(part);
    for (const auto& part : parts)
        if (const auto &from = valueIn(old, part), &to = valueIn(now, part); !isSame(from, to))
            changes.push_back({path, field, part, from, to});
}

}  // namespace

Fields readFields(const SdfLayerHandle& layer, const SdfPath& path) {
    Fields fields;
    if (!layer->HasSpec(path)) return fields;
    for (const TfToken& field : layer->ListFields(path))
        if (field != pxr::SdfFieldKeys->SubLayerOffsets && !layer->GetSchema().HoldsChildren(field))
            if (auto value = readField(layer, path, field); !value.IsEmpty())
                fields.emplace(field, std::move(value));
    return fields;
}

VtValue readRegister(const SdfLayerHandle& layer, const SdfPath& path, const TfToken& field,
                     const Part& part) {
    return valueIn(partsOf(readField(layer, path, field)), part);
}

void writeRegister(const SdfLayerHandle& layer, const SdfPath& path, const TfToken& field,
                   const Part& part, const VtValue& value) {
    if (const auto* keys = std::get_if<Keys>(&part))
        writeKey(layer, path, field, *keys, value);
    else if (const auto* time = std::get_if<double>(&part); time && value.IsEmpty())
        layer->EraseTimeSample(path, *time);
    else if (time)
        layer->SetTimeSample(path, *time, value);
    else
        writeField(layer, path, field, value);
}

bool isSame(const VtValue& left, const VtValue& right) {
    if (left == right) return true;
    if (left.IsEmpty() || left.GetTypeid() != right.GetTypeid()) return false;
    if (left == left) return false;
    NoBlobs blobs;  // a NaN differs from itself, but its bytes do not
    const auto bytes = usd::encodeValue(left, blobs);
    return bytes && bytes == usd::encodeValue(right, blobs);
}

std::vector<Change> changesBetween(const SdfPath& path, const Fields& before, const Fields& after) {
    std::vector<Change> changes;
    for (const auto& [field, value] : before)
        addChanges(path, field, value, valueIn(after, field), changes);
    for (const auto& [field, value] : after)
        if (!before.contains(field)) addChanges(path, field, VtValue(), value, changes);
    return changes;
}

}  // namespace usdlive::content
