// The provider `generator`: makes a parametric scene, for example a grid of instances or a town of
// blocks.
//
// providerArgs:
// - preset: "village" or "city", shape, size, spacing and seed in one argument; the single ones win
// - shape: "grid" (default), "spiral" or "buildings"
// - size: "COLUMNSxROWSxLEVELS", or as three arguments columns, rows, levels (default 10x10x1)
// - spacing: distance of two neighbours (default 2)
// - seed: of the heights of buildings (default 1)
// - prototype: an asset, relative to the payload's, that each item references as an instance;
//   without it, each item is a Cube
#include <pxr/base/gf/vec3d.h>
#include <pxr/base/gf/vec3f.h>
#include <pxr/base/vt/array.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/reference.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <string_view>
#include <vector>

#include "usdlive/edf/DataProvider.h"

namespace {

using pxr::GfVec3d;
using pxr::SdfPath;
using pxr::TfToken;
using pxr::VtValue;
using usdlive::edf::EdfArguments;
using usdlive::edf::EdfDataParameters;
using usdlive::edf::IEdfSourceData;

constexpr int kMaxItems = 10'000;

struct Layout {
    std::string shape = "grid";
    std::array<int, 3> size{10, 10, 1};  // columns, rows, levels
    double spacing = 2;
    int seed = 1;
    std::string prototype;

    [[nodiscard]] int count() const { return size[0] * size[1] * size[2]; }
};

template <class Number>
Number numberOf(const std::string& name, std::string_view text) {
    Number number{};
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
    if (error != std::errc() || end != text.data() + text.size())
        throw std::invalid_argument(name + " is '" + std::string(text) + "', which is no number");
    return number;
}

std::array<int, 3> sizeOf(const std::string& text) {
    std::array<int, 3> size{1, 1, 1};
    std::string_view left = text;
    for (int& side : size) {
        const auto end = std::min(left.find('x'), left.size());
        side = numberOf<int>("size", left.substr(0, end));
        if (end == left.size()) return size;
        left.remove_prefix(end + 1);
    }
    throw std::invalid_argument("size is '" + text + "'; it must be like 4x5x6");
}

Layout presetNamed(const std::string& name) {
    if (name == "village") return {"buildings", {8, 8, 1}, 20, 3, ""};
    if (name == "city") return {"buildings", {50, 40, 1}, 30, 7, ""};
    throw std::invalid_argument("preset is '" + name + "'; known are village and city");
}

// Sides are at least 0; more than kMaxItems are refused, because a scene without an end would look
// right.
void check(Layout& layout) {
    if (layout.shape != "grid" && layout.shape != "spiral" && layout.shape != "buildings")
        throw std::invalid_argument("shape is '" + layout.shape +
                                    "'; known are grid, spiral and buildings");
    if (!std::isfinite(layout.spacing)) throw std::invalid_argument("spacing is not finite");
    std::int64_t count = 1;
    for (int& side : layout.size) {
        side = std::max(side, 0);
        count = std::min<std::int64_t>(count * side, kMaxItems + 1);
        if (side > kMaxItems || count > kMaxItems)
            throw std::invalid_argument("size asks for more than " + std::to_string(kMaxItems) +
                                        " items");
    }
}

Layout layoutOf(const EdfArguments& arguments) {
    const auto at = [&](const char* name) {
        const auto found = arguments.find(name);
        return found == arguments.end() ? nullptr : &found->second;
    };
    Layout layout;
    if (const auto* text = at("preset")) layout = presetNamed(*text);
    if (const auto* text = at("shape")) layout.shape = *text;
    if (const auto* text = at("size")) layout.size = sizeOf(*text);
    if (const auto* text = at("columns")) layout.size[0] = numberOf<int>("columns", *text);
    if (const auto* text = at("rows")) layout.size[1] = numberOf<int>("rows", *text);
    if (const auto* text = at("levels")) layout.size[2] = numberOf<int>("levels", *text);
    if (const auto* text = at("spacing")) layout.spacing = numberOf<double>("spacing", *text);
    if (const auto* text = at("seed")) layout.seed = numberOf<int>("seed", *text);
    if (const auto* text = at("prototype")) layout.prototype = *text;
    check(layout);
    return layout;
}

std::string textOf(double number) {
    std::array<char, 32> text{};
    const auto end = std::to_chars(text.data(), text.data() + text.size(), number).ptr;
    return {text.data(), end};
}

// The same number for the same item on every machine (the finalizer of SplitMix64).
double randomOf(int seed, int item) {
    std::uint64_t bits = std::uint64_t(seed) * 0x9E3779B97F4A7C15ull + std::uint64_t(item);
    bits = (bits ^ (bits >> 30)) * 0xBF58476D1CE4E5B9ull;
    bits = (bits ^ (bits >> 27)) * 0x94D049BB133111EBull;
    return double((bits ^ (bits >> 31)) >> 11) / double(1ull << 53);
}

class GeneratorProvider final : public usdlive::edf::IEdfDataProvider {
public:
    explicit GeneratorProvider(const EdfDataParameters& parameters)
        : layout_(layoutOf(parameters.providerArgs)), isAnonymous_(parameters.assetPath.empty()) {}

