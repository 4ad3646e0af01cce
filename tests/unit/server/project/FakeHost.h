// A fake process around a project, which answers when a test asks for it.
#pragma once

#include <algorithm>
#include <deque>
#include <iterator>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "project/Project.h"
#include "usdlive/common/layer/TransactionExecutor.h"

namespace usdlive::server::projecttest {

/// Notes the requests of a project; the test answers them when it wants.
class FakeHost : public AllPorts {
public:
    struct HistoryRead {
        SessionId session;
        std::uint64_t request;
        LayerId layer;
        Revision revision;
    };
    struct Snapshot {
        SessionId session;
        std::uint64_t request;
        LayerDoc doc;
    };
    struct CommitsRead {
        SessionId session;
        Revision from, to;
    };
    struct Save {
        SessionId session;
        std::uint64_t request;
        std::vector<SaveJob> jobs;
    };

    struct Reload {
        SessionId session;
        std::uint64_t request;
        LayerId layer;
        LayerDoc present;
    };

    struct Creation {
        SessionId session;
        std::uint64_t request;
        LayerId layer;
    };

    struct Storing {
        SessionId session;
        std::uint64_t request;
        UploadJob job;
    };

    struct Naming {
        SessionId session;
        std::uint64_t request;
        Checkpoint checkpoint;
    };

    std::map<SessionId, std::deque<Bytes>> sent;  ///< frames without their length
    std::set<SessionId> closed;
    std::set<SessionId> congestedSessions;
    bool sendsToAll = false;  ///< commits are sent to all at once, as over DDS
    std::deque<CommitRecord> appending;
    std::deque<LayerId> loading;
    std::deque<CommitsRead> reading;
    std::deque<HistoryRead> readingHistory;
    std::vector<Snapshot> snapshots;
    std::vector<Save> saves;
    std::vector<LayerId> checking;
    std::deque<Reload> reloading;
    std::map<LayerId, SavedState> savedStates;
    std::deque<Naming> naming;
    std::vector<Creation> creating;
    std::vector<Storing> storing;
    std::vector<std::pair<SessionId, std::uint64_t>> listing;
    std::vector<std::string> logged;                  ///< "user: action layer, detail"
    std::vector<std::pair<Revision, LayerDoc>> kept;  ///< for all layers
    std::vector<std::pair<SessionId, BlobFrame>> blobParts;
    std::set<SessionId> withoutUnfinished;
    std::vector<std::pair<SessionId, std::uint64_t>> blobsSent;
    std::set<Hash> blobs;
    std::map<TransactionId, Revision> stored;
    std::deque<ClientId> readingClients;
    std::deque<std::vector<Hash>> findingBlobs;
    std::vector<StoredCommit> log;  ///< the content of the store

