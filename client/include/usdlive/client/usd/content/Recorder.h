// Records edits of layers and undoes them without undoing later edits of others.
#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>

#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "usdlive/client/usd/content/Registers.h"

namespace usdlive::content {

/// A part of an undo that was skipped because somebody else has written there since.
struct Kept {
    std::string layer;  ///< its identifier
    pxr::SdfPath path;
    pxr::TfToken field;  ///< empty: the spec itself
    Part part;
    std::string reason;
};

class LayerScope;
class ScopeDifference;
struct SharedContent;

/// The recorded edits and their undo. A value; keeps its layers alive.
class Record {
public:
    /// An empty record.
    Record();
    explicit Record(std::vector<ScopeDifference> differences);

    [[nodiscard]] bool isEmpty() const;
    [[nodiscard]] std::vector<pxr::SdfLayerHandle> layers() const;
    /// Returns whether other clients have written the layer, which was touched, since the edits.
    [[nodiscard]] bool isFollowed(const pxr::SdfLayerHandle& layer) const;

    /// Undoes the edits in one change block. In a layer for which `isShared` is true, restores only
    /// registers that still have the recorded content and that no other client has written since,
    /// and returns the others. In other layers, restores the earlier state regardless of later
    /// edits. May be called again after the same edits were made again.
    using IsShared = std::function<bool(const pxr::SdfLayerHandle&)>;
    std::vector<Kept> undo(const IsShared& isShared) const;
    /// Call it when this record's edits are those of `earlier`, made again. Reverts what they
    /// changed in shared layers although other clients have written there since `earlier`, and
    /// returns it. From then on this record's edits count as made when those of `earlier` were.
    std::vector<Kept> keepOthers(const Record& earlier, const IsShared& isShared);

private:
    std::shared_ptr<const std::vector<ScopeDifference>> differences_;
};

/// Records edits that are made by any means (Sdf, Usd): call touch() for the parts that will be
/// written, write, then call finish(). The cost grows with the content of the touched parts.
class Recorder {
public:
    Recorder();
    ~Recorder();
    Recorder(Recorder&&) noexcept;

    /// Remembers the fields of the spec at `path`, also if it is absent; with `deep` also
    /// everything below.
    void touch(const pxr::SdfLayerHandle& layer,
               const pxr::SdfPath& path = pxr::SdfPath::AbsoluteRootPath(), bool deep = false);
    /// Touches everything from the first missing ancestor of `path` on. For a spec that will be
    /// created with its ancestors.
    void touchWithAncestors(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path);
    /// Drops what was touched in a layer whose edits are recorded elsewhere.
    void forget(const pxr::SdfLayerHandle& layer);

    /// Returns the edits since the last call and starts again.
    [[nodiscard]] Record finish();

private:
    /// An open scope: the content of a path when it was touched.
    struct Touched {
        std::size_t index = 0;  ///< in scopes_
        bool deep = false;
    };
    [[nodiscard]] bool isTouched(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path,
                                 bool deep) const;
    void close(const LayerScope& before);

    std::vector<std::unique_ptr<LayerScope>> scopes_;  // null: closed
    std::vector<ScopeDifference> closed_;
    std::map<pxr::SdfLayerHandle, std::map<pxr::SdfPath, Touched>> touched_;
    std::map<pxr::SdfLayerHandle, std::shared_ptr<SharedContent>> shared_;  // by all scopes
};

}  // namespace usdlive::content
