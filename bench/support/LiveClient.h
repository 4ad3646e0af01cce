// A client with one live layer, for benchmarks.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <memory>
#include <string>

#include "usdlive/client/usd/Client.h"

namespace usdlive::bench {

/// A client and its live layer. The constructor throws when one of them cannot be created.
struct LiveClient {
    explicit LiveClient(const std::string& url);
    void open();

    std::unique_ptr<Client> client;
    pxr::SdfLayerRefPtr layer;
};

/// Throws unless the layer that writeLayer() created is complete up to its last field.
void checkLayer(const pxr::SdfLayerHandle& layer, int fields);

/// Makes the server import the layer from its file: another process joins the layer and ends, so
/// that this process keeps nothing of it. main() runs that other process when `isJoin` returns
/// true.
void joinElsewhere(const std::string& url);
[[nodiscard]] bool isJoin(int argc, char** argv);
void runJoin(char** argv);

/// Loads OpenUSD's plugins and schemas, which an editor has loaded long before it joins.
void loadUsd();

}  // namespace usdlive::bench
