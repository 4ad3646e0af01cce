// A stage with layers, for tests of the layers API.
#pragma once

#include <gtest/gtest.h>
#include <pxr/usd/sdf/attributeSpec.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/types.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "usdlive/client/usd/layers/LayerStackHost.h"
#include "usdlive/client/usd/layers/Layers.h"

namespace usdlive::layers {

/// A stage with a root layer, two sublayers (`strong` above `weak`) and a session layer, all of
/// them anonymous.
class LayersFixture : public testing::Test {
protected:
    LayersFixture() {
        root->InsertSubLayerPath(strong->GetIdentifier());
        root->InsertSubLayerPath(weak->GetIdentifier());
    }

    Layers& layers() {
        if (!layers_) {
            auto host = std::make_unique<LayerStackHost>(root, session);
            host_ = host.get();
            layers_ = std::make_unique<Layers>(std::move(host), Layers::Options{{"ada"}, nullptr});
        }
        return *layers_;
    }
    LayerStackHost& host() {
        layers();
        return *host_;
    }
    void frame() { layers().update(now_ += 1000); }
    void closeStage() { layers_.reset(); }

    std::vector<LayerEvent> frameEvents() {
        frame();
        return layers().takeEvents();
    }
    static const LayerEvent* find(const std::vector<LayerEvent>& events, LayerEventType type) {
        const auto found = std::ranges::find(events, type, &LayerEvent::type);
        return found == events.end() ? nullptr : &*found;
    }

    pxr::SdfLayerHandle target() { return host().editTarget(); }

    /// Returns the type of the error; fails if there is none.
    template <class T>
    static std::optional<LayerErrorType> refusal(const LayerResult<T>& result) {
        return result ? std::nullopt : std::optional(result.error().type);
    }

    static void define(const pxr::SdfLayerHandle& layer, const std::string& path) {
        pxr::SdfCreatePrimInLayer(layer, pxr::SdfPath(path))->SetSpecifier(pxr::SdfSpecifierDef);
    }
    static void set(const pxr::SdfLayerHandle& layer, const std::string& path, double value) {
        const pxr::SdfPath spec(path);
        if (!layer->HasSpec(spec))
            pxr::SdfJustCreatePrimAttributeInLayer(layer, spec, pxr::SdfValueTypeNames->Double);
        layer->SetField(spec, pxr::SdfFieldKeys->Default, value);
    }
    static double get(const pxr::SdfLayerHandle& layer, const std::string& path) {
        return layer->GetField(pxr::SdfPath(path), pxr::SdfFieldKeys->Default)
            .GetWithDefault<double>(-1);
    }
    static bool has(const pxr::SdfLayerHandle& layer, const std::string& path) {
        return layer->HasSpec(pxr::SdfPath(path));
    }

    const pxr::SdfLayerRefPtr root = pxr::SdfLayer::CreateAnonymous("root.usda");
    const pxr::SdfLayerRefPtr strong = pxr::SdfLayer::CreateAnonymous("strong.usda");
    const pxr::SdfLayerRefPtr weak = pxr::SdfLayer::CreateAnonymous("weak.usda");
    const pxr::SdfLayerRefPtr session = pxr::SdfLayer::CreateAnonymous("session.usda");

private:
    std::unique_ptr<Layers> layers_;
    LayerStackHost* host_ = nullptr;
    double now_ = 0;
};

}  // namespace usdlive::layers
