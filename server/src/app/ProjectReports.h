// The reports of several projects, for a page.
#pragma once

#include <boost/asio/io_context.hpp>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "app/ServedProject.h"

namespace usdlive::server {

/// The reports of projects by their names in addresses.
using ProjectReports = std::vector<std::pair<std::string, ServedProject::Report>>;

/// Asks projects for their reports, and calls `done` once: when all have answered, or after a
/// second, with the status "busy" for those that have not. Called on the thread that runs `io`, and
/// so is `done`, possibly before this returns. The projects may be removed meanwhile.
void gatherReports(boost::asio::io_context& io, const std::vector<ServedProject*>& projects,
                   bool haveMetrics, std::function<void(const ProjectReports&)> done);

}  // namespace usdlive::server
