// Writes composed values as JSON.
#include "cli/ComposedValue.h"

#include <pxr/base/gf/half.h>
#include <pxr/base/gf/matrix2d.h>
#include <pxr/base/gf/matrix3d.h>
#include <pxr/base/gf/matrix4d.h>
#include <pxr/base/gf/quatd.h>
#include <pxr/base/gf/quatf.h>
#include <pxr/base/gf/quath.h>
#include <pxr/base/gf/vec2d.h>
#include <pxr/base/gf/vec2f.h>
#include <pxr/base/gf/vec2h.h>
#include <pxr/base/gf/vec2i.h>
#include <pxr/base/gf/vec3d.h>
#include <pxr/base/gf/vec3f.h>
#include <pxr/base/gf/vec3h.h>
#include <pxr/base/gf/vec3i.h>
#include <pxr/base/gf/vec4d.h>
#include <pxr/base/gf/vec4f.h>
#include <pxr/base/gf/vec4h.h>
#include <pxr/base/gf/vec4i.h>
#include <pxr/base/tf/enum.h>
#include <pxr/base/tf/stringUtils.h>
#include <pxr/base/vt/array.h>
#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/sdf/assetPath.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/path.h>
#include <pxr/usd/sdf/pathExpression.h>
#include <pxr/usd/sdf/payload.h>
#include <pxr/usd/sdf/reference.h>
#include <pxr/usd/sdf/timeCode.h>
#include <pxr/usd/sdf/types.h>

#include <cmath>
#include <concepts>
#include <functional>
#include <nlohmann/json.hpp>
#include <typeindex>
#include <unordered_map>

#include "usdlive/common/core/Hash.h"

