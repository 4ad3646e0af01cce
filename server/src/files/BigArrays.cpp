// Writes layers with big arrays as text, part by part.
#include "files/BigArrays.h"

#include <pxr/base/tf/stringUtils.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/attributeSpec.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <fstream>

#include "files/BlobBridge.h"
#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/usd/LayerFill.h"
#include "usdlive/common/usd/TfComplaints.h"

namespace usdlive::server {

namespace {

constexpr std::size_t kBigBytes = 16 * 1024;
constexpr std::size_t kPartBytes = 256 * 1024;
constexpr std::size_t kCountBytes = 8;  // before the items of an array (V3)

// The placeholder for an array in the text: these two with the array's number in between.
constexpr std::string_view kMarkBegin = "usdlive-array-", kMarkEnd = "-";

// V2: returns true for items of a fixed size that are numbers in the text.
bool isNumeric(ValueType item) {
    return (item >= ValueType::Int && item <= ValueType::Double) ||
           (item >= ValueType::Matrix2d && item <= ValueType::Double4);
}

struct BigArray {
    Value value;
    std::string type;  // the attribute's type: "point3f[]"
};

/// Reads the items of an array, one part at a time.
class Parts {
public:
    Parts(const BigArray& array, const BlobStore& blobs) : array_(array), blobs_(blobs) {}

    /// Returns the next items as an array of their own, or nothing after the last.
    Result<std::optional<Value>> next() {
        if (itemBytes_ == 0)
            if (auto begun = begin(); !begun) return tl::unexpected(begun.error());
        const std::uint64_t count =
            std::min<std::uint64_t>(left_, std::max<std::size_t>(1, kPartBytes / itemBytes_));
        if (count == 0) return std::nullopt;
        auto items = read(offset_, std::size_t(count) * itemBytes_);
        if (!items) return tl::unexpected(items.error());
        offset_ += items->size();
        left_ -= count;
        Bytes part;
        appendNumber<std::uint64_t>(part, count);
        appendBytes(part, *items);
        return Value(array_.value.type(), std::move(part));
    }

private:
    Result<void> begin() {
        const auto head = read(0, kCountBytes);
        if (!head) return tl::unexpected(head.error());
        left_ = ByteReader(*head).u64();
        const std::uint64_t bytes = array_.value.size() - kCountBytes;
        if (left_ == 0 || bytes % left_ != 0)
            return fail(ErrorCode::InvalidValue, "a big array is damaged");
        itemBytes_ = std::size_t(bytes / left_);
        return {};
    }

    Result<Bytes> read(std::uint64_t offset, std::size_t count) const {
        Bytes bytes;
        if (array_.value.isBlob()) {
            auto found = blobs_.read(array_.value.hash(), offset, count);
            if (!found) return found;
            bytes = *std::move(found);
        } else {
            const ByteView all = array_.value.bytes();
            if (offset + count <= all.size()) {
                const ByteView part = all.subspan(std::size_t(offset), count);
                bytes.assign(part.begin(), part.end());
            }
        }
        if (bytes.size() != count)
            return fail(ErrorCode::BlobNotFound, "a part of a big value is missing");
        return bytes;
    }

    const BigArray& array_;
    const BlobStore& blobs_;
    std::size_t itemBytes_ = 0;
    std::uint64_t offset_ = kCountBytes, left_ = 0;
};

/// A layer without its big arrays.
class Outline {
public:
    explicit Outline(const LayerDoc& doc) : doc_(doc) {
        doc.visit([this](const LayerDoc::SpecView& spec) {
            if (spec.kind == SpecKind::Attribute) takeFrom(spec);
        });
    }

    const LayerDoc& doc() const { return doc_; }
    const std::vector<BigArray>& arrays() const { return arrays_; }

private:
    void takeFrom(const LayerDoc::SpecView& spec) {
        const std::string type = typeOf(spec);
        if (type.empty()) return;
        for (const auto& [name, field] : *spec.fields) {
            FieldValue changed = field;
            const std::size_t before = arrays_.size();
            if (Value* value = name == "default" ? changed.as<Value>() : nullptr)
                take(type, *value);
            else if (auto* samples = name == "timeSamples" ? changed.as<TimeSamples>() : nullptr)
                for (auto& [time, value] : samples->samples) take(type, value);
            if (arrays_.size() > before)
                (void)doc_.apply(spec.path, SetField{name, {}, std::move(changed)});
        }
    }

    // Returns an empty text for a type that OpenUSD does not know.
    static std::string typeOf(const LayerDoc::SpecView& spec) {
        const auto field = std::ranges::find(*spec.fields, "typeName",
                                             [](const auto& entry) { return entry.first; });
        const Value* value = field == spec.fields->end() ? nullptr : field->second.as<Value>();
        const auto text = value ? textOf(*value) : std::nullopt;
        if (!text) return {};
        const auto type = pxr::SdfSchema::GetInstance().FindType(pxr::TfToken(std::string(*text)));
        return type && type.IsArray() ? std::string(*text) : std::string();
    }

    void take(const std::string& type, Value& value) {
        const auto number = std::uint16_t(value.type());
        const bool isArray = (number & std::uint16_t(ValueType::ArrayFlag)) != 0;
        const ValueType item{std::uint16_t(number & ~std::uint16_t(ValueType::ArrayFlag))};
        if (!isArray || !isNumeric(item) || value.size() < kBigBytes) return;
        std::string mark = std::string(kMarkBegin) + std::to_string(arrays_.size());
        mark += kMarkEnd;
        arrays_.push_back({value, type});
        value = stringValue(mark);
    }

