// The edits and faults of a search.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "session/Session.h"

namespace usdlive::model {

inline constexpr std::size_t kClients = 2;
inline const LayerId kLayer{"root.usda"};

/// The number of an editor's write, which identifies it in all states. It is below 32, so that a
/// set of labels fits into one word of bits.
using Label = std::uint32_t;
using Labels = std::uint32_t;

/// Returns the next edits of an editor that sees `seen`; nothing when they are not possible now.
using Write = std::function<std::vector<client::AuthoredEdit>(const LayerDoc& seen, Label label)>;

/// A flaw that the model adds on purpose, and that the search must find.
enum class Flaw {
    None,
    AcksEarly,  ///< the store reports a commit as durable before it is
    Reorders,   ///< a message may overtake the one before it on its way to a client
    Forgets,    ///< the server does not know which transactions are committed (M9)
    Hides,      ///< an editor is not notified of its lost work (M12)
};

/// How often each fault or decision may happen in a search. Each may happen at any time.
struct Bounds {
    std::array<std::uint8_t, kClients> breaks{};   ///< for each client: of its connection
    std::array<std::uint8_t, kClients> toggles{};  ///< closing the layer, or opening it again
    std::uint8_t deaths = 0, diskFulls = 0, diskFailures = 0, rollBacks = 0;
    bool operator==(const Bounds&) const = default;
};

/// A searched scenario.
struct Scenario {
    std::string name;
    std::array<std::vector<Write>, kClients> scripts;
    Bounds bounds;
    bool joined = true;     ///< begins when everything is quiet; otherwise before a client connects
    bool ownTicks = false;  ///< an editor's tick is a step of its own, and not part of each input
    bool readsBack = false;  ///< the server keeps no recent commits in memory
    bool forgetful = false;  ///< the server carries addresses over one revision only
    Flaw flaw = Flaw::None;

    /// True if the store may lose acknowledged commits. Then only the rules for the end are
    /// checked.
    [[nodiscard]] bool losesHistory() const { return bounds.rollBacks > 0; }
};

/// Returns the content of the layer's file.
[[nodiscard]] LayerDoc startingLayer();
/// Returns the label that an edit carries.
[[nodiscard]] std::optional<Label> labelOf(const EditAction& action);

[[nodiscard]] const std::vector<Scenario>& scenarios();
[[nodiscard]] const std::vector<Scenario>& flawedScenarios();

}  // namespace usdlive::model
