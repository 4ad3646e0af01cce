// Requests to open layers, which ticks work off.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include "usd/Clocks.h"
#include "usd/OpenLayers.h"

namespace usdlive::client {

/// Opens layers with the layers they use, all the way down, tick by tick. A request ends by an
/// event (LayerOpened or LayerOpenFailed), or, for a blocking call, by an outcome that the caller
/// takes.
class OpenRequests {
public:
    OpenRequests(OpenLayers& layers, BigValues& values, EditorEvents& events)
        : layers_(layers), values_(values), events_(events) {}

    enum class Reports { Event, Outcome };
    /// Returns the number of the request; start() begins its work.
    std::uint64_t add(const LayerId& layer, LoadSet load, Reports reports);
    /// A request for layers that are joined already.
    std::uint64_t addJoined(const std::vector<LayerId>& layers, LoadSet load);

    // Parts of a tick, outside of a change block.
    /// Begins to open what was requested: one layer at least, and more within the budget. Returns
    /// whether some are left for the next tick.
    bool start(double budgetMs);
    /// Opens the layers that filled ones use, and ends requests whose layers are all filled, with
    /// their big values. The same of budget and result.
    bool advance(double budgetMs);

    /// Is there a request that asks for the layer?
    [[nodiscard]] bool has(const LayerId& layer) const;
    /// The server cannot give the layer.
    void failed(const LayerId& layer, const Error& reason);
    /// The editor closes the layer: requests that ask for it fail.
    void closed(const LayerId& layer);

    /// The outcome of a request with Reports::Outcome, once. Nothing: it is not at its end.
    [[nodiscard]] std::optional<Result<void>> takeOutcome(std::uint64_t request);
    /// Ends a request without an outcome; its layers go on opening.
    void drop(std::uint64_t request) { requests_.erase(request); }
    /// Grows whenever a request came closer to its end.
    [[nodiscard]] std::uint64_t steps() const { return steps_; }

private:
    struct Request {
        std::vector<LayerId> asked;
        LoadSet load;
        Reports reports;
        std::set<LayerId> seen = {};       ///< asked, and used by those
        std::set<LayerId> unfilled = {};   ///< of these; their used layers are not known yet
        std::set<LayerId> unchecked = {};  ///< of these; may wait for big values
        std::int64_t reportAtMs = 0;
        std::optional<Result<void>> outcome = {};
    };
    using Requests = std::map<std::uint64_t, Request>;

    void see(Request& request, const LayerId& layer);
    /// Returns false when the budget ended first.
    bool advance(Request& request, const Stopwatch& watch, double budgetMs);
    [[nodiscard]] bool isComplete(Request& request) const;
    void reportProgress(std::uint64_t number, Request& request, std::int64_t nowMs);
    /// The layer will not come. Ends requests that ask for it.
    void without(const LayerId& layer, const Error& reason);
    /// Returns the next request.
    Requests::iterator end(Requests::iterator request, Result<void> outcome);

    OpenLayers& layers_;
    BigValues& values_;
    EditorEvents& events_;
    Requests requests_;
    std::deque<std::uint64_t> unstarted_;
    // Numbers of requests to the server are smaller: a number means one request.
    std::uint64_t last_ = std::uint64_t(1) << 32;
    std::uint64_t steps_ = 0;
};

}  // namespace usdlive::client