    LayerDoc doc_;
    std::vector<BigArray> arrays_;
};

/// The text of the outline, split at the arrays.
struct Pieces {
    std::vector<std::string_view> between;  // one more than there are arrays
    std::vector<std::size_t> arrays;        // numbers of the arrays, in the order of the text
};

// Returns nothing if a text of the layer itself looks like a placeholder.
std::optional<Pieces> cut(std::string_view text, std::size_t arrays) {
    const std::string begin = '"' + std::string(kMarkBegin), end = std::string(kMarkEnd) + '"';
    Pieces pieces;
    for (;;) {
        const std::size_t at = text.find(begin);
        pieces.between.push_back(text.substr(0, at));
        if (at == std::string_view::npos) break;
        text.remove_prefix(at + begin.size());
        std::size_t number = 0;
        const auto [last, problem] =
            std::from_chars(text.data(), text.data() + text.size(), number);
        text.remove_prefix(std::size_t(last - text.data()));
        if (problem != std::errc() || number >= arrays || !text.starts_with(end))
            return std::nullopt;
        text.remove_prefix(end.size());
        pieces.arrays.push_back(number);
    }
    auto sorted = pieces.arrays;
    std::ranges::sort(sorted);
    const bool eachOnce =
        sorted.size() == arrays && std::ranges::adjacent_find(sorted) == sorted.end();
    if (!eachOnce) return std::nullopt;
    return pieces;
}

std::optional<std::string> textOf(const pxr::SdfLayer& layer) {
    const usd::TfComplaints complaints;
    std::string text;
    if (!layer.ExportToString(&text) || complaints.hasErrors()) return std::nullopt;
    return text;
}

// Checks the text with an empty array in each place.
bool isReadable(const Pieces& pieces) {
    const usd::TfComplaints complaints;
    std::string text;
    for (const std::string_view piece : pieces.between) {
        if (!text.empty()) text += "[]";
        text += piece;
    }
    const auto layer = pxr::SdfLayer::CreateAnonymous(".usda");
    return layer->ImportFromString(text) && textOf(*layer) == text;
}

/// Returns the items as text without brackets, or nothing if OpenUSD does not read the same items
/// from it.
std::optional<std::string> textOf(const Value& part, const std::string& type, BlobSource& blobs) {
    const usd::TfComplaints complaints;
    const auto value = usd::decodeLeaf(part, blobs);
    if (!value) return std::nullopt;
    std::string text = pxr::TfStringify(*value);
    if (text.size() < 2 || text.front() != '[' || text.back() != ']') return std::nullopt;
    const auto layer = pxr::SdfLayer::CreateAnonymous(".usda");
    const std::string file = "#usda 1.0\ndef \"a\"\n{\n    " + type + " a = " + text + "\n}\n";
    if (!layer->ImportFromString(file)) return std::nullopt;
    const auto attribute = layer->GetAttributeAtPath(pxr::SdfPath("/a.a"));
    if (!attribute) return std::nullopt;
    const pxr::VtValue read = attribute->GetDefaultValue();
    BlobNames names;
    const auto encoded = usd::encodeLeaf(read, names);
    // NaNs may have other bits afterwards, so equal text is enough for them.
    const bool same = encoded && encoded->type() == part.type() &&
                      (*encoded == part || pxr::TfStringify(read) == text);
    if (!same) return std::nullopt;
    return text.substr(1, text.size() - 2);
}

/// Returns false if a part cannot be checked.
Result<bool> writeArray(std::ostream& out, const BigArray& array, BlobStore& store) {
    Parts parts(array, store);
    StoredBlobs blobs(store);
    out << '[';
    for (bool first = true;; first = false) {
        const auto part = parts.next();
        if (!part) return tl::unexpected(part.error());
        if (!*part) break;
        const auto text = textOf(**part, array.type, blobs);
        if (!text) return false;
        if (!first) out << ", ";
        out << *text;
    }
    out << ']';
    return true;
}

}  // namespace

Result<bool> writeTextInParts(const std::filesystem::path& file, const LayerDoc& doc,
                              BlobStore& blobs) {
    const Outline outline(doc);
    const auto& arrays = outline.arrays();
    if (arrays.empty()) return false;
    StoredBlobs source(blobs);
    const auto layer = usd::makeLayer(outline.doc(), source, "usda");
    if (!layer) return tl::unexpected(layer.error());
    const auto text = textOf(**layer);
    const auto pieces = text ? cut(*text, arrays.size()) : std::nullopt;
    if (!pieces || !isReadable(*pieces)) return false;

    errno = 0;
    std::ofstream out(file, std::ios::binary | std::ios::trunc);
    for (std::size_t index = 0; out && index < pieces->between.size(); ++index) {
        out << pieces->between[index];
        if (index == pieces->arrays.size()) break;
        const auto written = writeArray(out, arrays[pieces->arrays[index]], blobs);
        if (!written || !*written) return written;
    }
    out.close();
    if (!out) return fail(ErrorCode::SaveFailed, std::strerror(errno));
    return true;
}

}  // namespace usdlive::server
