// Checks hello messages and sends welcomes.
#include "project/clients/Greeting.h"

#include <algorithm>
#include <cctype>
#include <utility>

#include "usdlive/common/core/ClientSecret.h"

namespace usdlive::server {

namespace {

// A client that lacks more commits than this cannot resume: it is sent snapshots, which is faster.
constexpr Revision kMaxResumeCommits = 50'000;

bool isClientId(const std::string& text) {
    return !text.empty() && text.size() <= 64 &&
           std::all_of(text.begin(), text.end(), [](unsigned char character) {
               return std::isalnum(character) || character == '-' || character == '_';
           });
}

int commonProtocol(const Hello& hello) {
    const int newest = std::min(hello.protocol, kProtocolVersion);
    return newest >= std::max(hello.oldestProtocol, kOldestProtocolVersion) ? newest : 0;
}

/// The client knows the answers to all transactions that it sent before this revision (M14).
Revision unansweredSince(const Hello::Resume& resume) {
    return resume.unansweredSince.value_or(resume.revision);
}

Error staleBase(std::string message) { return {ErrorCode::StaleBase, std::move(message)}; }

}  // namespace

Greeting::Greeting(const Project::Options& options, const Parts& parts)
    : options_(options),
      identity_(parts.identity),
      line_(parts.line),
      start_(parts.start),
      store_(parts.store),
      sessions_(parts.sessions),
      authors_(parts.authors),
      layers_(parts.layers),
      layerLists_(parts.layerLists),
      states_(parts.states),
      presences_(parts.presences),
      reads_(parts.reads),
      catchup_(parts.catchup),
      gestures_(parts.gestures),
      access_(parts.access),
      outbox_(parts.outbox),
      activity_(parts.activity),
      receiver_(parts.receiver) {}

void Greeting::greet(Session& session, const Hello& hello) {
    if (commonProtocol(hello) == 0)
        return sessions_->close(
            session,
            {ErrorCode::UnsupportedProtocol,
             "the server speaks versions " + std::to_string(kOldestProtocolVersion) + " to " +
                 std::to_string(kProtocolVersion) + ", the client " +
                 std::to_string(hello.oldestProtocol) + " to " + std::to_string(hello.protocol)});
    if (!isClientId(hello.client.value))
        return sessions_->close(session, {ErrorCode::MalformedControl,
                                          "a client's id is 1 to 64 letters, digits, '-' or '_'"});
    if (needsSecret(hello.client) &&
        (!hello.secret || clientIdOf(*hello.secret) != hello.client))  // ID5
        return sessions_->close(session,
                                {ErrorCode::InvalidArgument,
                                 "the client id " + hello.client.value +
                                     " belongs to whoever has its secret, which was not sent"});
    if (session.subject.proof) {
        auto subject = access_->subject(*session.subject.proof, hello.user);
        if (!subject) return sessions_->close(session, subject.error());
        session.subject = std::move(*subject);
    } else {
        session.subject = access_->subject(hello.user);
    }
    if (const auto refused = whyNotAs(session, hello.client))
        return sessions_->close(session, *refused);
    supersede(hello.client);
    if (sessions_->clients() >= options_->maxSessions)
        return sessions_->close(
            session, {ErrorCode::TooManySessions, "the project has " +
                                                      std::to_string(options_->maxSessions) +
                                                      " sessions, which is the limit"});
    session.client = hello.client;
    session.application = hello.application;
    for (std::string& feature : features(session.id, hello))
        session.features.insert(std::move(feature));
    Hello proved = hello;
    proved.secret.reset();
    session.phase = CheckingResume{std::move(proved), {}, 0};
    authors_->read(session.client);
    if (hello.resume)
        checkResume(session);
    else
        welcome(session, std::nullopt);
}

/// Returns the features that both ends have, and that the transport of the session can carry.
std::vector<std::string> Greeting::features(SessionId session, const Hello& hello) const {
    std::vector<std::string> both;
    for (const std::string& feature : protocolFeatures())
        if (std::ranges::count(hello.features, feature) > 0 &&
            (feature != kCompactFeature || !outbox_->isMulticast(session)))
            both.push_back(feature);
    return both;
}

/// Closes the client's earlier connection. It may still deliver messages, which would be executed
/// although the client has sent them again on the new connection, or has counted them as refused.
std::optional<Error> Greeting::whyNotAs(const Session& session, const ClientId& client) const {
    if (!session.subject.proof) return std::nullopt;
    const UserName& user = session.subject.user;
    std::size_t others = 0;
    for (const auto& [id, other] : sessions_->all()) {
        if (other.client.value.empty() || other.isClosing()) continue;
        const bool isOfUser = other.subject.user == user;
        if (other.client == client && !isOfUser)
            return Error{ErrorCode::InvalidArgument,
                         "the client id " + client.value + " is that of a session of another user"};
        if (other.client != client && isOfUser) ++others;
    }
    if (others < options_->maxUserSessions) return std::nullopt;
    return Error{ErrorCode::TooManySessions,
                 user.value + " has " + std::to_string(others) +
                     " sessions, which is the limit for one user (--max-user-sessions)"};
}

void Greeting::supersede(const ClientId& client) {
    bool superseded = false;
    for (auto& [id, other] : sessions_->all()) {
        if (other.client != client || other.isClosing()) continue;
        superseded = true;
        sessions_->end(other);
    }
    // The client sends the previews of open gestures again. Previews of ended gestures must
    // disappear.
    if (superseded) gestures_->withdrawAll(client);
}

bool Greeting::hold(Session& session, ByteView frame) {
    auto* checking = std::get_if<CheckingResume>(&session.phase);
    if (!checking) return false;
    checking->waitingBytes += frame.size();
    if (checking->waitingBytes > options_->maxFrameBytes)
        sessions_->close(session, {ErrorCode::NotGreeted, "too much was sent before the welcome"});
    else
        checking->waiting.emplace_back(frame.begin(), frame.end());
    return true;
}

// ---- resuming

void Greeting::checkResume(Session& session) {
    const auto& resume = *std::get<CheckingResume>(session.phase).hello.resume;
    const bool isKnown = authors_->of(session.client).committed.has_value();
    if (!isKnown && !store_->closed) return;  // called again when it is known
    if (auto why = otherHistory(resume)) return welcome(session, std::move(why));
    if (!isKnown && unansweredSince(resume) < authors_->forgottenUpTo())
        return sessions_->close(session, {ErrorCode::StorageFailed, "the store has failed"});
    const auto hash =
        start_->whyNotReadable(resume.revision) ? std::nullopt : catchup_->hashAt(resume.revision);
    if (hash) return resumeChecked(session, *hash);
    // Also the commit that is about to become the base.
    if (resume.revision >= start_->oldest())
        return reads_->request(session.id,
                               {ReadPurpose::ResumeCheck, resume.revision, resume.revision});
    auto why = whyNotResumable(session, resume);
    if (!why)
        why = staleBase("revision " + std::to_string(resume.revision) +
                        " is too old to resume from: the history begins at " +
                        std::to_string(start_->oldest()));
    welcome(session, std::move(why));
}

/// ID2: returns how the client's history differs from that of the server, as far as it can be known
/// without reading commits.
std::optional<Error> Greeting::otherHistory(const Hello::Resume& resume) const {
    const auto diverged = [](std::string message) {
        return Error{ErrorCode::HistoryDiverged, std::move(message)};
    };
    if (resume.store && isOtherStore(*resume.store, *identity_))
        return diverged("the client has the history of another project");
    if (resume.epoch > line_->epoch())
        return diverged("the client has seen epoch " + std::to_string(resume.epoch) +
                        ", this server has " + std::to_string(line_->epoch()));
    if (resume.revision > line_->durable())
        return Error{ErrorCode::FutureRevision,
                     "the client is at revision " + std::to_string(resume.revision) +
                         ", the server at " + std::to_string(line_->durable())};
    return std::nullopt;
}

/// Returns why a client with the same history has to open its layers again.
std::optional<Error> Greeting::whyNotResumable(const Session& session,
                                               const Hello::Resume& resume) const {
    if (auto forgotten = whyForgotten(session, resume)) return forgotten;
    const std::string at = "revision " + std::to_string(resume.revision);
    if (line_->durable() - resume.revision > kMaxResumeCommits)
        return staleBase(at + " is too old to resume from");
    return std::nullopt;
}

std::optional<Error> Greeting::whyForgotten(const Session& session,
                                            const Hello::Resume& resume) const {
    const auto& known = authors_->of(session.client).committed;
    if (!known || !known->mayLack(unansweredSince(resume))) return std::nullopt;
    return Error{ErrorCode::ClientForgotten,
                 "this client was away since revision " + std::to_string(unansweredSince(resume)) +
                     ", and the server no longer knows its transactions"};
}

void Greeting::resumeRead(SessionId id, const Result<std::vector<StoredCommit>>& commits) {
    Session* session = sessions_->find(id);
    const auto* checking = session ? std::get_if<CheckingResume>(&session->phase) : nullptr;
    if (!checking) return;
    auto hash = commits.map([](const auto& found) { return found.front().hash; });
    // The commit may have become the base meanwhile.
    if (!hash)
        if (const auto known = catchup_->hashAt(checking->hello.resume->revision)) hash = *known;
    resumeChecked(*session, hash);
}

void Greeting::resumeChecked(Session& session, const Result<Hash>& hash) {
    const auto* checking = std::get_if<CheckingResume>(&session.phase);
    if (!checking) return;
    // These do not mean that the histories differ. The client connects again; if the commit was
    // being replaced, the base has its hash then.
    if (!hash && (hash.error().code == ErrorCode::StorageFailed ||
                  hash.error().code == ErrorCode::HistoryReplaced))
        return sessions_->close(session, hash.error());
    if (!hash) return welcome(session, hash.error());
    const auto& resume = *checking->hello.resume;
    if (*hash == resume.hash) return welcome(session, whyNotResumable(session, resume));
    welcome(session, Error{ErrorCode::HistoryDiverged,
                           "at revision " + std::to_string(resume.revision) +
                               " the client has another history than the server"});
}

Revision Greeting::oldestNeeded(Revision newest) const {
    for (const auto& [id, session] : sessions_->all())
        if (const auto* checking = std::get_if<CheckingResume>(&session.phase))
            if (checking->hello.resume) newest = std::min(newest, checking->hello.resume->revision);
    return newest;
}

// ---- the welcome

void Greeting::welcome(Session& session, std::optional<Error> whyNotResumed) {
    const CheckingResume checked = std::move(std::get<CheckingResume>(session.phase));
    const Hello& hello = checked.hello;
    const bool resumed = hello.resume && !whyNotResumed;
    session.phase = Greeted{};
    session.wasGreeted = true;
    if (resumed && hello.open) keepOpen(session, *hello.open);
    if (whyNotResumed) {
        sessions_->sendError(session, *whyNotResumed);
        // The client may join the other history.
        const auto forgotten = hello.resume ? whyForgotten(session, *hello.resume) : std::nullopt;
        if (forgotten && forgotten->code != whyNotResumed->code)
            sessions_->sendError(session, *forgotten);
    }
    layerLists_->sendAllTo(session);
    sendWelcome(session, hello, resumed);
    activity_->record({"user joined", session.subject.user, {}, session.application});
    states_->sendAllTo(session);
    presences_->sendAllTo(session);
    const SessionId id = session.id;
    catchup_->begin(session, resumed ? hello.resume->revision : line_->durable());
    for (const Bytes& frame : checked.waiting) receiver_->receiveFrame(id, frame);
}

void Greeting::keepOpen(Session& session, const std::vector<LayerId>& layers) {
    for (const LayerId& layer : layers)
        if (layers_->has(layer) && !sessions_->whyNotOpen(session, layer))
            sessions_->open(session, layer);
}

void Greeting::sendWelcome(const Session& session, const Hello& hello, bool resumed) {
    Welcome message;
    message.protocol = commonProtocol(hello);
    message.features = features(session.id, hello);
    message.project = options_->name;
    message.epoch = line_->epoch();
    message.revision = line_->durable();
    message.hash = line_->durableHash();
    message.resumed = resumed;
    if (!session.features.contains(kLayerListFeature)) message.layers = layers_->infos();
    message.maxFrameBytes = options_->maxFrameBytes;
    message.maxBlobBytes = options_->maxBlobBytes;
    message.administrator = session.subject.isAdministrator();
    message.role = std::string(nameOf(session.subject.role));
    if (session.features.contains(kAccessFeature)) message.rules = access_->rulesOf(session);
    message.base = start_->oldest();
    message.store = *identity_;
    message.maxTransactionBytes = options_->maxTransactionBytes;
    sessions_->send(session, message);
}

}  // namespace usdlive::server
