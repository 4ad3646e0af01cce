// The text output of the commands.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "cli/Terminal.h"
#include "session/Session.h"
#include "usdlive/common/history/Blame.h"
#include "usdlive/common/layer/Edit.h"
#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/protocol/Control.h"

namespace usdlive::cli {

/// Returns the text on one line, with escaped control characters.
[[nodiscard]] std::string withoutControls(std::string_view text);

/// Returns `1 edit` or `2 edits` for "edit".
[[nodiscard]] std::string counted(std::size_t count, const std::string& what);

/// Returns a value as a short text: `(1, 2, 3)`, `"hello"`, `float3[1024]`. One line without
/// control characters.
[[nodiscard]] std::string describe(const FieldValue& value);

/// Returns an edit without its layer: `/World/Ball.radius default = 2`.
[[nodiscard]] std::string describe(const Edit& edit);

/// Returns a commit: a line with author and time, then one line for each edit, at most `maxEdits`.
/// With `layer`, only edits of that layer.
[[nodiscard]] std::string describe(const Commit& commit, std::size_t maxEdits, const LayerId& layer,
                                   const Palette& palette);

/// Returns who has made an opinion, and when: `#42  2026-01-02 03:04:05  ada`. `base`: where the
/// history begins.
[[nodiscard]] std::string describe(const BlamedOpinion& opinion, Revision base,
                                   const Palette& palette);

/// Returns the text after a layer's name: `  changed, locked by ada, open: ada bob`; may be empty.
[[nodiscard]] std::string describe(const LayerState& state, const Palette& palette);
/// Returns one line: `ada  usdview  /World/Ball  in shot.usda  at 24`.
[[nodiscard]] std::string describe(const Presence& presence, const Palette& palette);

/// Returns one line: `#42  2026-01-02 03:04:05  ada  before lunch`.
[[nodiscard]] std::string describe(const Checkpoint& checkpoint, const Palette& palette);

/// Returns one or two lines about the result of compacting.
[[nodiscard]] std::string describe(const HistoryCompacted& done);
/// Returns the used space: a line for each kind, then one for each layer, the largest first.
[[nodiscard]] std::string describe(const Storage& storage, const Palette& palette);

/// Returns one line: `a:b.usda  the layer name ... holds a colon`.
[[nodiscard]] std::string describe(const SkippedFile& file);

/// Returns the current operation: `saving shot.usda`.
[[nodiscard]] std::string describe(const client::event::Progress& progress);

/// Returns the prims of a layer as a tree with their types.
[[nodiscard]] std::string describeTree(const LayerDoc& doc, const Palette& palette);

/// Returns true if the commit changes this layer (empty: any layer).
[[nodiscard]] bool concerns(const Commit& commit, const LayerId& layer);

}  // namespace usdlive::cli
