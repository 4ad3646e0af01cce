// The live layers of this process and their connections.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <map>
#include <mutex>
#include <optional>

#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive::client {

/// The live layers of this process, each with the connection to which it belongs. Two connections
/// for one layer would each apply the edits of the other, and a layer has only one state delegate.
///
/// Also keeps the content of a layer when it stops being live: a layer that is opened again has
/// unsent edits only if it differs from that. Placeholders that are not live and layers that the
/// server could not give are closed to edits, which would go nowhere, and so are live layers in a
/// process that fork() makes. May be used by any thread.
class LayerClaims {
public:
    static LayerClaims& ofProcess();

    /// Claims the layer for `owner`, and undoes close(). Returns false if it belongs to another
    /// owner.
    [[nodiscard]] bool claim(const pxr::SdfLayerHandle& layer, const void* owner);
    [[nodiscard]] bool isLiveElsewhere(const pxr::SdfLayerHandle& layer, const void* owner) const;
    /// Ends the claim. `left` is the present content of the layer; nothing if it is unknown.
    void release(const pxr::SdfLayerHandle& layer, const void* owner, std::optional<LayerDoc> left);
    /// Makes a layer that is not live refuse edits (`permissionToEdit`), until it is claimed. Does
    /// so once: an editor that permits edits again wants a copy of its own.
    void close(const pxr::SdfLayerHandle& layer);
    /// Undoes close().
    void open(const pxr::SdfLayerHandle& layer);
    /// Returns the content of the layer when it was released last.
    [[nodiscard]] std::optional<LayerDoc> left(const pxr::SdfLayerHandle& layer) const;

private:
    struct Entry {
        pxr::SdfLayerHandle layer;  // prevents that the key is used again
        const void* owner = nullptr;
        std::optional<LayerDoc> left;
        bool isClosed = false;  // by close()
    };

    LayerClaims();
    void closeAll();
    Entry& entryOf(const pxr::SdfLayerHandle& layer);
    void forgetExpired();

    mutable std::mutex mutex_;  // guards all members below
    std::map<const void*, Entry> entries_;
    std::size_t forgetAt_ = 64;
};

}  // namespace usdlive::client
