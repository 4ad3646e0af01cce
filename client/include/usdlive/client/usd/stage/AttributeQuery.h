#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/base/ts/spline.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/pcp/primIndex.h>
#include <pxr/usd/sdf/layerOffset.h>
#include <pxr/usd/sdf/types.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "usdlive/client/usd/schema/PrimDefinition.h"
#include "usdlive/client/usd/stage/ValueSite.h"

namespace usdlive::stage {

/// Where the value of an attribute comes from, as UsdResolveInfoSource.
enum class ValueSource : std::uint8_t { None, Fallback, Default, TimeSamples, ValueClips, Spline };

/// Between two time samples: the earlier one, or what lies between them for types of real numbers.
enum class Interpolation : std::uint8_t { Held, Linear };

/// The value of one attribute at any time. Finds its sources once, when it is created or first
/// asked, so that reading at many times is quick.
///
/// In each layer time samples are stronger than a spline, and this than a default; but a default in
/// a stronger layer beats time samples in a weaker one. Values are shared with the layer, not
/// copied.
///
/// Valid while neither the prim index nor what the layers say of the attribute changes. One thread.
class AttributeQuery {
public:
    /// `definition`: what schemas say of the attribute; null if nothing. It has to outlive this.
    AttributeQuery(const pxr::PcpPrimIndex& prim, const pxr::TfToken& attribute,
                   const schema::PropertyDefinition* definition,
                   Interpolation interpolation = Interpolation::Linear,
                   AssetPaths assetPaths = AssetPaths::Resolved);

    /// The value at the default time, at which time samples and splines are not looked at. Empty:
    /// it has none, or it is blocked.
    [[nodiscard]] pxr::VtValue getDefault() const;
    /// The value at a time. Empty: it has none there, or it is blocked.
    [[nodiscard]] pxr::VtValue get(double time) const;

    /// Where values at times come from.
    [[nodiscard]] ValueSource source() const { return timed().source; }
    /// Whether a block hides weaker defaults, samples and splines.
    [[nodiscard]] bool isBlocked() const { return timed().blocked; }
    [[nodiscard]] bool hasValue() const { return source() != ValueSource::None; }
    [[nodiscard]] bool hasAuthoredValue() const {
        return hasValue() && source() != ValueSource::Fallback;
    }
    [[nodiscard]] bool hasSpline() const { return source() == ValueSource::Spline; }
    /// Where source() is Spline: it, in times of the stage.
    [[nodiscard]] pxr::TsSpline spline() const;
    /// Whether any layer has a default, a block included.
    [[nodiscard]] bool hasAuthoredDefault() const;
    /// False only if the value is the same at all times. A spline is not looked into.
    [[nodiscard]] bool mightBeTimeVarying() const;

    /// Times of the stage, in order; of a spline none.
    [[nodiscard]] std::vector<double> timeSamples() const;
    [[nodiscard]] std::size_t numTimeSamples() const;

    /// The site of the strongest opinion at times; nothing if there is none.
    [[nodiscard]] const ValueSite* site() const;

private:
    // An opinion, or several that are laid over each other.
    struct Source {
        ValueSource source = ValueSource::None;
        bool blocked = false;
        ValueSite site;
        pxr::SdfLayerOffset toStage;
        /// A default or fallback as it reads on the stage; a spline.
        pxr::VtValue value;
        /// Time samples that are in memory: as they are in the layer, or, if `onStage`, on the
        /// stage.
        pxr::VtValue samples;
        bool onStage = false;
    };
    // Where the search for the next weaker source goes on.
    struct Cursor {
        pxr::PcpNodeIterator node;
        std::size_t layerIndex = 0;
        bool animationBlocked = false;
    };

    [[nodiscard]] Cursor begin() const;
    [[nodiscard]] Source next(Cursor& cursor, bool withTimes) const;
    [[nodiscard]] bool findInLayer(Cursor& cursor, bool withTimes, Source& found) const;
    [[nodiscard]] Source fallback(bool blocked) const;
    [[nodiscard]] const Source& timed() const;
    bool composeWeaker(Source& strongest, Cursor& cursor, bool withTimes) const;
    [[nodiscard]] pxr::SdfTimeSampleMap samplesOnStage(const Source& source) const;
    [[nodiscard]] pxr::VtValue sampleAt(const Source& source, double time) const;

    const pxr::PcpPrimIndex* prim_;
    pxr::TfToken attribute_;
    const schema::PropertyDefinition* definition_;
    Interpolation interpolation_;
    AssetPaths assetPaths_;
    mutable std::optional<Source> timed_;
};

}  // namespace usdlive::stage
