// The implementation of Client: its parts, and the tick that drives them.
#pragma once

#include <cstdint>
#include <future>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "basics/CallerThread.h"
#include "basics/ProcessFolder.h"
#include "history/SessionHistory.h"
#include "link/AwaitedAnswers.h"
#include "link/EditorEvents.h"
#include "link/ServerLink.h"
#include "session/Session.h"
#include "usd/assets/LateAssets.h"
#include "usd/editor/ClientInternals.h"
#include "usd/editor/LocksAndMutes.h"
#include "usd/editor/OpenLayers.h"
#include "usd/editor/OpenPast.h"
#include "usd/editor/OpenRequests.h"
#include "usd/live/EditorFrame.h"
#include "usd/live/NeededBigValues.h"
#include "usd/places/FolderPlaces.h"
#include "usd/places/PlainFiles.h"
#include "usdlive/client/usd/Client.h"
#include "values/FileUploads.h"
#include "work/LostWorkReports.h"
#include "work/UnsentWorkReports.h"

namespace usdlive {

/// The folders in which a client keeps its layers and its files.
struct ClientFolders {
    /// Creates the folders. If `folder` is empty, creates a new one below the system's temporary
    /// folder.
    static Result<ClientFolders> create(const std::filesystem::path& folder);

    std::unique_ptr<client::Worker> background;  ///< for work that takes longer than a frame
    client::ProcessFolder own;                   ///< a new folder, removed with this object
    std::unique_ptr<client::CacheFolderPlaces> cache;
};

/// The parts of a client. Each part owns its state. This class calls them in the right order in
/// each tick, and connects them with the session.
class Client::Impl final : public client::SessionHost, public client::LayerView {
public:
    Impl(std::unique_ptr<client::Connection> connection, Options options, const Hash& secret,
         ClientFolders folders);
    ~Impl() override;

    // Checks of the calling thread and state.
    [[nodiscard]] std::optional<Error> misuse(std::string_view function, bool blocks) const;
    /// Throws Misuse if another thread calls.
    void require(std::string_view function) const;
    /// Does the same. Within tick(), returns false and reports an error event instead of throwing,
    /// because an exception in a notice handler would end the process.
    bool mayBlock(std::string_view function);

    // The frame.
    enum class Seal { WhenEncoded, Now };
    TickResult tick(double budgetMs, Seal seal = Seal::WhenEncoded);
    /// Returns whether the client itself is changing layers. Changes in callbacks are those of the
    /// editor.
    [[nodiscard]] bool isApplying() const { return ticking_ && !events_.isDispatching(); }
    void setGesture(bool begins);
    /// nullptr ends the group.
    void setUndoGroup(const std::string* label);
    using TakeBack = Result<client::UndoResult> (client::Session::*)();
    Result<client::UndoResult> takeBack(TakeBack undoOrRedo);
    std::uint64_t save(std::vector<LayerId> layers, bool force);

    // Calls that wait for the server: loops around tick().
    Result<void> greet();
    Result<pxr::SdfLayerRefPtr> openLayer(const LayerId& id, client::LoadSet load);
    Result<pxr::SdfLayerRefPtr> createLayer(const LayerId& id);
    Result<void> upload(const std::filesystem::path& file, const std::string& path, bool overwrite);
    Result<std::vector<LayerId>> attach(const std::filesystem::path& projectFolder);
    Result<void> close(const LayerId& id);
    bool flush(double timeoutMs);
    Result<LayersSaved> saveAndWait(std::vector<LayerId> layers, bool force, double timeoutMs);
    /// Returns nothing if the server has not answered in time.
    std::optional<Result<client::Event>> answerTo(std::uint64_t request, double timeoutMs);
    std::optional<client::UnsentWork> leave(double timeoutMs);
    Result<std::string> addressAt(const LayerId& id, Revision revision);

    /// Opens layers of the past; 0: as they are now.
    Result<std::shared_ptr<client::OpenPast>> openPast(const LayerId& id, Revision revision);
    /// Moves layers of the past, and waits for it.
    Result<void> moveTo(const std::shared_ptr<client::OpenPast>& past, Revision revision);

    // Layers.
    [[nodiscard]] pxr::SdfLayerRefPtr layer(const LayerId& id) const;
    [[nodiscard]] std::optional<LayerId> layerId(const pxr::SdfLayerHandle& layer) const;

    // Lost and unsent edits.
    [[nodiscard]] Result<pxr::SdfLayerRefPtr> lostWorkAsLayer(std::uint64_t index,
                                                              const LayerId& id);
    [[nodiscard]] Result<pxr::SdfLayerRefPtr> unsentAsLayer(const ClientId& work,
                                                            const LayerId& layer);
    [[nodiscard]] std::size_t pendingTransactions() const {
        return session_.pendingTransactions() + (frame_.holdsBack() ? 1 : 0);
    }

