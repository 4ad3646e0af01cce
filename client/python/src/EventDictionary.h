#pragma once

#include <nanobind/nanobind.h>

#include "usdlive/client/session/Session.h"

namespace usdlive {

// Values as dictionaries whose keys are the members of the dataclasses in usdlive/events.py. They
// need the interpreter's lock.

/// With the event's name under "event".
[[nodiscard]] nanobind::dict toDictionary(const client::Event& event);
[[nodiscard]] nanobind::dict toDictionary(const client::UnsentWork& work);
nanobind::dict toDictionary(const LayerState& state);
[[nodiscard]] nanobind::dict toDictionary(const Presence& presence);

}  // namespace usdlive
