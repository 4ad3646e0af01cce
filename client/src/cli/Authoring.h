// Edits layers of a project from the command line.
#pragma once

#include <set>
#include <string>
#include <vector>

#include "cli/Link.h"

namespace usdlive::cli {

/// Opens layers and waits until their content is here. Error: the layer that could not be opened.
[[nodiscard]] Result<void> joinLayers(Link& link, const std::set<LayerId>& layers);
/// Commits edits of joined layers as one transaction with a label, which may be empty, and returns
/// its revision. Error: they were refused, or the server cannot take them now; then nothing was
/// changed.
[[nodiscard]] Result<Revision> submitEdits(Link& link, std::vector<client::AuthoredEdit> edits,
                                           const std::string& label = {});

}  // namespace usdlive::cli
