// Declares Prim, a handle of one prim of a Stage, and the predicates that select prims.
#pragma once

#include <pxr/base/tf/delegatedCountPtr.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/pcp/primIndex.h>
#include <pxr/usd/sdf/path.h>
#include <pxr/usd/sdf/types.h>

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "usdlive/client/usd/stage/ValueSite.h"

namespace usdlive::schema {
class PrimDefinition;
}

namespace usdlive::stage {

class Stage;
class PrimNode;
class Property;

void TfDelegatedCountIncrement(PrimNode* node) noexcept;
void TfDelegatedCountDecrement(PrimNode* node) noexcept;

/// Properties of a prim that the stage keeps, so that reading them needs no layer.
enum class PrimFlag : std::uint16_t {
    Active = 1 << 0,
    /// The payload of the prim, or of the nearest prim above that has a payload, is loaded.
    Loaded = 1 << 1,
    Defined = 1 << 2,  ///< the prim and all prims above it have "def" or "class"
    HasDefiningSpecifier = 1 << 3,
    Abstract = 1 << 4,  ///< the prim or a prim above it is a class
    Model = 1 << 5,
    Group = 1 << 6,
    Component = 1 << 7,
    Instance = 1 << 8,
    HasPayload = 1 << 9,
    PrototypeRoot = 1 << 10,
    InPrototype = 1 << 11,
    PseudoRoot = 1 << 12,
};
[[nodiscard]] constexpr std::uint16_t operator|(PrimFlag one, PrimFlag two) {
    return std::uint16_t(one) | std::uint16_t(two);
}
[[nodiscard]] constexpr std::uint16_t operator|(std::uint16_t flags, PrimFlag flag) {
    return std::uint16_t(flags | std::uint16_t(flag));
}

/// Selects the prims that a traversal visits. If a prim is not visited, the prims below it are not
/// visited either.
struct PrimPredicate {
    std::uint16_t mask = 0;   ///< the flags that are compared
    std::uint16_t wants = 0;  ///< the values that these flags must have
    /// If true, the traversal enters instances. The prims inside them are instance proxies.
    bool instanceProxies = false;

    /// Selects active, defined and loaded prims that are not abstract. This is the default
    /// predicate of UsdStage.
    [[nodiscard]] static constexpr PrimPredicate normal() {
        const auto wants = PrimFlag::Active | PrimFlag::Defined | PrimFlag::Loaded;
        return {wants | PrimFlag::Abstract, wants};
    }
    [[nodiscard]] static constexpr PrimPredicate all() { return {}; }
    [[nodiscard]] constexpr PrimPredicate with(PrimFlag flag, bool value = true) const {
        PrimPredicate more = *this;
        more.mask = more.mask | flag;
        more.wants = value ? more.wants | flag : std::uint16_t(more.wants & ~std::uint16_t(flag));
        return more;
    }
    [[nodiscard]] constexpr PrimPredicate throughInstances() const {
        PrimPredicate more = *this;
        more.instanceProxies = true;
        return more;
    }
    [[nodiscard]] constexpr bool matches(std::uint16_t flags) const {
        return (flags & mask) == wants;
    }
};

/// Composed fields by name, in dictionary order.
using Metadata = std::map<pxr::TfToken, pxr::VtValue>;

struct VariantSet {
    std::string name, selection;  ///< `selection` is "" if nothing is selected
    std::vector<std::string> options;
};

/// A handle of one prim of a stage. It is cheap to copy.
///
/// A handle stays valid while its prim exists, also when the prim is composed again. It becomes
/// invalid when the prim or its stage is removed; a prim that is created later at the same path
/// needs a new handle.
///
/// Call only isValid(), operator bool and comparison on an invalid prim. Threads: see Stage.
class Prim {
public:
    Prim() = default;

    [[nodiscard]] bool isValid() const;
    explicit operator bool() const { return isValid(); }

    [[nodiscard]] Stage& stage() const;
    [[nodiscard]] pxr::SdfPath path() const;
    [[nodiscard]] pxr::TfToken name() const;
    /// Returns the parent. Returns an invalid prim for the pseudo-root, a prototype and an invalid
    /// prim.
    [[nodiscard]] Prim parent() const;

