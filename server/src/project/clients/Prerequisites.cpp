// Finds the data that a transaction needs, and requests what is missing.
#include "project/clients/Prerequisites.h"

#include <functional>
#include <optional>
#include <unordered_set>

#include "project/CommitContent.h"
#include "usdlive/common/layer/SpecPath.h"

namespace usdlive::server {

namespace {

/// Calls `visit` with each creation that an address of the transaction names.
void forEachCreation(const Transaction& transaction,
                     const std::function<void(const Creation&)>& visit) {
    for (const Edit& edit : transaction.edits) {
        if (edit.address.creation) visit(*edit.address.creation);
        const auto* move = std::get_if<MoveSpec>(&edit.action);
        if (move && move->parent.creation) visit(*move->parent.creation);
        for (const Address& name : edit.names)
            if (name.creation) visit(*name.creation);
    }
}

bool isTrue(const std::variant<bool, Refused>& ready) {
    const auto* answer = std::get_if<bool>(&ready);
    return answer && *answer;
}

}  // namespace

std::variant<bool, Refused> Prerequisites::check(SessionId session, const Author& author,
                                                 QueuedTransaction& queued) {
    auto stored = blobsReady(queued);
    if (!isTrue(stored)) return stored;
    auto loaded = layersReady(queued.transaction);
    if (!isTrue(loaded)) return loaded;
    return creationsKnown(session, author, queued);
}

/// Checks that all big values of the transaction are stored. Returns false while the store is being
/// asked.
std::variant<bool, Refused> Prerequisites::blobsReady(QueuedTransaction& queued) {
    std::unordered_set<Hash> checked;
    std::vector<Hash> missing;
    bool isSought = false;
    const std::vector<Edit>& edits = queued.transaction.edits;
    for (std::size_t index = 0; index < edits.size(); ++index) {
        std::optional<Refused> refused;
        const auto check = [&](const Value& blob) {
            const Hash hash = blob.hash();
            if (refused || !checked.insert(hash).second) return;
            if (blob.size() > values_->limits().maxBytes) {
                refused = Refused{{ErrorCode::BlobTooLarge,
                                   "a value of " + std::to_string(blob.size()) + " bytes"}};
            } else if (values_->isStored(hash)) {
                return;
            } else if (queued.soughtBlobs.insert(hash).second) {
                missing.push_back(hash);
            } else if (values_->isSought(hash)) {
                isSought = true;
            } else {
                refused = Refused{
                    {ErrorCode::BlobNotFound, "the value " + hash.hex() + " was not uploaded"}};
            }
        };
        forEachBlob(edits[index].action, check);
        if (!refused) continue;
        refused->edit = std::uint32_t(index);
        return *refused;
    }
    isSought = isSought || !missing.empty();
    if (!missing.empty()) values_->seek(std::move(missing));
    return !isSought;
}

/// Starts to load the layers of the transaction. Returns false until all are loaded.
std::variant<bool, Refused> Prerequisites::layersReady(const Transaction& transaction) {
    bool ready = true;
    const LayerId* previous = nullptr;
    for (std::size_t index = 0; index < transaction.edits.size(); ++index) {
        const LayerId& layer = transaction.edits[index].layer;
        if (previous && *previous == layer) continue;
        previous = &layer;
        const LayerLoading* loading = layers_->loading(layer);
        if (!loading)
            return Refused{{ErrorCode::LayerNotFound, "the project has no layer " + layer.value},
                           std::uint32_t(index)};
        if (const auto* failed = std::get_if<LoadFailed>(loading))
            return Refused{failed->error, std::uint32_t(index)};
        if (std::holds_alternative<Loaded>(*loading)) continue;
        layers_->require(layer);
        ready = false;
    }
    return ready;
}

/// M3: requests the specs that earlier transactions created from the store, if they are not in
/// memory after a restart or a reconnect. Returns false until they are read.
bool Prerequisites::creationsKnown(SessionId session, const Author& author,
                                   QueuedTransaction& queued) {
    bool known = true;
    forEachCreation(queued.transaction, [&](const Creation& creation) {
        const std::uint64_t sequence = creation.sequence;
        if (sequence == queued.transaction.id.sequence || author.creations.find(creation)) return;
        if (author.inFlight.contains(sequence) || !queued.lookedUp.insert(sequence).second) return;
        const auto revision = author.committed->find(sequence);
        if (!revision || *revision <= start_->oldest()) return;  // M4: treated as not created
        known = false;
        reads_->request(session, {ReadPurpose::Creations, *revision, *revision, sequence});
    });
    return known;
}

void Prerequisites::addCreations(Author& author, std::uint64_t sequence,
                                 const StoredCommit& stored) {
    const auto decoded = decodeCommit(stored);
    if (!decoded) return;
    for (auto& [index, entry] : createdBy(line_->namespaces(), *decoded))
        author.creations.record({sequence, index}, std::move(entry), decoded->revision);
}

}  // namespace usdlive::server
