// Whether the editor may write into a live layer.
#pragma once

#include <pxr/usd/sdf/layer.h>

namespace usdlive::client {

/// The permission to edit an SdfLayer. The editor may write if the layer has all its content, no
/// other user has locked it, and the editor's own setting permits it. Without permission, Sdf
/// refuses edits.
class EditPermission {
public:
    /// The layer is closed at first.
    explicit EditPermission(const pxr::SdfLayerHandle& layer) : layer_(layer) { set(true, false); }

    /// Closes a layer that has not all its content, or opens it.
    void setClosed(bool closed) { set(closed, lockedByOther_); }
    void setLockedByOther(bool locked) { set(closed_, locked); }
    /// Permits the client's own writes, whoever has locked the layer, for the lifetime of the
    /// result. The layer is open afterwards.
    class OwnWrites {
    public:
        explicit OwnWrites(EditPermission& permission)
            : permission_(permission), lockedByOther_(permission.lockedByOther_) {
            permission_.set(false, false);
        }
        ~OwnWrites() { permission_.set(false, lockedByOther_); }
        OwnWrites(const OwnWrites&) = delete;
        OwnWrites& operator=(const OwnWrites&) = delete;

    private:
        EditPermission& permission_;
        const bool lockedByOther_;
    };
    /// Gives the layer back with the editor's own setting.
    void release() { set(false, false); }

private:
    void set(bool closed, bool lockedByOther) {
        const bool before = closed_ || lockedByOther_;
        closed_ = closed;
        lockedByOther_ = lockedByOther;
        const bool after = closed || lockedByOther;
        if (before == after) return;
        // A muted layer never permits edits, so the editor's own setting is unknown.
        if (after) permitted_ = layer_->IsMuted() || layer_->PermissionToEdit();
        layer_->SetPermissionToEdit(!after && permitted_);
    }

    const pxr::SdfLayerHandle layer_;
    bool closed_ = false;
    bool lockedByOther_ = false;
    bool permitted_ = true;  // the editor's own setting
};

}  // namespace usdlive::client
