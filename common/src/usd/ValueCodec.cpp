// Encodes and decodes whole fields of USD, including dictionaries, samples, list ops and maps.
#include "usdlive/common/usd/ValueCodec.h"

#include <pxr/base/tf/enum.h>
#include <pxr/base/tf/token.h>
#include <pxr/base/vt/dictionary.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/path.h>
#include <pxr/usd/sdf/schema.h>
#include <pxr/usd/sdf/types.h>

#include <cmath>
#include <set>

#include "LeafCodec.h"
#include "usdlive/common/core/Utf8.h"

namespace usdlive::usd {

using pxr::VtValue;

namespace {

Error within(const Error& error, const std::string& where) {
    return {error.code, where + ": " + error.message};
}

// ------------------------------------------------------------------ encoding

Result<Dictionary> encodeDictionary(const pxr::VtDictionary& dictionary, BlobSink& blobs,
                                    std::size_t depth);

Result<Dictionary::Entry> encodeEntry(const VtValue& value, BlobSink& blobs, std::size_t depth) {
    if (value.IsHolding<pxr::VtDictionary>()) {
        auto nested = encodeDictionary(value.UncheckedGet<pxr::VtDictionary>(), blobs, depth + 1);
        if (!nested) return tl::unexpected(nested.error());
        return *std::move(nested);
    }
    auto leaf = encodeLeaf(value, blobs);
    if (!leaf) return tl::unexpected(leaf.error());
    return *std::move(leaf);
}

Result<Dictionary> encodeDictionary(const pxr::VtDictionary& dictionary, BlobSink& blobs,
                                    std::size_t depth) {
    if (depth > kMaxNesting)
        return fail(ErrorCode::UnsupportedValue, "dictionaries are nested too deeply");
    Dictionary result;
    for (const auto& [key, value] : dictionary) {
        if (!isUtf8(key)) return fail(ErrorCode::UnsupportedValue, "a dictionary key is not UTF-8");
        auto entry = encodeEntry(value, blobs, depth);
        if (!entry) return tl::unexpected(within(entry.error(), key));
        result.entries.emplace_hint(result.entries.end(), key, *std::move(entry));
    }
    return result;
}

Result<FieldValue> encodeTimeSamples(const pxr::SdfTimeSampleMap& map, BlobSink& blobs) {
    TimeSamples result;
    for (const auto& [time, value] : map) {
        if (!std::isfinite(time))
            return fail(ErrorCode::UnsupportedValue, "a time sample's time is not a finite number");
        auto leaf = encodeLeaf(value, blobs);
        if (!leaf) return tl::unexpected(within(leaf.error(), "time " + std::to_string(time)));
        result.samples.emplace_hint(result.samples.end(), time, *std::move(leaf));
    }
    return FieldValue(std::move(result));
}

Result<FieldValue> encodeSelection(const pxr::SdfVariantSelectionMap& selection, BlobSink& blobs) {
    Map result{ValueType::String, {}};
    for (const auto& [set, variant] : selection) {
        auto key = encodeLeaf(VtValue(set), blobs);
        auto value = encodeLeaf(VtValue(variant), blobs);
        if (!key) return tl::unexpected(key.error());
        if (!value) return tl::unexpected(value.error());
        result.entries.emplace_back(*std::move(key), *std::move(value));
    }
    return FieldValue(std::move(result));
}

template <class Pairs>
Result<FieldValue> encodeRelocates(const Pairs& relocates) {
    Map result{ValueType::Path, {}};
    std::set<pxr::SdfPath> sources;
    for (const auto& [from, to] : relocates) {
        if (!sources.insert(from).second)
            return fail(ErrorCode::UnsupportedValue,
                        from.GetAsString() + " is relocated more than once");
        for (const pxr::SdfPath& path : {from, to})
            if (!path.IsEmpty() && !path.IsAbsolutePath())
                return fail(ErrorCode::UnsupportedValue,
                            path.GetAsString() + " is a relative path");
        result.entries.emplace_back(pathValue(from.GetAsString()), pathValue(to.GetAsString()));
    }
    return FieldValue(std::move(result));
}

// `displayUnit` is the only field of Sdf with an enumeration that has names. It is sent as its
// name.
bool isUnit(const VtValue& value) {
    return value.IsHolding<pxr::TfEnum>() &&
           !pxr::SdfGetNameForUnit(value.UncheckedGet<pxr::TfEnum>()).empty();
}

// ------------------------------------------------------------------ decoding

Result<pxr::VtDictionary> decodeDictionary(const Dictionary& dictionary, BlobSource& blobs) {
    pxr::VtDictionary result;
    for (const auto& [key, entry] : dictionary.entries) {
        if (const auto* nested = std::get_if<Dictionary>(&entry)) {
            auto value = decodeDictionary(*nested, blobs);
            if (!value) return tl::unexpected(value.error());
            result[key] = VtValue::Take(*value);
        } else {
            auto value = decodeLeaf(std::get<Value>(entry), blobs);
            if (!value) return tl::unexpected(within(value.error(), key));
            result[key] = *std::move(value);
        }
    }
    return result;
}

Result<VtValue> decodeTimeSamples(const TimeSamples& samples, BlobSource& blobs) {
    pxr::SdfTimeSampleMap map;
    for (const auto& [time, sample] : samples.samples) {
        auto value = decodeLeaf(sample, blobs);
        if (!value) return tl::unexpected(within(value.error(), "time " + std::to_string(time)));
        map.emplace_hint(map.end(), time, *std::move(value));
    }
    return VtValue::Take(map);
}

Result<std::string> textIn(const Value& value, ValueType type) {
    const auto text = value.type() == type ? textOf(value) : std::nullopt;
    if (!text) return fail(ErrorCode::InvalidValue, "a map has an entry of another type");
    return std::string(*text);
}

Result<VtValue> decodeSelection(const Map& map) {
    pxr::SdfVariantSelectionMap selection;
    for (const auto& [key, value] : map.entries) {
        auto set = textIn(key, ValueType::String);
        auto variant = textIn(value, ValueType::String);
        if (!set) return tl::unexpected(set.error());
        if (!variant) return tl::unexpected(variant.error());
        selection.emplace(*std::move(set), *std::move(variant));
    }
    return VtValue::Take(selection);
}

Result<pxr::SdfRelocates> decodeRelocates(const Map& map) {
    pxr::SdfRelocates relocates;
    for (const auto& [key, value] : map.entries) {
        const auto from = textIn(key, ValueType::Path).and_then(parsePath);
        const auto to = textIn(value, ValueType::Path).and_then(parsePath);
        if (!from) return tl::unexpected(from.error());
        if (!to) return tl::unexpected(to.error());
        relocates.emplace_back(*from, *to);
    }
    return relocates;
}

Result<VtValue> decodeMap(const pxr::TfToken& field, const Map& map) {
    if (map.keyType == ValueType::String) return decodeSelection(map);
    if (map.keyType != ValueType::Path)
        return fail(ErrorCode::InvalidValue, "Sdf has no maps with such keys");
    auto relocates = decodeRelocates(map);
    if (!relocates) return tl::unexpected(relocates.error());
    if (field != pxr::SdfFieldKeys->Relocates) return VtValue::Take(*relocates);
    return VtValue(pxr::SdfRelocatesMap(relocates->begin(), relocates->end()));
}

Result<VtValue> decodeUnit(const Value& value) {
    const auto name = textOf(value).value_or("");
    const pxr::TfEnum unit = pxr::SdfGetUnitFromName(std::string(name));
    if (name.empty() || pxr::SdfGetNameForUnit(unit) != name)
        return fail(ErrorCode::InvalidValue, "unknown unit " + std::string(name));
    return VtValue(unit);
}

}  // namespace

Result<FieldValue> encodeValue(const VtValue& value, BlobSink& blobs) {
    const auto asField = [](auto content) { return FieldValue(std::move(content)); };
    if (value.IsHolding<pxr::VtDictionary>())
        return encodeDictionary(value.UncheckedGet<pxr::VtDictionary>(), blobs, 1).map(asField);
    if (value.IsHolding<pxr::SdfTimeSampleMap>())
        return encodeTimeSamples(value.UncheckedGet<pxr::SdfTimeSampleMap>(), blobs);
    if (value.IsHolding<pxr::SdfVariantSelectionMap>())
        return encodeSelection(value.UncheckedGet<pxr::SdfVariantSelectionMap>(), blobs);
    if (value.IsHolding<pxr::SdfRelocates>())
        return encodeRelocates(value.UncheckedGet<pxr::SdfRelocates>());
    if (value.IsHolding<pxr::SdfRelocatesMap>())
        return encodeRelocates(value.UncheckedGet<pxr::SdfRelocatesMap>());
    if (isUnit(value))
        return FieldValue(tokenValue(pxr::SdfGetNameForUnit(value.UncheckedGet<pxr::TfEnum>())));
    if (!value.IsEmpty() && isListOp(value.GetTypeid())) return encodeListOp(value).map(asField);
    return encodeLeaf(value, blobs).map(asField);
}

Result<VtValue> decodeValue(const pxr::TfToken& field, const FieldValue& value, BlobSource& blobs) {
    if (const auto* leaf = value.as<Value>()) {
        if (field == pxr::SdfFieldKeys->DisplayUnit && leaf->type() == ValueType::Token)
            return decodeUnit(*leaf);
        return decodeLeaf(*leaf, blobs);
    }
    if (const auto* dictionary = value.as<Dictionary>())
        return decodeDictionary(*dictionary, blobs).map([](pxr::VtDictionary decoded) {
            return VtValue::Take(decoded);
        });
    if (const auto* samples = value.as<TimeSamples>()) return decodeTimeSamples(*samples, blobs);
    if (const auto* list = value.as<ListOp>()) return decodeListOp(*list);
    return decodeMap(field, *value.as<Map>());
}

}  // namespace usdlive::usd
