// Takes chosen work of the past back, whoever made it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <set>
#include <utility>
#include <vector>

#include "session/UndoStack.h"
#include "usdlive/client/session/Undo.h"
#include "usdlive/common/layer/TransactionExecutor.h"

namespace usdlive::client {

/// Makes the edits that take chosen edits of the past back, against the present. It is the undo of
/// an editor (UndoStack) over commits of the history: a register goes back only if it still holds
/// what the chosen edits wrote and no other commit has written it since. Specs are followed through
/// later moves.
///
/// Add all commits since the first chosen one, in order, then call takeBack() once. One thread.
class Reversal {
public:
    /// `before`: the layers before the first commit that is added. Edits of other layers are
    /// ignored, and cannot be chosen.
    explicit Reversal(LayerDocs before);

    using Chosen = std::function<bool(const Edit& edit)>;
    /// Adds a commit of the history. The import of a layer cannot be chosen. Error: one of
    /// LayerDoc::apply(), if the commit does not follow those before.
    Result<void> add(const Commit& commit, const Chosen& chosen);

    /// Returns the number of edits that were chosen.
    [[nodiscard]] std::size_t chosen() const { return count_; }
    /// Returns the layers after the last commit that was added.
    [[nodiscard]] const LayerDocs& layers() const { return layers_; }

    struct TakenBack {
        std::vector<AuthoredEdit> edits;  ///< in an order in which they apply to layers()
        std::vector<KeptByUndo> kept;     ///< stays as it is, with the reasons
    };
    [[nodiscard]] TakenBack takeBack();

private:
    Result<void> addOwn(const Commit& run);
    Result<void> addOthers(const Commit& run);
    void follow();

    LayerDocs layers_;
    NamespaceLog log_;
    UndoStack stack_;
    Revision runs_ = 0;  // runs of edits that are all chosen, or all not
    std::size_t count_ = 0;
};

}  // namespace usdlive::client