    void send(SessionId session, SharedBytes frames) override {
        const auto split = splitMessage(*frames);
        for (const ByteView frame : *split) sent[session].emplace_back(frame.begin(), frame.end());
    }
    void sendCommit(std::span<const SessionId> sessions, SharedBytes frame, Revision) override {
        for (const SessionId session : sessions) send(session, frame);
    }
    [[nodiscard]] bool isMulticast(SessionId) const override { return sendsToAll; }
    bool holdCommits(SessionId) override { return sendsToAll; }
    void releaseCommits(SessionId, Revision) override {}
    void sendUpdate(std::span<const SessionId> sessions, const StateUpdate& update) override {
        for (const SessionId session : sessions) sendInitialState(session, update);
    }
    void sendInitialState(SessionId session, const StateUpdate& all) override {
        if (const SharedBytes frame = encodeStateUpdate(all)) send(session, frame);
    }
    void sendBeside(SessionId session, std::vector<SharedBytes> frames) override {
        for (const SharedBytes& frame : frames) send(session, frame);
    }
    bool congested(SessionId session) override { return congestedSessions.contains(session); }
    bool lags(SessionId session) override { return congested(session); }
    void close(SessionId session) override { closed.insert(session); }
    void append(CommitRecord commit) override { appending.push_back(std::move(commit)); }
    void keepSnapshot(const LayerId&, LayerDoc doc, Revision revision, const Hash&) override {
        kept.emplace_back(revision, std::move(doc));
    }
    void loadLayer(const LayerId& layer) override { loading.push_back(layer); }
    void readCommits(SessionId session, Revision from, Revision to) override {
        reading.push_back({session, from, to});
    }
    void importLayer(const LayerId& layer) override { importing.push_back(layer); }
    void readLayer(SessionId, std::uint64_t request, const LayerId&) override {
        readingLayers.push_back(request);
    }
    void readClient(const ClientId& client) override { readingClients.push_back(client); }
    void findBlobs(std::vector<Hash> hashes) override { findingBlobs.push_back(std::move(hashes)); }
    void readHistory(SessionId session, std::uint64_t request, const LayerId& layer,
                     Revision revision) override {
        readingHistory.push_back({session, request, layer, revision});
    }
    void sendSnapshot(SessionId session, std::uint64_t request, LayerDoc doc) override {
        snapshots.push_back({session, request, std::move(doc)});
    }
    void sendBlob(SessionId session, const Hash&, std::uint64_t offset) override {
        blobsSent.emplace_back(session, offset);
    }
    void writeBlob(SessionId session, const std::string&, BlobFrame part) override {
        blobParts.emplace_back(session, std::move(part));
    }
    void removeUnfinished(SessionId session) override { withoutUnfinished.insert(session); }
    void saveLayers(SessionId session, std::uint64_t request, std::vector<SaveJob> jobs) override {
        saves.push_back({session, request, std::move(jobs)});
    }
    void addCheckpoint(SessionId session, std::uint64_t request,
                       const Checkpoint& checkpoint) override {
        naming.push_back({session, request, checkpoint});
    }
    void readCheckpoints(SessionId, std::uint64_t) override {}
    void createLayerFile(SessionId session, std::uint64_t request, const LayerId& layer) override {
        creating.push_back({session, request, layer});
    }
    void storeFile(SessionId session, std::uint64_t request, UploadJob job) override {
        storing.push_back({session, request, std::move(job)});
    }
    void listSkipped(SessionId session, std::uint64_t request) override {
        listing.emplace_back(session, request);
    }
    void record(const ActivityEvent& event) override {
        logged.push_back(event.user.value + ": " + std::string(event.what) +
                         (event.layer.empty() ? "" : " " + event.layer.value) +
                         (event.detail.empty() ? "" : ", " + event.detail));
    }
    void checkFile(const LayerId& layer) override { checking.push_back(layer); }
    void reloadLayer(SessionId session, std::uint64_t request, const LayerId& layer,
                     LayerDoc present) override {
        reloading.push_back({session, request, layer, std::move(present)});
    }
    void setSaved(const LayerId& layer, const SavedState& saved) override {
        savedStates[layer] = saved;
    }
    Revision forgotten = 0;
    std::int64_t wallClockMs() override { return nowMs + jumpMs; }
    std::int64_t steadyMs() override { return nowMs; }
    void findBase(std::int64_t beforeMs, Revision upTo) override {
        findingBase.emplace_back(beforeMs, upTo);
    }
    void compact(Revision revision) override { compacting.push_back(revision); }
    void measureStorage(SessionId session, std::uint64_t request) override {
        measuring.emplace_back(session, request);
    }
    std::deque<LayerId> importing;
    std::deque<std::uint64_t> readingLayers;  ///< the requests
    std::vector<std::pair<std::int64_t, Revision>> findingBase;
    std::vector<Revision> compacting;
    std::vector<std::pair<SessionId, std::uint64_t>> measuring;
    std::int64_t nowMs = 1'700'000'000'000;
    std::int64_t jumpMs = 0;  ///< how far the clock of the machine is ahead of the right time
};

/// A project, the requests to its host, and the messages to its clients.
class World {
public:
    explicit World(Project::Options options = {},
                   std::vector<LayerId> layers = {{"a.usda"}, {"b.usda"}})
        : options(options), layers(std::move(layers)) {
        start();
    }

    /// Starts a new process with the stored state.
    void start() {
        StoreState state;
        if (!host.log.empty()) state.head = {host.log.back().revision, host.log.back().hash, 0};
        state.head.epoch = ++epoch;
        state.base = base;
        state.namespaceChanges = namespaceChanges;
        state.unsaved = unsaved;
        state.forgottenUpTo = host.forgotten;
        state.identity = identity;
        host.sent.clear();
        host.loading.clear();
        host.readingClients.clear();
        host.findingBlobs.clear();
        std::vector<LayerFile> files;
        for (const LayerId& layer : layers) files.push_back({layer});
        project = std::make_unique<Project>(options, host.ports(), std::move(state), files);
    }
    void restart() { start(); }

    /// Answers what the store knows about connected clients, and which big values it has. The test
    /// answers all other requests.
    void answerQuestions() {
        while (!host.readingClients.empty() || !host.findingBlobs.empty()) {
            if (!host.readingClients.empty()) {
                const ClientId client = host.readingClients.front();
                host.readingClients.pop_front();
                project->clientRead(client, clientRecord(client));
                continue;
            }
            const std::vector<Hash> asked = std::move(host.findingBlobs.front());
            host.findingBlobs.pop_front();
            std::vector<Hash> stored;
            std::ranges::copy_if(asked, std::back_inserter(stored),
                                 [this](const Hash& hash) { return host.blobs.contains(hash); });
            project->blobsFound(asked, stored);
        }
    }
    [[nodiscard]] ClientRecord clientRecord(const ClientId& client) const {
        ClientRecord known{{}, host.forgotten};
        for (const auto& [id, revision] : host.stored)
            if (id.client == client) known.committed.emplace_back(id.sequence, revision);
        return known;
    }

