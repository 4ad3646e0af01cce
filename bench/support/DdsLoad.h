// Loads a server with clients over DDS.
#pragma once

#include <string>

#include "Load.h"
#include "usdlive/common/dds/Domain.h"

namespace usdlive::bench {

/// Does the work of runLoad() over DDS: every connection is a client with a participant of its own,
/// and with a thread that notes the samples that arrive. The server serves `project` in the domain.
[[nodiscard]] LoadFigures runDdsLoad(const LoadPlan& plan, Dialect& dialect,
                                     const dds::DomainSettings& settings,
                                     const std::string& project, const ChildProcess& server);

/// The ceiling: Cyclone's own `ddsperf` writes as many samples of `frameBytes` to as many readers,
/// each a process. Returns the writer's CPU time per sample and reader, at the requested rate.
/// Latencies are from writing to the reader's answer, 0 if ddsperf printed none. Returns zeros only
/// if ddsperf is not installed.
[[nodiscard]] LoadFigures runDdsPerf(const LoadPlan& plan, std::size_t frameBytes,
                                     const dds::DomainSettings& settings,
                                     const std::vector<int>& serverCores);

}  // namespace usdlive::bench
