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

/// What is known of every prim without reading its layers again.
enum class PrimFlag : std::uint16_t {
    Active = 1 << 0,
    Loaded = 1 << 1,
    Defined = 1 << 2,  ///< it and all above it have "def" or "class"
    HasDefiningSpecifier = 1 << 3,
    Abstract = 1 << 4,  ///< it or a prim above is a class
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

/// Which prims a traversal visits. A prim that is not visited hides the prims below it.
struct PrimPredicate {
    std::uint16_t mask = 0;   ///< the flags that matter
    std::uint16_t wants = 0;  ///< what they must be
    /// Whether to enter instances, whose prims are then instance proxies.
    bool instanceProxies = false;

    /// Active, defined, loaded and not abstract.
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

/// Composed fields by name, in the order of a dictionary.
using Metadata = std::map<pxr::TfToken, pxr::VtValue>;

struct VariantSet {
    std::string name, selection;  ///< no selection: ""
    std::vector<std::string> options;
};

/// A prim of a stage. A handle: cheap to copy, and invalid once the prim, or its stage, is gone. A
/// prim that is composed again at the same path keeps its handles.
///
/// All but isValid(), operator bool and comparison need a valid one.
class Prim {
public:
    Prim() = default;

    [[nodiscard]] bool isValid() const;
    explicit operator bool() const { return isValid(); }

    [[nodiscard]] Stage& stage() const;
    [[nodiscard]] pxr::SdfPath path() const;
    [[nodiscard]] pxr::TfToken name() const;
    /// The pseudo-root, a prototype and an invalid prim have none: it is invalid.
    [[nodiscard]] Prim parent() const;

    [[nodiscard]] std::uint16_t flags() const;
    [[nodiscard]] bool has(PrimFlag flag) const { return flags() & std::uint16_t(flag); }
    [[nodiscard]] bool isInstanceProxy() const { return !proxyPath_.IsEmpty(); }
    [[nodiscard]] bool isPseudoRoot() const { return has(PrimFlag::PseudoRoot); }
    [[nodiscard]] bool isInstance() const { return has(PrimFlag::Instance); }
    /// The prim whose children an instance shows; invalid for other prims.
    [[nodiscard]] Prim prototype() const;

    [[nodiscard]] pxr::SdfSpecifier specifier() const;
    [[nodiscard]] pxr::TfToken typeName() const;
    [[nodiscard]] pxr::TfToken kind() const;
    /// API schemas as the layers list them, and with those that the schemas bring along.
    [[nodiscard]] const pxr::TfTokenVector& authoredSchemas() const;
    [[nodiscard]] const pxr::TfTokenVector& appliedSchemas() const;
    /// What the schemas of the prim say. Lives as long as the stage.
    [[nodiscard]] const schema::PrimDefinition& definition() const;
    [[nodiscard]] std::vector<VariantSet> variantSets() const;

    /// In order. Of an instance none, unless the predicate enters instances; and none of an
    /// instance inside an instance of the same prototype, which would have no end.
    [[nodiscard]] std::vector<Prim> children(
        const PrimPredicate& predicate = PrimPredicate::normal()) const;
    [[nodiscard]] Prim child(const pxr::TfToken& name) const;

    /// Authored ones and, unless `onlyAuthored`, those of the schemas; in order.
    [[nodiscard]] pxr::TfTokenVector propertyNames(bool onlyAuthored = false) const;
    [[nodiscard]] std::vector<Property> properties(bool onlyAuthored = false) const;
    /// Invalid if there is no such property.
    [[nodiscard]] Property property(const pxr::TfToken& name) const;

    /// One field, composed; empty: no layer has it. The pseudo-root has the stage's metadata.
    [[nodiscard]] pxr::VtValue metadata(const pxr::TfToken& field,
                                        AssetPaths assetPaths = AssetPaths::Resolved) const;
    /// All fields that the layers have. A field that composes to nothing has an empty value.
    [[nodiscard]] Metadata authoredMetadata(AssetPaths assetPaths = AssetPaths::Resolved) const;

    /// How the prim is composed: of an instance proxy, how the prim of its prototype is. Valid
    /// until the stage changes. A prototype's own has no opinions: its properties belong to the
    /// instances.
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
    pxr::SdfPath proxyPath_;  // of an instance proxy: where it is seen
};

}  // namespace usdlive::stage
