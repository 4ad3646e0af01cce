// Previews (M11): passed on at once, kept only while their gesture lasts.
#include "ProjectImpl.h"

namespace usdlive::server {

namespace {

constexpr std::size_t kMaxPreviewBytes = 1024 * 1024;  // larger ones are not passed on

}  // namespace

void Project::Impl::receivePreview(Session& session, PreviewFrame preview, std::size_t bytes) {
    if (preview.gesture == 0)
        return close(session, {ErrorCode::MalformedFrame, "a preview of no gesture"});
    if (bytes > kMaxPreviewBytes)
        return sendError(session, {ErrorCode::TransactionTooLarge,
                                   "a preview of " + std::to_string(bytes) + " bytes"});
    ++counters_.previews;
    if (preview.edits.empty()) {
        if (previews_.end(session.client, preview.gesture))
            withdraw(session.client, preview.gesture);
        return;
    }
    if (!access_.mayPreview(*this, session.subject, preview.edits)) return;
    preview.author = session.client;
    const auto frame = std::make_shared<const Bytes>(encodeFrame(preview));
    std::vector<Hash> named;
    for (const Edit& edit : preview.edits)
        forEachBlob(edit.action, [&](const Value& blob) { named.push_back(blob.hash()); });
    const std::uint64_t pushedOut =
        previews_.keep(session.client, preview.gesture, {frame, std::move(named)});
    if (pushedOut != 0) withdraw(session.client, pushedOut);
    // Who is behind gets it when it has caught up.
    for (auto& [id, other] : sessions_)
        if (other.isLive() && other.client != session.client) ports_.outbox.send(id, frame);
}

void Project::Impl::withdraw(const ClientId& author, std::uint64_t gesture) {
    const auto frame =
        std::make_shared<const Bytes>(encodeFrame(PreviewFrame{author, gesture, durable_, {}}));
    for (auto& [id, other] : sessions_)
        if (other.isGreeted() && other.client != author) ports_.outbox.send(id, frame);
}

void Project::Impl::withdrawAll(const ClientId& author) {
    for (const std::uint64_t gesture : previews_.endAll(author)) withdraw(author, gesture);
}

}  // namespace usdlive::server
