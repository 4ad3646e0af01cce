// Previews of others.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "session/BlobTransfer.h"
#include "session/SessionEvents.h"
#include "usdlive/common/layer/TransactionExecutor.h"
#include "usdlive/common/protocol/Frame.h"

namespace usdlive::client {

/// The gestures of others that are not committed. The view shows the newest preview of each whose
/// big values are here.
class OthersPreviews {
public:
    /// `confirmed` are the layers whose previews are of interest. `changed` is called when shown()
    /// returns something else.
    OthersPreviews(const ClientId& self, SessionHost& host, BlobDownloads& downloads,
                   SessionEvents& events, const LayerDocs& confirmed, std::function<void()> changed)
        : self_(self),
          host_(host),
          downloads_(downloads),
          events_(events),
          confirmed_(confirmed),
          changed_(std::move(changed)) {}

    void received(PreviewFrame&& frame);
    /// The commit of a gesture has come.
    void committed(const ClientId& author, std::uint64_t gesture);
    /// The connection is lost, or the session joins another history.
    void endAll();
    /// Call it when other layers are joined: previews may name big values in them.
    void presentAgain();
    void blobArrived(const Hash& hash);
    void blobFailed(const Hash& hash);

    [[nodiscard]] bool isEmpty() const { return previews_.empty(); }
    /// Returns the shown previews by the order in which their gestures began. Valid until the next
    /// call that changes them.
    [[nodiscard]] std::map<std::uint64_t, const PreviewFrame*> shown() const;

private:
    struct Preview {
        std::uint64_t slot = 0;               // the order in which gestures began
        std::optional<PreviewFrame> frame;    // shown
        std::optional<PreviewFrame> waiting;  // waits for its big values
        std::set<Hash> missing;               // those that are not here
        std::optional<PreviewFrame> newest;   // arrived while another one waits
    };
    using Previews = std::map<std::pair<ClientId, std::uint64_t>, Preview>;

    void present(Previews::value_type& entry, PreviewFrame frame);
    void presentNewest(Previews::value_type& entry);
    void show(Previews::value_type& entry, PreviewFrame frame);
    [[nodiscard]] std::set<Hash> missingOf(const PreviewFrame& frame) const;

    const ClientId& self_;
    SessionHost& host_;
    BlobDownloads& downloads_;
    SessionEvents& events_;
    const LayerDocs& confirmed_;
    const std::function<void()> changed_;
    Previews previews_;
    std::uint64_t lastSlot_ = 0;
};

}  // namespace usdlive::client
