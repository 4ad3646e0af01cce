// The facade for editors: checks the calling thread and forwards each call to the part that
// executes it.
#include "usdlive/client/usd/Client.h"

#include <utility>

#include "basics/SystemUser.h"
#include "link/Destination.h"
#include "session/OwnRights.h"
#include "session/Permissions.h"
#include "session/RootEdits.h"
#include "transport/Connection.h"
#include "usd/assets/DynamicPayloads.h"
#include "usd/editor/ClientImpl.h"
#include "usdlive/common/core/ClientSecret.h"
#include "usdlive/common/core/Thread.h"
#include "usdlive/common/protocol/Role.h"

namespace usdlive {

namespace fs = std::filesystem;
using client::ClientInternals;
using client::LoadSet;

Client::Client() = default;
Client::~Client() {
    // After fork(), the threads that the destructor would wait for are not there, and the socket
    // and the journal belong to the other process.
    if (impl_ && impl_->thread().isForked()) static_cast<void>(impl_.release());
}

// --- connecting

Result<std::unique_ptr<Client>> Client::connect(const std::string& url, Options options) {
    auto destination = client::destinationOf(url, options.user, options.token);
    if (!destination) return tl::unexpected(destination.error());
    options.user = std::move(destination->user.value);
    return ClientInternals::connectBy(
        [address = std::move(destination->address)] { return client::createConnection(address); },
        std::move(options));
}

Result<std::unique_ptr<Client>> ClientInternals::connectBy(std::unique_ptr<Connection> connection,
                                                           Client::Options options) {
    return make(std::move(connection), {}, std::move(options));
}

Result<std::unique_ptr<Client>> ClientInternals::connectBy(Connector connector,
                                                           Client::Options options) {
    auto connection = connector();
    if (!connection) return tl::unexpected(connection.error());
    options.stateFolder = folderOfState(options.stateFolder, options.cacheFolder);
    return make(std::move(*connection), std::move(connector), std::move(options));
}

Result<std::unique_ptr<Client>> ClientInternals::make(std::unique_ptr<Connection> connection,
                                                      Connector connector,
                                                      Client::Options options) try {
    if (options.user.empty()) options.user = systemUser().value;
    if (auto checked = checkNames(UserName{options.user}, options.application); !checked)
        return tl::unexpected(checked.error());
    auto folders = ClientFolders::create(options.cacheFolder);
    if (!folders) return tl::unexpected(folders.error());
    std::unique_ptr<Client> made(new Client);
    made->impl_ = std::make_unique<Client::Impl>(std::move(connection), std::move(options),
                                                 newClientSecret(), std::move(*folders));
    if (auto greeted = made->impl_->greet(); !greeted) return tl::unexpected(greeted.error());
    if (made->impl_->options().addresses) made->impl_->useAddresses();
    made->impl_->unsent().start(std::move(connector), *made->impl_->session().welcome());
    return made;
} catch (const ThreadRefused& refused) {
    return fail(ErrorCode::NotConnected, std::string("cannot connect: ") + refused.what());
}

// --- checks of the caller

std::optional<Error> Client::misuse(const std::string& function, bool blocks) const {
    return impl_->misuse(function, blocks);
}

Client::Impl& Client::here(const char* function) const {
    impl_->require(function);
    return *impl_;
}

// --- layers

std::optional<Error> Client::filesProblem() const {
    return impl_->files().problem();  // set by connect()
}

std::vector<LayerId> Client::layers() const {
    const std::set<LayerId>& all = here("layers").layers().ofProject();
    return {all.begin(), all.end()};
}

Result<pxr::SdfLayerRefPtr> Client::openLayer(const LayerId& layer, LoadSet load) {
    if (auto error = misuse("openLayer", true)) return tl::unexpected(*error);
    return impl_->openLayer(layer, load);
}

std::uint64_t Client::requestOpenLayer(const LayerId& layer, LoadSet load) {
    return here("requestOpenLayer").opens().add(layer, load, client::OpenRequests::Reports::Event);
}

Result<pxr::SdfLayerRefPtr> Client::createLayer(const LayerId& layer) {
    if (auto error = misuse("createLayer", true)) return tl::unexpected(*error);
    return impl_->createLayer(layer);
}

Result<void> Client::upload(const fs::path& file, const std::string& path, bool overwrite) {
    if (auto error = misuse("upload", true)) return tl::unexpected(*error);
    return impl_->upload(file, path, overwrite);
}

std::uint64_t Client::requestUpload(const fs::path& file, const std::string& path, bool overwrite) {
    return here("requestUpload").uploads().add(file, path, overwrite);
}

Result<std::vector<LayerId>> Client::attach(const fs::path& projectFolder) {
    if (auto error = misuse("attach", true)) return tl::unexpected(*error);
    return impl_->attach(projectFolder);
}

Result<void> Client::close(const LayerId& layer) { return here("close").close(layer); }

pxr::SdfLayerRefPtr Client::layer(const LayerId& layer) const { return here("layer").layer(layer); }

std::optional<LayerId> Client::layerId(const pxr::SdfLayerHandle& layer) const {
    return here("layerId").layers().idOf(layer);
}

std::string Client::identifierOf(const LayerId& layer, const pxr::SdfLayerHandle& beside) const {
    const auto& places = here("identifierOf").places();
    return beside ? places.identifierBeside(beside, layer) : places.identifierOf(layer);
}

// --- the past

Result<std::string> Client::addressAt(const LayerId& layer, Revision revision) {
    if (auto error = misuse("addressAt", true)) return tl::unexpected(*error);
    return impl_->addressAt(layer, revision);
}

Result<client::LogPage> Client::readLog(const client::LogQuery& query) {
    if (auto error = misuse("readLog", true)) return tl::unexpected(*error);
    return impl_->history().log(query);
}

Result<client::BlameResult> Client::blame(const LayerId& layer, const std::string& path,
                                          bool below) {
    if (auto error = misuse("blame", true)) return tl::unexpected(*error);
    return impl_->history().blame(layer, path, below);
}

// --- the frame

Client::TickResult Client::tick(double budgetMs) { return here("tick").tick(budgetMs); }
void Client::withoutWaiting(const std::function<void()>& compose) {
    const client::PlainFiles::Tick neverWaits(here("withoutWaiting").files());
    const client::DynamicPayloadTick neverAsks;
    compose();
}
void Client::beginGesture() { here("beginGesture").setGesture(true); }
void Client::endGesture() { here("endGesture").setGesture(false); }

Result<client::UndoResult> Client::undo() {
    if (auto error = misuse("undo", true)) return tl::unexpected(*error);
    return impl_->takeBack(&client::Session::undo);
}
Result<client::UndoResult> Client::redo() {
    if (auto error = misuse("redo", true)) return tl::unexpected(*error);
    return impl_->takeBack(&client::Session::redo);
}
client::UndoLabels Client::undoStack() const { return here("undoStack").session().undoLabels(); }
void Client::beginUndoGroup(const std::string& label) {
    here("beginUndoGroup").setUndoGroup(&label);
}
void Client::endUndoGroup() { here("endUndoGroup").setUndoGroup(nullptr); }
Client::UndoGroup::UndoGroup(Client& client, const std::string& label) : client_(client) {
    client_.here("undoGroup").setUndoGroup(&label);
}
Client::UndoGroup::~UndoGroup() {
    // On another thread the group stays open: a destructor reports nothing.
    if (!client_.misuse("endUndoGroup", false)) client_.endUndoGroup();
}

bool Client::flush(double timeoutMs) { return here("flush").flush(timeoutMs); }
bool Client::isApplying() const { return here("isApplying").isApplying(); }

std::size_t Client::pendingTransactions() const {
    return here("pendingTransactions").pendingTransactions();
}

void Client::setEventHandler(EventHandler handler) {
    if (const auto error = impl_->thread().check("setEventHandler")) throw Misuse(*error);
    impl_->events().setHandler(std::move(handler));
}

// --- locks, mutes and people

Result<void> Client::setLocked(const LayerId& layer, bool locked,
                               const std::function<void()>& alongside) {
    if (auto error = misuse("setLocked", true)) return tl::unexpected(*error);
    return impl_->locks().setLocked(layer, locked, alongside);
}

Result<void> Client::setGloballyMuted(const LayerId& root, const LayerId& layer, bool muted) {
    if (auto error = misuse("setGloballyMuted", true)) return tl::unexpected(*error);
    return impl_->locks().setGloballyMuted(root, layer, muted);
}

std::set<LayerId> Client::globallyMuted(const LayerId& root) const {
    return client::globallyMuted(here("globallyMuted").session(), root);
}

const std::map<LayerId, LayerState>& Client::layerStates() const {
    return here("layerStates").session().layerStates();
}

Result<void> Client::showPresence(Presence presence) {
    if (auto error = misuse("showPresence", false)) return tl::unexpected(*error);
    return impl_->session().showPresence(std::move(presence));
}

void Client::hidePresence() { here("hidePresence").session().hidePresence(); }

const std::map<ClientId, Presence>& Client::presences() const {
    return here("presences").session().presences();
}

// --- files and checkpoints

std::uint64_t Client::request(AnyRequest request) {
    return here("request").session().request(std::move(request));
}

Result<client::Event> Client::waitFor(std::uint64_t request, double timeoutMs) {
    if (const auto error = misuse("waitFor", true)) return tl::unexpected(*error);
    if (auto answer = impl_->answerTo(request, timeoutMs)) return *std::move(answer);
    return fail(ErrorCode::NotConnected, "the server did not answer within " +
                                             std::to_string(std::int64_t(timeoutMs)) + " ms");
}

std::uint64_t Client::save(std::vector<LayerId> layers, bool force) {
    return here("save").save(std::move(layers), force);
}

Result<LayersSaved> Client::saveAndWait(std::vector<LayerId> layers, bool force, double timeoutMs) {
    if (auto error = misuse("saveAndWait", true)) return tl::unexpected(*error);
    return impl_->saveAndWait(std::move(layers), force, timeoutMs);
}

std::uint64_t Client::reload(std::vector<LayerId> layers) {
    return here("reload").session().request(ReloadLayers{.layers = std::move(layers)});
}

std::uint64_t Client::createCheckpoint(std::string name) {
    return here("createCheckpoint").session().request(CreateCheckpoint{.name = std::move(name)});
}

std::uint64_t Client::listCheckpoints() {
    return here("listCheckpoints").session().request(ListCheckpoints{});
}

std::uint64_t Client::listSkipped() { return here("listSkipped").session().request(ListSkipped{}); }

// --- lost and unsent edits

std::uint64_t Client::lostWorkCount() const { return here("lostWorkCount").lost().count(); }

Result<client::LostWork> Client::lostWork(std::uint64_t index) const {
    if (auto error = misuse("lostWork", false)) return tl::unexpected(*error);
    return impl_->lost().at(index);
}

Result<pxr::SdfLayerRefPtr> Client::lostWorkAsLayer(std::uint64_t index,
                                                    const LayerId& layer) const {
    if (auto error = misuse("lostWorkAsLayer", false)) return tl::unexpected(*error);
    return impl_->lostWorkAsLayer(index, layer);
}

const std::optional<client::OtherHistory>& Client::otherHistory() const {
    return here("otherHistory").session().otherHistory();
}

Result<void> Client::joinOtherHistory() {
    if (auto error = misuse("joinOtherHistory", false)) return tl::unexpected(*error);
    return impl_->session().joinOtherHistory();
}

std::vector<client::UnsentWork> Client::unsentWork() { return here("unsentWork").unsent().left(); }

Result<client::SentWork> Client::sendUnsent(const ClientId& work, double timeoutMs) {
    if (auto error = misuse("sendUnsent", true)) return tl::unexpected(*error);
    return impl_->unsent().send(work, timeoutMs, impl_->lost());
}

Result<pxr::SdfLayerRefPtr> Client::unsentAsLayer(const ClientId& work, const LayerId& layer) {
    if (auto error = misuse("unsentAsLayer", false)) return tl::unexpected(*error);
    return impl_->unsentAsLayer(work, layer);
}

Result<void> Client::discardUnsent(const ClientId& work) {
    if (auto error = misuse("discardUnsent", false)) return tl::unexpected(*error);
    return impl_->unsent().discard(work);
}

std::optional<client::UnsentWork> Client::leave(double timeoutMs) {
    return here("leave").leave(timeoutMs);
}

// --- state

bool Client::isConnected() const { return here("isConnected").session().isConnected(); }
Revision Client::revision() const { return here("revision").session().revision(); }
ClientId Client::id() const { return here("id").session().id(); }
const std::string& Client::user() const { return here("user").options().user; }
bool Client::isAdministrator() const {
    const auto& welcome = here("isAdministrator").session().welcome();
    return welcome && welcome->administrator.value_or(false);
}
std::string Client::role() const {
    const client::Session& session = here("role").session();
    return session.welcome() ? std::string(nameOf(session.rights().role())) : "";
}
Result<Client::Permission> Client::mayEdit(const LayerId& layer, const std::string& path,
                                           std::string_view kind) const {
    if (auto error = misuse("mayEdit", false)) return tl::unexpected(*error);
    return client::mayEdit(impl_->session(), layer, path, kind);
}
Result<Client::Permission> Client::mayDo(std::string_view action, const LayerId& place) const {
    if (auto error = misuse("mayDo", false)) return tl::unexpected(*error);
    return client::mayDo(impl_->session(), action, place);
}
fs::path Client::cacheFolder() const { return here("cacheFolder").cache().folder(); }

}  // namespace usdlive