    // Different ways to say the same layout become the same arguments, so that such payloads share
    // a layer.
    static EdfArguments ComposeArguments(const EdfArguments& metadata) {
        const Layout layout = layoutOf(metadata);
        EdfArguments composed{
            {"shape", layout.shape},
            {"size", std::to_string(layout.size[0]) + "x" + std::to_string(layout.size[1]) + "x" +
                         std::to_string(layout.size[2])},
            {"spacing", textOf(layout.spacing)}};
        if (layout.shape == "buildings") composed["seed"] = std::to_string(layout.seed);
        if (!layout.prototype.empty()) composed["prototype"] = layout.prototype;
        return composed;
    }

    bool Read(IEdfSourceData& data, std::string& why) override {
        if (isAnonymous_ && layout_.prototype.starts_with(".")) {
            why =
                "prototype is '" + layout_.prototype + "', which is relative to an anonymous layer";
            return false;
        }
        const SdfPath root("/Data");
        data.SetField(root, pxr::SdfFieldKeys->TypeName, VtValue(TfToken("Xform")));
        for (int item = 0; item < layout_.count() && !data.IsCancelled(); ++item)
            create(data, root, item);
        return true;
    }

private:
    void create(IEdfSourceData& data, const SdfPath& root, int item) const {
        const bool isInstance = !layout_.prototype.empty();
        const std::string name = "Item_" + std::to_string(item);
        const SdfPath path = root.AppendChild(TfToken(name));
        data.CreatePrim(root, name, pxr::SdfSpecifierDef, isInstance ? xform_ : cube_);
        if (isInstance) {
            data.SetField(path, pxr::SdfFieldKeys->Instanceable, VtValue(true));
            data.SetField(path, pxr::SdfFieldKeys->References, prototype_);
        } else {
            data.CreateAttribute(path, sizeName_, pxr::SdfValueTypeNames->Double,
                                 pxr::SdfVariabilityVarying, VtValue(1.0));
        }
        const auto [place, scale] = placeOf(item);
        data.CreateAttribute(path, translate_, pxr::SdfValueTypeNames->Double3,
                             pxr::SdfVariabilityVarying, VtValue(place));
        pxr::VtTokenArray order{translate_};
        if (layout_.shape == "buildings") {
            data.CreateAttribute(path, scale_, pxr::SdfValueTypeNames->Float3,
                                 pxr::SdfVariabilityVarying, VtValue(pxr::GfVec3f(scale)));
            order.push_back(scale_);
        }
        data.CreateAttribute(path, order_, pxr::SdfValueTypeNames->TokenArray,
                             pxr::SdfVariabilityUniform, VtValue(order));
    }

    // The place of an item, and its scale, which only buildings have.
    [[nodiscard]] std::pair<GfVec3d, GfVec3d> placeOf(int item) const {
        if (layout_.shape == "spiral") {
            const double angle = 2.399963229728653 * item;  // the golden angle
            const double radius = layout_.spacing * std::sqrt(double(item));
            return {{radius * std::cos(angle), 0, radius * std::sin(angle)}, GfVec3d(1)};
        }
        const int column = item % layout_.size[0], row = item / layout_.size[0] % layout_.size[1],
                  level = item / layout_.size[0] / layout_.size[1];
        GfVec3d place(column * layout_.spacing, level * layout_.spacing, row * layout_.spacing);
        if (layout_.shape == "grid") return {place, GfVec3d(1)};
        const double width = layout_.spacing * 0.7;
        const double height = width * (0.3 + 2.7 * randomOf(layout_.seed, item));
        place[1] += height / 2;
        return {place, {width, height, width}};
    }

    const Layout layout_;
    const bool isAnonymous_;
    const VtValue prototype_{
        pxr::SdfReferenceListOp::Create({pxr::SdfReference(layout_.prototype)})};
    const TfToken xform_{"Xform"}, cube_{"Cube"}, sizeName_{"size"},
        translate_{"xformOp:translate"}, scale_{"xformOp:scale"}, order_{"xformOpOrder"};
};

}  // namespace

EDF_DEFINE_DATAPROVIDER(GeneratorProvider, "EdfGeneratorProvider");
