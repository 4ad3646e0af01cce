// Who is connected, and what arrives from them.
#include <algorithm>
#include <cctype>

#include "ProjectImpl.h"
#include "usdlive/common/core/Overloaded.h"

namespace usdlive::server {

namespace {

// A client further behind than this joins anew: snapshots are then quicker than commits.
constexpr Revision kMaxResumeCommits = 50'000;

bool isClientId(const std::string& text) {
    return !text.empty() && text.size() <= 64 &&
           std::all_of(text.begin(), text.end(), [](unsigned char character) {
               return std::isalnum(character) || character == '-' || character == '_';
           });
}

std::vector<std::string> common(const std::vector<std::string>& asked) {
    std::vector<std::string> both;
    for (const std::string& feature : protocolFeatures())
        if (std::find(asked.begin(), asked.end(), feature) != asked.end()) both.push_back(feature);
    return both;
}

int commonProtocol(const Hello& hello) {
    const int newest = std::min(hello.protocol, kProtocolVersion);
    return newest >= std::max(hello.oldestProtocol, kOldestProtocolVersion) ? newest : 0;
}

}  // namespace

Session* Project::Impl::find(SessionId id) {
    const auto found = sessions_.find(id);
    return found == sessions_.end() ? nullptr : &found->second;
}

void Project::Impl::connected(SessionId id) {
    Session& session = sessions_[id];
    session.id = id;
    if (sessions_.size() > options_.maxSessions)
        close(session, {ErrorCode::TooManySessions, "the project has " +
                                                        std::to_string(options_.maxSessions) +
                                                        " sessions, as many as it may have"});
}

void Project::Impl::received(SessionId id, ByteView message) {
    Session* session = find(id);
    if (!session || std::holds_alternative<Closing>(session->phase)) return;
    const auto frames = splitMessage(message, options_.maxFrameBytes);
    if (!frames) return close(*session, frames.error());
    for (const ByteView frame : *frames) receiveFrame(*session, frame);
}

void Project::Impl::receiveFrame(Session& session, ByteView bytes) {
    if (std::holds_alternative<Closing>(session.phase)) return;
    if (auto* checking = std::get_if<CheckingResume>(&session.phase)) {
        checking->waitingBytes += bytes.size();
        if (checking->waitingBytes > options_.maxFrameBytes)
            return close(session, {ErrorCode::NotGreeted, "too much was sent before the welcome"});
        checking->waiting.emplace_back(bytes.begin(), bytes.end());
        return;
    }
    auto frame = decodeFrame(bytes);
    if (!frame) return close(session, frame.error());
    const auto* control = std::get_if<ControlFrame>(&*frame);
    if (control) return receiveControl(session, control->json);
    if (!session.isGreeted())
        return close(session, {ErrorCode::NotGreeted, "the first frame was no hello"});
    std::visit(Overloaded{
                   [&](SubmitFrame& submitted) {
                       receiveSubmit(session, std::move(submitted), bytes.size());
                   },
                   [&](PreviewFrame& preview) {
                       receivePreview(session, std::move(preview), bytes.size());
                   },
                   [&](BlobFrame& part) { receiveBlob(session, std::move(part)); },
                   [&](auto&) {
                       close(session, {ErrorCode::UnknownFrame,
                                       "a frame of a kind that only the server sends"});
                   },
               },
               *frame);
}

void Project::Impl::receiveControl(Session& session, const std::string& json) {
    const auto message = decodeControl(json);
    if (!message) return close(session, message.error());
    const auto* hello = std::get_if<Hello>(&*message);
    if (hello && session.isGreeted())
        return close(session, {ErrorCode::SecondHello, "a second hello"});
    if (hello) return greet(session, *hello);
    if (!session.isGreeted())
        return close(session, {ErrorCode::NotGreeted, "the first frame was no hello"});
    receive(session, *message);
}

void Project::Impl::receive(Session& session, const ControlMessage& message) {
    std::visit(Overloaded{
                   [&](const OpenLayer& open) { openLayer(session, open); },
                   [&](const CloseLayer& close) { closeLayer(session, close.layer); },
                   [&](const ShowPresence& shown) { showPresence(session, shown.presence); },
                   [&](const RequestBlob& request) { requestBlob(session, request); },
                   [&](const SaveLayers& request) { saveLayers(session, request); },
                   [&](const ReloadLayers& request) { reloadLayers(session, request); },
                   [&](const RequestLog& request) { requestLog(session, request); },
                   [&](const CreateLayer& request) { createLayer(session, request); },
                   [&](const ListSkipped& request) {
                       ports_.files.listSkipped(session.id, request.request);
                   },
                   [&](const CreateCheckpoint& request) { createCheckpoint(session, request); },
                   [&](const ListCheckpoints& request) {
                       ports_.history.readCheckpoints(session.id, request.request);
                   },
                   [&](const CompactHistory& request) { compactHistory(session, request); },
                   [&](const RequestStorage& request) {
                       ports_.history.measureStorage(session.id, request.request);
                   },
                   [&]<class Message>(const Message&) {
                       static_assert(!IsRequest<Message>, "every request needs its meaning here");
                       close(session, {ErrorCode::MalformedControl,
                                       "a message of a type that only the server sends"});
                   },
               },
               message);
}

void Project::Impl::greet(Session& session, const Hello& hello) {
    if (commonProtocol(hello) == 0)
        return close(
            session,
            {ErrorCode::UnsupportedProtocol,
             "the server speaks versions " + std::to_string(kOldestProtocolVersion) + " to " +
                 std::to_string(kProtocolVersion) + ", the client " +
                 std::to_string(hello.oldestProtocol) + " to " + std::to_string(hello.protocol)});
    if (!isClientId(hello.client.value))
        return close(session, {ErrorCode::MalformedControl,
                               "a client's id is 1 to 64 letters, digits, '-' or '_'"});
    supersede(hello.client);
    session.client = hello.client;
    session.subject = access_.subject(hello.user);
    session.application = hello.application;
    for (std::string& feature : common(hello.features)) session.features.insert(std::move(feature));
    session.phase = CheckingResume{hello, {}, 0};
    if (!authors_[session.client].committed) readClient(session.client);
    if (hello.resume)
        checkResume(session);
    else
        welcome(session, std::nullopt);
}

/// What it has committed (M9): asked for when it comes, and kept as long as it is here.
void Project::Impl::readClient(const ClientId& client) {
    Author& author = authors_[client];
    if (storeClosed_ || std::exchange(author.isRead, true)) return;
    ports_.history.readClient(client);
}

void Project::Impl::clientRead(const ClientId& client, const Result<ClientRecord>& record) {
    const auto found = authors_.find(client);
    if (found == authors_.end()) return;
    Author& author = found->second;
    if (!std::exchange(author.isRead, false) || author.committed) return;
    if (record) {
        author.committed.emplace(*record);
        forgottenUpTo_ = std::max(forgottenUpTo_, record->forgottenUpTo);
    }
    for (auto& [id, session] : sessions_) {
        if (session.client != client || std::holds_alternative<Closing>(session.phase)) continue;
        const bool isResuming = std::holds_alternative<CheckingResume>(session.phase);
        // Without it what it sends may be committed twice. It comes again, and is asked for again.
        // Who only looks on stays.
        if (!record && !storeClosed_ && (isResuming || !session.transactions.empty()))
            close(session, record.error());
        else if (isResuming)
            checkResume(session);
        else
            work(session);
    }
    forgetAuthor(client);
}

/// A connection its client has given up may still deliver. What comes over it now would be executed
/// beside what the client sends anew, after it was told that it is refused.
void Project::Impl::supersede(const ClientId& client) {
    bool superseded = false;
    for (auto& [id, other] : sessions_) {
        if (other.client != client || std::holds_alternative<Closing>(other.phase)) continue;
        superseded = true;
        ports_.outbox.close(id);
        other.phase = Closing{};
        other.transactions.clear();
        other.answers.clear();
        forgetComing(other);
    }
    // A gesture that is still open is sent anew; one that has ended empty meanwhile is not.
    if (superseded) withdrawAll(client);
}

void Project::Impl::checkResume(Session& session) {
    const auto& resume = *std::get<CheckingResume>(session.phase).hello.resume;
    const std::string at = "revision " + std::to_string(resume.revision);
    const auto& known = authors_[session.client].committed;
    if (!known && !storeClosed_) return;  // clientRead() calls this again
    if (!known && resume.revision < forgottenUpTo_)
        return close(session, {ErrorCode::StorageFailed, "the store has failed"});
    if (known && known->mayLack(resume.revision))
        return welcome(session, Error{ErrorCode::ClientForgotten,
                                      "this client was away since " + at +
                                          ", and the server no longer knows what it has sent"});
    if (resume.epoch > epoch_)
        return welcome(session, Error{ErrorCode::HistoryDiverged,
                                      "the client has seen epoch " + std::to_string(resume.epoch) +
                                          ", this server has " + std::to_string(epoch_)});
    if (resume.revision > durable_)
        return welcome(session, Error{ErrorCode::FutureRevision, "the client is at " + at +
                                                                     ", the server at " +
                                                                     std::to_string(durable_)});
    if (resume.revision < newestInParts_ && !session.features.contains(kPartsFeature))
        return welcome(session, Error{ErrorCode::StaleBase,
                                      "commit " + std::to_string(newestInParts_) +
                                          " comes in parts, which the client cannot read"});
    if (durable_ - resume.revision > kMaxResumeCommits)
        return welcome(session,
                       Error{ErrorCode::StaleBase, at + " is too far back to resume from"});
    const auto hash = resume.revision < oldest_ ? std::nullopt : knownHash(resume.revision);
    if (!hash && resume.revision <= oldest_)
        return welcome(session,
                       Error{ErrorCode::StaleBase, at +
                                                       " is too far back to resume from: the "
                                                       "history begins at " +
                                                       std::to_string(oldest_)});
    if (hash)
        resumeChecked(session, *hash);
    else
        requestRead(session, {ReadPurpose::ResumeCheck, resume.revision, resume.revision});
}

void Project::Impl::resumeChecked(Session& session, const Result<Hash>& hash) {
    const auto* checking = std::get_if<CheckingResume>(&session.phase);
    if (!checking) return;
    // That the store cannot say it now does not make its history another one.
    if (!hash && hash.error().code == ErrorCode::StorageFailed) return close(session, hash.error());
    if (!hash) return welcome(session, hash.error());
    const auto& resume = *checking->hello.resume;
    if (*hash == resume.hash) return welcome(session, std::nullopt);
    welcome(session, Error{ErrorCode::HistoryDiverged,
                           "at revision " + std::to_string(resume.revision) +
                               " the client's history is another than the server's"});
}

void Project::Impl::welcome(Session& session, std::optional<Error> whyNotResumed) {
    const CheckingResume checked = std::move(std::get<CheckingResume>(session.phase));
    const auto& [hello, waiting, waitingBytes] = checked;
    const bool resumed = hello.resume && !whyNotResumed;
    session.phase = Greeted{};
    session.greeted = true;
    session.greetedAt = durable_;
    session.position = resumed ? hello.resume->revision : durable_;
    session.stream = CatchingUp{};
    if (resumed && hello.open)
        for (const LayerId& layer : *hello.open)
            if (layers_.contains(layer) && session.open.insert(layer).second)
                suspects_.insert(layer);
    if (whyNotResumed) sendError(session, *whyNotResumed);

    Welcome message;
    message.protocol = commonProtocol(hello);
    message.features = common(hello.features);
    message.project = options_.name;
    message.epoch = epoch_;
    message.revision = durable_;
    message.hash = durableHash_;
    message.resumed = resumed;
    message.layers = layerInfos();
    message.maxFrameBytes = options_.maxFrameBytes;
    message.maxBlobBytes = options_.maxBlobBytes;
    message.administrator = session.subject.isAdministrator;
    message.base = oldest_;
    if (session.features.contains(kPartsFeature))
        message.maxTransactionBytes = options_.maxTransactionBytes;
    send(session, message);
    ports_.activity.happened({"user joined", session.subject.user, {}, session.application});
    tellStatesTo(session);
    tellPresencesTo(session);

    pump(session);
    for (const Bytes& frame : waiting) receiveFrame(session, frame);
}

void Project::Impl::send(Session& session, const ControlMessage& message) {
    ports_.outbox.send(session.id, std::make_shared<const Bytes>(
                                       encodeFrame(ControlFrame{encodeControl(message)})));
}

/// To those that asked for the feature.
void Project::Impl::tellAll(const std::string& feature, const News& news) {
    std::vector<SessionId> listening;
    for (const auto& [id, session] : sessions_)
        if (session.isGreeted() && session.features.contains(feature)) listening.push_back(id);
    ports_.outbox.tell(listening, news);
}

void Project::Impl::sendError(Session& session, const Error& error,
                              std::optional<std::uint64_t> request, std::optional<Hash> blob) {
    send(session,
         ErrorMessage{std::string(errorName(error.code)), error.message, false, request, blob});
}

void Project::Impl::close(Session& session, const Error& error) {
    send(session, ErrorMessage{std::string(errorName(error.code)), error.message, true, {}, {}});
    ports_.outbox.close(session.id);
    session.phase = Closing{};
    session.transactions.clear();
    session.answers.clear();
    forgetComing(session);
    session.sending.reset();
}

void Project::Impl::disconnected(SessionId id) {
    const auto found = sessions_.find(id);
    if (found == sessions_.end()) return;
    forgetComing(found->second);
    const ClientId client = found->second.client;
    const bool wasShown = found->second.presence.has_value();
    const std::set<LayerId> open = std::move(found->second.open);
    suspects_.insert(open.begin(), open.end());
    if (!found->second.subject.user.empty())
        access_.left(found->second.subject.user, wallClockMs());
    if (found->second.greeted)
        ports_.activity.happened(
            {"user left", found->second.subject.user, {}, found->second.application});
    sessions_.erase(found);
    for (const LayerId& layer : open) noteIdle(layer);
    if (wasShown) presenceLeft(client);
    if (client.empty() || isConnected(client)) return;
    withdrawAll(client);
    forgetAuthor(client);
}

bool Project::Impl::isHere(const UserName& user) const {
    return std::ranges::any_of(sessions_, [&](const auto& one) {
        return one.second.isGreeted() && one.second.subject.user == user;
    });
}

std::set<ClientId> Project::Impl::activeClients() const {
    std::set<ClientId> clients;
    for (const auto& [id, session] : sessions_) clients.insert(session.client);
    for (const auto& [client, author] : authors_) clients.insert(client);
    return clients;
}

bool Project::Impl::isConnected(const ClientId& client) const {
    return std::any_of(sessions_.begin(), sessions_.end(),
                       [&client](const auto& entry) { return entry.second.client == client; });
}

// What is known of an author beyond its durable commits is nothing once none are under way: the
// rest is looked up in the store when it comes back (see creationsKnown()).
void Project::Impl::forgetAuthor(const ClientId& client) {
    const auto author = authors_.find(client);
    if (author != authors_.end() && author->second.inFlight.empty() && !isConnected(client))
        authors_.erase(author);
}

}  // namespace usdlive::server
