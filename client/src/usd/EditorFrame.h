// What the editor has written in one frame, on its way to the session.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "session/Session.h"
#include "usd/ArrayEncodings.h"
#include "usd/BlobCache.h"
#include "usd/LiveSet.h"
#include "usd/LostWorkReports.h"

namespace usdlive::client {

/// Captures what the editor writes, over all live layers: one frame is one transaction.
class EditorFrame {
public:
    /// All of it outlives this. `encoder` encodes big arrays.
    EditorFrame(BlobCache& blobs, Worker& encoder, LostWorkReports& lost)
        : encodings_(blobs, encoder), lost_(lost) {}

    /// Where LiveLayers put the big arrays that the editor writes.
    [[nodiscard]] usd::BlobSink& sink() { return encodings_; }

    /// Makes what was written since the last call a transaction of the session. Must not be called
    /// from within Sdf.
    void seal(LiveSet& layers, Session& session);
    /// The same, unless big arrays are still being encoded beside it (false): then the frame stays
    /// open, and no edits of others may come into the layers.
    [[nodiscard]] bool sealWhenEncoded(LiveSet& layers, Session& session);
    /// A frame is open because of its big arrays.
    [[nodiscard]] bool holdsBack() const { return holdsBack_; }
    [[nodiscard]] static bool hasWrites(LiveSet& layers);

    /// Makes edits of a layer's root and authors them, after what was written before. `makeEdits`
    /// is called when the session has that.
    void author(LiveSet& layers, Session& session, LiveLayer& live,
                const std::function<std::vector<EditAction>()>& makeEdits);

private:
    ArrayEncodings encodings_;
    LostWorkReports& lost_;
    bool holdsBack_ = false;
};

/// Has the server write the files of layers again that the editor has saved itself: their files
/// would count as changed by somebody else, and lack what others have edited.
void saveAgain(LiveSet& layers, Session& session);

}  // namespace usdlive::client
