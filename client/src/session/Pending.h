#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "session/Session.h"
#include "usdlive/common/layer/Edit.h"

namespace usdlive::client {

/// A spec that a transaction touches, where the editor sees it now.
struct Touched {
    LayerId layer;
    std::string path;
};

/// What a transaction became when it was last executed on top of what the editor sees.
struct Prognosis {
    /// Of each edit, in order, the spec; of a move that changes something also where it goes.
    std::vector<Touched> touched;
    std::uint64_t names = 0;  ///< of the predicted log, after this transaction
    bool complete = true;     ///< nothing of it was dropped or refused
    bool refused = false;     ///< all of it: nothing of it is seen
};

/// A transaction of one's own that the server has not answered.
struct Pending {
    Transaction transaction;
    std::vector<AuthoredEdit> authored;  ///< one for each edit, as the editor made it
    Prognosis prognosis;
    std::vector<Value> blobs;  ///< big values it names
    bool sent = false;         ///< on this connection
    bool everSent = false;     ///< under its present number
    std::size_t sentBytes = 0;
    int attempts = 0;  ///< how often it has been sent anew under another number
    /// While the history it was meant for is gone (HistoryDiverged): its edits where they stood
    /// then; nothing for those that were dropped.
    std::vector<std::optional<AuthoredEdit>> carried;
};

/// Do both set the same register, so that the later is all that is left? False also where the order
/// of what is in a field is part of its content.
[[nodiscard]] bool setSameRegister(const EditAction& earlier, const EditAction& later);

/// The big values that an action names.
void collectBlobs(const EditAction& action, std::vector<Value>& blobs);

}  // namespace usdlive::client
