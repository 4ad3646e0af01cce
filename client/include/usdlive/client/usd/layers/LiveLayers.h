// The live layers of a connection, for the layers API.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <functional>
#include <optional>
#include <string>

#include "usdlive/common/core/Id.h"

namespace usdlive {
class Client;
}

namespace usdlive::layers {

/// The state of a live layer besides its content.
struct LiveState {
    bool dirty = false;          ///< differs from its file
    UserName lockHolder;         ///< empty: nobody, or a holder without a name
    bool lockedByOther = false;  ///< by `lockHolder`, and the user may not unlock it
    bool outdated = false;       ///< somebody else has changed its file on the server
    bool writable = true;        ///< the server can write the file
    std::string owner;           ///< owner of the server's file
    Revision saved = 0;          ///< the revision in the server's file; 0: unknown
    bool pending = false;        ///< the connection has edits that the server has not acknowledged
};

/// Provides the states and locks of live layers.
class LiveLayers {
public:
    virtual ~LiveLayers() = default;
    /// Returns the user in whose name the connection locks.
    [[nodiscard]] virtual UserName user() const = 0;
    /// Returns nothing if the layer is not live.
    [[nodiscard]] virtual std::optional<LiveState> state(
        const pxr::SdfLayerHandle& layer) const = 0;
    /// Returns false if the layer is not open, or has other data in the place of the lock. What
    /// `alongside` writes is sent in the same transaction; it is not called after a failure.
    virtual bool setLocked(const pxr::SdfLayerHandle& layer, bool locked,
                           const std::function<void()>& alongside) = 0;
    /// Returns true while the connection writes edits of others, or the server's refusals, into
    /// layers.
    [[nodiscard]] virtual bool isApplying() const { return false; }
    /// Calls Client::withoutWaiting().
    virtual void withoutWaiting(const std::function<void()>& compose) { compose(); }
    /// Asks the server to reload the layer's file. The content arrives in later frames.
    virtual void reload(const pxr::SdfLayerHandle& layer) = 0;
};

/// The layers of one connection, which must outlive this object.
class ClientLayers final : public LiveLayers {
public:
    explicit ClientLayers(Client& client) : client_(client) {}
    [[nodiscard]] UserName user() const override;
    [[nodiscard]] std::optional<LiveState> state(const pxr::SdfLayerHandle& layer) const override;
    bool setLocked(const pxr::SdfLayerHandle& layer, bool locked,
                   const std::function<void()>& alongside) override;
    [[nodiscard]] bool isApplying() const override;
    void withoutWaiting(const std::function<void()>& compose) override;
    void reload(const pxr::SdfLayerHandle& layer) override;

private:
    Client& client_;
};

}  // namespace usdlive::layers
