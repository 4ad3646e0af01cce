// Merges a live session and the main line: reads both, follows earlier merges, and commits.
#include "lines/SessionMerge.h"

#include <algorithm>
#include <thread>
#include <utility>

#include "lines/LineEdits.h"

namespace usdlive::client {

namespace {

constexpr double kLineConnectMs = 10'000;
constexpr Revision kMergedPerPage = 1'000;
// A merge is committed directly after it was noted. What has no commit after this time was not
// done.
constexpr std::chrono::milliseconds kUnderWay{10'000}, kLookAgain{200};

bool concerns(const Commit& commit, const std::set<LayerId>& layers) {
    return (commit.imported && layers.contains(*commit.imported)) ||
           std::ranges::any_of(commit.edits,
                               [&](const Edit& edit) { return layers.contains(edit.layer); });
}

std::string numbered(Revision revision) { return "#" + std::to_string(revision); }

}  // namespace

Error undecidedConflicts(std::size_t count, const std::string& how) {
    return {ErrorCode::InvalidArgument, "nothing was merged: " + std::to_string(count) +
                                            (count == 1 ? " conflict is" : " conflicts are") +
                                            " not decided. " + how};
}

Result<SessionMerged> SessionMerge::run() {
    for (;;) {
        auto read =
            find().and_then([&] { return connect(); }).and_then([&] { return readLines(); });
        if (!read) return tl::unexpected(read.error());
        if (findDone()) break;
        std::this_thread::sleep_for(kLookAgain);
    }
    auto done = readCommon()
                    .and_then([&] { return followMerges(); })
                    .and_then([&] { return joinInto(); })
                    .and_then([&] { return mergeNewest(); })
                    .and_then([&] { return commit(); });
    if (!done) return tl::unexpected(done.error());
    return merged_;
}

Result<void> SessionMerge::find() {
    const auto all = listLiveSessions(wanted_.server, kSessionRequestTime);
    if (!all) return tl::unexpected(all.error());
    const auto found = std::ranges::find(*all, wanted_.name, &ListedLiveSession::name);
    if (found == all->end())
        return fail(ErrorCode::InvalidArgument, "the project has no live session " + wanted_.name +
                                                    "; usdlive session list lists them");
    if (found->isEnded)
        return fail(
            ErrorCode::InvalidArgument,
            "the live session " + wanted_.name + " was ended" +
                (found->merged > 0 ? " and merged in " + numbered(found->merged) : std::string()) +
                "; usdlive session restore opens it again");
    session_ = *found;
    return {};
}

Result<void> SessionMerge::connect() {
    from_ = {};
    into_ = {};
    auto main = LineLink::connect(mainLineAddress(wanted_.server), wanted_.user, kLineConnectMs);
    if (!main) return tl::unexpected(main.error());
    auto session = LineLink::connect(liveSessionAddress(wanted_.server, wanted_.name), wanted_.user,
                                     kLineConnectMs);
    if (!session) return tl::unexpected(session.error());
    mainLine().link = *std::move(main);
    mainLine().start = mainLine().read = session_.revision;
    sessionLine().link = *std::move(session);
    sessionLine().start = sessionLine().read = session_.begin;
    into_.link->lend(*from_.link);
    return {};
}

/// Without the commits since the lines parted, nobody knows what each has changed. The only line
/// that can do without is a main line that receives for the first time.
Result<void> SessionMerge::checkHistory() const {
    const bool isFromCut = from_.link->base() > from_.start;
    const bool isFirst = isIntoMain() && session_.merges.empty();
    if (!isFromCut && (!isIntoCut_ || isFirst)) return {};
    return fail(ErrorCode::HistoryReplaced,
                "the live session " + wanted_.name +
                    " cannot be merged or updated: the commits of " +
                    (isFromCut == isIntoMain() ? "the session" : "the main line") +
                    " since both parted were replaced (usdlive compact). Create another session, "
                    "and copy what is needed");
}

Result<void> SessionMerge::readLines() {
    isIntoCut_ = into_.link->base() > into_.start;
    if (auto whole = checkHistory(); !whole) return whole;
    if (auto done = read(from_, from_.link->welcome().revision); !done) return done;
    layers_.clear();
    for (const Commit& commit : from_.commits)
        for (const Edit& edit : commit.edits) layers_.insert(edit.layer);
    return isIntoCut_ ? Result<void>() : read(into_, into_.link->welcome().revision);
}

Result<void> SessionMerge::read(Line& line, Revision to) {
    while (line.read < to) {
        auto commits = line.link->readLog(line.read + 1, std::min(to, line.read + kMergedPerPage));
        if (!commits) return tl::unexpected(commits.error());
        line.read = std::min(to, line.read + kMergedPerPage);
        for (Commit& commit : *commits)
            if (&line == &from_ || concerns(commit, layers_))
                line.commits.push_back(std::move(commit));
    }
    return {};
}

bool SessionMerge::findDone() {
    done_.clear();
    for (const NotedMerge& one : session_.merges) {
        if (one.client.value.empty()) {
            done_.push_back({one, one.into});
            continue;
        }
        const Line& line = one.isIntoMain ? mainLine() : sessionLine();
        const auto found = std::ranges::find_if(line.commits, [&](const Commit& commit) {
            return commit.revision > one.into && commit.id.client == one.client &&
                   !commit.imported && !commit.edits.empty();
        });
        if (found != line.commits.end())
            done_.push_back({one, found->revision});
        else if (one.age < kUnderWay)
            return false;
    }
    return true;
}

/// Reads the layers that the line that gives has changed, as they were when the lines parted.
Result<void> SessionMerge::readCommon() {
    LayerDocs common;
    for (const LayerId& layer : layers_) {
        auto content = from_.link->readLayer(layer, std::max<Revision>(from_.start, 1));
        if (!content) return tl::unexpected(content.error());
        common.emplace(layer, std::move(content->doc));
    }
    merge_.emplace(std::move(common), into_.start);
    return {};
}

/// Adds the commits of a line up to a revision to the merge.
Result<void> SessionMerge::goTo(Side side, Revision revision) {
    Line& line = side == Side::From ? from_ : into_;
    for (; line.added < line.commits.size(); ++line.added) {
        const Commit& commit = line.commits[line.added];
        if (commit.revision > revision) return {};
        auto added = side == Side::From ? merge_->addFrom(commit) : merge_->addInto(commit);
        if (!added) return added;
        // The common content is that of the line that gives, when it began to use the layer.
        if (side == Side::From || !commit.imported || !merge_->into().contains(*commit.imported))
            continue;
        const auto content = line.link->readLayer(*commit.imported, commit.revision);
        if (!content) return tl::unexpected(content.error());
        if (auto set = merge_->setContent(side, *commit.imported, content->doc); !set) return set;
    }
    return {};
}

Result<void> SessionMerge::followMerges() {
    Revision given = from_.start, received = into_.start;  // up to where the merge has the commits
    for (const auto& [noted, at] : done_) {
        const bool isInto = noted.isIntoMain == isIntoMain();
        const Revision from = isInto ? noted.from : at, into = isInto ? at : noted.from;
        // Another merge, which was under way at the same time, has seen more.
        if (from < given || into < received) continue;
        auto done =
            goTo(Side::From, from).and_then([&] { return goTo(Side::Into, into); }).and_then([&] {
                return merge_->received(isInto ? Side::Into : Side::From);
            });
        if (!done) return done;
        given = from;
        received = into;
    }
    return goTo(Side::From, from_.read);
}

/// A line lists a file that another line has just made a moment later: waits for it.
bool SessionMerge::isListed(const LayerId& layer) {
    const auto end = std::chrono::steady_clock::now() + kSessionRequestTime;
    bool isThere = false;
    const auto ran = into_.link->run([&](const std::vector<Event>&) {
        isThere = into_.link->session().projectLayers().contains(layer);
        return isThere || std::chrono::steady_clock::now() > end;
    });
    return ran && isThere;
}

/// Joins the layers that the line that gives has changed. Creates those that the other one lacks.
Result<void> SessionMerge::joinInto() {
    std::set<LayerId> layers;
    for (const LayerId& layer : merge_->changed()) {
        if (!into_.link->session().projectLayers().contains(layer)) {
            const bool isDryRun = wanted_.options.isDryRun;
            const auto created =
                isDryRun ? Result<LayerCreated>() : into_.link->ask(CreateLayer{.layer = layer});
            if (!created && (created.error().code != ErrorCode::LayerExists || !isListed(layer)))
                return tl::unexpected(created.error());
            if (created) merged_.created.push_back(layer);
            if (isDryRun) continue;
        }
        layers.insert(layer);
    }
    return joinLayers(*into_.link, layers);
}

SessionConflict SessionMerge::shown(const MergeConflict& conflict) const {
    SessionConflict one;
    one.what = SessionConflict::What(conflict.what);
    one.layer = conflict.layer;
    one.path = conflict.path;
    one.field = conflict.field;
    one.part = conflict.part;
    one.before = conflict.before;
    one.reason = conflict.reason;
    one.main = isIntoMain() ? conflict.into : conflict.from;
    one.session = isIntoMain() ? conflict.from : conflict.into;
    one.mainUser = isIntoMain() ? conflict.intoUser : conflict.fromUser;
    one.sessionUser = isIntoMain() ? conflict.fromUser : conflict.intoUser;
    if (conflict.what == MergeConflict::What::Deleted)
        (conflict.isDeletedFrom == isIntoMain() ? one.isDeletedInSession : one.isDeletedInMain) =
            true;
    return one;
}

/// Merges with the newest revision of the line that receives.
Result<void> SessionMerge::mergeNewest() {
    const auto decide = [&](const MergeConflict& conflict) {
        const Take take =
            wanted_.options.decide ? wanted_.options.decide(shown(conflict)) : Take::Undecided;
        if (take == Take::Undecided) return Side::Undecided;
        return (take == Take::Main) == isIntoMain() ? Side::Into : Side::From;
    };
    for (;;) {
        const Revision now = into_.link->session().revision();
        if (isIntoCut_) {
            into_.read = now;
        } else {
            auto added = read(into_, now).and_then([&] { return goTo(Side::Into, now); });
            if (!added) return added;
        }
        for (const LayerId& layer : merge_->changed())
            if (const LayerDoc* content = into_.link->session().view(layer);
                content && !(*content == merge_->into().at(layer)))
                if (auto set = merge_->setContent(Side::Into, layer, *content); !set) return set;
        if (auto matched = merge_->matchContents(); !matched) return matched;
        auto merged = merge_->merge(decide);
        if (!merged) return tl::unexpected(merged.error());
        merged_.dropped = merged->dropped;
        merged_.undecided = std::size_t(std::ranges::count(merged->decisions, Side::Undecided));
        merged_.conflicts.clear();
        for (std::size_t index = 0; index < merged->conflicts.size(); ++index) {
            merged_.conflicts.push_back(shown(merged->conflicts[index]));
            const Side side = merged->decisions[index];
            if (side != Side::Undecided)
                merged_.conflicts.back().take =
                    (side == Side::Into) == isIntoMain() ? Take::Main : Take::Session;
        }
        edits_ = std::move(merged->edits);
        Commit edits;
        for (const AuthoredEdit& one : edits_)
            edits.edits.push_back({one.layer, {one.path, {}}, one.action, {}});
        if (!wanted_.options.isDryRun)
            if (auto here = from_.link->fetchBlobs(edits); !here) return here;
        merged_.edits = std::move(edits.edits);
        // Others may have committed meanwhile.
        if (wanted_.options.isDryRun || into_.link->session().revision() == now) return {};
    }
}

Result<void> SessionMerge::commit() {
    if (wanted_.options.isDryRun || merged_.undecided > 0) return {};
    if (merge_->changed().empty()) return {};
    NotedMerge merge{isIntoMain(), from_.read, into_.read};
    if (!edits_.empty()) merge.client = into_.link->session().id();
    auto noted = noteMerge(wanted_.server, wanted_.name, wanted_.user, merge,
                           session_.merges.size(), kSessionRequestTime);
    if (!noted || edits_.empty()) return noted;
    const auto revision = submitEdits(
        *into_.link, edits_, isIntoMain() ? "Merge " + wanted_.name : "Update from the main line");
    if (!revision) return tl::unexpected(revision.error());
    merged_.revision = *revision;
    return {};
}

Result<void> SessionMerge::end() {
    (void)from_.link->step();
    if (const Revision newest = from_.link->session().revision(); newest > from_.read)
        return fail(ErrorCode::InvalidArgument,
                    "the session was merged as it was at " + numbered(from_.read) + ". It is at " +
                        numbered(newest) + " by now, and goes on: merge again");
    const auto ended = changeLiveSession(
        wanted_.server, wanted_.name, "end", wanted_.user, kSessionRequestTime,
        merged_.revision > 0 ? merged_.revision : into_.link->session().revision());
    if (!ended)
        return fail(ended.error().code,
                    "the changes are merged, and the live session could not be ended: " +
                        ended.error().message);
    return checkNothingCameLate();
}

/// Somebody may have edited the session until it ended. The server sends every commit before it
/// closes the connection.
Result<void> SessionMerge::checkNothingCameLate() {
    const auto end = std::chrono::steady_clock::now() + kSessionRequestTime;
    while (from_.link->step() && std::chrono::steady_clock::now() < end) {
    }
    if (from_.link->session().revision() == from_.read) return {};
    return fail(ErrorCode::InvalidArgument,
                "the session was merged as it was at " + numbered(from_.read) +
                    ", and somebody edited it until it ended. usdlive session restore opens it "
                    "again: then merge again");
}

}  // namespace usdlive::client
