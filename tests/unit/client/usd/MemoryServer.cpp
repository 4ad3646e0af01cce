// The real project of a server, in memory, for tests of clients.
#include "MemoryServer.h"

#include <algorithm>
#include <iterator>
#include <thread>

namespace usdlive::tests {

class MemoryConnection final : public client::Connection {
public:
    explicit MemoryConnection(MemoryServer& server) : server_(server) {}
    ~MemoryConnection() override { server_.disconnect(*this); }

    void send(SharedBytes frames) override {
        if (session_ == 0) return;
        server_.post([&server = server_, session = session_, frames] {
            if (server.lines_.contains(session)) server.project_->received(session, *frames);
        });
    }
    std::vector<Happening> poll(std::size_t most) override {
        if (session_ == 0 && server_.open(*this)) inbox.push_back(Opened{});
        server_.work();
        std::vector<Happening> happenings;
        while (!inbox.empty() && happenings.size() < most) {
            happenings.push_back(std::move(inbox.front()));
            inbox.pop_front();
        }
        return happenings;
    }
    bool wait(std::chrono::milliseconds time) override {
        if (session_ != 0) server_.work();
        if (inbox.empty())
            std::this_thread::sleep_for(std::min(time, std::chrono::milliseconds(1)));
        return !inbox.empty();
    }
    std::size_t queuedBytes() const override { return 0; }
    std::size_t bulkBytes() const override { return kChunkBytes; }
    void reset() override { cut("reset"); }

    void cut(const std::string& why) {
        if (session_ == 0) return;
        server_.disconnect(*this);
        inbox.push_back(Lost{{ErrorCode::NotConnected, why}});
    }

    void open(server::SessionId session) {
        session_ = session;
        reader_.emplace();
    }
    void deliver(const SharedBytes& frames) { inbox.push_back(Message{reader_->read(*frames)}); }

