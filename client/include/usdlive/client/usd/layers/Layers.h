#pragma once

#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "usdlive/client/usd/layers/AutoAuthoring.h"
#include "usdlive/client/usd/layers/LayersContext.h"
#include "usdlive/client/usd/layers/LayersState.h"
#include "usdlive/client/usd/layers/SpecsLinking.h"
#include "usdlive/client/usd/layers/SpecsLocking.h"

namespace usdlive::layers {

/// Everything about the layers of one stage, under Kit's names: states, auto authoring, links and
/// locks of specs, and what happens to them.
///
/// Used from the stage's thread. Once per frame, after what is live has been brought in: update(),
/// and then takeEvents(). Nothing throws; results that stand for a failure leave a reason in
/// lastError().
class Layers {
public:
    struct Options {
        std::string user;            ///< who locks specs; empty: the system's user name
        LiveLayers* live = nullptr;  ///< outlives this
    };
    explicit Layers(std::unique_ptr<StageHost> host);
    Layers(std::unique_ptr<StageHost> host, Options options);
    ~Layers();

    [[nodiscard]] LayersState& state();
    [[nodiscard]] AutoAuthoring& autoAuthoring();
    [[nodiscard]] SpecsLinking& specsLinking();
    [[nodiscard]] SpecsLocking& specsLocking();
    [[nodiscard]] StageHost& host();
    [[nodiscard]] const LastError& lastError() const;

    [[nodiscard]] LayerEditMode editMode() const;
    bool setEditMode(LayerEditMode mode);

    /// `nowMs`: of any steady clock.
    void update(double nowMs);
    /// Brings edits of the delegate to their layers and takes back edits of locked specs now, also
    /// while auto authoring is suspended: before something is saved, sent or left.
    void distribute();
    /// What happened since the last call, in order.
    [[nodiscard]] std::vector<LayerEvent> takeEvents();
    /// Tells of edits that somebody else did not take, a server, with those that went back here.
    void refuse(std::vector<RefusedEdit> edits);
    /// The latest edits that went back, oldest first; at most 10,000 are kept.
    [[nodiscard]] const std::deque<RefusedEdit>& refusedEdits() const;

    void setLive(LiveLayers* live);

private:
    class Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace usdlive::layers