namespace usdlive::cli {

using nlohmann::json;
using pxr::VtArray;
using pxr::VtValue;

namespace {

template <class T>
concept Scalar = std::is_arithmetic_v<T> || std::same_as<T, pxr::GfHalf>;
template <class T>
concept Quaternion = requires(const T& value) { value.GetImaginary(); };

template <Scalar T>
json plain(T value) {
    if constexpr (std::integral<T>)
        return value;
    else
        return ComposedValue::number(double(value));
}

template <class T>
    requires(pxr::GfIsGfVec<T>::value)
json plain(const T& vector) {
    json list = json::array();
    for (std::size_t i = 0; i < T::dimension; ++i) list.push_back(plain(vector[i]));
    return list;
}

template <class T>
    requires(pxr::GfIsGfMatrix<T>::value)
json plain(const T& matrix) {
    json rows = json::array();
    for (std::size_t r = 0; r < T::numRows; ++r) {
        json row = json::array();
        for (std::size_t c = 0; c < T::numColumns; ++c) row.push_back(plain(matrix[r][c]));
        rows.push_back(std::move(row));
    }
    return rows;
}

template <Quaternion T>
json plain(const T& value) {
    json list = plain(value.GetImaginary());
    list.push_back(plain(value.GetReal()));
    return list;
}

template <class T>
json folded(const T* data, std::size_t count) {
    const ByteView bytes(reinterpret_cast<const std::uint8_t*>(data), count * sizeof(T));
    return {{"n", count}, {"sha256", sha256(bytes).hex()}};
}

// Writes JSON like Python's json.dumps: a space after each comma and colon, and ASCII only.
std::string asPython(const json& value) {
    std::string text;
    const bool object = value.is_object();
    if (!object && !value.is_array()) return value.dump(-1, ' ', true);
    for (auto at = value.begin(); at != value.end(); ++at) {
        if (!text.empty()) text += ", ";
        if (object) text += json(at.key()).dump(-1, ' ', true) + ": ";
        text += asPython(*at);
    }
    return object ? "{" + text + "}" : "[" + text + "]";
}

json foldedTexts(const json& items) {
    std::string text;
    for (const auto& item : items) {
        if (&item != &items.front()) text += "\n";
        text += item.is_string() ? item.get_ref<const std::string&>() : asPython(item);
    }
    return {{"n", items.size()}, {"sha256", sha256(asBytes(text)).hex()}};
}

using Writer = std::function<json(const VtValue&, const ComposedValue&, std::size_t fold)>;
using Writers = std::unordered_map<std::type_index, Writer>;

template <class... Ts>
void addPlain(Writers& writers) {
    (writers.emplace(typeid(Ts), [](const VtValue& value, const ComposedValue&,
                                    std::size_t) { return plain(value.UncheckedGet<Ts>()); }),
     ...);
    (writers.emplace(typeid(VtArray<Ts>),
                     [](const VtValue& value, const ComposedValue&, std::size_t fold) -> json {
                         const auto& array = value.UncheckedGet<VtArray<Ts>>();
                         if (array.size() > fold) return folded(array.cdata(), array.size());
                         json list = json::array();
                         for (const Ts& one : array) list.push_back(plain(one));
                         return list;
                     }),
     ...);
}

json text(const std::string& value, const ComposedValue&) { return value; }
json text(const pxr::TfToken& value, const ComposedValue&) { return value.GetString(); }
json text(const pxr::SdfPath& value, const ComposedValue&) { return value.GetAsString(); }
json text(const pxr::SdfTimeCode& value, const ComposedValue&) {
    return ComposedValue::number(value.GetValue());
}
json text(const pxr::SdfAssetPath& value, const ComposedValue& encode) {
    return {{"asset", value.GetAssetPath()}, {"resolved", encode.file(value.GetResolvedPath())}};
}
json text(const pxr::SdfPathExpression& value, const ComposedValue&) {
    return {{"pathExpression", value.GetText()}};
}

template <class Items>
json texts(const Items& values, const ComposedValue& encode, std::size_t fold) {
    json items = json::array();
    for (const auto& one : values) items.push_back(text(one, encode));
    return items.size() > fold ? foldedTexts(items) : items;
}

template <class T>
void addText(Writers& writers) {
    writers.emplace(typeid(T), [](const VtValue& value, const ComposedValue& encode, std::size_t) {
        return text(value.UncheckedGet<T>(), encode);
    });
    const auto list = []<class Items>(std::type_identity<Items>) {
        return [](const VtValue& value, const ComposedValue& encode, std::size_t fold) {
            return texts(value.UncheckedGet<Items>(), encode, fold);
        };
    };
    writers.emplace(typeid(VtArray<T>), list(std::type_identity<VtArray<T>>()));
    writers.emplace(typeid(std::vector<T>), list(std::type_identity<std::vector<T>>()));
}

// The format has arrays of the types of Sdf as text.
template <class T>
void addArrayText(Writers& writers, const char* name) {
    writers.insert_or_assign(typeid(VtArray<T>),
                             [name](const VtValue& value, const ComposedValue&, std::size_t) {
                                 return json{{"type", name}, {"text", pxr::TfStringify(value)}};
                             });
}

template <class ListOp>
void addListOp(Writers& writers) {
    writers.emplace(
        typeid(ListOp), [](const VtValue& value, const ComposedValue& encode, std::size_t) {
            const auto& operation = value.UncheckedGet<ListOp>();
            json out = json::object();
            const auto add = [&](const char* name, const typename ListOp::ItemVector& items,
                                 bool always = false) {
                if (items.empty() && !always) return;
                json list = json::array();
                for (const auto& item : items) list.push_back(encode(VtValue(item)));
                out[name] = std::move(list);
            };
            if (operation.IsExplicit()) {
                add("explicit", operation.GetExplicitItems(), true);
            } else {
                add("added", operation.GetAddedItems());
                add("prepended", operation.GetPrependedItems());
                add("appended", operation.GetAppendedItems());
                add("deleted", operation.GetDeletedItems());
                add("ordered", operation.GetOrderedItems());
            }
            return json{{"listOp", out}};
        });
}

Writers createWriters() {
    using namespace pxr;
    Writers writers;
    addPlain<bool, unsigned char, int, unsigned, std::int64_t, std::uint64_t, GfHalf, float, double,
             GfVec2h, GfVec2f, GfVec2d, GfVec2i, GfVec3h, GfVec3f, GfVec3d, GfVec3i, GfVec4h,
             GfVec4f, GfVec4d, GfVec4i, GfMatrix2d, GfMatrix3d, GfMatrix4d, GfQuath, GfQuatf,
             GfQuatd>(writers);
    addText<std::string>(writers);
    addText<TfToken>(writers);
    addText<SdfPath>(writers);
    addText<SdfTimeCode>(writers);
    addText<SdfAssetPath>(writers);
    addText<SdfPathExpression>(writers);
    addArrayText<SdfPath>(writers, "PathArray");
    addArrayText<SdfAssetPath>(writers, "AssetPathArray");
    addArrayText<SdfPathExpression>(writers, "PathExpressionArray");
    addListOp<SdfIntListOp>(writers);
    addListOp<SdfInt64ListOp>(writers);
    addListOp<SdfUIntListOp>(writers);
    addListOp<SdfUInt64ListOp>(writers);
    addListOp<SdfStringListOp>(writers);
    addListOp<SdfTokenListOp>(writers);
    addListOp<SdfPathListOp>(writers);
    const auto add = [&]<class T>(std::type_identity<T>, auto write) {
        writers.emplace(typeid(T),
                        [write](const VtValue& value, const ComposedValue& encode, std::size_t) {
                            return write(value.UncheckedGet<T>(), encode);
                        });
    };
    add(std::type_identity<SdfValueBlock>(),
        [](const auto&, const auto&) -> json { return {{"block", true}}; });
    add(std::type_identity<VtDictionary>(),
        [](const VtDictionary& dictionary, const ComposedValue& encode) -> json {
            json inner = json::object();
            for (const auto& [key, one] : dictionary) inner[key] = encode(one);
            return {{"dict", std::move(inner)}};
        });
    add(std::type_identity<SdfUnregisteredValue>(),
        [](const SdfUnregisteredValue& value, const ComposedValue& encode) -> json {
            return {{"unregistered", encode(value.GetValue())}};
        });
    add(std::type_identity<std::vector<VtValue>>(),
        [](const std::vector<VtValue>& values, const ComposedValue& encode) -> json {
            json list = json::array();
            for (const auto& one : values) list.push_back(encode(one));
            return list;
        });
    const auto addEnum = [&]<class E>(std::type_identity<E> type) {
        add(type, [](E value, const auto&) -> json { return TfEnum::GetDisplayName(value); });
    };
    addEnum(std::type_identity<SdfPermission>());
    addEnum(std::type_identity<SdfSpecifier>());
    addEnum(std::type_identity<SdfVariability>());
    return writers;
}

}  // namespace

ComposedValue::ComposedValue(const std::string& base, std::size_t fold) : fold_(fold) {
    std::error_code failed;
    if (!base.empty()) base_ = std::filesystem::weakly_canonical(base, failed);
}

json ComposedValue::number(double value) {
    if (std::isnan(value)) return "nan";
    if (std::isinf(value)) return value > 0 ? "inf" : "-inf";
    if (value == std::floor(value) && std::abs(value) < 9007199254740992.0)
        return std::int64_t(value);
    return value;
}

json ComposedValue::numbers(const std::vector<double>& values) const {
    return (*this)(VtValue(VtArray<double>(values.begin(), values.end())));
}

std::string ComposedValue::file(const std::string& path) const {
    if (path.empty() || base_.empty()) return path;
    const auto bracket = path.find('[');
    const std::filesystem::path head = path.substr(0, bracket);
    const std::string tail = bracket == std::string::npos ? "" : path.substr(bracket);
    if (!head.is_absolute()) return path;
    std::error_code failed;
    const auto relative = std::filesystem::weakly_canonical(head, failed).lexically_relative(base_);
    if (relative.empty() || *relative.begin() == "..") return path;
    return "$BASE/" + relative.string() + tail;
}

json ComposedValue::operator()(const VtValue& value) const {
    static const Writers writers = createWriters();
    if (value.IsEmpty()) return nullptr;
    const auto found = writers.find(value.GetTypeid());
    if (found != writers.end()) return found->second(value, *this, fold_);
    return {{"type", value.GetTypeName()}, {"text", pxr::TfStringify(value)}};
}

}  // namespace usdlive::cli
