// Implements the verbs that take work back.
#include "cli/RevertCommands.h"

#include <algorithm>
#include <deque>
#include <iostream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <utility>

#include "cli/Json.h"
#include "cli/Reach.h"
#include "cli/Text.h"
#include "lines/LineEdits.h"
#include "session/Reversal.h"
#include "usdlive/common/access/ProjectAction.h"

namespace usdlive::cli {

namespace {

void printEdits(const std::vector<client::AuthoredEdit>& edits) {
    for (const Edit& edit : commitOf(edits).edits)
        std::cout << "    " << edit.layer.value << "  " << describe(edit) << "\n";
}

std::string revertLabel(const RevertOptions& options) {
    if (options.first == 0) return "Revert";
    if (options.first == options.last) return "Revert of revision " + std::to_string(options.first);
    return "Revert of revisions " + std::to_string(options.first) + " to " +
           std::to_string(options.last);
}

/// A value that the edits name may not be in the project any more: it is sent again.
Result<void> fetchBlobs(Link& link, const std::vector<client::AuthoredEdit>& edits) {
    return link.fetchBlobs(commitOf(edits));
}

/// The commits that a revert looks at, and what it takes back of them.
class Chosen {
public:
    /// Reads the commits of the range and all later ones.
    Result<void> read(Link& link, const RevertOptions& options, const CommitFilter& filter) {
        const Revision base = link.base();
        newest_ = link.welcome().revision;
        const Revision last = options.last > 0 ? options.last : newest_;
        const Revision first = std::max<Revision>(options.first, base + 1);
        CommitSearch search(filter);
        auto done = client::readBackward(link, newest_, first, [&](const Commit& commit) {
            if (commit.timeMs < filter.sinceMs) return false;
            std::set<std::size_t> edits;
            const auto found = search.look(commit);
            if (found && commit.revision <= last && !commit.imported)
                std::ranges::copy_if(
                    found->edits, std::inserter(edits, edits.end()),
                    [&](std::size_t index) { return !locks(commit.edits[index]); });
            if (!edits.empty()) {
                ++count_;
                first_ = commit.revision;
            }
            for (const std::size_t index : edits) layers_.insert(commit.edits[index].layer);
            commits_.push_front({commit, std::move(edits)});
            return true;
        });
        while (!commits_.empty() && commits_.front().commit.revision < first_) commits_.pop_front();
        return done;
    }
    /// Reads the commits since the last call.
    Result<void> readNewer(Link& link) {
        const Revision now = link.session().revision();
        if (now == newest_) return {};
        const auto commits = link.readLog(newest_ + 1, now);
        if (!commits) return tl::unexpected(commits.error());
        for (const Commit& commit : *commits) commits_.push_back({commit, {}});
        newest_ = now;
        return {};
    }
    [[nodiscard]] std::size_t count() const { return count_; }
    [[nodiscard]] Revision first() const { return first_; }
    [[nodiscard]] Revision newest() const { return newest_; }
    [[nodiscard]] const std::set<LayerId>& layers() const { return layers_; }

    Result<client::Reversal::TakenBack> takenBack(LayerDocs before, Link& link) const {
        client::Reversal reversal(std::move(before));
        for (const auto& [commit, edits] : commits_) {
            const Edit* const begin = commit.edits.data();
            const auto isChosen = [&](const Edit& edit) {
                return edits.contains(std::size_t(&edit - begin));
            };
            if (auto added = reversal.add(commit, isChosen); !added)
                return tl::unexpected(added.error());
        }
        for (const LayerId& layer : layers_)
            if (const LayerDoc* now = link.session().view(layer);
                now && !(*now == reversal.layers().at(layer)))
                return fail(ErrorCode::Internal, "the commits of " + layer.value +
                                                     " do not give its content at " +
                                                     inRevision(newest_));
        return reversal.takeBack();
    }

private:
    /// Locks stay: only who holds one may end it, and all of the revert would be refused.
    static bool locks(const Edit& edit) {
        return projectActionOf(edit.address.path, edit.action) == ProjectAction::Lock;
    }

