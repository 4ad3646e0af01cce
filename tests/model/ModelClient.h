// The client of the model.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "Explored.h"
#include "Scenario.h"

namespace usdlive::model {

/// The real Session with a simulated editor that has one layer, a LayerDoc.
class ModelClient : public client::SessionHost, public client::LayerView {
public:
    /// The properties of a state that rules about several machines need.
    struct Summary {
        bool online = false, joined = false, wanted = false, hasHistory = false;
        bool upToDate = false;  ///< nothing is pending, and the editor shows the confirmed layer
        Revision revision = 0;
        bool holds = false;  ///< work that was refused for a reason that passes waits (SE21)
        Hash hash;           ///< the chain hash of the commit `revision`
        Hash confirmed;      ///< the hash of the layer's content, when joined
        std::size_t written = 0;
        Labels authored = 0, pending = 0, lost = 0, acknowledged = 0;
    };

    ModelClient(const Scenario& scenario, std::size_t number, Messages& messages);

    std::vector<Output> apply(Input input);
    void digest(Digest& out) const;
    [[nodiscard]] Summary summary() const;

private:
    // SessionHost, LayerView
    void send(SharedBytes frames) override;
    SharedBytes localBlob(const Hash&) override { return nullptr; }
    void blobArrived(const Hash&, SharedBytes, bool) override {}
    void reset(const LayerId& layer, const LayerDoc& doc) override;
    void apply(const LayerId& layer, const std::string& path, const EditAction& action) override;

    void write();
    void toggle();
    void tick();
    void checkTold();
    void on(const client::event::Lost& event);
    void on(const client::event::Joined& event);
    void on(const client::event::Committed& event);
    void on(const client::event::Connected& event);
    void on(const client::event::ServerError& event);
    void on(const client::event::JoinFailed& event);
    void on(const auto&) {}
    void checkEditor() const;
    [[nodiscard]] Labels pendingLabels() const;

    const Scenario& scenario_;
    const std::size_t number_;
    std::int64_t nowMs_ = 0;
    Messages& messages_;
    std::vector<Output> outputs_;

    LayerDoc editor_;
    bool wanted_ = true;  // the layer is open
    std::size_t written_ = 0;
    Labels authored_ = 0, lost_ = 0, acknowledged_ = 0;
    // ID4: the confirmed layer of the history that the session has stopped in or is leaving.
    std::optional<LayerDoc> told_;
    std::vector<client::AuthoredEdit> regained_;
    bool stopped_ = false, leaving_ = false, left_ = false;
    Revision notified_ = 0;  // the last commit that the editor was notified of
    std::optional<client::MessageReader> reader_;  // belongs to the current connection
    client::Session session_;
};

}  // namespace usdlive::model
