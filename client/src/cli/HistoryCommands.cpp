// Implements the verbs that read the history of a project.
#include "cli/HistoryCommands.h"

#include <algorithm>
#include <deque>
#include <iostream>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "cli/DifferenceLayer.h"
#include "cli/Json.h"
#include "cli/Reach.h"
#include "cli/Replay.h"
#include "cli/Text.h"
#include "history/HistorySearch.h"
#include "usdlive/common/layer/Inverse.h"
#include "usdlive/common/usd/LayerFill.h"

namespace usdlive::cli {

namespace {

Result<void> printCommits(const std::deque<std::string>& texts) {
    for (const auto& text : texts) std::cout << text;
    return {};
}

Result<std::string> shown(const Commit& commit, Link& link, const CommitView& view) {
    if (view.json)
        if (auto fetched = link.fetchBlobs(commit); !fetched)
            return tl::unexpected(fetched.error());
    return view.text(commit, link);
}

// Prints the latest commits that the filter chooses, the oldest first.
Result<void> showLatest(Link& link, std::size_t limit, const CommitView& view,
                        const CommitFilter& filter) {
    std::deque<std::string> texts;
    client::LogPage page;
    page.next = {filter, 0, limit};
    do {
        auto found = client::searchLog(link, page.next);
        if (!found) return tl::unexpected(found.error());
        page = *std::move(found);
        for (const Commit& commit : page.commits) {
            auto text = shown(commit, link, view);
            if (!text) return tl::unexpected(text.error());
            texts.push_front(*std::move(text));
        }
        page.next.limit = limit - texts.size();
    } while (page.end == client::LogPage::End::More && page.next.limit > 0);
    if (page.end == client::LogPage::End::Base) warnOfBase(link.base());
    return printCommits(texts);
}

Result<void> showFrom(Link& link, const LogOptions& options, const CommitView& view,
                      const CommitFilter& filter) {
    constexpr Revision kPage = 1'000;
    const Revision newest = link.welcome().revision;
    if (options.from > newest)
        return fail(ErrorCode::FutureRevision,
                    "the project is at revision " + std::to_string(newest));
    CommitSearch search(filter);  // without a path, in any order
    std::size_t count = 0;
    for (Revision from = options.from; from <= newest && count < options.limit; from += kPage) {
        const auto commits = link.readLog(from, std::min(from + kPage - 1, newest));
        if (!commits) return tl::unexpected(commits.error());
        for (const auto& commit : *commits) {
            const auto found = search.look(commit);
            if (!found || count++ >= options.limit) continue;
            const auto text =
                shown(filter.choosesEdits() ? client::onlyEdits(commit, found->edits) : commit,
                      link, view);
            if (!text) return tl::unexpected(text.error());
            std::cout << *text;
        }
    }
    return {};
}

std::string partText(const BlamedOpinion& one) {
    if (one.field.empty()) return {};
    const Edit edit{{}, {one.path, {}}, EraseField{one.field, one.part}, {}};
    // Without the name of the action and the path.
    const std::string text = describe(edit);
    return text.substr(text.find(one.path) + one.path.size());
}

Result<void> printBlame(const client::BlameResult& blame, Link& link, bool json) {
    Json all = Json::array();
    const Palette palette = Palette::of(STDOUT_FILENO);
    for (const auto& [made, content, isPriorKnown, prior] : blame.opinions) {
        if (json) {
            Json line{{"path", made.path}, {"field", made.field}, {"part", partText(made)}};
            if (content) line["value"] = toJson(*content, link);
            if (made.revision > 0) {
                line.update({{"revision", made.revision},
                             {"user", made.user.value},
                             {"timeMs", made.timeMs},
                             {"imported", made.isImport}});
                if (isPriorKnown) line["before"] = prior ? toJson(*prior, link) : Json();
            }
            all.push_back(std::move(line));
            continue;
        }
        std::cout << describe(made, link.base(), palette) << "  " << made.path << partText(made);
        if (content) std::cout << " = " << describe(*content);
        if (isPriorKnown)
            std::cout << palette.paint("  was " + (prior ? describe(*prior) : "nothing"),
                                       Colour::Dim);
        std::cout << "\n";
    }
    if (json) std::cout << line(all);
    return {};
}

}  // namespace

Result<void> log(const LogOptions& options) {
    const auto link = reach(options);
    if (!link) return tl::unexpected(link.error());
    const auto filter = filterFor(**link, options, options.filter);
    if (!filter) return tl::unexpected(filter.error());
    const CommitView view{filter->layer, options.all ? std::size_t(-1) : kEditsShown, options.json};
    return options.from == 0 ? showLatest(**link, options.limit, view, *filter)
                             : showFrom(**link, options, view, *filter);
}

Result<void> blame(const BlameOptions& options) {
    const auto link = reach(options);
    if (!link) return tl::unexpected(link.error());
    const auto layer = chosenLayer(**link, options);
    if (!layer) return tl::unexpected(layer.error());
    const auto found = client::findBlame(**link, *layer, options.path, options.below);
    if (!found) return tl::unexpected(found.error());
    if (options.json)
        if (auto here = (*link)->fetchBlobs(found->present); !here) return here;
    return printBlame(*found, **link, options.json);
}

Result<void> diff(const DiffOptions& options) {
    const auto link = reach(options);
    if (!link) return tl::unexpected(link.error());
    const auto layer = chosenLayer(**link, options);
    if (!layer) return tl::unexpected(layer.error());
    LayerDoc docs[2];
    Revision revisions[2];
    for (const int side : {0, 1}) {
        const auto revision = revisionAt(**link, side == 0 ? options.from : options.to);
        if (!revision) return tl::unexpected(revision.error());
        auto fetched = (*link)->readLayer(*layer, *revision);
        if (!fetched) return tl::unexpected(fetched.error());
        docs[side] = std::move(fetched->doc);
        revisions[side] = *revision;
    }
    const int earlier = revisions[0] <= revisions[1] ? 0 : 1;
    Replay replay(**link, {{*layer, docs[earlier]}}, revisions[earlier]);
    if (auto done = replay.goTo(revisions[1 - earlier]); !done) return done;
    docs[1 - earlier] = replay.matched(*layer, docs[earlier], docs[1 - earlier]);
    const auto& [from, to] = docs;
    if (!options.path.empty() && !from.has(options.path) && !to.has(options.path))
        return fail(ErrorCode::SpecNotFound,
                    layer->value + " has nothing at " + options.path + ", neither then nor later");
    const auto edits = restoring(*layer, from, to, options.path, options.path);
    if (!edits) return tl::unexpected(edits.error());
    const Commit changes = commitOf(*edits);
    if (options.asLayer || options.json)
        if (auto here = (*link)->fetchBlobs(changes); !here) return here;
    if (options.asLayer) {
        const auto text = usd::exportText(differenceLayer(to, changes.edits), **link);
        if (!text) return tl::unexpected(text.error());
        std::cout << *text;
        for (const Edit& edit : changes.edits)
            if (!isInDifferenceLayer(edit.action))
                std::cout << "# no layer can say this: " << describe(edit) << "\n";
        return {};
    }
    // The content that each edit replaces, at its path of then.
    std::vector<std::optional<FieldValue>> replaced;
    LayerDoc work = from;
    for (const Edit& edit : changes.edits) {
        replaced.push_back(replacedBy(work, edit));
        (void)work.apply(edit.address.path, edit.action);
    }
    if (options.json) {
        Json json = toJson(changes, {}, **link)["edits"];
        for (std::size_t index = 0; index < replaced.size(); ++index)
            if (replaced[index]) json[index]["before"] = toJson(*replaced[index], **link);
        std::cout << line(Json{{"layer", layer->value},
                               {"from", revisions[0]},
                               {"to", revisions[1]},
                               {"edits", std::move(json)}});
        return {};
    }
    const Palette palette = Palette::of(STDOUT_FILENO);
    for (std::size_t index = 0; index < replaced.size(); ++index) {
        std::cout << describe(changes.edits[index]);
        if (replaced[index])
            std::cout << palette.paint("  was " + describe(*replaced[index]), Colour::Dim);
        std::cout << "\n";
    }
    if (edits->empty())
        std::cerr << "usdlive: " << layer->value << " is the same at " << inRevision(revisions[0])
                  << " and " << inRevision(revisions[1]) << "\n";
    return {};
}

}  // namespace usdlive::cli
