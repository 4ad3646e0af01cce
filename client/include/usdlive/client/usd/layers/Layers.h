// The layers API of one stage, with Kit's names.
#pragma once

#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "usdlive/client/usd/layers/AutoAuthoring.h"
#include "usdlive/client/usd/layers/LayersState.h"
#include "usdlive/client/usd/layers/LiveLayers.h"
#include "usdlive/client/usd/layers/SpecsLinking.h"
#include "usdlive/client/usd/layers/SpecsLocking.h"
#include "usdlive/client/usd/layers/StageHost.h"

namespace usdlive::content {
class Recorder;
}

namespace usdlive::layers {

/// All functions for the layers of one stage, under Kit's names: states, auto authoring, links and
/// locks of specs, and events.
///
/// Belongs to the thread that created it and owns the stage; on another thread all functions throw
/// Misuse. The parts do not check the thread, so request them only on this one. Call update() once
/// per frame, after the live client's tick(), and then takeEvents().
class Layers {
public:
    struct Options {
        UserName user;               ///< locks specs in this name; empty: the system's user name
        LiveLayers* live = nullptr;  ///< must outlive this object
    };
    explicit Layers(std::unique_ptr<StageHost> host);
    Layers(std::unique_ptr<StageHost> host, Options options);
    ~Layers();

    [[nodiscard]] LayersState& state();
    [[nodiscard]] AutoAuthoring& autoAuthoring();
    [[nodiscard]] SpecsLinking& specsLinking();
    [[nodiscard]] SpecsLocking& specsLocking();
    [[nodiscard]] StageHost& host();

    [[nodiscard]] LayerEditMode editMode() const;
    /// Fails for a stage that has no place for the delegate, and keeps the mode.
    LayerResult<void> setEditMode(LayerEditMode mode);

    /// `nowMs` is the time of any steady clock. Returns the refused edits.
    std::vector<RefusedEdit> update(double nowMs);
    /// Moves edits of the delegate to their layers and takes back edits of locked specs, even while
    /// auto authoring is suspended. Call it before saving, sending or leaving, and before and
    /// after a command that can be undone, after it with its recorder, which gets the edits of the
    /// layers instead of those of the delegate. Returns the refused edits.
    std::vector<RefusedEdit> distribute(content::Recorder* recorder = nullptr);
    /// Returns the events since the last call, in order.
    [[nodiscard]] std::vector<LayerEvent> takeEvents();
    /// Reports edits that a server refused, together with those refused here.
    void refuse(std::vector<RefusedEdit> edits);
    /// Returns the latest refused edits, oldest first; at most 10,000 are kept.
    [[nodiscard]] const std::deque<RefusedEdit>& refusedEdits() const;

    void setLive(LiveLayers* live);

private:
    class Impl;
    [[nodiscard]] Impl& here(const char* function) const;

    std::unique_ptr<Impl> impl_;
};

}  // namespace usdlive::layers
