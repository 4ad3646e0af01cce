// Edits whole layers of a line of history.
#pragma once

#include <set>
#include <string>
#include <vector>

#include "lines/LineLink.h"

namespace usdlive::client {

/// Opens layers and waits until their content is here. Error: the layer that could not be opened.
[[nodiscard]] Result<void> joinLayers(LineLink& link, const std::set<LayerId>& layers);
/// Commits edits of joined layers as one transaction with a label, which may be empty, and returns
/// its revision. Error: they were refused, or the server cannot take them now; then nothing was
/// changed.
[[nodiscard]] Result<Revision> submitEdits(LineLink& link, std::vector<AuthoredEdit> edits,
                                           const std::string& label = {});

}  // namespace usdlive::client
