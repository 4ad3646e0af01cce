// A line of history: executes edits, numbers and chains their commits, and passes them to the log.
#pragma once

#include <deque>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "project/CommitStore.h"
#include "project/Wiring.h"
#include "project/lines/CommitFrames.h"
#include "project/lines/LineListener.h"
#include "project/lines/TimeOfDay.h"
#include "project/ports/CommitLog.h"
#include "usdlive/common/layer/TransactionExecutor.h"

namespace usdlive::server {

/// A line of history. It executes edits on its documents, gives each commit the next revision and
/// the hash of the chain, passes it to the log, and rolls back commits that the log could not
/// append. It does not know sessions or files; its listeners do. A project has one main line. A
/// branch is another line, which starts with the documents and the head of the revision at which it
/// leaves the main line.
class HistoryLine {
public:
    struct Start {
        CommitStore::Head head;
        /// The moves and deletes of the revisions after `oldestNamespace`, so that older addresses
        /// still find their specs (M3).
        Revision oldestNamespace = 0;
        std::vector<NamespaceChange> namespaceChanges;
        LayerDocs docs = {};      ///< at the head; others are added when they are loaded
        std::int64_t timeMs = 0;  ///< time of the commit at the head; 0: unknown
    };
    struct Limits {
        CommitLimits commits;
        /// The most revisions that a base may be old.
        Revision namespaceRevisions = kNamespaceLogRevisions;
    };

    HistoryLine(const Limits& limits, Start start, ports::CommitLog& log, TimeOfDay& time);

    /// Listeners are notified in the order in which they are added.
    void addListener(LineListener& listener) { listeners_.add(listener); }

    // --- documents, with all executed commits, durable or not

    [[nodiscard]] const LayerDocs& docs() const { return docs_; }
    /// Returns nullptr if the layer is not loaded.
    [[nodiscard]] const LayerDoc* doc(const LayerId& layer) const;
    void put(const LayerId& layer, LayerDoc doc) { docs_.insert_or_assign(layer, std::move(doc)); }
    void drop(const LayerId& layer) { docs_.erase(layer); }

    // --- ordering

    /// Checks executed edits. Returns the refusal if they must be undone. `before` has the edited
    /// layers before them.
    using Check =
        std::function<std::optional<Refused>(const Executed& executed, const LayerDocs& before)>;

    /// A transaction with the rights of its author.
    struct Submission {
        const Transaction& transaction;
        std::size_t bytes = 0;  ///< size as received
        UserName user;
        Check check = {};  ///< empty: no check
    };
    /// Executes and orders a transaction, or changes nothing. Returns the revision of its commit.
    /// Precondition: its layers are loaded.
    std::variant<Revision, Refused> commit(const Submission& submission, OwnCreations& creations);

    /// Edits with absolute paths, in order, that are not a transaction of a client.
    struct OwnEdits {
        std::vector<Edit> edits;
        UserName user;
        Check check = {};
        /// The file of the layer, which has the layer's content after the commit. Stored with the
        /// commit.
        std::optional<std::pair<LayerId, FileStamp>> file = {};
        std::string label = {};
    };
    Result<Revision> commitInOrder(OwnEdits edits);

    /// The import of a whole layer. The caller adds its document.
    struct Import {
        LayerId layer;
        ImportFrame frame;
        std::vector<Hash> blobs;        ///< the big values that it names
        std::optional<FileStamp> file;  ///< stored with the commit
    };
    Revision commitImport(Import import);

    // --- answers of the log

    void appended(Revision upTo);
    /// Rolls back all commits after `head`. Throws std::logic_error if `head` is not a commit of
    /// this line.
    void appendFailed(const Error& error, const CommitStore::Head& head);

    // --- position

    [[nodiscard]] Epoch epoch() const { return epoch_; }
    [[nodiscard]] Revision executed() const { return executed_; }
    [[nodiscard]] const Hash& executedHash() const { return executedHash_; }
    [[nodiscard]] Revision durable() const { return durable_; }
    [[nodiscard]] const Hash& durableHash() const { return durableHash_; }
    /// Returns the newest durable revision at the time when the object was created.
    [[nodiscard]] Revision first() const { return first_; }
    [[nodiscard]] const NamespaceLog& namespaces() const { return namespaces_; }
    [[nodiscard]] const CommitLimits& limits() const { return limits_.commits; }
    /// Returns whether a commit that is not durable yet changes the layer's custom layer data.
    [[nodiscard]] bool isLayerDataInFlight(const LayerId& layer) const;

private:
    using Made = std::pair<OrderedCommit, CommitRecord>;
    [[nodiscard]] std::optional<Made> make(const Transaction& transaction, const UserName& user,
                                           Executed executed, std::uint64_t mark);
    Revision append(OrderedCommit commit, CommitRecord record);
    void undo(LayerDocs before, std::uint64_t mark);
    [[nodiscard]] bool mayNotFit(const Submission& submission) const;
    void rollBack(const Error& error);
    [[nodiscard]] std::int64_t commitTimeMs();

    Limits limits_;
    Wire<ports::CommitLog> log_;
    Wire<TimeOfDay> time_;
    Listeners<LineListener> listeners_;

    LayerDocs docs_;
    NamespaceLog namespaces_;
    Epoch epoch_;
    Revision first_;
    Revision executed_;
    Hash executedHash_;
    std::int64_t newestMs_;               ///< time of the newest commit
    std::deque<OrderedCommit> inFlight_;  ///< passed to the log, not durable yet
    Revision durable_;
    Hash durableHash_;
};

}  // namespace usdlive::server
