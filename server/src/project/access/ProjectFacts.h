// The state of a project on which its access rules depend.
#pragma once

#include "project/access/AccessPolicy.h"
#include "project/layers/StateBoard.h"
#include "project/lines/HistoryLine.h"
#include "project/sessions/SessionTable.h"

namespace usdlive::server {

/// Reads the facts from the parts of a project.
class ProjectFacts : public AccessPolicy::Facts {
public:
    ProjectFacts(const HistoryLine& line, const StateBoard& states, const SessionTable& sessions,
                 ports::Clock& clock)
        : line_(line), states_(states), sessions_(sessions), clock_(clock) {}

    [[nodiscard]] const LayerDocs& loadedLayers() const override { return line_->docs(); }
    [[nodiscard]] LayerLock lockAt(const LayerId& layer) const override {
        return states_->lockAt(layer);
    }
    [[nodiscard]] bool isUserConnected(const UserName& user) const override {
        return sessions_->isUserConnected(user);
    }
    [[nodiscard]] std::int64_t steadyMs() const override { return clock_->steadyMs(); }

private:
    Wire<const HistoryLine> line_;
    Wire<const StateBoard> states_;
    Wire<const SessionTable> sessions_;
    Wire<ports::Clock> clock_;
};

}  // namespace usdlive::server