    struct One {
        Commit commit;
        std::set<std::size_t> edits;  // that were chosen
    };
    std::deque<One> commits_;
    std::set<LayerId> layers_;
    std::size_t count_ = 0;
    Revision first_ = 0, newest_ = 0;
};

Result<LayerDocs> contentsAt(Link& link, const std::set<LayerId>& layers, Revision revision) {
    LayerDocs docs;
    for (const LayerId& layer : layers) {
        auto fetched = link.readLayer(layer, std::max<Revision>(revision, 1));
        if (!fetched) return tl::unexpected(fetched.error());
        docs.emplace(layer, std::move(fetched->doc));
    }
    return docs;
}

/// Prints what was, or would be, done.
void printDone(const Common& options, Link& link, const std::string& verb, bool dryRun,
               const std::vector<client::AuthoredEdit>& edits,
               const std::vector<client::KeptByUndo>& kept, Revision revision) {
    std::set<LayerId> layers;
    for (const auto& edit : edits) layers.insert(edit.layer);
    if (options.json) {
        Json json{{verb, edits.size()}, {"dryRun", dryRun}};
        if (!dryRun && !edits.empty()) json["revision"] = revision;
        json["edits"] = toJson(commitOf(edits), {}, link)["edits"];
        json["kept"] = Json::array();
        for (const auto& one : kept) json["kept"].push_back(toJson(one));
        std::cout << line(json);
        return;
    }
    std::string names;
    for (const LayerId& layer : layers) names += (names.empty() ? "" : ", ") + layer.value;
    if (edits.empty())
        std::cout << "nothing to be " << verb << "\n";
    else if (dryRun)
        std::cout << "would be " << verb << ": " << counted(edits.size(), "edit") << " of " << names
                  << "\n";
    else
        std::cout << verb << " " << names << ": " << counted(edits.size(), "edit") << ", "
                  << inRevision(revision) << "\n";
    if (dryRun) printEdits(edits);
    for (const auto& one : kept)
        std::cout << "stays  " << one.layer.value << "  " << one.path
                  << (one.field.empty() ? "" : "  " + one.field) << "  " << one.reason << "\n";
}

}  // namespace

Result<void> revert(const RevertOptions& options) {
    const auto reached = reach(options);
    if (!reached) return tl::unexpected(reached.error());
    Link& link = **reached;
    const Revision base = link.base(), newest = link.welcome().revision;
    if (options.first > 0 && options.first <= base)
        return tl::unexpected(isBefore(base, options.first));
    if (const Revision last = std::max(options.first, options.last); last > newest)
        return tl::unexpected(isFuture(last, newest));
    const auto filter = filterFor(link, options, options.filter);
    if (!filter) return tl::unexpected(filter.error());
    Chosen chosen;
    if (auto read = chosen.read(link, options, *filter); !read) return read;
    if (chosen.count() == 0)
        return fail(ErrorCode::InvalidArgument,
                    "no commit was chosen that can be reverted; `usdlive log` with the same "
                    "options shows what they choose. The import of a file and locks cannot be "
                    "reverted");
    const auto before = contentsAt(link, chosen.layers(), chosen.first() - 1);
    if (!before) return tl::unexpected(before.error());
    if (auto joined = joinLayers(link, chosen.layers()); !joined) return joined;
    client::Reversal::TakenBack taken;
    for (;;) {
        if (auto read = chosen.readNewer(link); !read) return read;
        if (link.session().revision() != chosen.newest()) continue;
        auto result = chosen.takenBack(*before, link);
        if (!result) return tl::unexpected(result.error());
        taken = *std::move(result);
        if (options.dryRun && !options.json) break;
        if (auto here = fetchBlobs(link, taken.edits); !here) return here;
        // Others may have committed meanwhile.
        if (link.session().revision() == chosen.newest()) break;
    }
    const auto revision = options.dryRun || taken.edits.empty()
                              ? Result<Revision>(0)
                              : submitEdits(link, taken.edits, revertLabel(options));
    if (!revision) return tl::unexpected(revision.error());
    printDone(options, link, "reverted", options.dryRun, taken.edits, taken.kept, *revision);
    if (options.dryRun || taken.kept.empty()) return {};
    return fail(ErrorCode::InvalidArgument,
                counted(taken.kept.size(), "opinion") +
                    (taken.kept.size() == 1 ? " stays as it is" : " stay as they are"));
}

Result<void> restore(const RestoreOptions& options) {
    const auto reached = reach(options);
    if (!reached) return tl::unexpected(reached.error());
    Link& link = **reached;
    const auto to = revisionAt(link, options.to);
    if (!to) return tl::unexpected(to.error());
    for (const LayerId& layer : options.target.layers)
        if (!hasLayer(link, layer)) return tl::unexpected(noSuchLayer(layer));
    // Which layers have changed since, and where the path was.
    std::set<LayerId> changed, imported;
    std::optional<FormerPath> former;
    if (!options.path.empty()) former.emplace(options.target.layers.front(), options.path);
    auto read =
        client::readBackward(link, link.welcome().revision, *to + 1, [&](const Commit& commit) {
            for (auto edit = commit.edits.rbegin(); edit != commit.edits.rend(); ++edit) {
                changed.insert(edit->layer);
                if (former) former->goBefore(*edit);
            }
            if (commit.imported) imported.insert(*commit.imported);
            return true;
        });
    if (!read) return read;
    std::set<LayerId> layers(options.target.layers.begin(), options.target.layers.end());
    if (layers.empty()) layers = changed;
    for (const LayerId& layer : imported)
        if (layers.erase(layer) > 0)
            std::cerr << "usdlive: " << layer.value << " was not in use at " << inRevision(*to)
                      << ", and stays as it is\n";
    if (auto joined = joinLayers(link, layers); !joined) return joined;
    const auto then = contentsAt(link, layers, *to);
    if (!then) return tl::unexpected(then.error());
    Replay replay(link, *then, *to);
    std::vector<client::AuthoredEdit> edits;
    for (;;) {
        const Revision now = link.session().revision();
        if (auto done = replay.goTo(now); !done) return done;
        if (link.session().revision() != now) continue;
        edits.clear();
        for (const LayerId& layer : layers) {
            const LayerDoc& wanted = then->at(layer);
            auto some = restoring(layer, replay.matched(layer, wanted, *link.session().view(layer)),
                                  wanted, options.path, former ? former->path() : std::string());
            if (!some) return tl::unexpected(some.error());
            std::ranges::move(*some, std::back_inserter(edits));
        }
        if (options.dryRun && !options.json) break;
        if (auto here = fetchBlobs(link, edits); !here) return here;
        if (link.session().revision() == now) break;
    }
    const auto revision = options.dryRun || edits.empty()
                              ? Result<Revision>(0)
                              : submitEdits(link, edits, "Restore revision " + std::to_string(*to));
    if (!revision) return tl::unexpected(revision.error());
    printDone(options, link, "restored", options.dryRun, edits, {}, *revision);
    return {};
}

}  // namespace usdlive::cli
