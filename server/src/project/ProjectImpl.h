// The parts of a project and their connections.
#pragma once

#include "project/Project.h"
#include "project/access/ProjectFacts.h"
#include "project/clients/Greeting.h"
#include "project/clients/Submissions.h"
#include "project/files/NewFiles.h"
#include "project/files/NewLayers.h"
#include "project/files/Reloads.h"
#include "project/files/Saves.h"
#include "project/layers/LayerLists.h"
#include "project/layers/Snapshots.h"
#include "project/layers/StateBoard.h"
#include "project/sessions/PresenceBoard.h"
#include "project/stream/BigValues.h"
#include "project/stream/Gestures.h"
#include "project/stream/Openings.h"
#include "project/upkeep/CheckpointRequests.h"
#include "project/upkeep/Compaction.h"
#include "project/upkeep/IdleLayers.h"

namespace usdlive::server {

/// A project: its parts, in the order in which they refer to each other. Each part has its own
/// state. Messages and answers are passed to the part that handles them; parts that follow others
/// are notified by them (LineListener, LayerListener, SessionListener).
class Project::Impl : public Greeting::Receiver {
public:
    Impl(Options options, Ports ports, StoreState store, const std::vector<LayerFile>& files);
    Impl(const Impl&) = delete;
    /// Copies the state of all parts. Precondition: both were made with the same options.
    Impl& operator=(const Impl&) = default;

    // Dispatch.cpp
    void connected(SessionId id, std::optional<SignedIn> user, const std::string& address);
    void setRules(std::shared_ptr<const AccessRules> rules);
    void rolesChanged(const std::function<Role(const SignedIn&)>& roleOf);
    bool endSignIns(std::int64_t now);
    void received(SessionId id, ByteView message);
    void disconnected(SessionId id);
    void receiveFrame(SessionId id, ByteView frame) override;

    // ProjectImpl.cpp: answers of the ports that several parts handle.
    void appendFailed(const Error& error, const CommitStore::Head& head);
    void clientRead(const ClientId& client, const Result<ClientRecord>& record);
    void commitsRead(SessionId id, Result<std::vector<StoredCommit>> commits);
    void blobsFound(const std::vector<Hash>& asked, const std::vector<Hash>& stored);
    [[nodiscard]] std::vector<Hash> unusedBlobs(const std::vector<Hash>& unnamed, Revision upTo,
                                                std::int64_t nowMs);
    /// Call it after each change that may affect the states of layers, or whether they are needed.
    void finishCall();

private:
    friend class Project;

    void receiveCompact(Session& session, ByteView frame);
    void receiveControl(Session& session, const std::string& json);
    void receive(Session& session, const ControlMessage& message);
    void connectListeners();

    Options options_;
    StoreId identity_;
    Wire<ports::Activity> activity_;
    ProjectCounters counters_;

    StoreCondition store_;
    HistoryStart start_;
    TimeOfDay time_;
    HistoryLine line_;
    SessionTable sessions_;
    PresenceBoard presences_;

    SuspectLayers suspects_;
    LayerTable layers_;
    LayerLists layerLists_;
    FileStates fileStates_;
    StateBoard states_;
    Snapshots snapshots_;

    ProjectFacts facts_;
    AccessPolicy access_;

    Previews previews_;
    CommitReads reads_;
    Catchup catchup_;
    Gestures gestures_;
    BigValues values_;
    Openings openings_;

    Authors authors_;
    Prerequisites prerequisites_;
    Submissions submissions_;
    Greeting greeting_;

    Saves saves_;
    Reloads reloads_;
    NewLayers newLayers_;
    NewFiles newFiles_;

    CheckpointRequests checkpoints_;
    Compaction compaction_;
    IdleLayers idleLayers_;
};

}  // namespace usdlive::server
