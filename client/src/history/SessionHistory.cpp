// Reads the history over the session of an editor.
#include "history/SessionHistory.h"

#include <memory>
#include <string>
#include <utility>

#include "basics/Clocks.h"
#include "history/HistorySearch.h"
#include "usdlive/common/core/LayerPath.h"

namespace usdlive::client {

namespace {

// A call fails if a connected server sends nothing for this time.
constexpr double kSilentHistoryMs = 60'000;

}  // namespace

Result<LogPage> SessionHistory::log(const LogQuery& query) {
    if (!query.filter.layer.empty())
        if (auto known = checkLayer(query.filter.layer); !known)
            return tl::unexpected(known.error());
    return searchLog(*this, query);
}

Result<BlameResult> SessionHistory::blame(const LayerId& layer, const std::string& path,
                                          bool below) {
    if (auto known = checkLayer(layer); !known) return tl::unexpected(known.error());
    return findBlame(*this, layer, path, below);
}

Result<void> SessionHistory::checkLayer(const LayerId& layer) const {
    if (auto valid = parseLayerId(layer.value); !valid) return tl::unexpected(valid.error());
    if (!session_.isConnected()) return tl::unexpected(editor_.notThere());
    if (!session_.projectLayers().contains(layer))
        return fail(ErrorCode::LayerNotFound, "the project has no layer " + layer.value);
    return {};
}

Result<void> SessionHistory::checkRevision(Revision revision) const {
    if (revision == 0)
        return fail(ErrorCode::InvalidArgument, "there is no revision 0: revisions count from 1");
    if (revision <= newest()) return {};
    return fail(ErrorCode::FutureRevision, "there is no revision " + std::to_string(revision) +
                                               " yet: the newest is " + std::to_string(newest()));
}

// The commit after a revision can be read if the content at the revision can.
Result<void> SessionHistory::checkReadable(const LayerId& layer, Revision revision) {
    if (auto known = checkLayer(layer); !known) return known;
    if (newest() == 0)
        return fail(ErrorCode::FutureRevision,
                    "the project has no history yet: open a layer of it first");
    if (revision == 0) return checkRevision(revision);
    if (revision == newest()) return {};
    const Revision asked =
        revision < newest() ? revision + 1 : revision;  // others may have made it
    const auto read = readLog(asked, asked);
    if (read) return {};
    if (read.error().code == ErrorCode::FutureRevision) return checkRevision(revision);
    if (read.error().code != ErrorCode::HistoryReplaced) return tl::unexpected(read.error());
    // The error of the server says which revision is the oldest.
    return readLayer(layer, revision).map([](const auto&) {});
}

Result<void> SessionHistory::waitUntil(const std::function<bool()>& done) const {
    Stopwatch silent;
    while (!done()) {
        if (editor_.step()) silent = Stopwatch();
        if (silent.ms() > kSilentHistoryMs && !done())
            return fail(ErrorCode::NotConnected, "the server no longer answers");
    }
    return {};
}

// The session may set the answer after this has given up.
Result<std::vector<Commit>> SessionHistory::readLog(Revision from, Revision to) {
    struct Reading {
        std::vector<Commit> commits;
        std::optional<Result<void>> end;
    };
    const auto reading = std::make_shared<Reading>();
    session_.requestLog(
        from, to, [reading](const Commit& commit) { reading->commits.push_back(commit); },
        [reading](Result<void> end) { reading->end = std::move(end); });
    if (auto waited = waitUntil([&] { return reading->end.has_value(); }); !waited)
        return tl::unexpected(waited.error());
    if (!*reading->end) return tl::unexpected(reading->end->error());
    return std::move(reading->commits);
}

Result<HistoryReader::Content> SessionHistory::readLayer(const LayerId& layer, Revision revision) {
    const LayerDoc* const confirmed = session_.confirmed(layer);
    if (revision == 0 && confirmed) return Content{*confirmed, session_.revision()};
    const auto answer = std::make_shared<std::optional<Result<Content>>>();
    session_.peek(layer, revision > 0 ? revision : session_.revision(),
                  [answer](Result<LayerDoc> doc, Revision at) {
                      if (doc)
                          *answer = Content{*std::move(doc), at};
                      else
                          *answer = tl::unexpected(doc.error());
                  });
    if (auto waited = waitUntil([&] { return answer->has_value(); }); !waited)
        return tl::unexpected(waited.error());
    return std::move(**answer);
}

}  // namespace usdlive::client
