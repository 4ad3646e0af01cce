// Implements the verbs that read the history of a project.
#include "cli/HistoryCommands.h"

#include <algorithm>
#include <deque>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "cli/DifferenceLayer.h"
#include "cli/Json.h"
#include "cli/Reach.h"
#include "cli/Replay.h"
#include "cli/Text.h"
#include "usdlive/common/history/Blame.h"
#include "usdlive/common/layer/Inverse.h"
#include "usdlive/common/usd/LayerFill.h"

namespace usdlive::cli {

namespace {

Commit only(const Commit& commit, const std::vector<std::size_t>& edits) {
    Commit chosen = commit;
    chosen.edits.clear();
    for (const std::size_t index : edits) chosen.edits.push_back(commit.edits[index]);
    return chosen;
}

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
    constexpr Revision kPage = 1'000;
    const Revision base = baseOf(link);
    CommitSearch search(filter);
    std::deque<std::string> texts;
    std::optional<Error> failed;
    bool isOlder = false;
    const bool isPlain = filter.users.empty() && !filter.choosesEdits();
    const auto read = readBackward(
        link, link.welcome().revision, base + 1,
        [&](const Commit& commit) {
            isOlder = commit.timeMs < filter.sinceMs;
            if (isOlder) return false;
            const auto found = search.look(commit);
            if (!found) return true;
            auto text =
                shown(filter.choosesEdits() ? only(commit, found->edits) : commit, link, view);
            if (!text)
                failed = text.error();
            else
                texts.push_front(*std::move(text));
            return !failed && texts.size() < limit;
        },
        isPlain ? std::min<Revision>(kPage, limit) : kPage);
    if (!read) return read;
    if (failed) return tl::unexpected(*failed);
    if (texts.size() < limit && !isOlder) warnOfBase(base);
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
        const auto commits = readLog(link, from, std::min(from + kPage - 1, newest));
        if (!commits) return tl::unexpected(commits.error());
        for (const auto& commit : *commits) {
            const auto found = search.look(commit);
            if (!found || count++ >= options.limit) continue;
            const auto text =
                shown(filter.choosesEdits() ? only(commit, found->edits) : commit, link, view);
            if (!text) return tl::unexpected(text.error());
            std::cout << *text;
        }
    }
    return {};
}

/// Reads layers at earlier revisions, each once.
class Past {
public:
    explicit Past(Link& link) : link_(link) {}

    /// Returns nullptr if the layer did not exist then.
    Result<const LayerDoc*> at(const LayerId& layer, Revision revision) {
        auto& known = docs_[{layer, revision}];
        if (!known) {
            auto fetched = link_.fetch(layer, revision);
            if (!fetched) return tl::unexpected(fetched.error());
            known = std::move(fetched->doc);
        }
        return &*known;
    }
    [[nodiscard]] std::size_t count() const { return docs_.size(); }

private:
    Link& link_;
    std::map<std::pair<LayerId, Revision>, std::optional<LayerDoc>> docs_;
};

std::string partText(const BlamedOpinion& one) {
    if (one.field.empty()) return {};
    const Edit edit{{}, {one.path, {}}, EraseField{one.field, one.part}, {}};
    // Without the name of the action and the path.
    const std::string text = describe(edit);
    return text.substr(text.find(one.path) + one.path.size());
}

Result<std::pair<std::string, std::string>> specAndField(const LayerDoc& doc, const LayerId& layer,
                                                         const std::string& path) {
    const auto isSpec = [&](const std::string& one) {
        return specpath::parse(one) && doc.has(one);
    };
    if (isSpec(path)) return std::pair(path, std::string());
    const std::size_t dot = path.rfind('.');
    if (dot != std::string::npos) {
        std::string spec = path.substr(0, dot), field = path.substr(dot + 1);
        if (isSpec(spec) && doc.field(spec, field)) return std::pair(spec, field);
        if (isSpec(spec))
            return fail(ErrorCode::SpecNotFound, layer.value + " has no property and no field " +
                                                     field + " at " + spec +
                                                     "; `usdlive log --path` shows what it had");
    }
    return fail(ErrorCode::SpecNotFound,
                layer.value + " has nothing at " + path + "; `usdlive tree` shows its prims");
}

struct Prior {
    std::string text;  // empty: unknown
    Json json;
};

// Returns the content before an opinion.
Result<Prior> priorOf(const BlamedOpinion& one, const LayerId& layer, Past& past, Link& link) {
    constexpr std::size_t kMostLayers = 20;  // each is read as a whole
    if (one.revision < 2 || one.isImport || one.field.empty() || one.pathThen.empty())
        return Prior{};
    if (past.count() >= kMostLayers || one.revision - 1 < baseOf(link)) return Prior{};
    const auto then = past.at(layer, one.revision - 1);
    if (!then) return tl::unexpected(then.error());
    const FieldValue* field =
        (*then)->has(one.pathThen) ? (*then)->field(one.pathThen, one.field) : nullptr;
    const auto content = contentOf(field, one.part);
    if (!content) return Prior{"nothing", nullptr};
    return Prior{describe(*content), toJson(*content, link)};
}

Result<void> printBlame(const Blame& blame, const LayerDoc& doc, const LayerId& layer, Link& link,
                        bool json) {
    Past past(link);
    Json all = Json::array();
    const Palette palette = Palette::of(STDOUT_FILENO);
    for (const BlamedOpinion& one : blame.opinions()) {
        const auto prior = priorOf(one, layer, past, link);
        if (!prior) return tl::unexpected(prior.error());
        const auto content =
            one.field.empty() ? std::nullopt : contentOf(doc.field(one.path, one.field), one.part);
        if (json) {
            Json line{{"path", one.path}, {"field", one.field}, {"part", partText(one)}};
            if (content) line["value"] = toJson(*content, link);
            if (one.revision > 0) {
                line.update({{"revision", one.revision},
                             {"user", one.user.value},
                             {"timeMs", one.timeMs},
                             {"imported", one.isImport}});
                if (!prior->text.empty()) line["before"] = prior->json;
            }
            all.push_back(std::move(line));
            continue;
        }
        std::cout << describe(one, baseOf(link), palette) << "  " << one.path << partText(one);
        if (content) std::cout << " = " << describe(*content);
        if (!prior->text.empty()) std::cout << palette.paint("  was " + prior->text, Colour::Dim);
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
    const auto now = (*link)->fetch(*layer, 0);
    if (!now) return tl::unexpected(now.error());
    const auto asked = specAndField(now->doc, *layer, options.path);
    if (!asked) return tl::unexpected(asked.error());
    const auto& [path, field] = *asked;
    Blame blame = field.empty() ? Blame(now->doc, *layer, path,
                                        options.below ? Blame::Depth::Below : Blame::Depth::Spec)
                                : Blame(now->doc, *layer, path, field);
    const auto read =
        readBackward(**link, now->revision, baseOf(**link) + 1, [&](const Commit& commit) {
            blame.add(commit);
            return !blame.isComplete();
        });
    if (!read) return read;
    if (options.json)
        if (auto here = (*link)->fetchBlobs(now->doc); !here) return here;
    return printBlame(blame, now->doc, *layer, **link, options.json);
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
        auto fetched = (*link)->fetch(*layer, *revision);
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
