// Searches the history: for commits, and for the authors of opinions.
#include "history/HistorySearch.h"

#include <algorithm>
#include <map>
#include <utility>

#include "usdlive/common/layer/Inverse.h"
#include "usdlive/common/layer/SpecPath.h"

namespace usdlive::client {

namespace {

constexpr Revision kReadAtOnce = 1'000;
// The most commits that one page looks at.
constexpr std::size_t kLookedAt = 10'000;
// The most revisions at which a layer is read for what was there before an opinion: each is read as
// a whole.
constexpr std::size_t kMostPriors = 20;

/// Reads a layer at earlier revisions, each once.
class Priors {
public:
    Priors(HistoryReader& reader, const LayerId& layer) : reader_(reader), layer_(layer) {}

    /// Sets the content before an opinion, if it is known.
    Result<void> complete(BlamedContent& one) {
        const BlamedOpinion& made = one.made;
        if (made.revision < 2 || made.isImport || made.field.empty() || made.pathThen.empty())
            return {};
        const Revision revision = made.revision - 1;
        if (revision < reader_.base()) return {};
        auto known = docs_.find(revision);
        if (known == docs_.end()) {
            if (docs_.size() >= kMostPriors) return {};
            auto read = reader_.readLayer(layer_, revision);
            // The history began earlier when the connection was made.
            if (!read && read.error().code == ErrorCode::HistoryReplaced) return {};
            if (!read) return tl::unexpected(read.error());
            known = docs_.emplace(revision, std::move(read->doc)).first;
        }
        const LayerDoc& doc = known->second;
        const FieldValue* field =
            doc.has(made.pathThen) ? doc.field(made.pathThen, made.field) : nullptr;
        one.prior = contentOf(field, made.part);
        one.isPriorKnown = true;
        return {};
    }

private:
    HistoryReader& reader_;
    const LayerId& layer_;
    std::map<Revision, LayerDoc> docs_;
};

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

}  // namespace

Commit onlyEdits(const Commit& commit, const std::vector<std::size_t>& edits) {
    Commit chosen = commit;
    chosen.edits.clear();
    for (const std::size_t index : edits) chosen.edits.push_back(commit.edits[index]);
    return chosen;
}

Result<LogPage> searchLog(HistoryReader& reader, const LogQuery& query) {
    const CommitFilter& filter = query.filter;
    if (!filter.path.empty()) {
        if (filter.layer.empty())
            return fail(ErrorCode::InvalidArgument,
                        "a path is one of a layer: name the layer of " + filter.path);
        if (const auto parsed = specpath::parse(filter.path); !parsed)
            return tl::unexpected(parsed.error());
    }
    const bool isPlain = filter.users.empty() && !filter.choosesEdits();
    const Revision newest = query.before > 0 ? query.before - 1 : reader.newest();
    CommitSearch search(filter);
    LogPage page;
    page.next = query;
    std::size_t looked = 0;
    const auto read = readBackward(
        reader, newest, reader.base() + 1,
        [&](const Commit& commit) {
            if (commit.timeMs < filter.sinceMs) {
                page.end = LogPage::End::Since;
                return false;
            }
            if (const auto found = search.look(commit))
                page.commits.push_back(filter.choosesEdits() ? onlyEdits(commit, found->edits)
                                                             : commit);
            page.next.before = commit.revision;
            if (page.commits.size() < query.limit && ++looked < kLookedAt) return true;
            page.end = LogPage::End::More;
            return false;
        },
        AtBase::End, isPlain ? std::clamp<Revision>(query.limit, 1, kReadAtOnce) : kReadAtOnce);
    if (!read) return tl::unexpected(read.error());
    page.next.filter.path = search.formerPath();
    return page;
}

Result<BlameResult> findBlame(HistoryReader& reader, const LayerId& layer, const std::string& path,
                              bool below) {
    auto now = reader.readLayer(layer, 0);
    if (!now) return tl::unexpected(now.error());
    const auto asked = specAndField(now->doc, layer, path);
    if (!asked) return tl::unexpected(asked.error());
    const auto& [spec, field] = *asked;
    Blame blame = field.empty() ? Blame(now->doc, layer, spec,
                                        below ? Blame::Depth::Below : Blame::Depth::Spec)
                                : Blame(now->doc, layer, spec, field);
    const auto read = readBackward(
        reader, now->revision, reader.base() + 1,
        [&](const auto& commit) {
            blame.add(commit);
            return !blame.isComplete();
        },
        AtBase::End);
    if (!read) return tl::unexpected(read.error());
    BlameResult result{now->revision, std::move(now->doc), {}};
    Priors priors(reader, layer);
    for (const BlamedOpinion& made : blame.opinions()) {
        BlamedContent one{made, {}, false, {}};
        if (!made.field.empty())
            one.content = contentOf(result.present.field(made.path, made.field), made.part);
        if (auto done = priors.complete(one); !done) return tl::unexpected(done.error());
        result.opinions.push_back(std::move(one));
    }
    return result;
}

}  // namespace usdlive::client
