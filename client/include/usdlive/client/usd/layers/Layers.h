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
/// Used from the thread that made it, the one that owns the stage: from another one all functions
/// throw Misuse. The parts do not check: ask for them where they are used. Once per frame, after
/// what is live has been brought in: update(), and then takeEvents().
class Layers {
public:
    struct Options {
        UserName user;               ///< who locks specs; empty: the system's user name
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

    [[nodiscard]] LayerEditMode editMode() const;
    /// Fails for a stage that has no place for the delegate; the mode stays.
    LayerResult<void> setEditMode(LayerEditMode mode);

    /// `nowMs`: of any steady clock. Returns the edits that went back.
    std::vector<RefusedEdit> update(double nowMs);
    /// Brings edits of the delegate to their layers and takes back edits of locked specs now, also
    /// while auto authoring is suspended: before something is saved, sent or left. Returns the
    /// edits that went back.
    std::vector<RefusedEdit> distribute();
    /// What happened since the last call, in order.
    [[nodiscard]] std::vector<LayerEvent> takeEvents();
    /// Tells of edits that somebody else did not take, a server, with those that went back here.
    void refuse(std::vector<RefusedEdit> edits);
    /// The latest edits that went back, oldest first; at most 10,000 are kept.
    [[nodiscard]] const std::deque<RefusedEdit>& refusedEdits() const;

    void setLive(LiveLayers* live);

private:
    class Impl;
    [[nodiscard]] Impl& here(const char* function) const;

    std::unique_ptr<Impl> impl_;
};

}  // namespace usdlive::layers
