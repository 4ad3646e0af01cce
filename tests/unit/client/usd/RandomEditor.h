// Edits layers at random through Sdf.
#pragma once

#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/valueTypeName.h>

#include <random>
#include <string>
#include <vector>

namespace usdlive::tests {

/// Edits a layer at random through Sdf's API, like an editor: each kind of spec and field,
/// namespace edits, whole replacements. It uses a seed, so that a run can be repeated.
class RandomEditor {
public:
    explicit RandomEditor(pxr::SdfLayerRefPtr layer, unsigned seed)
        : layer_(std::move(layer)), random_(seed) {}

    /// Makes one edit and returns its description.
    std::string step();

private:
    using Path = pxr::SdfPath;

    std::size_t pick(std::size_t count) { return count == 0 ? 0 : random_() % count; }
    bool chance(std::size_t in) { return pick(in) == 0; }
    std::string name();
    std::vector<Path> paths(bool prims, bool properties, bool attributesOnly = false) const;
    Path prim(bool orVariant = false);
    Path anyPrimOrRoot();
    Path property();
    Path attribute();
    static const std::vector<pxr::SdfValueTypeName>& types();
    pxr::VtValue value(std::size_t type);
    pxr::VtValue value();
    pxr::VtValue valueFor(const Path& attribute);

    std::string createPrim();
    std::string createProperty();
    std::string remove();
    std::string namespaceEdit();
    std::string renamePrim();
    std::string orderChildren();
    std::string setValue();
    std::string setSample();
    std::string setDictionary();
    std::string setTargets();
    std::string setArcs();
    std::string setVariants();
    std::string setLayerFields();
    std::string setPrimFields();
    std::string copy();
    std::string replace();

    pxr::SdfLayerRefPtr layer_;
    std::mt19937 random_;
};

}  // namespace usdlive::tests
