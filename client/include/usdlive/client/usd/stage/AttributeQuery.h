// Declares AttributeQuery, which reads the value of one attribute at many times.
#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/base/ts/spline.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/pcp/primIndex.h>
#include <pxr/usd/sdf/layerOffset.h>
#include <pxr/usd/sdf/types.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "usdlive/client/usd/schema/PrimDefinition.h"
#include "usdlive/client/usd/stage/ValueSite.h"

namespace usdlive::stage {

class ClipSet;
/// The value clips of a prim, from strong to weak.
using ClipSets = std::vector<std::shared_ptr<ClipSet>>;

/// The kind of source that an attribute's value comes from. Corresponds to UsdResolveInfoSource.
enum class ValueSource : std::uint8_t { None, Fallback, Default, TimeSamples, ValueClips, Spline };

/// The value between two time samples: Held returns the earlier sample; Linear interpolates types
/// of real numbers and returns the earlier sample for other types.
enum class Interpolation : std::uint8_t { Held, Linear };

/// Reads the value of one attribute at any time. The sources of values at times are searched once,
/// at the first such read, so that later reads are quick.
///
/// In one layer, time samples are stronger than a spline, and a spline is stronger than a default.
/// A default in a stronger layer is stronger than time samples in a weaker layer. Value clips are
/// weaker than the layer that names them, and stronger than the next layer. Returned values share
/// their data with the layer; arrays are not copied.
///
/// Valid until the prim index changes, or until a layer changes the attribute. Use a query on one
/// thread at a time.
class AttributeQuery {
public:
    /// `definition` is the attribute's definition from the schemas, or null. `clips` are the value
    /// clips of the prim, or null. `prim` and `definition` must outlive the query.
    AttributeQuery(const pxr::PcpPrimIndex& prim, const pxr::TfToken& attribute,
                   const schema::PropertyDefinition* definition,
                   Interpolation interpolation = Interpolation::Linear,
                   AssetPaths assetPaths = AssetPaths::Resolved,
                   std::shared_ptr<const ClipSets> clips = nullptr);

    /// Returns the value at the default time, for which time samples and splines are ignored.
    /// Returns an empty value if there is no value, or if it is blocked.
    [[nodiscard]] pxr::VtValue getDefault() const;
    /// Returns the value at a time of the stage. Returns an empty value if there is no value at
    /// that time, or if it is blocked.
    [[nodiscard]] pxr::VtValue get(double time) const;

    /// Returns the kind of source that get() reads.
    [[nodiscard]] ValueSource source() const { return timed().source; }
    /// Returns true if a block hides the weaker defaults, samples and splines.
    [[nodiscard]] bool isBlocked() const { return timed().blocked; }
    [[nodiscard]] bool hasValue() const { return source() != ValueSource::None; }
    [[nodiscard]] bool hasAuthoredValue() const {
        return hasValue() && source() != ValueSource::Fallback;
    }
    [[nodiscard]] bool hasSpline() const { return source() == ValueSource::Spline; }
    /// Returns the spline in times of the stage if source() is Spline, else an empty spline.
    [[nodiscard]] pxr::TsSpline spline() const;
    /// Returns true if a layer has a default. A block counts as a default.
    [[nodiscard]] bool hasAuthoredDefault() const;
    /// Returns false only if the value is the same at all times. Returns true for every spline,
    /// without evaluating it.
    [[nodiscard]] bool mightBeTimeVarying() const;

    /// Returns the times of the samples, as times of the stage in ascending order. Returns none for
    /// a spline.
    [[nodiscard]] std::vector<double> timeSamples() const;
    [[nodiscard]] std::size_t numTimeSamples() const;

    /// Returns the site of the strongest opinion that get() uses, or null if no layer has one. The
    /// pointer is valid as long as the query.
    [[nodiscard]] const ValueSite* site() const;

private:
    // One opinion, or several opinions that were composed over each other.
    struct Source {
        ValueSource source = ValueSource::None;
        bool blocked = false;
        ValueSite site;
        pxr::SdfLayerOffset toStage;
        /// The default or fallback with its times and paths mapped to the stage; for Spline, the
        /// spline in layer times.
        pxr::VtValue value;
        /// The time samples if they are in memory. Their times are stage times if `onStage` is
        /// true, else layer times.
        pxr::VtValue samples;
        bool onStage = false;
        std::shared_ptr<ClipSet> clips;  // set for ValueClips
    };
    // The position from which the search for the next weaker source continues.
    struct Cursor {
        pxr::PcpNodeIterator node;
        std::size_t layerIndex = 0;
        bool animationBlocked = false;
        bool clipsAreNext = false;  // the clips of the layer before layerIndex
    };

    [[nodiscard]] Cursor begin() const;
    [[nodiscard]] Source next(Cursor& cursor, bool withTimes) const;
    [[nodiscard]] bool findInLayer(Cursor& cursor, bool withTimes, Source& found) const;
    [[nodiscard]] bool findInClips(const Cursor& cursor, Source& found) const;
    [[nodiscard]] bool hasClips(const pxr::PcpNodeRef& node) const;
    [[nodiscard]] Source fallback(bool blocked) const;
    [[nodiscard]] pxr::VtValue clipAt(const Source& source, double time) const;
    [[nodiscard]] const Source& timed() const;
    bool composeWeaker(Source& strongest, Cursor& cursor, bool withTimes) const;
    [[nodiscard]] pxr::SdfTimeSampleMap samplesOnStage(const Source& source) const;
    [[nodiscard]] pxr::VtValue sampleAt(const Source& source, double time) const;

    const pxr::PcpPrimIndex* prim_;
    pxr::TfToken attribute_;
    const schema::PropertyDefinition* definition_;
    Interpolation interpolation_;
    AssetPaths assetPaths_;
    std::shared_ptr<const ClipSets> clips_;
    mutable std::optional<Source> timed_;
};

}  // namespace usdlive::stage
