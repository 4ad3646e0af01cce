// Runs one project: the Project, its ports and its periodic work.
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <string_view>
#include <vector>

#include "app/ActivityLog.h"
#include "app/BlobCollector.h"
#include "app/FileFollower.h"
#include "app/Intake.h"
#include "app/Metrics.h"
#include "app/ProjectPlace.h"
#include "app/ProjectStrand.h"
#include "app/ServedBlobs.h"
#include "app/ServedFiles.h"
#include "app/SessionOutbox.h"
#include "app/SessionWork.h"
#include "app/SharedStore.h"
#include "app/StorageThread.h"
#include "app/StoreCopyFile.h"
#include "app/StoreHistory.h"
#include "app/Workers.h"
#include "auth/AccessRulesFile.h"
#include "files/LayerFiles.h"
#include "project/Project.h"
#include "transport/Log.h"
#include "transport/Transport.h"

namespace usdlive::server {

/// The initial content of a project.
struct ProjectBeginning {
    StoreState store;
    std::vector<LayerFile> files;
};
struct ProjectSetup {
    Project::Options options;
    std::function<Result<ProjectBeginning>()> read;  ///< may be called from any thread; slow
};

/// The project's folder and its files. Any thread.
struct ProjectFiles {
    ProjectPlace place;
    /// Returns the served layers: the files, and layers that exist only in the store.
    std::function<Result<std::vector<LayerFile>>()> list;
    LayerFiles& layers;
    AssetFiles& assets;
    const PublicText& texts;  ///< filters errors for clients
};

struct ProjectHealth {
    std::string_view status = "ok";  ///< or "storageFull", "starting"
    Revision revision = 0;           ///< durable
    std::size_t sessions = 0;
    std::set<UserName> users = {};  ///< have the sessions
};

/// A project at run time: the Project, its ports and its periodic work. The project's strand is the
/// network thread, so that messages are ordered and passed on without changing threads. Blocking
/// work runs on the storage thread and on workers, and its results are posted back.
class ProjectRuntime final : public SessionHandler {
public:
    ProjectRuntime(boost::asio::io_context& network, WorkerShares& workers, SharedStore& store,
                   StorageThread& storage, BlobStore& blobs, ProjectFiles files,
                   std::chrono::milliseconds keepUnusedBlobs, Metrics& metrics, ports::Clock& clock,
                   ActivityLog activity, Log& log);

    // Call on the network thread, unless a comment says otherwise.
    Result<void> start(ProjectSetup setup);
    /// Adds a transport for this project's sessions.
    void carry(Transport& transport) { transports_.add(transport); }
    /// See Project::rolesChanged().
    void rolesChanged(const std::function<Role(const SignedIn&)>& roleOf);
    /// Starts the periodic work, such as looking for new files.
    void serve();
    /// Sends the acknowledgements, closes the sessions, appends the remaining commits, then calls
    /// `done`.
    void stop(std::function<void()> done);

    [[nodiscard]] Revision durableRevision() const {
        const Project* project = strand_.project();
        return project ? project->durableRevision() : 0;
    }
    [[nodiscard]] ProjectHealth health() const;
    [[nodiscard]] std::shared_ptr<const MetricFamilies> metrics() const;

private:
    // SessionHandler
    void opened(SessionId session, const std::optional<SignedIn>& user) override;
    void received(SessionId session, ByteView message) override;
    void closed(SessionId session) override;
    void drained(SessionId session) override;

    // The messages of sessions, in turns.
    void handle(SessionId session, ByteView frames);
    [[nodiscard]] Party partyOf(SessionId session);
    [[nodiscard]] FairTurns::Store storeRoom() const;

    // Creating the project.
    void startAgain();
    void makeProject(ProjectBeginning beginning);
    void makeProjectAgain();

    // Periodic work.
    void scanFilesIn(std::chrono::milliseconds pause);
    void filesScanned(Result<std::vector<LayerFile>> files, std::chrono::milliseconds time);
    void sweepSoon();
    void forgetClientsIn(std::chrono::milliseconds pause);
    void boundHistoryIn(std::chrono::milliseconds pause);
    void lookForSpaceIn(std::chrono::milliseconds pause);
    void takeRules(const std::string& stamp, AccessRules rules);
    void confirmRules(const std::string& stamp) const;
    void copyStore(const std::string& name);
    void endSignInsIn(std::chrono::milliseconds pause);

    boost::asio::io_context& network_;
    WorkerShares& workers_;
    SharedStore& store_;
    StorageThread& storage_;
    const ProjectPlace place_;
    const std::function<Result<std::vector<LayerFile>>()> list_;
    Metrics& metrics_;
    ports::Clock& clock_;
    Log& log_;

    TransportTable transports_;
    SessionWork work_;
    Intake intake_;
    ProjectStrand strand_;
    SessionOutbox outbox_;
    StoreHistory history_;
    ServedBlobs blobs_;
    ServedFiles files_;
    ActivityLog activity_;

    const AccessRulesFile rulesFile_;
    FileFollower<AccessRulesFile> rulesFollower_;
    std::shared_ptr<const AccessRules> rules_ = std::make_shared<const AccessRules>();
    FileFollower<StoreCopyFile> copies_;
    ProjectSetup setup_;
    std::function<Role(const SignedIn&)> roleOf_;  ///< empty: roles have not changed yet
    boost::asio::steady_timer retryTimer_, scanTimer_, sweepTimer_, clientsTimer_, historyTimer_,
        spaceTimer_, signInsTimer_;
    BlobCollector collector_;
    bool sweeping_ = false;
    bool watchesSignIns_ = false;
    bool hasSpace_ = true;            ///< last answer of the store
    std::vector<LayerFile> scanned_;  ///< result of the last scan
};

}  // namespace usdlive::server
