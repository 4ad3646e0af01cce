// Keeps, lists and sends the unsent transactions of a user.
#include "work/UnsentWorkStore.h"

namespace usdlive::client {

namespace {

// Reads big values from a journal's folder or from the client's cache.
class LeftBlobs final : public BlobSource {
public:
    LeftBlobs(LeftJournal journal, BlobSource& cache)
        : journal_(std::move(journal)), kept_(journal_.blobFolder()), cache_(cache) {}
    SharedBytes blob(const Hash& hash) override {
        auto bytes = kept_.blob(hash);
        return bytes ? bytes : cache_.blob(hash);
    }

private:
    const LeftJournal journal_;  // locked
    BlobCache kept_;
    BlobSource& cache_;
};

}  // namespace

UnsentWorkStore::UnsentWorkStore(std::filesystem::path folder, StoreId store, Connector connector,
                                 Session::Options options, BlobCache& blobs)
    : folder_(std::move(folder)),
      store_(std::move(store)),
      connector_(std::move(connector)),
      options_(std::move(options)),
      blobs_(blobs) {
    if (!folder_.empty())
        journal_ = std::make_unique<Journal>(folder_, options_.client, options_.secret, blobs_);
}

void UnsentWorkStore::pending(const PendingWork& work) {
    if (journal_) journal_->pending(work);
}

void UnsentWorkStore::answered(std::uint64_t sequence) {
    if (journal_) journal_->answered(sequence);
}

std::optional<UnsentWork> UnsentWorkStore::keep() {
    if (!journal_) return std::nullopt;
    journal_->flush();
    return journal_->summary();
}

std::optional<Error> UnsentWorkStore::takeError() {
    return journal_ ? journal_->takeError() : std::nullopt;
}

std::set<Hash> UnsentWorkStore::neededBlobs() {
    return journal_ ? journal_->neededBlobs() : std::set<Hash>();
}

std::vector<UnsentWork> UnsentWorkStore::left(std::vector<Error>& damaged) const {
    return folder_.empty() ? std::vector<UnsentWork>()
                           : LeftJournal::list(folder_, store_, damaged);
}

Result<LeftJournal> UnsentWorkStore::open(const ClientId& work) const {
    const bool isName = !work.value.empty() && work.value.find('/') == std::string::npos;
    if (folder_.empty() || !isName)
        return fail(ErrorCode::InvalidArgument, "there is no unsent work " + work.value);
    return LeftJournal::open(folder_, work);
}

Result<SentWork> UnsentWorkStore::send(const ClientId& work, double timeoutMs,
                                       std::vector<LostWork>& lost) {
    auto journal = open(work);
    if (!journal) return tl::unexpected(journal.error());
    if (!connector_)
        return fail(ErrorCode::InvalidConfiguration,
                    "the client cannot open a second connection to the server");
    auto connection = connector_();
    if (!connection) return tl::unexpected(connection.error());
    auto options = options_;
    options.client = work;
    options.secret = journal->secret();
    options.features = {"history", "log", "resends", kPartsFeature, kLayerListFeature};
    UnsentSender sender(**connection, std::move(options), *journal, blobs_);
    auto sent = sender.send(timeoutMs);
    lost = sender.takeLost();
    for (const LostWork& one : lost)
        for (const AuthoredEdit& edit : one.edits)
            forEachBlob(edit.action, [&](const Value& blob) {
                blobs_.keepBlob(blob.hash(), sender.localBlob(blob.hash()));
            });
    if (!sent) return sent;
    sent->lost = lost.size();
    journal->remove();
    return sent;
}

Result<LeftEdits> UnsentWorkStore::edits(const ClientId& work) {
    auto journal = open(work);
    if (!journal) return tl::unexpected(journal.error());
    LeftEdits left;
    for (const auto& [sequence, one] : journal->works())
        left.work.edits.insert(left.work.edits.end(), one.edits.begin(), one.edits.end());
    left.blobs = std::make_unique<LeftBlobs>(*std::move(journal), blobs_);
    return left;
}

Result<void> UnsentWorkStore::discard(const ClientId& work) {
    auto journal = open(work);
    if (!journal) return tl::unexpected(journal.error());
    journal->remove();
    return {};
}

}  // namespace usdlive::client
