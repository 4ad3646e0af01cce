// The order of edits: what is executed, numbered, chained, handed to the log, and durable.
#pragma once

#include <deque>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "Wiring.h"
#include "lines/CommitFrames.h"
#include "lines/LineListener.h"
#include "lines/NamespaceHistory.h"
#include "usdlive/common/layer/TransactionExecutor.h"
#include "usdlive/server/project/CommitStore.h"
#include "usdlive/server/project/ports/Clock.h"
#include "usdlive/server/project/ports/CommitLog.h"

namespace usdlive::server {

/// One line of history. It executes edits on its documents, gives each commit the next revision and
/// the hash of the chain, hands it to the log, and rolls back what the log could not append. Knows
/// neither sessions nor files: its listeners do. A project's main line is one; a branch is another
/// one, which starts with the documents and the head of the revision where it leaves the main line.
class HistoryLine {
public:
    struct Start {
        CommitStore::Head head;
        /// Moves and deletes of the revisions after `oldestNamespace`, so that older addresses
        /// still find their specs (M3).
        Revision oldestNamespace = 0;
        std::vector<NamespaceChange> namespaceChanges;
        LayerDocs docs = {};  ///< as of the head; others are put in when they are loaded
    };
    struct Limits {
        CommitLimits commits;
        Revision namespaceRevisions = kNamespaceLogRevisions;  ///< how far back a base may lie
    };

    HistoryLine(const Limits& limits, Start start, ports::CommitLog& log, ports::Clock& clock);

    /// Notified in the order in which they are added.
    void addListener(LineListener& listener) { listeners_.add(listener); }

    // --- documents, as executed: ahead of what is durable

    [[nodiscard]] const LayerDocs& docs() const { return docs_; }
    /// nullptr: not loaded.
    [[nodiscard]] const LayerDoc* doc(const LayerId& layer) const;
    void put(const LayerId& layer, LayerDoc doc) { docs_.insert_or_assign(layer, std::move(doc)); }
    void drop(const LayerId& layer) { docs_.erase(layer); }

    // --- ordering

    /// Says why what was executed may not stay. `before`: the layers that were edited, as they
    /// were.
    using Check =
        std::function<std::optional<Refused>(const Executed& executed, const LayerDocs& before)>;

    /// A transaction, with what its author may do and can read.
    struct Submission {
        const Transaction& transaction;
        std::size_t bytes = 0;  ///< as it came
        UserName user;
        bool readsParts = true;  ///< the author can read a commit in parts (FR8)
        Check check = {};        ///< empty: whatever was executed may stay
    };
    /// Executes and orders a transaction whose layers are loaded, or changes nothing. Returns the
    /// revision of its commit.
    std::variant<Revision, Refused> commit(const Submission& submission, OwnCreations& creations);

    /// Edits whose paths are absolute, each valid after the ones before, that are no client's
    /// transaction.
    struct OwnEdits {
        std::vector<Edit> edits;
        UserName user;
        Check check = {};
        /// Kept by the store with the commit: the layer's file holds this then.
        std::optional<std::pair<LayerId, FileStamp>> file = {};
    };
    Result<Revision> commitInOrder(OwnEdits edits);

    /// Brings in a whole layer. Its document is put in by the caller.
    struct Import {
        LayerId layer;
        ImportFrame frame;
        std::vector<Hash> blobs;        ///< that it names
        std::optional<FileStamp> file;  ///< kept by the store with the commit
    };
    Revision commitImport(Import import);

    // --- answers of the log

    void appended(Revision upTo);
    /// Everything after `head` is rolled back. Throws std::logic_error if `head` is no commit of
    /// this line.
    void appendFailed(const Error& error, const CommitStore::Head& head);

    // --- where it is

    [[nodiscard]] Epoch epoch() const { return epoch_; }
    [[nodiscard]] Revision executed() const { return executed_; }
    [[nodiscard]] const Hash& executedHash() const { return executedHash_; }
    [[nodiscard]] Revision durable() const { return durable_; }
    [[nodiscard]] const Hash& durableHash() const { return durableHash_; }
    /// Its newest durable revision when this was made.
    [[nodiscard]] Revision first() const { return first_; }
    [[nodiscard]] const NamespaceHistory& namespaces() const { return namespaces_; }
    [[nodiscard]] const CommitLimits& limits() const { return limits_.commits; }
    /// Is a commit under way that changes the layer's custom layer data?
    [[nodiscard]] bool isLayerDataInFlight(const LayerId& layer) const;

private:
    using Made = std::pair<OrderedCommit, CommitRecord>;
    [[nodiscard]] std::optional<Made> make(const TransactionId& id, const UserName& user,
                                           std::uint64_t gesture, Executed executed,
                                           std::uint64_t mark);
    Revision append(OrderedCommit commit, CommitRecord record);
    void undo(LayerDocs before, std::uint64_t mark);
    [[nodiscard]] bool mayNotFit(const Submission& submission) const;
    void rollBack(const Error& error);

    Limits limits_;
    Wire<ports::CommitLog> log_;
    Wire<ports::Clock> clock_;
    Listeners<LineListener> listeners_;

    LayerDocs docs_;
    NamespaceHistory namespaces_;
    Epoch epoch_;
    Revision first_;
    Revision executed_;
    Hash executedHash_;
    std::deque<OrderedCommit> inFlight_;  ///< handed to the log, not durable yet
    Revision durable_;
    Hash durableHash_;
};

}  // namespace usdlive::server
