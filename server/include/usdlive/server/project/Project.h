#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/protocol/Control.h"
#include "usdlive/common/protocol/Frame.h"
#include "usdlive/server/project/CommitStore.h"

namespace usdlive::server {

/// One connection, as long as it lasts.
using SessionId = std::uint64_t;

/// What a project asks of the process around it. Calls come from the project's strand and return at
/// once; answers come back as calls of Project on the same strand. The server's app implements it
/// with threads and sockets, the simulation with a queue and a seed.
class ProjectHost {
public:
    virtual ~ProjectHost() = default;

    /// Sends encoded frames to a session, in order. Bounded by the host: who does not read is cut
    /// with SlowReader and reported by Project::disconnected().
    virtual void send(SessionId session, SharedBytes frames) = 0;
    /// Is so much queued for the session that history should wait? Then no more commits of the past
    /// are sent to it until Project::drained(). Who sends live commits too slowly is not asked, but
    /// cut.
    [[nodiscard]] virtual bool congested(SessionId) { return false; }
    /// Sends what is queued, then closes.
    virtual void close(SessionId session) = 0;

    /// Appends to the store, in order; answered by appended() or appendFailed().
    virtual void append(CommitRecord commit) = 0;
    /// From the store, or, if it has none, from the layer's file; answered by layerLoaded().
    virtual void loadLayer(const LayerId& layer) = 0;
    /// Commits of [from, to] from the store, answered by commitsRead().
    virtual void readCommits(SessionId session, Revision from, Revision to) = 0;
    /// The layer as it was; answered by historyRead().
    virtual void readHistory(SessionId session, std::uint64_t request, const LayerId& layer,
                             Revision revision) = 0;
    /// Encodes and sends a snapshot, chunk by chunk, beside the stream.
    virtual void sendSnapshot(SessionId session, std::uint64_t request, LayerDoc doc) = 0;
    /// Sends a big value from `offset` on, beside the stream.
    virtual void sendBlob(SessionId session, const Hash& hash, std::uint64_t offset) = 0;
    /// Adds a part of a big value; answered by blobWritten().
    virtual void writeBlob(SessionId session, BlobFrame part) = 0;
    [[nodiscard]] virtual bool hasBlob(const Hash& hash) = 0;
    [[nodiscard]] virtual bool hasSpace() = 0;
    /// Writes layers to their files; answered by layersSaved().
    struct SaveJob {
        LayerId layer;
        LayerDoc doc;
        Revision revision = 0;
    };
    virtual void saveLayers(SessionId session, std::uint64_t request,
                            std::vector<SaveJob> jobs) = 0;
    /// Layers whose stored state is newer than their file (CommitStore::unsavedLayers).
    [[nodiscard]] virtual std::vector<LayerId> unsavedLayers() { return {}; }
    /// M9; from the store.
    [[nodiscard]] virtual std::optional<Revision> committed(const TransactionId& transaction) = 0;
    /// No transaction of the client with a higher number is in the store. Asked once for each
    /// author who comes.
    [[nodiscard]] virtual std::uint64_t lastSequence(const ClientId&) { return ~std::uint64_t(0); }
    [[nodiscard]] virtual std::int64_t wallClockMs() = 0;
};

/// The commit that brings a whole layer in from its file, but for its place in the history.
struct LayerImport {
    Bytes frame;  ///< encodeFrame() of a CommitFrame; stampCommit() says where it stands
    std::vector<StateChange> changes;
    std::size_t edits = 0;
};
/// Any thread; takes time. LayerUnreadable: larger than one commit can be.
[[nodiscard]] Result<LayerImport> makeImport(const LayerId& layer, const LayerDoc& doc);

struct LoadedLayer {
    LayerDoc doc;
    std::optional<LayerImport> import = std::nullopt;  ///< it came from its file
};

/// Counts for /metrics, all since the start.
struct ProjectCounters {
    std::uint64_t commits = 0, edits = 0, dropped = 0, refused = 0, previews = 0, duplicates = 0;
    std::uint64_t delivered = 0;  ///< commit frames handed to sessions
};

/// The authority over one project: greets sessions, orders and executes their transactions, tells
/// everybody. Decides without I/O; belongs to one strand and has no mutex.
class Project {
public:
    struct Options {
        std::string name;
        std::size_t maxFrameBytes = kMaxFrameBytes;
        std::uint64_t maxBlobBytes = 4ull << 30;
        std::size_t maxEditsPerTransaction = 1'000'000;
        std::size_t maxSessions = 1'000;
        std::size_t recentCommitBytes = 64ull << 20;  ///< kept in memory for who resumes
        std::size_t namespaceLogRevisions = 100'000;  ///< how far back a base may lie
    };

    /// `head`: what the store says; `layers`: the files served and those with state in the store
    /// (all are listed, none is loaded); `namespaceChanges`: what the store says of the revisions
    /// after firstNamespaceRevision(), so that transactions of before the start still find their
    /// specs (M3).
    Project(Options options, ProjectHost& host, CommitStore::Head head, std::vector<LayerId> layers,
            std::vector<NamespaceChange> namespaceChanges);
    ~Project();

    /// What to ask CommitStore::namespaceChanges() for.
    [[nodiscard]] static Revision firstNamespaceRevision(const Options& options,
                                                         const CommitStore::Head& head) {
        return head.revision - std::min<Revision>(head.revision, options.namespaceLogRevisions);
    }

    // Sessions.
    void connected(SessionId session);
    /// One message as it came. Anything that is not the protocol is answered and the session
    /// closed.
    void received(SessionId session, ByteView message);
    void disconnected(SessionId session);
    /// It is no longer ProjectHost::congested().
    void drained(SessionId session);

    // Answers of the host.
    void appended(Revision upTo);
    /// Everything after the store's head is taken back: authors are told (refusals with `error`),
    /// the layers concerned are loaded anew, sessions go on. What was handed to append() before
    /// this call must not be appended after it. StorageFull: goes on when there is space.
    /// Otherwise, if `head` has a higher epoch, the store was opened anew and the project goes on
    /// with it; if not, it takes no more transactions.
    void appendFailed(Error error, CommitStore::Head head);
    void layerLoaded(const LayerId& layer, Result<LoadedLayer> loaded);
    void commitsRead(SessionId session, Result<std::vector<StoredCommit>> commits);
    void historyRead(SessionId session, std::uint64_t request, Result<LayerDoc> doc);
    void blobWritten(SessionId session, const Hash& hash, Result<bool> whole);
    void layersSaved(SessionId session, std::uint64_t request, LayersSaved outcome);

    /// Layers on disk have changed (a file was added or taken away).
    void setLayers(std::vector<LayerId> layers);

    [[nodiscard]] Revision durableRevision() const;
    [[nodiscard]] const ProjectCounters& counters() const;
    [[nodiscard]] std::size_t sessionCount() const;
    /// A loaded layer as executed so far (ahead of what is durable); nullptr otherwise.
    [[nodiscard]] const LayerDoc* layer(const LayerId& layer) const;

private:
    class Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace usdlive::server
