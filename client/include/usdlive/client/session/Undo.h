// The results of undo and redo.
#pragma once

#include <string>
#include <vector>

#include "usdlive/common/layer/Edit.h"

namespace usdlive::client {

/// Something that an undo or redo has left as it is.
struct KeptByUndo {
    LayerId layer;
    std::string path;
    std::string field;  ///< empty: the spec itself
    FieldPart part;
    UserName author;     ///< the user that has written it since; empty: unknown, or nobody
    std::string reason;  ///< for the user
};

/// The result of an undo or redo.
struct UndoResult {
    bool done = false;  ///< false: there was nothing to undo or redo
    std::string label;  ///< the label of the step
    std::vector<KeptByUndo> kept = {};
};

/// The labels of the steps that can be undone and redone. The last of each is the next.
struct UndoLabels {
    std::vector<std::string> undo, redo;
};

}  // namespace usdlive::client