    /// Makes everything durable that was passed to append().
    void store() {
        Revision upTo = 0;
        for (CommitRecord& commit : host.appending) {
            upTo = commit.revision;
            if (commit.id.sequence != 0) host.stored[commit.id] = commit.revision;
            host.log.push_back({commit.revision, commit.frame, commit.hash});
            namespaceChanges.insert(namespaceChanges.end(), commit.namespaceChanges.begin(),
                                    commit.namespaceChanges.end());
            records.push_back(std::move(commit));
        }
        host.appending.clear();
        if (upTo != 0) project->appended(upTo);
    }
    /// Answers readCommits() once.
    void answerRead() {
        const auto read = host.reading.front();
        host.reading.pop_front();
        std::vector<StoredCommit> commits;
        for (const StoredCommit& commit : host.log)
            if (commit.revision >= read.from && commit.revision <= read.to)
                commits.push_back(commit);
        project->commitsRead(read.session, std::move(commits));
    }
    /// Answers loadLayer() with a layer that contains /A and /B.
    void load(bool imported = false) {
        const LayerId layer = host.loading.front();
        host.loading.pop_front();
        LoadedLayer loaded{sample()};
        if (imported) loaded.import = *makeImport(layer, loaded.doc);
        project->layerLoaded(layer, std::move(loaded));
    }
    static LayerDoc sample() {
        LayerDoc doc;
        (void)doc.apply("/A", CreateSpec{SpecKind::Prim});
        (void)doc.apply("/A.x", CreateSpec{SpecKind::Attribute});
        (void)doc.apply("/B", CreateSpec{SpecKind::Prim});
        return doc;
    }

    static ClientId client(SessionId session) { return {"client" + std::to_string(session)}; }
    void receive(SessionId session, const Frame& frame) {
        project->received(session, encodeFrame(frame));
        if (answers) answerQuestions();
    }
    void receive(SessionId session, const ControlMessage& message) {
        receive(session, Frame(ControlFrame{encodeControl(message)}));
    }
    Hello hello(SessionId session) const {
        return {kProtocolVersion,
                kOldestProtocolVersion,
                {},
                client(session),
                {"user" + std::to_string(session)},
                "test",
                {},
                {},
                {}};
    }
    void connect(SessionId session, std::optional<Hello> greeting = {},
                 const std::string& address = {}) {
        project->connected(session, {}, address);
        receive(session, ControlMessage(greeting ? *greeting : hello(session)));
    }
    /// Connects and drops the welcome.
    void join(SessionId session) {
        connect(session);
        host.sent[session].clear();
    }
    void submit(SessionId session, std::uint64_t sequence, std::vector<Edit> edits,
                Revision base = 0, std::uint64_t gesture = 0) {
        receive(session,
                Frame(SubmitFrame{{{client(session), sequence}, base, gesture, std::move(edits)}}));
    }

    /// Returns the next frame for the session; fails the test when there is none.
    Frame next(SessionId session) {
        auto& frames = host.sent[session];
        if (frames.empty()) throw std::runtime_error("nothing was sent");
        auto frame = decodeFrame(frames.front());
        lastHash = sha256({});
        if (frame)
            if (const auto* commit = std::get_if<CommitFrame>(&*frame))
                lastHash = hashAfter(*commit, commit->commit.previous, frames.front());
        frames.pop_front();
        return frame.value();
    }
    template <class T>
    T nextFrame(SessionId session) {
        return std::get<T>(next(session));
    }
    template <class T>
    T nextControl(SessionId session) {
        const auto message = decodeControl(nextFrame<ControlFrame>(session).json);
        return std::get<T>(message.value());
    }
    [[nodiscard]] bool silent(SessionId session) const {
        const auto found = host.sent.find(session);
        return found == host.sent.end() || found->second.empty();
    }

    Project::Options options;
    bool answers = true;  ///< calls answerQuestions() after each message
    std::vector<LayerId> layers, unsaved;
    CommitStore::Base base;
    Epoch epoch = 0;
    StoreId identity;
    FakeHost host;
    std::vector<NamespaceChange> namespaceChanges;
    std::vector<CommitRecord> records;
    std::unique_ptr<Project> project;
    Hash lastHash;
};

inline Edit set(const std::string& path, double value, LayerId layer = {"a.usda"}) {
    return {layer, {path, {}}, SetField{"default", {}, doubleValue(value), {}}};
}
inline Edit create(const std::string& path, LayerId layer = {"a.usda"}) {
    return {layer, {path, {}}, CreateSpec{SpecKind::Prim}};
}
inline Edit erase(const std::string& path, LayerId layer = {"a.usda"}) {
    return {layer, {path, {}}, DeleteSpec{}};
}
inline Edit move(const std::string& path, const std::string& parent, const std::string& name,
                 LayerId layer = {"a.usda"}) {
    return {layer, {path, {}}, MoveSpec{{parent, {}}, name}};
}
inline Edit inCreated(std::uint64_t sequence, std::uint32_t edit, const std::string& path,
                      EditAction action, LayerId layer = {"a.usda"}) {
    return {layer, {path, Creation{sequence, edit}}, std::move(action)};
}

}  // namespace usdlive::server::projecttest
