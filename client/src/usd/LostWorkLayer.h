#pragma once

#include "session/Session.h"
#include "usdlive/common/usd/ValueCodec.h"

namespace usdlive::client {

/// The lost edits of one layer as a layer of their own (M12): sparse, with overs on the way to what
/// they are about, so that it can be laid over the project's. `known` (nullptr: nothing) tells the
/// kinds and types of specs that the edits take for granted. Best effort: an edit that finds
/// nothing to stand on, like the deletion of a spec of the project, is passed over.
[[nodiscard]] LayerDoc lostWorkDoc(const LostWork& work, const LayerId& layer,
                                   const LayerDoc* known, usd::BlobSource& blobs);

}  // namespace usdlive::client
