// Keeps the committed transactions of clients, and the specs that they created.
#include "project/clients/Authors.h"

#include <algorithm>
#include <utility>

namespace usdlive::server {

void Authors::read(const ClientId& client) {
    Author& author = authors_[client];
    if (author.committed || store_->closed || std::exchange(author.isBeingRead, true)) return;
    history_->readClient(client);
}

bool Authors::answered(const ClientId& client, const Result<ClientRecord>& record) {
    const auto found = authors_.find(client);
    if (found == authors_.end()) return false;
    Author& author = found->second;
    if (!std::exchange(author.isBeingRead, false) || author.committed) return false;
    if (record) {
        author.committed.emplace(*record);
        clientsForgotten(record->forgottenUpTo);
    }
    return true;
}

void Authors::forgetIfUnused(const ClientId& client) {
    const auto author = authors_.find(client);
    if (author != authors_.end() && author->second.inFlight.empty() &&
        !sessions_->isConnected(client))
        authors_.erase(author);
}

std::set<ClientId> Authors::active() const {
    std::set<ClientId> clients;
    for (const auto& [id, session] : sessions_->all()) clients.insert(session.client);
    for (const auto& [client, author] : authors_) clients.insert(client);
    return clients;
}

void Authors::durable(const OrderedCommit& commit) {
    const auto author = authors_.find(commit.id.client);
    if (author == authors_.end()) return;
    author->second.inFlight.erase(commit.id.sequence);
    if (commit.id.sequence != 0) author->second.committed->add(commit.id.sequence, commit.revision);
    forgetIfUnused(commit.id.client);
}

void Authors::rolledBack(const Error& /*error*/, const LostCommits& lost) {
    const Revision durable = lost.commits.front().revision - 1;
    for (auto& [client, author] : authors_) author.newest = std::min(author.newest, durable);
    for (const OrderedCommit& commit : lost.commits) {
        const auto author = authors_.find(commit.id.client);
        if (author == authors_.end()) continue;
        author->second.creations.forget(commit.id.sequence);
        author->second.inFlight.erase(commit.id.sequence);
        forgetIfUnused(commit.id.client);
    }
}

void Authors::left(const Session& session) {
    if (!session.client.empty()) forgetIfUnused(session.client);
}

}  // namespace usdlive::server
