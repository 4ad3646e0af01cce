#pragma once

#include <pxr/usd/sdf/layer.h>

#include <map>
#include <mutex>
#include <optional>

#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive::client {

/// The layers of this process that are live, each through one connection. Two connections would
/// each apply the edits of the other, and a layer has one state delegate.
///
/// Also remembers what a layer held when it stopped being live: a layer that is opened again has
/// unsaved work only if it differs from that. Any thread.
class LayerClaims {
public:
    static LayerClaims& ofProcess();

    /// Claims the layer for `owner`. False when another owner has it.
    [[nodiscard]] bool claim(const pxr::SdfLayerHandle& layer, const void* owner);
    [[nodiscard]] bool isLiveElsewhere(const pxr::SdfLayerHandle& layer, const void* owner) const;
    /// Ends the claim. `left` is what the layer holds now; nothing when that is not known.
    void release(const pxr::SdfLayerHandle& layer, const void* owner, std::optional<LayerDoc> left);
    /// What the layer held when it was released last.
    [[nodiscard]] std::optional<LayerDoc> left(const pxr::SdfLayerHandle& layer) const;

private:
    struct Entry {
        pxr::SdfLayerHandle layer;  // keeps the key from being used again
        const void* owner = nullptr;
        std::optional<LayerDoc> left;
    };

    void forgetExpired();

    mutable std::mutex mutex_;  // guards all below
    std::map<const void*, Entry> entries_;
    std::size_t forgetAt_ = 64;
};

}  // namespace usdlive::client
