#pragma once

#include <pxr/usd/sdf/layer.h>

#include <memory>
#include <string>

#include "usdlive/client/usd/Client.h"

namespace usdlive::bench {

/// A client, and its live layer. Throws where either cannot be had.
struct LiveClient {
    explicit LiveClient(const std::string& url);
    void open();

    std::unique_ptr<Client> client;
    pxr::SdfLayerRefPtr layer;
};

/// Throws unless the layer that writeLayer() made is there up to its last field.
void checkLayer(const pxr::SdfLayerHandle& layer, int fields);

/// Has the server bring the layer in from its file: another process joins it and goes, so that
/// nothing of it is left in this one. `isJoin`: main() is that other process.
void joinElsewhere(const std::string& url);
[[nodiscard]] bool isJoin(int argc, char** argv);
void runJoin(char** argv);

/// What an editor has long done when it joins: OpenUSD's plugins and schemas are loaded.
void loadUsd();

}  // namespace usdlive::bench
