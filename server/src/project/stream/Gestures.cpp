// Receives previews, forwards them, and withdraws them.
#include "project/stream/Gestures.h"

#include "project/SharedFrame.h"

namespace usdlive::server {

namespace {

constexpr std::size_t kMaxPreviewBytes = 1024 * 1024;  // larger previews are dropped

}  // namespace

void Gestures::receive(Session& session, PreviewFrame preview, std::size_t bytes) {
    if (preview.gesture == 0)
        return sessions_->close(session,
                                {ErrorCode::MalformedFrame, "a preview without a gesture"});
    if (bytes > kMaxPreviewBytes)
        return sessions_->sendError(session, {ErrorCode::TransactionTooLarge,
                                              "a preview of " + std::to_string(bytes) + " bytes"});
    ++counters_->previews;
    if (preview.edits.empty()) return refused(session.client, preview.gesture);
    if (!access_->mayPreview(session.subject, preview.edits)) return;
    preview.author = session.client;
    const SharedBytes frame = sharedFrame(preview);
    std::vector<Hash> named;
    for (const Edit& edit : preview.edits)
        forEachBlob(edit.action, [&](const Value& blob) { named.push_back(blob.hash()); });
    bool isKept = true;
    for (const auto& [author, gesture] : previews_->keep(
             session.client, session.share, preview.gesture, {frame, std::move(named)})) {
        withdraw(author, gesture);
        if (author == session.client && gesture == preview.gesture) isKept = false;
    }
    // Nothing would withdraw a preview that is not kept.
    if (!isKept) return;
    // A session that is behind is sent the preview when it has caught up.
    catchup_->sendPreview(preview, frame);
}

void Gestures::refused(const ClientId& author, std::uint64_t gesture) {
    if (gesture != 0 && previews_->end(author, gesture)) withdraw(author, gesture);
}

void Gestures::withdraw(const ClientId& author, std::uint64_t gesture) {
    const SharedBytes frame = sharedFrame(PreviewFrame{author, gesture, line_->durable(), {}});
    for (const auto& [id, other] : sessions_->all())
        if (other.isGreeted() && other.client != author) outbox_->send(id, frame);
}

void Gestures::withdrawAll(const ClientId& author) {
    for (const std::uint64_t gesture : previews_->endAll(author)) withdraw(author, gesture);
}

void Gestures::durable(const OrderedCommit& commit) {
    if (commit.gesture != 0) previews_->end(commit.id.client, commit.gesture);
}

void Gestures::rolledBack(const Error& /*error*/, const LostCommits& lost) {
    for (const OrderedCommit& commit : lost.commits) refused(commit.id.client, commit.gesture);
}

void Gestures::left(const Session& session) {
    if (!session.client.empty() && !sessions_->isConnected(session.client))
        withdrawAll(session.client);
}

}  // namespace usdlive::server
