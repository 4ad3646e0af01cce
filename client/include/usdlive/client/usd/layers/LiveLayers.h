#pragma once

#include <pxr/usd/sdf/layer.h>

#include <optional>
#include <string>

#include "usdlive/common/core/Id.h"

namespace usdlive {
class Client;
}

namespace usdlive::layers {

/// What a layer that is live knows beside its content; told by whoever makes it live.
struct LiveState {
    bool dirty = false;     ///< differs from its file
    UserName lockHolder;    ///< empty: nobody, or nobody who is named
    bool outdated = false;  ///< its file, at the server, was changed by somebody else
    bool writable = true;   ///< as far as the server's files go
    std::string owner;      ///< of the server's file
};

/// Where states and locks of live layers come from.
class LiveLayers {
public:
    virtual ~LiveLayers() = default;
    /// In whose name the connection locks.
    [[nodiscard]] virtual UserName user() const = 0;
    /// Nothing: the layer is not live.
    [[nodiscard]] virtual std::optional<LiveState> state(
        const pxr::SdfLayerHandle& layer) const = 0;
    /// False: the layer holds something else where its lock would stand, or is not open.
    virtual bool setLocked(const pxr::SdfLayerHandle& layer, bool locked) = 0;
    /// Is the connection writing into layers what others did, or what the server did not take?
    [[nodiscard]] virtual bool isApplying() const { return false; }
    /// Asks the server to take the layer's file; what is in it comes with later frames.
    virtual void reload(const pxr::SdfLayerHandle& layer) = 0;
};

/// The layers of one connection. It must outlive this.
class ClientLayers final : public LiveLayers {
public:
    explicit ClientLayers(Client& client) : client_(client) {}
    [[nodiscard]] UserName user() const override;
    [[nodiscard]] std::optional<LiveState> state(const pxr::SdfLayerHandle& layer) const override;
    bool setLocked(const pxr::SdfLayerHandle& layer, bool locked) override;
    [[nodiscard]] bool isApplying() const override;
    void reload(const pxr::SdfLayerHandle& layer) override;

private:
    Client& client_;
};

}  // namespace usdlive::layers
