// Converts layer states and presences to DDS samples and back.
#pragma once

#include <optional>
#include <vector>

#include "usdlive/common/dds/Topics.h"
#include "usdlive/common/protocol/Control.h"

namespace usdlive::dds {

/// A layer's state as a sample. The sample points into `state`, which must outlive it.
class LayerStateOut {
public:
    explicit LayerStateOut(const LayerState& state);
    LayerStateOut(const LayerStateOut&) = delete;
    LayerStateOut& operator=(const LayerStateOut&) = delete;

    LayerStateSample sample{};

private:
    std::vector<char*> editors_;
};
/// Returns nothing if the sample is invalid.
[[nodiscard]] std::optional<LayerState> layerStateOf(const LayerStateSample& sample);

/// A presence as a sample. The sample points into `presence`, which must outlive it.
class PresenceOut {
public:
    explicit PresenceOut(const Presence& presence);
    PresenceOut(const PresenceOut&) = delete;
    PresenceOut& operator=(const PresenceOut&) = delete;

    PresenceSample sample{};

private:
    std::string colour_;
    std::vector<char*> selection_;
};
/// Returns nothing if the sample is invalid.
[[nodiscard]] std::optional<Presence> presenceOf(const PresenceSample& sample);

}  // namespace usdlive::dds
