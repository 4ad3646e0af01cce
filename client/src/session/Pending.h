#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "usdlive/client/session/Session.h"
#include "usdlive/common/layer/Edit.h"

namespace usdlive::client {

/// A spec that a transaction touches, where the editor sees it now.
struct Touched {
    LayerId layer;
    std::string path;
};

/// What a transaction became when it was last executed on top of what the editor sees.
struct Prognosis {
    std::vector<Touched> touched;
    /// Fields only and none of them dropped: where each edit landed. Empty otherwise.
    std::vector<std::string> fieldsAt;
    bool complete = true;  ///< nothing of it was dropped or refused
    bool refused = false;  ///< all of it: nothing of it is seen

    /// To take back what was noted of the latest edit.
    struct Size {
        std::size_t touched, fieldsAt;
    };
    [[nodiscard]] Size size() const { return {touched.size(), fieldsAt.size()}; }
    void shrink(Size size) {
        touched.resize(size.touched);
        fieldsAt.resize(size.fieldsAt);
    }
};

/// A transaction of one's own that the server has not answered.
struct Pending {
    Transaction transaction;
    std::vector<AuthoredEdit> authored;  ///< one for each edit, as the editor made it
    Prognosis prognosis;
    std::vector<Value> blobs;  ///< big values it names
    bool sent = false;         ///< on this connection
    std::size_t sentBytes = 0;
    bool reseal = false;  ///< its addresses have to be told anew before it is sent
    int attempts = 0;     ///< how often it has been sent anew under another number
    /// While the history it was meant for is gone (HistoryDiverged): its edits where they stood
    /// then; nothing for those that were dropped.
    std::vector<std::optional<AuthoredEdit>> carried;
};

/// Calls `visit` for every address of the edits.
void forEachAddress(std::vector<Edit>& edits, const std::function<void(Address&)>& visit);

/// The big values that an action names.
void collectBlobs(const EditAction& action, std::vector<Value>& blobs);

}  // namespace usdlive::client