    [[nodiscard]] std::uint16_t flags() const;
    [[nodiscard]] bool has(PrimFlag flag) const { return flags() & std::uint16_t(flag); }
    [[nodiscard]] bool isInstanceProxy() const { return !proxyPath_.IsEmpty(); }
    [[nodiscard]] bool isPseudoRoot() const { return has(PrimFlag::PseudoRoot); }
    [[nodiscard]] bool isInstance() const { return has(PrimFlag::Instance); }
    /// Returns the prim whose children an instance shows. Returns an invalid prim if this prim is
    /// not an instance.
    [[nodiscard]] Prim prototype() const;

    [[nodiscard]] pxr::SdfSpecifier specifier() const;
    [[nodiscard]] pxr::TfToken typeName() const;
    [[nodiscard]] pxr::TfToken kind() const;
    /// Returns the API schemas that the layers list. appliedSchemas() also includes the API schemas
    /// that these schemas and the type add.
    [[nodiscard]] const pxr::TfTokenVector& authoredSchemas() const;
    [[nodiscard]] const pxr::TfTokenVector& appliedSchemas() const;
    /// Returns the properties and metadata that the prim's schemas define. The reference is valid
    /// as long as the stage.
    [[nodiscard]] const schema::PrimDefinition& definition() const;
    [[nodiscard]] std::vector<VariantSet> variantSets() const;

    /// Returns the matching children in order. An instance has no children unless the predicate
    /// enters instances. An instance inside an instance of the same prototype never has children,
    /// so that a traversal always ends.
    [[nodiscard]] std::vector<Prim> children(
        const PrimPredicate& predicate = PrimPredicate::normal()) const;
    [[nodiscard]] Prim child(const pxr::TfToken& name) const;
    /// Returns the child of this name, with any flags, or an invalid prim.

    /// Returns the property names in order: the authored ones and, unless `onlyAuthored`, the ones
    /// that the schemas define.
    [[nodiscard]] pxr::TfTokenVector propertyNames(bool onlyAuthored = false) const;
    [[nodiscard]] std::vector<Property> properties(bool onlyAuthored = false) const;
    /// Returns an invalid property if neither a layer nor a schema has it.
    [[nodiscard]] Property property(const pxr::TfToken& name) const;

    /// Returns one composed field. Returns an empty value if no layer has it. The pseudo-root has
    /// the metadata of the stage.
    [[nodiscard]] pxr::VtValue metadata(const pxr::TfToken& field,
                                        AssetPaths assetPaths = AssetPaths::Resolved) const;
    /// Returns all composed fields that the layers have. If a field composes to nothing, its value
    /// is empty.
    [[nodiscard]] Metadata authoredMetadata(AssetPaths assetPaths = AssetPaths::Resolved) const;

    /// Returns the prim index, which describes how the prim is composed. For an instance proxy it
    /// is the index of the prototype's prim. A prototype itself returns an empty index, because its
    /// properties belong to the instances. The reference is valid until the stage changes.
    [[nodiscard]] const pxr::PcpPrimIndex& primIndex() const;

    bool operator==(const Prim&) const = default;

private:
    friend class StageState;
    friend class Property;
    friend class Stage;
    Prim(PrimNode* node, pxr::SdfPath proxyPath);
    [[nodiscard]] pxr::TfTokenVector ordered(pxr::TfTokenVector names) const;
    [[nodiscard]] bool isInsideItself() const;
    [[nodiscard]] pxr::VtValue metadataOfStage(const pxr::TfToken& field,
                                               AssetPaths assetPaths) const;
    [[nodiscard]] std::function<pxr::SdfPath(const pxr::SdfPath&)> mapper() const;
    [[nodiscard]] std::vector<std::pair<pxr::SdfPath, pxr::SdfPath>> sources() const;

    pxr::TfDelegatedCountPtr<PrimNode> node_;
    pxr::SdfPath proxyPath_;  // the path of an instance proxy; otherwise empty
};

}  // namespace usdlive::stage
