// Layers of a project that show a revision of the past, and move to others.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "basics/ProcessFolder.h"
#include "history/DocTimeline.h"
#include "session/Session.h"
#include "usd/live/ApartEdits.h"
#include "usd/live/BackgroundFill.h"
#include "usd/places/FolderPlaces.h"
#include "usd/places/PlainFiles.h"
#include "usdlive/common/usd/SdfLayerStore.h"
#include "values/BlobCache.h"

namespace usdlive::client {

/// A root layer and all layers of the project that it uses, as they were at one revision, in
/// SdfLayers of their own. They have a place of their own, so that relative paths lead from one to
/// another, and refuse edits. Moving to another revision changes them by the difference.
///
/// No function waits: aim() says where to go, and advance() does what is possible. Belongs to the
/// thread of the client.
class PastLayers {
public:
    /// All members outlive this object.
    struct Dependencies {
        Session& session;
        BlobCache& blobs;
        Worker& filler;  ///< builds the content of layers
    };
    /// `web`: the server, if layers get addresses. Error: InvalidArgument (no folder can be
    /// created).
    static Result<std::unique_ptr<PastLayers>> create(Dependencies dependencies, LayerId root,
                                                      const std::optional<ServerAddress>& web);
    ~PastLayers();
    PastLayers(const PastLayers&) = delete;
    PastLayers& operator=(const PastLayers&) = delete;

    /// The revision that the layers show; 0: none yet.
    [[nodiscard]] Revision shown() const { return shown_; }
    /// Returns the oldest revision that can be read.
    [[nodiscard]] Revision first() const;
    /// Returns the newest revision.
    [[nodiscard]] Revision last() const;
    /// Returns the root layer; null before the first content.
    [[nodiscard]] pxr::SdfLayerRefPtr root() const;

    /// Sets the revision to be shown. Precondition: it is between first() and last().
    void aim(Revision revision);
    [[nodiscard]] bool isThere() const { return shown_ == target_; }
    /// Goes on as far as possible. Notices of Sdf are sent when the layers change. Error: what is
    /// needed cannot be read; the layers show what they have shown before.
    [[nodiscard]] Result<void> advance();
    /// Reads commits around the shown revision before they are needed.
    enum class Direction { Forward, Backward };
    void prefetch(Direction direction);
    /// Returns the time of a commit if it is known, in milliseconds since 1970.
    [[nodiscard]] std::optional<std::int64_t> timeOf(Revision revision) const;
    /// Returns whether the commit that leads to this revision, or back from it, is known.
    [[nodiscard]] bool knows(Revision revision) const { return timeline_.contains(revision); }

    /// Returns whether the next content waits for the big value.
    [[nodiscard]] bool needs(const Hash& hash) const;
    /// Call it when a big value could not be fetched.
    void blobFailed(const Hash& hash, const Error& reason);

private:
    struct Layer {
        pxr::SdfLayerRefPtr layer;
        std::unique_ptr<usd::SdfLayerStore> store;  // set when the layer has its content
        std::unique_ptr<BackgroundFill> fill;       // builds the first content
        ApartEdits apart;
    };
    // The requests that were sent last. Their answers belong together.
    struct Asked {
        enum class For { Restart, Later, Earlier, Layers } purpose;
        Revision revision = 0;         // the layers are read at it
        std::vector<LayerId> waiting;  // not asked for yet
        std::size_t open = 0;          // requests without an answer
        LayerDocs docs;
        std::vector<Commit> commits;
        std::optional<Error> error;
        [[nodiscard]] bool isDone() const { return open == 0 && (waiting.empty() || error); }
    };
    using Edits = std::vector<std::pair<std::string, EditAction>>;
    // The next content, which is prepared before the layers change.
    struct Next {
        Revision revision = 0;
        LayerDocs docs;
        bool restarts = false;  // the timeline begins with it
        std::map<LayerId, Edits> edits;
        std::set<LayerId> examined, named;
        std::set<Hash> blobs;  // that are not here yet
    };

    PastLayers(Dependencies dependencies, LayerId root, std::unique_ptr<Worker> worker,
               ProcessFolder folder, std::unique_ptr<CacheFolderPlaces> places);

    void ask(Asked::For purpose, Revision revision, std::vector<LayerId> layers);
    void askLog(Revision from, Revision to);
    void askMore();
    [[nodiscard]] std::vector<LayerId> known() const;
    Result<void> step();
    Result<void> begin();
    Result<void> take(Asked asked);
    /// Returns whether everything is here that the next content needs.
    Result<bool> isPrepared();
    void examine(const LayerId& id, const LayerDoc& doc);
    Result<void> startFill(const LayerId& id, const LayerDoc& doc);
    void addNamed(const LayerId& id, const usd::LayerFill::Named& named, std::set<LayerId>& used);
    [[nodiscard]] usd::LayerFill::Named namedBy(const LayerId& id, const LayerDoc& doc) const;
    void show();
    void dropNext();

    const Dependencies with_;
    const LayerId root_;
    // The order of destruction: the files' thread, the places, their worker, the folder.
    const ProcessFolder folder_;
    const std::unique_ptr<Worker> worker_;
    const std::unique_ptr<CacheFolderPlaces> places_;
    PlainFiles files_;

    std::map<LayerId, Layer> layers_;
    DocTimeline timeline_;
    LayerDocs docs_;  // that are shown
    Revision shown_ = 0, target_ = 0;
    Revision oldest_ = 0;  // before it nothing is read ahead
    std::shared_ptr<Asked> asked_;
    std::optional<Next> next_;
    std::optional<Error> failed_;  // a big value could not be fetched
};

}  // namespace usdlive::client
