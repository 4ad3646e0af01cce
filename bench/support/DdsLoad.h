#pragma once

#include <string>

#include "Load.h"
#include "usdlive/common/dds/Domain.h"

namespace usdlive::bench {

/// runLoad() over DDS: every connection is a client with a participant of its own, and a thread
/// that notes what comes. The server serves `project` in the domain.
[[nodiscard]] LoadFigures runDdsLoad(const LoadPlan& plan, Dialect& dialect,
                                     const dds::DomainSettings& settings,
                                     const std::string& project, const ChildProcess& server);

/// The ceiling: Cyclone's own `ddsperf` writes as many samples of `frameBytes` to as many readers,
/// each a process. CPU of the writer, per sample and reader at the rate asked for; latencies are
/// from writing to the reader's answer, 0 when it told none. Nothing but zeros: it is not
/// installed.
[[nodiscard]] LoadFigures runDdsPerf(const LoadPlan& plan, std::size_t frameBytes,
                                     const dds::DomainSettings& settings,
                                     const std::vector<int>& serverCores);

}  // namespace usdlive::bench