    std::deque<Happening> inbox;
    server::SessionId session_ = 0;

private:
    MemoryServer& server_;
    std::optional<client::MessageReader> reader_;
};

namespace {

std::vector<server::LayerFile> servedOf(const std::map<LayerId, LayerDoc>& files) {
    std::vector<server::LayerFile> served;
    for (const auto& [name, doc] : files) served.push_back({name});
    return served;
}

SharedBytes encoded(const Frame& frame) {
    return std::make_shared<const Bytes>(encodeFrame(frame));
}

}  // namespace

MemoryServer::MemoryServer(std::map<LayerId, LayerDoc> docs) : files(std::move(docs)) {
    project_ =
        std::make_unique<server::Project>(server::Project::Options{.name = "test"}, ports(),
                                          server::StoreState{.head = {0, {}, 1}}, servedOf(files));
}

std::unique_ptr<client::Connection> MemoryServer::connect() {
    return std::make_unique<MemoryConnection>(*this);
}

void MemoryServer::setReachable(bool reachable) {
    reachable_ = reachable;
    if (reachable) return;
    work();
    for (const auto& [session, line] : std::map(lines_)) line->cut("the cable was pulled");
}

void MemoryServer::work() {
    while (!tasks_.empty()) {
        const auto task = std::move(tasks_.front());
        tasks_.pop_front();
        task();
    }
}

bool MemoryServer::open(MemoryConnection& connection) {
    if (!reachable_) return false;
    connection.open(++lastSession_);
    lines_[lastSession_] = &connection;
    project_->connected(lastSession_);
    return true;
}

void MemoryServer::disconnect(MemoryConnection& connection) {
    const auto session = std::exchange(connection.session_, 0);
    if (lines_.erase(session)) project_->disconnected(session);
}

void MemoryServer::send(server::SessionId session, SharedBytes frames) {
    if (const auto line = lines_.find(session); line != lines_.end()) line->second->deliver(frames);
}

void MemoryServer::close(server::SessionId session) {
    post([this, session] {
        if (const auto line = lines_.find(session); line != lines_.end())
            line->second->cut("the server closed the connection");
    });
}

void MemoryServer::append(server::CommitRecord commit) {
    commits_.push_back({commit.revision, commit.frame, commit.hash});
    transactions_[commit.id] = commit.revision;
    post([this, revision = commit.revision] { project_->appended(revision); });
}

void MemoryServer::loadLayer(const LayerId& layer) {
    post([this, layer] {
        const auto file = files.find(layer);
        if (file == files.end())
            project_->layerLoaded(layer, fail(ErrorCode::LayerNotFound, "no layer " + layer.value));
        else if (unreadable.contains(layer))
            project_->layerLoaded(layer, fail(ErrorCode::LayerUnreadable, "it does not parse"));
        else
            project_->layerLoaded(layer, server::LoadedLayer{file->second});
    });
}

void MemoryServer::readCommits(server::SessionId session, Revision from, Revision to) {
    post([this, session, from, to] {
        std::vector<server::StoredCommit> commits;
        for (const auto& commit : commits_)
            if (commit.revision >= from && commit.revision <= to) commits.push_back(commit);
        project_->commitsRead(session, std::move(commits));
    });
}

void MemoryServer::readHistory(server::SessionId session, std::uint64_t request, const LayerId&,
                               Revision) {
    post([this, session, request] {
        project_->historyRead(session, request, fail(ErrorCode::Internal, "no history here"));
    });
}

void MemoryServer::sendSnapshot(server::SessionId session, std::uint64_t request, LayerDoc doc) {
    SnapshotEncoder encoder(std::move(doc), request);
    while (auto frame = encoder.next())
        post([this, session, bytes = encoded(*frame)] { send(session, bytes); });
}

void MemoryServer::sendBlob(server::SessionId session, const Hash& hash, std::uint64_t offset) {
    const Bytes& blob = blobs.at(hash);
    for (; offset < blob.size(); offset += kChunkBytes) {
        const ByteView part = ByteView(blob).subspan(
            offset, std::min<std::size_t>(kChunkBytes, blob.size() - offset));
        const BlobFrame frame{hash, blob.size(), offset, std::uint32_t(part.size()), deflate(part)};
        post([this, session, bytes = encoded(frame)] { send(session, bytes); });
    }
}

void MemoryServer::writeBlob(server::SessionId session, const std::string& /*share*/,
                             BlobFrame part) {
    const auto raw = inflate(part.data, part.rawBytes, kChunkBytes * 2);
    static std::map<Hash, Bytes> unfinished;
    if (blobs.contains(part.hash)) {
        const bool ends = part.offset == 0 || part.offset + part.rawBytes == part.size;
        return post([this, session, hash = part.hash, ends] {
            project_->blobWritten(session, hash, ends);
        });
    }
    Bytes& bytes = unfinished[part.hash];
    if (part.offset == 0) bytes.clear();
    bytes.insert(bytes.end(), raw->begin(), raw->end());
    const bool whole = bytes.size() == part.size;
    if (whole) blobs[part.hash] = std::move(unfinished.extract(part.hash).mapped());
    post([this, session, hash = part.hash, whole] { project_->blobWritten(session, hash, whole); });
}

void MemoryServer::saveLayers(server::SessionId session, std::uint64_t request,
                              std::vector<server::SaveJob> jobs) {
    server::SaveOutcome outcome;
    for (auto& job : jobs) {
        outcome.saved.emplace_back(job.layer, server::FileStamp());
        saved.push_back(job.layer);
        files[job.layer] = std::move(job.doc);
    }
    post([this, session, request, outcome] { project_->layersSaved(session, request, outcome); });
}

void MemoryServer::createLayerFile(server::SessionId session, std::uint64_t request,
                                   const LayerId& layer) {
    post([this, session, request, layer] {
        files.try_emplace(layer);
        project_->layerCreated(session, request, layer, {});
    });
}

void MemoryServer::storeFile(server::SessionId session, std::uint64_t request,
                             server::UploadJob job) {
    post([this, session, request, job = std::move(job)] {
        const auto content = blobs.find(job.hash);
        if (content == blobs.end()) return project_->fileStored(session, request, job.path, false);
        const auto [file, isNew] = uploaded.try_emplace(job.path, content->second);
        if (!isNew && file->second != content->second && !job.overwrite)
            return project_->fileStored(session, request, job.path,
                                        fail(ErrorCode::FileExists, "there is another file"));
        file->second = content->second;
        project_->fileStored(session, request, job.path, true);
    });
}

void MemoryServer::listSkipped(server::SessionId session, std::uint64_t request) {
    post([this, session, request] {
        project_->skippedListed(session, request, std::vector<SkippedFile>());
    });
}

void MemoryServer::readClient(const ClientId& client) {
    post([this, client] {
        server::ClientRecord known;
        for (const auto& [id, revision] : transactions_)
            if (id.client == client) known.committed.emplace_back(id.sequence, revision);
        project_->clientRead(client, known);
    });
}

void MemoryServer::findBlobs(std::vector<Hash> hashes) {
    post([this, hashes = std::move(hashes)] {
        std::vector<Hash> stored;
        std::ranges::copy_if(hashes, std::back_inserter(stored),
                             [this](const Hash& hash) { return blobs.contains(hash); });
        project_->blobsFound(hashes, stored);
    });
}

void MemoryServer::sendCommit(std::span<const server::SessionId> sessions, SharedBytes frame,
                              Revision) {
    for (const server::SessionId session : sessions) send(session, frame);
}

void MemoryServer::sendUpdate(std::span<const server::SessionId> sessions,
                              const server::StateUpdate& update) {
    for (const server::SessionId session : sessions) sendInitialState(session, update);
}

void MemoryServer::sendInitialState(server::SessionId session, const server::StateUpdate& all) {
    if (SharedBytes frame = server::encodeStateUpdate(all)) send(session, std::move(frame));
}

void MemoryServer::sendBeside(server::SessionId session, std::vector<SharedBytes> frames) {
    for (SharedBytes& frame : frames) send(session, std::move(frame));
}

}  // namespace usdlive::tests
