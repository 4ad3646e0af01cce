// A connection to a project and its layers, for an editor that reads and writes them elsewhere.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <future>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <variant>
#include <vector>

#include "LayerComparison.h"
#include "basics/CallerThread.h"
#include "basics/ProcessFolder.h"
#include "history/SessionHistory.h"
#include "link/EditorEvents.h"
#include "link/ServerLink.h"
#include "session/Session.h"
#include "values/BlobCache.h"
#include "values/FileUploads.h"
#include "work/LostWorkReports.h"
#include "work/UnsentWorkReports.h"

namespace usdlive::client {

/// One change of a layer for the editor to make.
struct LayerChange {
    /// All content was replaced: read it with content().
    struct Replaced {};
    /// Create, Delete, Move or Place.
    struct Namespace {
        std::string path;
        EditAction action;
    };
    /// The whole field with its big values inline, or nothing if it was erased.
    struct Field {
        std::string path, field;
        std::optional<Bytes> value;
    };
    std::variant<Replaced, Namespace, Field> what;
};

/// The session of an editor whose layers are not here. It remembers what the editor's layers were
/// given, so that a comparison finds what the editor wrote and what it lacks. Belongs to the first
/// thread that calls advance(); the network has a thread of its own. No OpenUSD.
class SharedLayers final : public SessionHost, public LayerView {
public:
    struct Settings {
        std::string user;         ///< empty: the name that is known for the server
        std::string application;  ///< shown to others
        std::string cacheFolder;  ///< for layers and big values; empty: a temporary folder
        double timeoutMs = 10'000;
        std::uint64_t cacheBytes = std::uint64_t(4) << 30;
        std::string token;  ///< empty: the one that is known for the server
    };
    /// Connects and waits for the welcome. Errors: InvalidArgument, NotConnected, and those with
    /// which a server refuses.
    static Result<std::unique_ptr<SharedLayers>> connect(const std::string& url, Settings settings);

    [[nodiscard]] const CallerThread& thread() const { return thread_; }
    [[nodiscard]] Session& session() { return *session_; }
    [[nodiscard]] const std::string& user() const { return settings_.user; }
    [[nodiscard]] const std::filesystem::path& cacheFolder() const { return folder_; }
    /// Blocks until something is received, at most `ms`.
    bool wait(double ms) {
        return link_->connection().wait(std::chrono::milliseconds(std::int64_t(ms)));
    }

    /// Receives, sends, and executes what was received. Returns true if more is to be done.
    bool advance(double budgetMs);
    [[nodiscard]] std::vector<Event> takeEvents();
    /// Call it before the object is destroyed. Returns the transactions that were not acknowledged;
    /// the journal has them. takeEvents() then has all events.
    [[nodiscard]] std::optional<UnsentWork> leave();

    void open(const LayerId& layer);
    void close(const LayerId& layer);

    /// Adds what the editor wrote in the layer to the next submit(). Returns what cannot be shared;
    /// takeChanges() then undoes it in the editor's layer. Precondition: takeChanges() was applied.
    [[nodiscard]] std::vector<LayerChanges::Refused> capture(
        const LayerId& layer, const std::vector<SeenSpec>& seen,
        const std::function<bool(std::string_view, std::string_view, const Bytes&)>& keeps);
    /// Notes a value of the editor's layer that cannot be shared, as lost work with its text in the
    /// custom data of its spec. If the spec cannot be shared, `field` is empty.
    void lose(const LayerId& layer, const std::string& path, const std::string& field, Error reason,
              const std::string& text);
    /// Sends what was captured, as one transaction.
    void submit();

    /// Returns what the editor has to change in the layer, in order, and takes it as done. Empty
    /// while the layer is not joined.
    [[nodiscard]] std::vector<LayerChange> takeChanges(const LayerId& layer);
    using Visit = std::function<void(const LayerDoc::SpecView&,
                                     const std::vector<std::pair<std::string, Bytes>>&)>;
    /// Calls `visit` for each spec of the layer as the editor has it after takeChanges(): parents
    /// before children, siblings in order, with the fields that are here.
    void content(const LayerId& layer, const Visit& visit);
    /// Does the same for the result of past().
    void content(const LayerDoc& past, const Visit& visit);
    /// Returns a layer as it was at a revision, when its big values are here, too. Waits for the
    /// server; takeEvents() then has what happened meanwhile. Errors: those of
    /// SessionHistory::readLayer(); BlobNotFound (the server lacks a big value).
    [[nodiscard]] Result<LayerDoc> past(const LayerId& layer, Revision revision);
    /// Returns whether the editor should have the spec after takeChanges().
    [[nodiscard]] bool has(const LayerId& layer, const std::string& path) const {
        const auto found = layers_.find(layer);
        return found != layers_.end() && found->second.shown && found->second.shown->has(path);
    }
    /// Returns the field as the editor should have it after takeChanges(), or nothing.
    [[nodiscard]] std::optional<Bytes> held(const LayerId& layer, const std::string& path,
                                            const std::string& field);

