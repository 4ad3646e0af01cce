// What the commands print for people.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "Terminal.h"
#include "usdlive/client/session/Session.h"
#include "usdlive/common/layer/Edit.h"
#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/protocol/Control.h"

namespace usdlive::cli {

/// The text on one line, with control characters escaped.
[[nodiscard]] std::string withoutControls(std::string_view text);

/// A value in a few words for a person: `(1, 2, 3)`, `"hello"`, `float3[1024]`. One line, no
/// control characters.
[[nodiscard]] std::string describe(const FieldValue& value);

/// What an edit does, without its layer: `/World/Ball.radius default = 2`.
[[nodiscard]] std::string describe(const Edit& edit);

/// A commit: a line that says who and when, then one for each edit, at most `maxEdits` of them.
/// With `layer`, only edits of that one.
[[nodiscard]] std::string describe(const Commit& commit, std::size_t maxEdits, const LayerId& layer,
                                   const Palette& palette);

/// Beside a layer's name: `  changed, locked by ada, open: ada bob`; empty when there is nothing.
[[nodiscard]] std::string describe(const LayerState& state, const Palette& palette);
/// A line: `ada  usdview  /World/Ball  in shot.usda  at 24`.
[[nodiscard]] std::string describe(const Presence& presence, const Palette& palette);

/// A line: `#42  2026-01-02 03:04:05  ada  before lunch`.
[[nodiscard]] std::string describe(const Checkpoint& checkpoint, const Palette& palette);

/// What became of the history, in a line or two.
[[nodiscard]] std::string describe(const HistoryCompacted& done);
/// What the store takes: a line for each kind, then one for each layer, the largest first.
[[nodiscard]] std::string describe(const Storage& storage, const Palette& palette);

/// A line: `a:b.usda  the layer name ... holds a colon`.
[[nodiscard]] std::string describe(const SkippedFile& file);

/// What is under way: `saving shot.usda`.
[[nodiscard]] std::string describe(const client::event::Progress& progress);

/// The prims of a layer as a tree with their types.
[[nodiscard]] std::string describeTree(const LayerDoc& doc, const Palette& palette);

/// Does the commit change this layer (empty: any)?
[[nodiscard]] bool concerns(const Commit& commit, const LayerId& layer);

}  // namespace usdlive::cli
