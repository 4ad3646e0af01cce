// Keeps and reports the unsent edits of a client.
#include "work/UnsentWorkReports.h"

#include <utility>

namespace usdlive::client {

UnsentWorkReports::UnsentWorkReports(std::filesystem::path stateFolder, Session::Options options,
                                     BlobCache& blobs, EditorEvents& events)
    : stateFolder_(std::move(stateFolder)),
      options_(std::move(options)),
      blobs_(blobs),
      events_(events) {}

void UnsentWorkReports::start(UnsentWorkStore::Connector connector, const Welcome& welcome) {
    connector_ = std::move(connector);
    open(welcome);
}

void UnsentWorkReports::welcomed(const Welcome& welcome) {
    const StoreId project = welcome.store.value_or(project_);
    if (isOtherStore(std::exchange(project_, project), project) && store_) open(welcome);
}

void UnsentWorkReports::open(const Welcome& welcome) {
    store_.reset();  // one journal of a client is open at a time
    store_.emplace(stateFolder_.empty()
                       ? std::filesystem::path()
                       : journalFolder(stateFolder_, welcome.project, options_.user),
                   project_, connector_, options_, blobs_);
    if (auto found = left(); !found.empty()) events_.push(event::UnsentFound{std::move(found)});
}

void UnsentWorkReports::reportErrors() {
    if (!store_) return;
    if (auto error = store_->takeError()) events_.report(std::move(*error));
}

std::optional<UnsentWork> UnsentWorkReports::keep(const Session& session) {
    if (store_)
        if (auto kept = store_->keep()) return kept;
    if (session.pendingTransactions() == 0) return std::nullopt;
    UnsentWork work;
    work.client = session.id();
    work.transactions = session.pendingTransactions();
    return work;
}

std::vector<UnsentWork> UnsentWorkReports::left() {
    std::vector<Error> damaged;
    auto found = store_->left(damaged);
    for (Error& error : damaged) events_.report(std::move(error));
    return found;
}

Result<SentWork> UnsentWorkReports::send(const ClientId& work, double timeoutMs,
                                         LostWorkReports& lost) {
    std::vector<LostWork> pieces;
    auto sent = store_->send(work, timeoutMs, pieces);
    for (LostWork& one : pieces) lost.add(std::move(one));
    return sent;
}

std::filesystem::path folderOfState(const std::filesystem::path& chosen,
                                    const std::filesystem::path& cacheFolder) {
    if (!chosen.empty()) return chosen;
    return cacheFolder.empty() ? stateFolder() : cacheFolder / ".usdlive-unsent";
}

}  // namespace usdlive::client