    // Edits of a layer's root as an own transaction; takeChanges() then has them. Precondition:
    // what the editor wrote was submitted. Errors: LayerNotOpen, those of lockEdits() and
    // muteEdits().
    [[nodiscard]] Result<void> setLocked(const LayerId& layer, bool locked);
    [[nodiscard]] Result<void> setGloballyMuted(const LayerId& root, const LayerId& layer,
                                                bool muted);
    /// Its calls wait for the server. takeEvents() then has what happened meanwhile.
    [[nodiscard]] SessionHistory& history() { return history_; }

    /// Begins to upload a file of this machine. Ends with an event that has the number.
    std::uint64_t requestUpload(const std::filesystem::path& file, const std::string& path,
                                bool overwrite) {
        return uploads_.add(file, path, overwrite);
    }
    /// Does the same, and waits for the end. takeEvents() then has what happened meanwhile.
    Result<void> upload(const std::filesystem::path& file, const std::string& path, bool overwrite);

    [[nodiscard]] UnsentWorkReports& unsent() { return unsent_; }
    Result<SentWork> sendUnsent(const ClientId& work, double timeoutMs) {
        return unsent_.send(work, timeoutMs, lost_);
    }
    /// Names the type of an attribute that has this encoded value, if nobody knows the attribute.
    using NameOfType = std::function<std::string(const Bytes&)>;
    /// Visit the content of a sparse layer with edits of one layer, as content() does.
    [[nodiscard]] Result<void> lostContent(std::uint64_t index, const LayerId& layer,
                                           const NameOfType& nameOfType, const Visit& visit);
    [[nodiscard]] Result<void> unsentContent(const ClientId& work, const LayerId& layer,
                                             const NameOfType& nameOfType, const Visit& visit);

    // SessionHost
    void send(SharedBytes frames) override { link_->connection().send(std::move(frames)); }
    std::size_t bulkBytes() override { return link_->connection().bulkBytes(); }
    SharedBytes localBlob(const Hash& hash) override { return blobs_.blob(hash); }
    bool holdsBlob(const Hash& hash) override { return blobs_.holds(hash); }
    void blobArrived(const Hash& hash, SharedBytes bytes, bool lasting) override;
    void blobStored(const Hash& hash) override { uploads_.blobStored(hash); }
    bool needsBlob(const Hash& hash) override { return awaited_.contains(hash); }
    void pending(const PendingWork& work) override { unsent_.pending(work); }
    void answered(std::uint64_t sequence) override { unsent_.answered(sequence); }

    // LayerView
    void reset(const LayerId& layer, const LayerDoc& doc) override;
    void apply(const LayerId& layer, const std::string& path, const EditAction& action) override;

private:
    struct Layer {
        std::optional<LayerDoc> shown;  ///< the content of the editor's layer; unset: none yet
        bool isReplaced = false;        ///< the editor has to read all
        bool isBehind = false;          ///< the view differs from `shown`
        bool hasOwnIds = false;         ///< `shown` has specs with other ids than the view
        std::set<Hash> late;            ///< big values that arrived for fields that lack them
    };

    SharedLayers(Settings settings, ProcessFolder folder, std::filesystem::path cache,
                 std::unique_ptr<Connection> connection, const Hash& secret);
    Result<void> greet();
    void followUploads();
    /// Waits until something is received, and takes it. Returns whether something was received.
    bool step();
    void collectEvents();
    /// Returns false for events that the editor does not get, or not yet.
    bool note(Event& event);
    void visitSparse(const LostWork& work, const LayerId& layer, const NameOfType& nameOfType,
                     BlobSource& blobs, const Visit& visit);
    static void visitContent(const LayerDoc& doc,
                             const std::function<std::optional<Bytes>(const FieldValue&)>& encoded,
                             const Visit& visit);
    [[nodiscard]] Result<void> checkOpen(const LayerId& layer) const;
    Result<void> authorAtRoot(const LayerId& layer, Result<std::vector<EditAction>> actions);
    [[nodiscard]] std::optional<Bytes> inlineOrAsk(const FieldValue& value);
    void addLateFields(Layer& layer, std::vector<LayerChange>& changes);

    const Settings settings_;
    const ProcessFolder ownFolder_;  // used if the editor has not set one
    std::future<void> removing_;     // removes the folders of killed editors
    const std::filesystem::path folder_;
    CallerThread thread_;
    EditorEvents events_;
    std::vector<Event> taken_;
    BlobCache blobs_;
    LostWorkReports lost_;
    UnsentWorkReports unsent_;
    std::unique_ptr<ServerLink> link_;
    std::unique_ptr<Session> session_;
    SessionHistory history_;
    FileUploads uploads_;
    std::map<LayerId, Layer> layers_;
    std::vector<AuthoredEdit> captured_;
    std::set<Hash> awaited_;
    std::set<Hash> committed_;  // big values of own commits since the last release
};

}  // namespace usdlive::client
