// Checks hello messages and sends welcomes.
#include "clients/Greeting.h"

#include <algorithm>
#include <cctype>
#include <utility>

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

Error staleBase(std::string message) { return {ErrorCode::StaleBase, std::move(message)}; }

}  // namespace

Greeting::Greeting(const Project::Options& options, const Parts& parts)
    : options_(options),
      line_(parts.line),
      start_(parts.start),
      store_(parts.store),
      sessions_(parts.sessions),
      authors_(parts.authors),
      layers_(parts.layers),
      states_(parts.states),
      presences_(parts.presences),
      reads_(parts.reads),
      catchup_(parts.catchup),
      gestures_(parts.gestures),
      access_(parts.access),
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
    supersede(hello.client);
    session.client = hello.client;
    session.subject = access_->subject(hello.user);
    session.application = hello.application;
    for (std::string& feature : common(hello.features)) session.features.insert(std::move(feature));
    session.phase = CheckingResume{hello, {}, 0};
    authors_->read(session.client);
    if (hello.resume)
        checkResume(session);
    else
        welcome(session, std::nullopt);
}

/// Closes the client's earlier connection. It may still deliver messages, which would be executed
/// although the client has sent them again on the new connection, or has counted them as refused.
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
    if (!isKnown && resume.revision < authors_->forgottenUpTo())
        return sessions_->close(session, {ErrorCode::StorageFailed, "the store has failed"});
    if (auto why = whyNotResumable(session, resume)) return welcome(session, std::move(why));
    const auto hash =
        start_->whyNotReadable(resume.revision) ? std::nullopt : catchup_->hashAt(resume.revision);
    if (!hash && resume.revision <= start_->oldest())
        return welcome(session, staleBase("revision " + std::to_string(resume.revision) +
                                          " is too old to resume from: the history begins "
                                          "at " +
                                          std::to_string(start_->oldest())));
    if (hash)
        resumeChecked(session, *hash);
    else
        reads_->request(session.id, {ReadPurpose::ResumeCheck, resume.revision, resume.revision});
}

std::optional<Error> Greeting::whyNotResumable(const Session& session,
                                               const Hello::Resume& resume) const {
    const std::string at = "revision " + std::to_string(resume.revision);
    const Revision newest = line_->durable();
    const auto& known = authors_->of(session.client).committed;
    if (known && known->mayLack(resume.revision))
        return Error{ErrorCode::ClientForgotten,
                     "this client was away since " + at +
                         ", and the server no longer knows its transactions"};
    if (resume.epoch > line_->epoch())
        return Error{ErrorCode::HistoryDiverged,
                     "the client has seen epoch " + std::to_string(resume.epoch) +
                         ", this server has " + std::to_string(line_->epoch())};
    if (resume.revision > newest)
        return Error{ErrorCode::FutureRevision,
                     "the client is at " + at + ", the server at " + std::to_string(newest)};
    const Revision inParts = catchup_->newestInParts();
    if (resume.revision < inParts && !session.features.contains(kPartsFeature))
        return staleBase("commit " + std::to_string(inParts) +
                         " is sent in parts, which the client cannot read");
    if (newest - resume.revision > kMaxResumeCommits)
        return staleBase(at + " is too old to resume from");
    return std::nullopt;
}

void Greeting::resumeRead(SessionId id, const Result<std::vector<StoredCommit>>& commits) {
    if (Session* session = sessions_->find(id))
        resumeChecked(*session, commits.map([](const auto& found) { return found.front().hash; }));
}

void Greeting::resumeChecked(Session& session, const Result<Hash>& hash) {
    const auto* checking = std::get_if<CheckingResume>(&session.phase);
    if (!checking) return;
    // A failure of the store does not mean that the histories differ.
    if (!hash && hash.error().code == ErrorCode::StorageFailed)
        return sessions_->close(session, hash.error());
    if (!hash) return welcome(session, hash.error());
    const auto& resume = *checking->hello.resume;
    if (*hash == resume.hash) return welcome(session, std::nullopt);
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
    if (resumed && hello.open)
        for (const LayerId& layer : *hello.open)
            if (layers_->has(layer)) sessions_->open(session, layer);
    if (whyNotResumed) sessions_->sendError(session, *whyNotResumed);
    sendWelcome(session, hello, resumed);
    activity_->record({"user joined", session.subject.user, {}, session.application});
    states_->sendAllTo(session);
    presences_->sendAllTo(session);
    const SessionId id = session.id;
    catchup_->begin(session, resumed ? hello.resume->revision : line_->durable());
    for (const Bytes& frame : checked.waiting) receiver_->receiveFrame(id, frame);
}

void Greeting::sendWelcome(const Session& session, const Hello& hello, bool resumed) {
    Welcome message;
    message.protocol = commonProtocol(hello);
    message.features = common(hello.features);
    message.project = options_->name;
    message.epoch = line_->epoch();
    message.revision = line_->durable();
    message.hash = line_->durableHash();
    message.resumed = resumed;
    message.layers = layers_->infos();
    message.maxFrameBytes = options_->maxFrameBytes;
    message.maxBlobBytes = options_->maxBlobBytes;
    message.administrator = session.subject.isAdministrator;
    message.base = start_->oldest();
    if (session.features.contains(kPartsFeature))
        message.maxTransactionBytes = options_->maxTransactionBytes;
    sessions_->send(session, message);
}

}  // namespace usdlive::server
