// Distributes edits of the delegate layer to the layers of the stack.
#pragma once

#include <pxr/base/tf/smallVector.h>
#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/sdf/layer.h>

#include <functional>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "usd/layers/DelegateWrites.h"
#include "usd/layers/LocalStack.h"
#include "usdlive/client/usd/content/Recorder.h"
#include "usdlive/client/usd/layers/LayerTypes.h"

namespace usdlive::layers {

/// Decides which layers and specs accept edits.
class DistributionRules {
public:
    virtual ~DistributionRules() = default;
    /// Returns the reason why the layer accepts no edits, or nothing if it does.
    [[nodiscard]] virtual std::optional<LayerError> whyNotWritable(
        const pxr::SdfLayerHandle& layer) = 0;
    /// Returns the reason why the spec accepts no edits.
    [[nodiscard]] virtual std::optional<LayerError> whyLocked(const pxr::SdfPath& spec) = 0;
    /// Returns the layers for edits of the spec. Empty: the layer with the strongest opinion.
    [[nodiscard]] virtual std::vector<pxr::SdfLayerHandle> linkedLayers(
        const pxr::SdfPath& spec) = 0;
};

/// Moves edits of the delegate layer to the layers of the stack, and keeps the delegate a mirror of
/// them. Used for one frame, within a change block and DelegateWrites::Ignoring.
///
/// Each register (a metadata field, a key of a dictionary, the value of a property) is written to
/// the layer with the strongest opinion, otherwise to the strongest layer with the spec, otherwise
/// to the default layer. If the strongest opinion of a property is inside a selected variant of the
/// stack, it is written there.
class Distribution {
public:
    /// The edits of the stack's layers are recorded if there is a `recorder`.
    Distribution(LocalStack& stack, const pxr::SdfLayerHandle& delegate,
                 const pxr::SdfLayerHandle& defaultLayer, DistributionRules& rules,
                 content::Recorder* recorder = nullptr);
    ~Distribution();

    /// Returns the refused edits.
    [[nodiscard]] std::vector<RefusedEdit> distribute(const DelegateWrites::Taken& taken);
    /// Updates the delegate from the stack at the spec. With `below`, after it was created or
    /// removed, also everything below.
    void refresh(const pxr::SdfPath& path, bool below);

    /// Content that lend() has added to the delegate.
    struct Lent {
        pxr::SdfPath path;
        pxr::SdfPath created;  ///< the first spec that was missing
        struct Field {
            pxr::TfToken name;
            pxr::VtValue value;
            bool written = false;  ///< an edit is noted already, which has erased it
        };
        std::vector<Field> fields;
        std::vector<std::pair<pxr::TfToken, pxr::TfToken>> keys;  ///< a dictionary and its key
        std::optional<double> sample;
    };
    /// Gives the delegate an opinion for each field of the spec that a layer has an opinion for, so
    /// that it can be erased there, or a list edited. Values are placeholders and must not be
    /// composed. With `time`, only for the sample at this time.
    [[nodiscard]] Lent lend(const pxr::SdfPath& path, std::optional<double> time,
                            const DelegateWrites& writes);
    /// Removes what was not edited since. Specs in `writes` stay, because distribute() needs them.
    void takeBack(const Lent& lent, const DelegateWrites& writes);

private:
    struct Target {
        pxr::SdfLayerHandle layer;
        pxr::SdfLayerOffset toTarget, toDelegate;
        std::optional<LayerError> closed;
    };
    struct Place {
        const Target* target = nullptr;
        pxr::SdfPath path;
        bool exists = false;  ///< the spec exists already
    };
    // Most specs exist in few layers.
    using Holders = pxr::TfSmallVector<const Target*, 4>;
    /// A written register and its destination. All are planned before the first is written, so that
    /// edits of one frame do not influence each other.
    struct Planned {
        const DelegateWrites::Spec* spec = nullptr;
        const DelegateWrites::Field* field = nullptr;
        pxr::TfToken key;  ///< the dictionary's key; empty: the whole field
        Place place;
    };
    using Spec = DelegateWrites::Spec;
    using Field = DelegateWrites::Field;

    void remove(const pxr::SdfPath& path);
    void removePrim(const pxr::SdfPath& path);
    void removeProperty(const pxr::SdfPath& path);
    void move(const pxr::SdfPath& from, const pxr::SdfPath& to);
    void planSpec(const Spec& spec);
    void planField(const Spec& spec, const Field& field, const Holders& holders);
    void planKeys(const Spec& spec, const Field& field, const Holders& holders);
    void carryOut(const Planned& planned);
    void refuseLocked(const Spec& spec, const LayerError& why);
    void distributeRelocates();
    void planLinks(const Spec& spec, const std::vector<pxr::SdfLayerHandle>& links);
    void keepBare(const Spec& spec);
    [[nodiscard]] bool isBareOver(const pxr::SdfPath& path) const;

    [[nodiscard]] Holders holdersOf(const pxr::SdfPath& path) const;
    [[nodiscard]] std::optional<Place> strongest(const pxr::SdfPath& path,
                                                 const pxr::TfToken& field, const Holders& holders);
    [[nodiscard]] std::optional<Place> strongestInVariants(const pxr::SdfPath& path,
                                                           const pxr::TfToken& field);
    [[nodiscard]] std::vector<Place> placesOf(const pxr::SdfPath& path);
    [[nodiscard]] bool mayHaveVariants(const pxr::SdfPath& path);
    [[nodiscard]] Place placeFor(const pxr::SdfPath& path, const pxr::TfToken& field,
                                 const Holders& holders);
    [[nodiscard]] Place strongestKey(const Spec& spec, const pxr::TfToken& field,
                                     const pxr::TfToken& keyPath, const Holders& holders);

    void record(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path, bool deep = false);
    bool ensure(const Place& place, const pxr::SdfPath& source);
    void write(const Place& place, const Spec& spec, const Field& field);
    void writeSamples(const Place& place, const Spec& spec, const Field& field);
    void writeKey(const Planned& planned);
    void updateMirror(const Place& place, const pxr::SdfPath& path, const pxr::TfToken& field);
    bool isRedundant(const Spec& spec, const Field& field, const Holders& holders) const;

    void refreshField(const pxr::SdfPath& path, const pxr::TfToken& field, const Holders& holders);
    void refreshKeys(const pxr::SdfPath& path, const pxr::TfToken& field, const Holders& holders);
    void refuse(const Spec& spec, const Field& field, const Target& target);
    void refuse(const pxr::SdfPath& path, const std::string& field, const std::string& layer,
                const LayerError& why);
    void takeBack(const Spec& spec, const Field& field);
    void lendField(Lent& lent, const Place& place, const pxr::TfToken& field,
                   const DelegateWrites& writes);
    void lendKeys(Lent& lent, const pxr::TfToken& field, const pxr::VtDictionary& dictionary);
    void dropVariants(const pxr::SdfPath& path);
    void dropEmpty();
    void dropEmpty(const pxr::SdfPath& path);

    LocalStack& stack_;
    const pxr::SdfLayerHandle delegate_;
    DistributionRules& rules_;
    content::Recorder* const recorder_;
    std::vector<Target> targets_;  // strong to weak, without the delegate
    const Target* default_ = nullptr;
    std::vector<Planned> plan_;
    std::set<const Spec*> linked_;
    std::vector<RefusedEdit> refused_;
    std::vector<pxr::SdfPath> maybeEmpty_;
    std::unordered_map<pxr::SdfPath, bool, pxr::SdfPath::Hash> variants_;
};

}  // namespace usdlive::layers
