// Contents of layers at other revisions, and the edits between them.
#include "cli/Replay.h"

#include <algorithm>
#include <charconv>

#include "cli/Reach.h"
#include "usdlive/common/layer/Inverse.h"
#include "usdlive/common/layer/MatchedSpecs.h"

namespace usdlive::cli {

namespace {

std::vector<client::AuthoredEdit> authored(const LayerId& layer,
                                           std::vector<std::pair<std::string, EditAction>> edits) {
    std::vector<client::AuthoredEdit> all;
    for (auto& [path, action] : edits) all.push_back({layer, std::move(path), std::move(action)});
    return all;
}

}  // namespace

std::string inRevision(Revision revision) { return "#" + std::to_string(revision); }

Error isBefore(Revision base, Revision revision) {
    return {ErrorCode::HistoryReplaced,
            "revision " + std::to_string(revision) +
                " is not there any more: the history begins at " + inRevision(base) +
                ", because older commits were replaced by the content of the layers"};
}

Error isFuture(Revision revision, Revision newest) {
    return {ErrorCode::FutureRevision, "there is no revision " + std::to_string(revision) +
                                           ": the project is at " + inRevision(newest)};
}

Result<Revision> revisionAt(Link& link, const RevisionWord& word) {
    const Revision newest = link.welcome().revision;
    if (word == "now") return newest;
    Revision number = 0;
    const std::string_view digits = std::string_view(word).substr(word.starts_with('#') ? 1 : 0);
    const auto [stop, error] =
        std::from_chars(digits.data(), digits.data() + digits.size(), number);
    if (error != std::errc() || stop != digits.data() + digits.size())
        return revisionOf(link, word);
    if (number > newest) return tl::unexpected(isFuture(number, newest));
    if (number == 0) return fail(ErrorCode::InvalidArgument, "revisions count from 1");
    if (number < link.base()) return tl::unexpected(isBefore(link.base(), number));
    return number;
}

Result<CommitFilter> filterFor(const Link& link, const Common& options, CommitFilter filter) {
    const auto layer = chosenLayer(link, options);
    if (!layer) return tl::unexpected(layer.error());
    filter.layer = *layer;
    return filter;
}

Result<void> Replay::goTo(Revision revision) {
    constexpr Revision kPage = 1'000;
    while (revision_ < revision) {
        const auto commits = link_.readLog(revision_ + 1, std::min(revision_ + kPage, revision));
        if (!commits) return tl::unexpected(commits.error());
        for (const Commit& commit : *commits) {
            // A client is not sent the edits of an import.
            if (commit.imported) docs_.erase(*commit.imported);
            if (auto applied = applyCommit(docs_, log_, commit); !applied) return applied;
            revision_ = commit.revision;
        }
        log_.prune(revision_);
    }
    return {};
}

LayerDoc Replay::matched(const LayerId& layer, const LayerDoc& then,
                         const LayerDoc& present) const {
    const auto found = docs_.find(layer);
    const bool isSame = found != docs_.end() && found->second == present;
    return isSame ? found->second : matchedSpecs(then, present);
}

Result<std::vector<client::AuthoredEdit>> restoring(const LayerId& layer, const LayerDoc& now,
                                                    const LayerDoc& then, const std::string& path,
                                                    const std::string& pathThen) {
    if (path.empty()) return authored(layer, difference(now, then));
    if (!then.has(pathThen)) {
        if (!now.has(path))
            return fail(ErrorCode::SpecNotFound,
                        "there is nothing at " + path + ", neither then nor now");
        return authored(layer, {{path, DeleteSpec{}}});
    }
    if (!now.has(specpath::parent(path)))
        return fail(ErrorCode::SpecNotFound, "there is no " + specpath::parent(path) +
                                                 " now: restore that with everything below it");
    LayerDoc wanted = now;
    const std::string next = now.has(path) ? now.nextSibling(path) : then.nextSibling(pathThen);
    if (now.has(path)) (void)wanted.apply(path, DeleteSpec{});
    for (auto& [at, action] : restoredSpecs(SpecTree(then, pathThen), path))
        if (auto done = wanted.apply(at, action); !done) return tl::unexpected(done.error());
    const std::string sibling =
        next.empty() ? next
                     : specpath::child(specpath::parent(path), specpath::last(path).list, next);
    if (sibling.empty() || wanted.has(sibling)) (void)wanted.apply(path, PlaceSpec{next});
    return authored(layer, difference(now, matchedSpecs(now, wanted)));
}

Commit commitOf(const std::vector<client::AuthoredEdit>& edits) {
    Commit commit;
    for (const auto& edit : edits)
        commit.edits.push_back({edit.layer, {edit.path, {}}, edit.action, {}});
    return commit;
}

}  // namespace usdlive::cli
