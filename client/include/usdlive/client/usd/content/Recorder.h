// Undo of what one has written in layers, without what others have written since.
#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "usdlive/client/usd/content/Registers.h"

namespace usdlive::content {

/// Something that an undo left as it is, because somebody else has written it since.
struct Kept {
    std::string layer;  ///< its identifier
    pxr::SdfPath path;
    pxr::TfToken field;  ///< empty: the spec itself
    Part part;
    std::string reason;
};

class LayerScope;
class ScopeDifference;

/// What was written, and the way back. A value; keeps its layers.
class Record {
public:
    /// Of nothing.
    Record();
    explicit Record(std::vector<ScopeDifference> differences);

    [[nodiscard]] bool isEmpty() const;
    [[nodiscard]] std::vector<pxr::SdfLayerHandle> layers() const;

    /// Takes back what was written, in one change block. In a layer that `isShared`, only registers
    /// that still hold what was written go back; the others are returned. In all other layers the
    /// earlier state comes back, whatever was done since. May be called again after the same edits
    /// were made again.
    using IsShared = std::function<bool(const pxr::SdfLayerHandle&)>;
    std::vector<Kept> undo(const IsShared& isShared) const;

private:
    std::shared_ptr<const std::vector<ScopeDifference>> differences_;
};

/// Records edits of layers by any means (Sdf, Usd): touch() what is going to be written, write,
/// then finish(). Costs what the touched parts hold.
class Recorder {
public:
    Recorder();
    ~Recorder();
    Recorder(Recorder&&) noexcept;

    /// Keeps the fields of the spec at `path`, also an absent one; with `deep` everything below.
    void touch(const pxr::SdfLayerHandle& layer,
               const pxr::SdfPath& path = pxr::SdfPath::AbsoluteRootPath(), bool deep = false);
    /// For a spec that is going to be created with the ancestors it lacks: touches everything from
    /// the first missing ancestor on.
    void touchWithAncestors(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path);

    /// Returns what was written since, and begins anew.
    [[nodiscard]] Record finish();

private:
    std::vector<LayerScope> scopes_;
};

}  // namespace usdlive::content
