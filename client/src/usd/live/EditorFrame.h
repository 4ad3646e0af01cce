// Turns the editor's writes of one frame into a transaction of the session.
#pragma once

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <utility>
#include <vector>

#include "session/Session.h"
#include "usd/live/ArrayEncodings.h"
#include "usd/live/LiveSet.h"
#include "usd/places/LayerPlaces.h"
#include "values/BlobCache.h"
#include "work/LostWorkReports.h"

namespace usdlive::client {

/// Captures the editor's writes in all live layers. To *seal* a frame means to end it and to submit
/// its edits as one transaction.
class EditorFrame {
public:
    /// All arguments outlive this object. `encoder` encodes big arrays.
    EditorFrame(BlobCache& blobs, Worker& encoder, LostWorkReports& lost)
        : blobs_(blobs), encodings_(blobs, encoder), lost_(lost) {}

    /// The sink for big arrays that the editor writes into LiveLayers.
    [[nodiscard]] BlobSink& sink() { return encodings_; }

    /// Submits the writes since the last call as one transaction of the session. Must not be called
    /// from within Sdf.
    void seal(LiveSet& layers, Session& session);
    /// Does the same if all big arrays are encoded. Otherwise returns false: the frame stays open,
    /// and edits of others must not be applied to the layers.
    [[nodiscard]] bool sealWhenEncoded(LiveSet& layers, Session& session);
    /// Returns whether a frame is kept open because of its big arrays.
    [[nodiscard]] bool holdsBack() const { return holdsBack_; }
    [[nodiscard]] static bool hasWrites(LiveSet& layers);
    /// Names a folder of the project, whose files others have, too.
    void addProjectFolder(const std::filesystem::path& folder) {
        if (std::ranges::find(folders_, folder) == folders_.end()) folders_.push_back(folder);
    }
    /// Returns the paths to files outside the project that were submitted since the last call.
    [[nodiscard]] std::vector<event::PathOutside> takeOutside() {
        return std::exchange(outside_, {});
    }

    /// Submits edits of a layer's root as one transaction. The writes of `alongside` become part of
    /// it. Precondition: all earlier writes are sealed.
    void author(LiveSet& layers, Session& session, LiveLayer& live, std::vector<EditAction> actions,
                const std::function<void()>& alongside = {});

private:
    /// Ends the frame and returns its edits.
    std::vector<AuthoredEdit> take(LiveSet& layers);
    void submit(std::vector<AuthoredEdit> edits, Session& session);

    BlobCache& blobs_;
    ArrayEncodings encodings_;
    LostWorkReports& lost_;
    std::vector<std::filesystem::path> folders_;
    std::vector<event::PathOutside> outside_;
    bool holdsBack_ = false;
};

/// Requests the server to save layers that the editor has saved itself (FI4). A file in a project's
/// folder is overwritten already, would count as changed outside, and lacks the edits of others. A
/// layer in `cache` has only a placeholder: nothing is overwritten that somebody else has changed.
void saveAgain(LiveSet& layers, const LayerPlaces& cache, Session& session);

}  // namespace usdlive::client
