// Replays commits, and takes the chosen edits back.
#include "session/Reversal.h"

#include <limits>
#include <optional>
#include <utility>

namespace usdlive::client {

namespace {

// The chosen edits are taken back as a whole or not at all.
constexpr UndoStack::Bounds kUnbounded{std::numeric_limits<std::size_t>::max(),
                                       std::numeric_limits<std::size_t>::max()};

// Notes the inverse of each edit of a run while it is applied.
class Noted final : public AppliedEdits {
public:
    Noted(UndoStack& stack, const Commit& run) : stack_(stack), run_(run) {}

    void before(const LayerDoc& doc, const Edit& edit) override {
        inverse_.reset();
        if (concernsPlace(edit.action) && !doc.has(edit.address.path)) return;  // M15: no effect
        if (!stack_.goesWithCreated(run_.revision, authored(edit)))
            inverse_ = inverseBefore(doc, edit.address.path, edit.action);
    }
    void after(const LayerDoc& doc, const Edit& edit) override {
        if (!inverse_) return;
        const auto index = std::uint32_t(&edit - run_.edits.data());
        UndoStack::Executed one{index, &edit, *inverse_, 0};
        completeInverse(one.inverse, doc, edit.address.path);
        stack_.add(run_.revision, index, authored(edit), *std::move(inverse_), doc,
                   run_.revision - 1);
        executed_.push_back(std::move(one));
    }
    [[nodiscard]] std::vector<UndoStack::Executed> take(const NamespaceLog& log) {
        auto one = executed_.begin();
        forEachExecuted(log, run_, [&](const Edit& edit, std::uint32_t, std::uint64_t mark) {
            if (one != executed_.end() && one->edit == &edit) (one++)->mark = mark;
        });
        return std::move(executed_);
    }

private:
    static AuthoredEdit authored(const Edit& edit) {
        return {edit.layer, edit.address.path, edit.action};
    }

    UndoStack& stack_;
    const Commit& run_;
    std::optional<Inverse> inverse_;
    std::vector<UndoStack::Executed> executed_;
};

}  // namespace

Reversal::Reversal(LayerDocs before) : layers_(std::move(before)), stack_(kUnbounded) {
    stack_.begin({});
}

Result<void> Reversal::add(const Commit& commit, const Chosen& chosen) {
    const bool isImport = commit.imported.has_value();
    if (isImport && !commit.edits.empty())
        if (const auto layer = layers_.find(*commit.imported); layer != layers_.end())
            layer->second = LayerDoc();
    std::optional<bool> ofRun;
    Commit run;
    run.id.client = commit.id.client;
    run.user = commit.user;
    const auto end = [&]() -> Result<void> {
        if (run.edits.empty()) return {};
        run.revision = ++runs_;
        auto added = *ofRun ? addOwn(run) : addOthers(run);
        run.edits.clear();
        return added;
    };
    for (const Edit& edit : commit.edits) {
        if (!layers_.contains(edit.layer)) continue;
        const bool isChosen = !isImport && chosen(edit);
        if (ofRun && *ofRun != isChosen)
            if (auto added = end(); !added) return added;
        ofRun = isChosen;
        count_ += isChosen;
        run.edits.push_back(edit);
    }
    return end();
}

Result<void> Reversal::addOwn(const Commit& run) {
    Noted noted(stack_, run);
    auto applied = applyCommit(layers_, log_, run, &noted);
    if (!applied) return applied;
    stack_.committed(run.revision, run.revision, noted.take(log_));
    follow();
    return {};
}

Result<void> Reversal::addOthers(const Commit& run) {
    auto applied = applyCommit(layers_, log_, run);
    if (!applied) return applied;
    stack_.othersCommitted(log_, run);
    for (const Edit& edit : run.edits) stack_.shown(edit.layer, edit.address.path, edit.action);
    follow();
    return {};
}

// The view of this stack is the layers themselves.
void Reversal::follow() {
    stack_.follow([this](const LayerId& layer, const std::string& path, std::uint64_t mark) {
        return log_.translateFrom(layer, path, mark);
    });
    log_.prune(runs_);
}

Reversal::TakenBack Reversal::takeBack() {
    TakenBack taken;
    stack_.end();
    const Revision last = ++runs_;
    const auto author = [&](AuthoredEdit edit) -> Result<void> {
        LayerDoc& doc = layers_.at(edit.layer);
        Inverse inverse = inverseBefore(doc, edit.path, edit.action);
        auto applied = doc.apply(edit.path, edit.action, LayerDoc::By::Author);
        if (!applied) return tl::unexpected(std::move(applied.error()));
        if (!applied->changed && concernsPlace(edit.action)) return {};  // M15: nothing is there
        stack_.add(last, std::uint32_t(taken.edits.size()), edit, std::move(inverse), doc,
                   last - 1);
        taken.edits.push_back(std::move(edit));
        return {};
    };
    const LayerDocs present = layers_;
    const auto docOf = [this](const LayerId& layer) -> const LayerDoc* {
        const auto found = layers_.find(layer);
        return found == layers_.end() ? nullptr : &found->second;
    };
    taken.kept = stack_.takeBack(UndoStack::Direction::Undo, docOf, author).kept;
    layers_ = present;
    return taken;
}

}  // namespace usdlive::client
