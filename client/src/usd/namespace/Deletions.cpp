// Finds out what an edit deletes by composing copies of the stages with the edit made.
#include "usd/namespace/Deletions.h"

#include <algorithm>
#include <unordered_map>

#include "usd/stage/Composition.h"

namespace usdlive::naming {

using pxr::PcpPrimIndex;
using pxr::SdfPath;

namespace {

/// Composes single prims of a stage that no longer changes.
class Lookup {
public:
    explicit Lookup(const ComposedStage& stage)
        : view_(stage.view()),
          composition_(stage.layers(), view_.muted,
                       {[](const PcpPrimIndex&, pxr::TfTokenVector*) { return true; },
                        [this](const SdfPath& path) { return view_.isLoaded(path); }},
                       view_.variantFallbacks) {}

    /// Returns null if the stage has no such prim.
    [[nodiscard]] const PcpPrimIndex* prim(const SdfPath& path) {
        const auto prefixes = path.GetPrefixes();
        return std::ranges::all_of(prefixes, [&](const SdfPath& one) { return isChild(one); })
                   ? composition_.primIndex(path)
                   : nullptr;
    }

private:
    bool isChild(const SdfPath& path) {
        const SdfPath parent = path.GetParentPath();
        const auto [known, isNew] = children_.try_emplace(parent);
        const auto* index = isNew ? composition_.primIndex(parent) : nullptr;
        if (index && ComposedStage::isActive(*index))
            for (const auto& name : composition_.childNames(parent)) known->second.insert(name);
        return known->second.count(path.GetNameToken()) > 0 && view_.includes(path);
    }

    const StageView& view_;
    stage::Composition composition_;
    std::unordered_map<SdfPath, pxr::PcpTokenSet, SdfPath::Hash> children_;
};

/// Compares a stage with the same stage after an edit.
class Comparison {
public:
    Comparison(ComposedStage& before, const ComposedStage& after, PathMoves& deleted)
        : before_(before), after_(after), deleted_(deleted) {}

    /// Notes the objects at and below a path that no longer exist.
    void note(const SdfPath& path) {
        const auto* now = after_.prim(path.GetPrimPath());
        const bool exists = now && (path.IsPrimPath() ||
                                    ComposedStage::hasAuthoredProperty(*now, path.GetNameToken()));
        if (!exists)
            deleted_.push_back({path, SdfPath()});
        else if (const auto* prim = path.IsPrimPath() ? before_.prim(path) : nullptr)
            noteBelow(path, *prim, *now);
    }

private:
    void noteBelow(const SdfPath& path, const PcpPrimIndex& prim, const PcpPrimIndex& now) {
        pxr::TfTokenVector properties, children;
        pxr::PcpTokenSet prohibited;
        prim.ComputePrimPropertyNames(&properties);
        for (const auto& name : properties)
            if (!ComposedStage::hasAuthoredProperty(now, name))
                deleted_.push_back({path.AppendProperty(name), SdfPath()});
        prim.ComputePrimChildNames(&children, &prohibited);
        for (const auto& name : children)
            if (const SdfPath child = path.AppendChild(name); before_.prim(child)) note(child);
    }

    ComposedStage& before_;
    Lookup after_;
    PathMoves& deleted_;
};

}  // namespace

void Deletions::addDeleted(Plan& plan) {
    const bool isNeeded = std::ranges::any_of(
        plan.reportedDeleted, [](const auto& reported) { return !reported.empty(); });
    if (!after_ && !isNeeded) return;
    if (!after_) after_.emplace(stages_);
    after_->apply(plan);
    for (std::size_t i = 0; i < plan.reportedDeleted.size(); ++i) {
        if (plan.reportedDeleted[i].empty()) continue;
        const auto stage = [i](const Stages& all) {
            return i == 0 ? all.edited : all.dependents[i - 1];
        };
        Comparison comparison(*stage(stages_), *stage(after_->stages()), plan.objects[i]);
        for (const SdfPath& path : plan.reportedDeleted[i]) comparison.note(path);
    }
}

}  // namespace usdlive::naming
