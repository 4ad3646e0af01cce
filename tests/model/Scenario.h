#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "usdlive/client/session/Session.h"

namespace usdlive::model {

inline constexpr std::size_t kClients = 2;
inline const LayerId kLayer{"root.usda"};

/// Each write of an editor carries a number of its own, by which it is known again wherever it
/// ends: below 32, so that a set of them is a word of bits.
using Label = std::uint32_t;
using Labels = std::uint32_t;

/// What an editor writes next, given what it sees; nothing when that cannot be done now.
using Write = std::function<std::vector<client::AuthoredEdit>(const LayerDoc& seen, Label label)>;

/// A deliberate fault of the model's own, that the checker has to find.
enum class Flaw {
    None,
    AcksEarly,  ///< the store says that a commit is durable when it is not yet
    Reorders,   ///< a message may overtake the one before on its way to a client
    Forgets,    ///< the server does not know which transactions are committed (M9)
    Hides,      ///< an editor's lost work is not told (M12)
};

/// How much may happen in a search. What is bounded by nothing else: each is a choice at any time.
struct Bounds {
    std::array<std::uint8_t, kClients> breaks{};   ///< of each client's line
    std::array<std::uint8_t, kClients> toggles{};  ///< closing the layer, opening it again
    std::uint8_t deaths = 0, diskFulls = 0, diskFailures = 0, rollBacks = 0;
    bool operator==(const Bounds&) const = default;
};

/// What is searched.
struct Scenario {
    std::string name;
    std::array<std::vector<Write>, kClients> scripts;
    Bounds bounds;
    bool joined = true;      ///< begins when all is quiet; otherwise before anybody connects
    bool ownTicks = false;   ///< an editor's tick is a step of its own, not part of each input
    bool readsBack = false;  ///< the server keeps no recent commits in memory
    bool forgetful = false;  ///< the server carries addresses over one revision only
    Flaw flaw = Flaw::None;

    /// May the store lose what was acknowledged? Then only what holds in the end is checked.
    [[nodiscard]] bool losesHistory() const { return bounds.rollBacks > 0; }
};

/// The layer's file.
[[nodiscard]] LayerDoc startingLayer();
/// The label an edit carries.
[[nodiscard]] std::optional<Label> labelOf(const EditAction& action);

[[nodiscard]] const std::vector<Scenario>& scenarios();
[[nodiscard]] const std::vector<Scenario>& flawedScenarios();

}  // namespace usdlive::model
