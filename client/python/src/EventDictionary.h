#pragma once

#include <nanobind/nanobind.h>

#include "usdlive/client/session/Session.h"

namespace usdlive {

/// An event as a dictionary whose "event" is its name; the other keys are the members of the
/// dataclass of that name in usdlive/events.py. Needs the interpreter's lock.
[[nodiscard]] nanobind::dict toDictionary(const client::Event& event);

}  // namespace usdlive
