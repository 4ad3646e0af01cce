// Requests to open layers, which are executed by ticks.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include "basics/Clocks.h"
#include "usd/editor/OpenLayers.h"

namespace usdlive::client {

/// Opens layers with all layers that they use, recursively, over several ticks. A request ends with
/// an event (LayerOpened or LayerOpenFailed), or for a blocking call with an outcome that the
/// caller takes.
class OpenRequests {
public:
    OpenRequests(OpenLayers& layers, NeededBigValues& values, EditorEvents& events)
        : layers_(layers), values_(values), events_(events) {}

    enum class Reports { Event, Outcome };
    /// Adds a request, which start() starts. Returns its number.
    std::uint64_t add(const LayerId& layer, LoadSet load, Reports reports);
    /// Adds a request for layers that are already joined. It does not fail if one of them does.
    std::uint64_t addJoined(const std::vector<LayerId>& layers, LoadSet load);

    // Parts of a tick, outside of a change block.
    /// Starts to open requested layers: at least one, and more within the budget. Returns whether
    /// some are left for the next tick.
    bool start(double budgetMs);
    /// Opens the layers that filled layers use, and ends requests whose layers are all filled, with
    /// their big values. Budget and result are as for start().
    bool advance(double budgetMs);

    /// Returns whether there is a request for the layer.
    [[nodiscard]] bool has(const LayerId& layer) const;
    /// Call it when the server does not have the layer.
    void failed(const LayerId& layer, const Error& reason);
    /// Call it when the editor closes the layer: requests for it fail.
    void closed(const LayerId& layer);

    /// Returns the outcome of a request with Reports::Outcome, once. Returns nothing if it has not
    /// ended.
    [[nodiscard]] std::optional<Result<void>> takeOutcome(std::uint64_t request);
    /// Ends a request without an outcome. Its layers continue to open.
    void drop(std::uint64_t request) { requests_.erase(request); }
    /// Returns a counter that grows with the progress of requests.
    [[nodiscard]] std::uint64_t steps() const { return steps_; }

private:
    struct Request {
        std::vector<LayerId> asked;
        LoadSet load;
        Reports reports;
        std::set<LayerId> seen = {};       ///< requested layers, and those that they use
        std::set<LayerId> unfilled = {};   ///< layers of `seen` whose used layers are not known yet
        std::set<LayerId> unchecked = {};  ///< layers of `seen` that may wait for big values
        std::int64_t reportAtMs = 0;
        std::optional<Result<void>> outcome = {};
    };
    using Requests = std::map<std::uint64_t, Request>;

    void see(Request& request, const LayerId& layer);
    /// Returns false if the budget was not sufficient.
    bool advance(Request& request, const Stopwatch& watch, double budgetMs);
    [[nodiscard]] bool isComplete(Request& request) const;
    void reportProgress(std::uint64_t number, Request& request, std::int64_t nowMs);
    /// Call it when the layer cannot be opened. Ends requests for it.
    void without(const LayerId& layer, const Error& reason);
    /// Ends a request. Returns the next one.
    Requests::iterator end(Requests::iterator request, Result<void> outcome);

    OpenLayers& layers_;
    NeededBigValues& values_;
    EditorEvents& events_;
    Requests requests_;
    std::deque<std::uint64_t> unstarted_;
    // Starts above the numbers of requests to the server, so that all numbers are distinct.
    std::uint64_t last_ = std::uint64_t(1) << 32;
    std::uint64_t steps_ = 0;
};

}  // namespace usdlive::client
