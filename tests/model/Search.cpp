// Searches all reachable worlds of a scenario, the nearest first.
#include "Search.h"

#include <algorithm>
#include <cstring>
#include <limits>

namespace usdlive::model {

namespace {

using Index = std::uint32_t;

/// The visited worlds, by number; the table holds only numbers.
class Worlds {
public:
    [[nodiscard]] std::size_t size() const { return worlds_.size(); }
    [[nodiscard]] const World& operator[](Index index) const { return worlds_[index]; }

    /// Returns the number of a world, and whether it is new.
    std::pair<Index, bool> add(const World& world) {
        if (table_.size() < 2 * (worlds_.size() + 1)) grow();
        Index& slot = slotOf(world);
        if (slot != kFree) return {slot, false};
        slot = Index(worlds_.size());
        worlds_.push_back(world);
        return {slot, true};
    }

private:
    static constexpr Index kFree = std::numeric_limits<Index>::max();

    Index& slotOf(const World& world) {
        static_assert(std::has_unique_object_representations_v<World>);
        const std::string_view bytes(reinterpret_cast<const char*>(&world), sizeof world);
        std::size_t at = std::hash<std::string_view>()(bytes);
        for (;; ++at) {
            Index& slot = table_[at & (table_.size() - 1)];
            if (slot == kFree || worlds_[slot] == world) return slot;
        }
    }
    void grow() {
        table_.assign(std::max<std::size_t>(table_.size() * 2, 1024), kFree);
        for (Index index = 0; index < worlds_.size(); ++index) slotOf(worlds_[index]) = index;
    }

    std::vector<World> worlds_;
    std::vector<Index> table_;
};

class Search {
public:
    Search(Model& model, std::uint64_t most) : model_(model), most_(most) {}

    Found run() {
        try {
            visitAll();
            if (found_.exhausted) checkEnds();
        } catch (const Violation& violation) {
            found_.counterexample = {violation.what(), way_};
        }
        found_.states = worlds_.size();
        return std::move(found_);
    }

private:
    struct Origin {
        Index parent = 0;
        std::uint32_t action = 0;
    };

    void visitAll() {
        enter(model_.start(), {});
        Index levelEnd = 1;
        for (Index index = 0; index < worlds_.size(); ++index) {
            if (worlds_.size() >= most_) return;
            if (index == levelEnd) {
                ++found_.depth;
                levelEnd = Index(worlds_.size());
            }
            expand(index);
        }
        found_.exhausted = true;
    }

    void expand(Index index) {
        const World world = worlds_[index];
        const auto actions = model_.actions(world);
        const bool quiet = std::none_of(actions.begin(), actions.end(),
                                        [](Action action) { return action.isProgress(); });
        if (quiet) {
            ++found_.quiet;
            way_ = wayTo(index);
            model_.check(world, true);
        }
        progressBegins_.push_back(progress_.size());
        for (const Action action : actions) {
            ++found_.transitions;
            const Index next = follow(index, world, action);
            if (action.isProgress()) progress_.push_back(next);
        }
    }

    Index follow(Index from, const World& world, Action action) {
        try {
            return enter(model_.after(world, action), {from, action.packed()});
        } catch (const Violation&) {
            way_ = wayTo(from);
            way_.push_back(action);
            throw;
        }
    }

    Index enter(const World& world, Origin origin) {
        const auto [index, added] = worlds_.add(world);
        if (!added) return index;
        origins_.push_back(origin);
        model_.check(world, false);
        return index;
    }

    [[nodiscard]] std::vector<Action> wayTo(Index index) const {
        std::vector<Action> way;
        for (; index != 0; index = origins_[index].parent)
            way.push_back(Action::unpacked(origins_[index].action));
        std::reverse(way.begin(), way.end());
        return way;
    }

    // Repeatedly removes worlds that no step without a decision leads to: a circle remains.
    void checkEnds() {
        progressBegins_.push_back(progress_.size());
        std::vector<Index> entries(worlds_.size());
        for (const Index next : progress_) ++entries[next];
        std::vector<Index> free;
        for (Index index = 0; index < worlds_.size(); ++index)
            if (entries[index] == 0) free.push_back(index);
        for (std::size_t done = 0; done < free.size(); ++done)
            for (auto edge = progressBegins_[free[done]]; edge < progressBegins_[free[done] + 1];
                 ++edge)
                if (--entries[progress_[edge]] == 0) free.push_back(progress_[edge]);
        if (free.size() == worlds_.size()) return;
        const auto first =
            std::find_if(entries.begin(), entries.end(), [](Index count) { return count > 0; });
        way_ = wayTo(Index(first - entries.begin()));
        throw Violation("a run may continue for ever without becoming quiet");
    }

    Model& model_;
    const std::uint64_t most_;
    Found found_;
    Worlds worlds_;
    std::vector<Origin> origins_;
    std::vector<Index>
        progress_;  // for each world, the worlds to which steps without a decision lead
    std::vector<std::size_t> progressBegins_;
    std::vector<Action> way_;  // the way to the world that is being checked
};

}  // namespace

Found search(Model& model, std::uint64_t most) { return Search(model, most).run(); }

}  // namespace usdlive::model