    // Direct access to parts.
    [[nodiscard]] const Options& options() const { return options_; }
    [[nodiscard]] const client::CallerThread& thread() const { return thread_; }
    [[nodiscard]] client::Session& session() { return session_; }
    [[nodiscard]] client::EditorEvents& events() { return events_; }
    [[nodiscard]] client::LostWorkReports& lost() { return lost_; }
    [[nodiscard]] client::UnsentWorkReports& unsent() { return unsent_; }
    [[nodiscard]] client::OpenLayers& layers() { return layers_; }
    [[nodiscard]] client::OpenRequests& opens() { return opens_; }
    [[nodiscard]] client::FileUploads& uploads() { return uploads_; }
    [[nodiscard]] client::LocksAndMutes& locks() { return locks_; }
    [[nodiscard]] client::SessionHistory& history() { return history_; }
    /// Gives layers addresses, if the resolver plug-in is there.
    void useAddresses();
    [[nodiscard]] client::PlainFiles& files() { return files_; }
    [[nodiscard]] const client::CacheFolderPlaces& cache() const { return cache_; }
    [[nodiscard]] const client::AllPlaces& places() const { return places_; }

    // SessionHost
    void send(SharedBytes frames) override { line_.connection().send(std::move(frames)); }
    std::size_t bulkBytes() override { return line_.connection().bulkBytes(); }
    SharedBytes localBlob(const Hash& hash) override { return values_.cache().blob(hash); }
    bool holdsBlob(const Hash& hash) override { return values_.cache().holds(hash); }
    void blobArrived(const Hash& hash, SharedBytes bytes, bool lasting) override {
        values_.arrived(hash, std::move(bytes), lasting);
    }
    void blobStored(const Hash& hash) override { uploads_.blobStored(hash); }
    bool needsBlob(const Hash& hash) override;
    void pending(const client::PendingWork& work) override;
    void answered(std::uint64_t sequence) override;
    void discard(std::shared_ptr<void> garbage) override;

    // LayerView
    void arriving(const LayerId& id, std::shared_ptr<const client::SnapshotPart> part) override;
    void arrived(const LayerId& id, const LayerDoc& snapshot) override;
    void reset(const LayerId& id, const LayerDoc& doc) override;
    void apply(const LayerId& id, const std::string& path, const EditAction& action) override;
    void othersCommitted(const Commit& commit) override;
    void ownCommitted(const Commit& commit, Revision base) override;

private:
    static client::Session::Options sessionOptions(const Options& options, const Hash& secret);

    void work(double budgetMs, TickResult& result, Seal seal);
    template <class Note>
    void noteWrites(const Commit& commit, const Note& note);
    bool exchange(double budgetMs, Seal seal);
    /// Advances the session.
    bool advance(double budgetMs);
    /// Calls a function in which the session makes edits, and writes each list of children that it
    /// orders once.
    template <class Function>
    auto withEdits(const Function& function);
    void applyApart();
    void takeEvents(std::vector<client::Event> happened, TickResult& result);
    /// Returns false for events that the editor does not get, or not yet.
    bool note(client::Event& one);
    bool noteError(const ErrorMessage& message);
    void reportJoined();
    void followFiles();
    void followUploads();

    Result<void> waitForOpen(std::uint64_t request);
    /// Waits until something is received, and ticks. Returns whether something was received.
    bool step();
    void closePasts();
    Result<void> advanceUntilThere(const std::shared_ptr<client::OpenPast>& past);
    [[nodiscard]] Error notConfirmed(double timeoutMs) const;

    const Options options_;
    const Hash secret_;                      // proves the id of the client (ID5)
    const client::ProcessFolder ownFolder_;  // used if the editor has not set one
    std::future<void> removing_;             // removes the folders of killed editors
    client::CallerThread thread_;
    const std::unique_ptr<client::Worker> background_;
    client::CacheFolderPlaces& cache_;
    client::AllPlaces places_;
    client::EditorEvents events_;
    client::LostWorkReports lost_;
    client::NeededBigValues values_;
    client::Worker filler_;   // builds the content of layers
    client::Worker encoder_;  // encodes the editor's big arrays
    client::EditorFrame frame_;
    client::ServerLink line_;
    client::UnsentWorkReports unsent_;
    client::Session session_;
    client::SessionHistory history_;
    client::PlainFiles files_;
    client::OpenLayers layers_;
    client::OpenRequests opens_;
    client::LocksAndMutes locks_;
    client::LateAssets late_;
    client::FileUploads uploads_;
    /// Uploads that ended, and for which the list of files is awaited, with its number.
    std::vector<std::pair<client::FileUploads::Ended, std::uint64_t>> uploaded_;
    client::AwaitedAnswers answers_;
    std::vector<client::event::Joined> joined_;  // events for layers that are not filled yet
    bool ticking_ = false;
    std::optional<usd::SdfLayerStore::Block> edits_;  // the session makes them while it advances
    TakeBack takesBack_ = nullptr;  // called in the present tick, after the editor's edits
    std::optional<Result<client::UndoResult>> takenBack_;
    std::vector<std::weak_ptr<client::OpenPast>> pasts_;  // players move them
    int gestures_ = 0;                                    // open ones, each inside the one before
};

}  // namespace usdlive
