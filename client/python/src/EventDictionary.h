// Converts events to Python dictionaries.
#pragma once

#include <nanobind/nanobind.h>

#include <map>

#include "usdlive/client/history/History.h"
#include "usdlive/client/lines/ProjectSessions.h"
#include "usdlive/client/session/Events.h"
#include "usdlive/client/session/Undo.h"

namespace usdlive {

// Converts values to dictionaries with the members of the dataclasses in usdlive/events.py as keys.
// Call it with the interpreter's lock.

/// Returns the event with its name under the key "event".
[[nodiscard]] nanobind::dict toDictionary(const client::Event& event);
[[nodiscard]] nanobind::dict toDictionary(const client::UnsentWork& work);
[[nodiscard]] nanobind::dict toDictionary(const client::OtherHistory& other);
[[nodiscard]] nanobind::dict toDictionary(const client::UndoResult& result);
[[nodiscard]] nanobind::dict toDictionary(const Commit& commit);
/// The value and what was there before are JSON.
[[nodiscard]] nanobind::dict toDictionary(const client::BlamedContent& one);
[[nodiscard]] nanobind::dict toDictionary(const client::SessionInfo& session);
/// The values are JSON.
[[nodiscard]] nanobind::dict toDictionary(const client::SessionConflict& conflict);
[[nodiscard]] nanobind::dict toDictionary(const client::SessionMerged& merged);
nanobind::dict toDictionary(const LayerState& state);
[[nodiscard]] nanobind::dict toDictionary(const Presence& presence);
[[nodiscard]] nanobind::list toDictionaries(const std::map<ClientId, Presence>& presences);
[[nodiscard]] nanobind::list toDictionaries(const std::map<LayerId, LayerState>& states);
[[nodiscard]] nanobind::list toDictionaries(const client::BlameResult& found);
/// Returns (commits, before, path, more): the middle two ask for the next page.
[[nodiscard]] nanobind::tuple toTuple(const client::LogPage& page);
/// Returns (allowed, why).
[[nodiscard]] nanobind::tuple toTuple(const client::Permission& permission);

}  // namespace usdlive
