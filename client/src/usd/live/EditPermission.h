// Whether the editor may write into a live layer.
#pragma once

#include <pxr/usd/sdf/layer.h>

namespace usdlive::client {

/// The permission to edit an SdfLayer. The editor may write if the layer has all its content, the
/// server permits it to this user, and so does the editor's own setting. Without permission, Sdf
/// refuses edits.
class EditPermission {
public:
    /// The layer is closed at first.
    explicit EditPermission(const pxr::SdfLayerHandle& layer) : layer_(layer) { set(true, false); }

    /// Closes a layer that has not all its content, or opens it.
    void setClosed(bool closed) { set(closed, forbidden_); }
    /// Closes a layer that another user has locked, or that the user's role does not permit to
    /// edit, or opens it.
    void setForbidden(bool forbidden) { set(closed_, forbidden); }
    /// Permits the client's own writes, whoever has locked the layer, for the lifetime of the
    /// result. The layer is open afterwards.
    class OwnWrites {
    public:
        explicit OwnWrites(EditPermission& permission)
            : permission_(permission), forbidden_(permission.forbidden_) {
            permission_.set(false, false);
        }
        ~OwnWrites() { permission_.set(false, forbidden_); }
        OwnWrites(const OwnWrites&) = delete;
        OwnWrites& operator=(const OwnWrites&) = delete;

    private:
        EditPermission& permission_;
        const bool forbidden_;
    };
    /// Gives the layer back with the editor's own setting.
    void release() { set(false, false); }

private:
    void set(bool closed, bool forbidden) {
        const bool before = closed_ || forbidden_;
        closed_ = closed;
        forbidden_ = forbidden;
        const bool after = closed || forbidden;
        if (before == after) return;
        // A muted layer never permits edits, so the editor's own setting is unknown.
        if (after) permitted_ = layer_->IsMuted() || layer_->PermissionToEdit();
        layer_->SetPermissionToEdit(!after && permitted_);
    }

    const pxr::SdfLayerHandle layer_;
    bool closed_ = false;
    bool forbidden_ = false;
    bool permitted_ = true;  // the editor's own setting
};

}  // namespace usdlive::client
