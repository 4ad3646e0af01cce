#pragma once

#include <pxr/base/tf/smallVector.h>
#include <pxr/usd/sdf/layer.h>

#include <functional>
#include <optional>
#include <set>
#include <vector>

#include "DelegateWrites.h"
#include "usdlive/client/usd/layers/LayerTypes.h"
#include "usdlive/client/usd/layers/LocalStack.h"

namespace usdlive::layers {

/// What decides where an edit may go.
class DistributionRules {
public:
    virtual ~DistributionRules() = default;
    /// Why the layer takes no edits; nothing: it does.
    [[nodiscard]] virtual std::optional<LayerError> whyNotWritable(
        const pxr::SdfLayerHandle& layer) = 0;
    /// Why the spec takes none.
    [[nodiscard]] virtual std::optional<LayerError> whyLocked(const pxr::SdfPath& spec) = 0;
    /// The layers that edits of the spec are for; none: the one with the strongest opinion.
    [[nodiscard]] virtual std::vector<pxr::SdfLayerHandle> linkedLayers(
        const pxr::SdfPath& spec) = 0;
};

/// Brings what was written into the delegate layer to the layers of the stack, and keeps in the
/// delegate what mirrors them. For one frame; within a change block and DelegateWrites::Ignoring.
///
/// Of each register (a metadata field, a key of a dictionary, the value of a property) the layer
/// with the strongest opinion is written, else the strongest that has the spec, else the default
/// layer. A property whose strongest opinion is inside a selected variant of the stack's own is
/// written there.
class Distribution {
public:
    Distribution(LocalStack& stack, const pxr::SdfLayerHandle& delegate,
                 const pxr::SdfLayerHandle& defaultLayer, DistributionRules& rules);
    ~Distribution();

    /// Returns what went back.
    [[nodiscard]] std::vector<RefusedEdit> distribute(const DelegateWrites::Taken& taken);
    /// The delegate says again what the stack says of the spec and, when it came or went, of all
    /// below.
    void refresh(const pxr::SdfPath& path, bool below);

private:
    struct Target {
        pxr::SdfLayerHandle layer;
        pxr::SdfLayerOffset toTarget, toDelegate;
        std::optional<LayerError> closed;
    };
    struct Place {
        const Target* target = nullptr;
        pxr::SdfPath path;
        bool exists = false;  ///< the spec is there already
    };
    // Most specs stand in few layers.
    using Having = pxr::TfSmallVector<const Target*, 4>;
    /// A register that was written, and where it belongs. Decided for all before the first is
    /// written, so that edits of one frame do not attract each other.
    struct Planned {
        const DelegateWrites::Spec* spec = nullptr;
        const DelegateWrites::Field* field = nullptr;
        pxr::TfToken key;  ///< of a dictionary; empty: the whole field
        Place place;
    };
    using Spec = DelegateWrites::Spec;
    using Field = DelegateWrites::Field;

    void remove(const pxr::SdfPath& path);
    void removePrim(const pxr::SdfPath& path, const Having& having);
    void move(const pxr::SdfPath& from, const pxr::SdfPath& to);
    void planSpec(const Spec& spec);
    void planField(const Spec& spec, const Field& field, const Having& having);
    void planKeys(const Spec& spec, const Field& field, const Having& having);
    void carryOut(const Planned& planned);
    void refuseLocked(const Spec& spec, const LayerError& why);
    void distributeRelocates();
    void planLinks(const Spec& spec, const std::vector<pxr::SdfLayerHandle>& links);
    void keepBareOver(const Spec& spec);

    [[nodiscard]] Having having(const pxr::SdfPath& path) const;
    [[nodiscard]] std::optional<Place> strongest(const pxr::SdfPath& path,
                                                 const pxr::TfToken& field, const Having& having);
    [[nodiscard]] std::optional<Place> strongestInVariants(const pxr::SdfPath& path,
                                                           const pxr::TfToken& field);
    [[nodiscard]] bool mayHaveVariants(const pxr::SdfPath& path);
    [[nodiscard]] Place placeFor(const pxr::SdfPath& path, const pxr::TfToken& field,
                                 const Having& having);
    [[nodiscard]] Place strongestKey(const Spec& spec, const pxr::TfToken& field,
                                     const pxr::TfToken& keyPath, const Having& having);

    bool ensure(const Place& place, const pxr::SdfPath& source);
    void write(const Place& place, const Spec& spec, const Field& field);
    void writeSamples(const Place& place, const Spec& spec, const Field& field);
    void writeKey(const Planned& planned);
    void settle(const Place& place, const pxr::SdfPath& path, const pxr::TfToken& field);
    bool isRedundant(const Spec& spec, const Field& field, const Having& having) const;

    void refreshField(const pxr::SdfPath& path, const pxr::TfToken& field, const Having& having);
    void refreshKeys(const pxr::SdfPath& path, const pxr::TfToken& field, const Having& having);
    void refuse(const Spec& spec, const Field& field, const Target& target);
    void refuse(const pxr::SdfPath& path, const std::string& field, const std::string& layer,
                const LayerError& why);
    void takeBack(const Spec& spec, const Field& field);
    void dropEmpty(const pxr::SdfPath& path);

    LocalStack& stack_;
    const pxr::SdfLayerHandle delegate_;
    DistributionRules& rules_;
    std::vector<Target> targets_;  // strong to weak, without the delegate
    const Target* default_ = nullptr;
    std::vector<Planned> plan_;
    std::set<const Spec*> linked_;
    std::vector<RefusedEdit> refused_;
    std::vector<pxr::SdfPath> maybeEmpty_;
    std::unordered_map<pxr::SdfPath, bool, pxr::SdfPath::Hash> variants_;
};

}  // namespace usdlive::layers
