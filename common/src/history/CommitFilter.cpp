// Chooses commits and edits of the history.
#include "usdlive/common/history/CommitFilter.h"

#include <algorithm>
#include <string_view>
#include <unordered_set>
#include <utility>

#include "usdlive/common/layer/SpecPath.h"

namespace usdlive {

namespace {

// Tells the kinds of a commit's edits, in order. A spec that the commit has created states nothing
// by being there.
class KindsOfCommit {
public:
    std::optional<OpinionKind> of(const Edit& edit) {
        const std::string& path = edit.address.path;
        const auto kind = opinionKindOf(path, edit.action, !isNew(edit.layer, path));
        if (std::holds_alternative<CreateSpec>(edit.action))
            created_.insert(edit.layer.value + '\n' + path);
        return kind;
    }

private:
    [[nodiscard]] bool isNew(const LayerId& layer, std::string path) const {
        for (; path.size() > 1; path = specpath::parent(path))
            if (created_.contains(layer.value + '\n' + path)) return true;
        return false;
    }

    std::unordered_set<std::string> created_;
};

/// Letters of ASCII count in any case.
bool containsText(std::string_view text, std::string_view part) {
    const auto lower = [](char one) { return one >= 'A' && one <= 'Z' ? char(one + 32) : one; };
    return !std::ranges::search(text, part, {}, lower, lower).empty() || part.empty();
}

}  // namespace

CommitSearch::CommitSearch(CommitFilter filter) : filter_(std::move(filter)) {
    if (!filter_.path.empty()) path_.emplace(filter_.layer, filter_.path);
}

std::optional<CommitSearch::Found> CommitSearch::look(const Commit& commit) {
    const bool isChosen = (filter_.users.empty() || filter_.users.contains(commit.user)) &&
                          commit.timeMs >= filter_.sinceMs && commit.timeMs <= filter_.untilMs &&
                          containsText(commit.label, filter_.label);
    if (!isChosen && !path_) return std::nullopt;
    std::vector<bool> fits(commit.edits.size(), true);
    if (!filter_.kinds.empty()) {
        KindsOfCommit kinds;
        for (std::size_t index = 0; index < fits.size(); ++index) {
            const auto kind = kinds.of(commit.edits[index]);
            fits[index] = kind && filter_.kinds.contains(*kind);
        }
    }
    for (std::size_t index = fits.size(); index-- > 0;) {
        const Edit& edit = commit.edits[index];
        if (!filter_.layer.empty() && edit.layer != filter_.layer) fits[index] = false;
        if (!path_) continue;
        if (!path_->isConcernedBy(edit)) fits[index] = false;
        path_->goBefore(edit);
    }
    if (!isChosen) return std::nullopt;
    Found found;
    for (std::size_t index = 0; index < fits.size(); ++index)
        if (fits[index]) found.edits.push_back(index);
    if (found.edits.empty() && filter_.choosesEdits() &&
        !(commit.imported == filter_.layer && !path_ && filter_.kinds.empty()))
        return std::nullopt;
    return found;
}

}  // namespace usdlive
