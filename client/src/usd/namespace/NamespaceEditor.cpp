// Collects, validates and applies the batch of a NamespaceEditor.
#include "usdlive/client/usd/namespace/NamespaceEditor.h"

#include <pxr/base/tf/stringUtils.h>

#include <map>
#include <optional>
#include <set>
#include <thread>
#include <utility>

#include "usd/namespace/Application.h"
#include "usd/namespace/ComposedStage.h"
#include "usd/namespace/Deletions.h"
#include "usd/namespace/PathIndex.h"
#include "usd/namespace/Planner.h"
#include "usd/namespace/ScratchStages.h"
#include "usdlive/client/usd/Misuse.h"

namespace usdlive {

using naming::ComposedStage;
using naming::Plan;
using pxr::SdfPath;
using pxr::TfToken;

std::string CanApplyResult::whyNot() const { return pxr::TfStringJoin(errors, "; "); }

namespace {

bool isPrimEditPath(const SdfPath& path) {
    return path.IsPrimPath() && path.IsAbsolutePath() && !path.ContainsPrimVariantSelection();
}
bool isPropertyEditPath(const SdfPath& path) {
    return path.IsPrimPropertyPath() && path.IsAbsolutePath() &&
           !path.ContainsPrimVariantSelection();
}

/// A stage and its composition.
struct OpenStage {
    std::unique_ptr<EditedStage> host;
    std::unique_ptr<ComposedStage> composed;
    pxr::SdfLayerRefPtr root, session;

    /// Returns null if the stage no longer exists.
    ComposedStage* open() {
        const auto rootNow = host->rootLayer(), sessionNow = host->sessionLayer();
        if (!rootNow) return nullptr;
        const auto view = host->view();
        // Both sides are handles, because comparing a pointer with a handle would recurse.
        if (!composed || pxr::SdfLayerHandle(root) != rootNow ||
            pxr::SdfLayerHandle(session) != sessionNow || composed->view() != view) {
            root = rootNow;
            session = sessionNow;
            composed = std::make_unique<ComposedStage>(root, session, view);
        }
        return composed.get();
    }
};

}  // namespace

class NamespaceEditor::Impl {
public:
    Impl(std::unique_ptr<EditedStage> stage, Options options)
        : options_(options), stage_{std::move(stage), nullptr, {}, {}} {}

    bool add(bool isProperty, const SdfPath& from, const SdfPath& to, bool isMove) {
        check("an edit");
        const auto isValid = isProperty ? isPropertyEditPath : isPrimEditPath;
        const std::string kind = isProperty ? "property" : "prim";
        invalid_.clear();
        if (!isValid(from))
            invalid_ = "Invalid path '" + from.GetString() + "' provided as the source for a " +
                       kind + " namespace edit.";
        else if (isMove && !isValid(to))
            invalid_ = "Invalid path '" + to.GetString() + "' provided as the destination for a " +
                       kind + " namespace edit.";
        hasInvalid_ = hasInvalid_ || !invalid_.empty();
        if (invalid_.empty()) edits_.push_back({from, to});
        return invalid_.empty();
    }

    CanApplyResult canApply() {
        check("CanApplyEdits");
        CanApplyResult result;
        (void)process(result);
        return result;
    }

    CanApplyResult apply() {
        check("ApplyEdits");
        CanApplyResult result;
        const auto application = process(result);
        clear();
        if (!result) return result;
        if (auto record = application->apply())
            record_ = std::move(*record);
        else
            result.errors.push_back(record.error().message);
        return result;
    }

    pxr::SdfLayerHandleVector layersToEdit() {
        check("GetLayersToEdit");
        CanApplyResult result;
        const auto application = process(result);
        return result ? application->layers() : pxr::SdfLayerHandleVector();
    }

    void clear() {
        check("ClearEdits");
        edits_.clear();
        hasInvalid_ = false;
    }

    void prepare() {
        check("Prepare");
        std::vector<Plan> none;
        if (const auto stages = openStages())
            for (const auto& layer : stages->edited->localLayers()->GetLayers())
                index_.of(layer).read();
    }

    void check(const char* function) const {
        if (std::this_thread::get_id() != thread_)
            throw Misuse({ErrorCode::InvalidEdit,
                          std::string("NamespaceEditor: ") + function +
                              " was called on another thread than the one that made the editor"});
    }

    const Options options_;
    OpenStage stage_;
    std::map<std::size_t, OpenStage> dependents_;
    std::size_t lastDependent_ = 0;
    std::vector<Edit> edits_;
    bool hasInvalid_ = false;
    std::string invalid_;
    NamespaceRecord record_;

private:
    // Returns nothing if the edited stage no longer exists. Leaves out dependent stages that no
    // longer exist.
    std::optional<naming::Stages> openStages() {
        naming::Stages stages;
        stages.edited = stage_.open();
        if (!stages.edited) return std::nullopt;
        for (auto& [number, dependent] : dependents_)
            if (auto* composed = dependent.open()) stages.dependents.push_back(composed);
        stages.host = stage_.host.get();
        const auto target = stage_.host->editTarget();
        stages.editTarget = target.layer ? target.layer : pxr::SdfLayerHandle(stage_.root);
        stages.targetMapsPaths = target.mapsPaths;
        return stages;
    }

    std::optional<naming::Application> process(CanApplyResult& result) {
        if (edits_.empty() || hasInvalid_) {
            result.errors.emplace_back("There are no valid edits to perform");
            return std::nullopt;
        }
        const auto stages = openStages();
        if (!stages) {
            result.errors.emplace_back("The stage to edit is no longer open");
            return std::nullopt;
        }
        const auto plans = planAll(*stages, result);
        if (!result) return std::nullopt;
        naming::Application application(plans, index_);
        result.errors = application.errors();
        return application;
    }

    std::vector<Plan> planAll(const naming::Stages& stages, CanApplyResult& result) {
        if (edits_.size() == 1) {
            std::vector<Plan> plans{naming::planEdit(stages, edits_.front(), options_)};
            result.errors = plans.front().errors;
            result.warnings = plans.front().warnings;
            if (result) naming::Deletions(stages).addDeleted(plans.front());
            return plans;
        }
        auto plans = planApart(stages);
        if (plans.empty()) return planInOrder(stages, result);
        for (std::size_t i = 0; i < plans.size(); ++i)
            for (const auto& warning : plans[i].warnings)
                result.warnings.push_back(named(i) + warning);
        return plans;
    }

    // Makes the plans of edits that do not concern each other, on the stage as it is. Returns
    // nothing if some may do so.
    std::vector<Plan> planApart(const naming::Stages& stages) const {
        std::vector<Plan> plans;
        naming::MoveSteps steps;
        for (const Edit& edit : edits_) {
            auto plan = naming::planEdit(stages, edit, options_);
            if (!plan.errors.empty() || plan.concernsMore() || steps.addAtOnce(plan.touched()) > 0)
                return {};
            plans.push_back(std::move(plan));
        }
        return plans;
    }

    // Makes the plans on copies of the layers, so that each edit sees the edits before it.
    std::vector<Plan> planInOrder(const naming::Stages& stages, CanApplyResult& result) const {
        std::vector<Plan> plans;
        const naming::ScratchStages scratch(stages);
        naming::Deletions deletions(scratch.stages());
        for (std::size_t i = 0; i < edits_.size(); ++i) {
            auto plan = naming::planEdit(scratch.stages(), edits_[i], options_);
            if (plan.errors.empty()) deletions.addDeleted(plan);
            auto real = scratch.toReal(std::move(plan));
            for (const auto& error : real.errors) result.errors.push_back(named(i) + error);
            for (const auto& warning : real.warnings) result.warnings.push_back(named(i) + warning);
            if (!result) return {};
            plans.push_back(std::move(real));
            if (i + 1 < edits_.size()) scratch.apply(plans.back());
        }
        return plans;
    }

    [[nodiscard]] std::string named(std::size_t i) const {
        const auto& [from, to] = edits_[i];
        return "Edit " + std::to_string(i + 1) + " of " + std::to_string(edits_.size()) +
               (to.IsEmpty() ? ", delete <" + from.GetString() + ">"
                             : ", <" + from.GetString() + "> to <" + to.GetString() + ">") +
               ": ";
    }

    const std::thread::id thread_ = std::this_thread::get_id();
    naming::PathIndex index_;
};

NamespaceEditor::NamespaceEditor(std::unique_ptr<EditedStage> stage, Options options)
    : impl_(std::make_unique<Impl>(std::move(stage), options)) {}
NamespaceEditor::NamespaceEditor(stage::Stage& stage, Options options)
    : NamespaceEditor(editedStage(stage), options) {}
NamespaceEditor::~NamespaceEditor() = default;

bool NamespaceEditor::DeletePrimAtPath(const SdfPath& path) {
    return impl_->add(false, path, {}, false);
}
bool NamespaceEditor::MovePrimAtPath(const SdfPath& path, const SdfPath& newPath) {
    return impl_->add(false, path, newPath, true);
}
bool NamespaceEditor::RenamePrim(const SdfPath& path, const TfToken& newName) {
    return MovePrimAtPath(path, path.IsPrimPath() ? path.ReplaceName(newName) : SdfPath());
}
bool NamespaceEditor::ReparentPrim(const SdfPath& path, const SdfPath& newParent) {
    return ReparentPrim(path, newParent, path.GetNameToken());
}
bool NamespaceEditor::ReparentPrim(const SdfPath& path, const SdfPath& newParent,
                                   const TfToken& newName) {
    const bool isParent = newParent.IsAbsoluteRootOrPrimPath();
    return MovePrimAtPath(path, isParent ? newParent.AppendChild(newName) : SdfPath());
}
bool NamespaceEditor::DeletePropertyAtPath(const SdfPath& path) {
    return impl_->add(true, path, {}, false);
}
bool NamespaceEditor::MovePropertyAtPath(const SdfPath& path, const SdfPath& newPath) {
    return impl_->add(true, path, newPath, true);
}
bool NamespaceEditor::RenameProperty(const SdfPath& path, const TfToken& newName) {
    return MovePropertyAtPath(path,
                              path.IsPrimPropertyPath() ? path.ReplaceName(newName) : SdfPath());
}
bool NamespaceEditor::ReparentProperty(const SdfPath& path, const SdfPath& newParent) {
    return ReparentProperty(path, newParent, path.GetNameToken());
}
bool NamespaceEditor::ReparentProperty(const SdfPath& path, const SdfPath& newParent,
                                       const TfToken& newName) {
    const bool isParent = newParent.IsPrimPath();
    return MovePropertyAtPath(path, isParent ? newParent.AppendProperty(newName) : SdfPath());
}

const std::string& NamespaceEditor::invalid() const { return impl_->invalid_; }
std::vector<NamespaceEditor::Edit> NamespaceEditor::GetEdits() const {
    impl_->check("GetEdits");
    return impl_->edits_;
}
void NamespaceEditor::ClearEdits() { impl_->clear(); }

std::size_t NamespaceEditor::AddDependentStage(std::unique_ptr<EditedStage> stage) {
    impl_->check("AddDependentStage");
    impl_->dependents_[++impl_->lastDependent_] = {std::move(stage), nullptr, {}, {}};
    return impl_->lastDependent_;
}
std::size_t NamespaceEditor::AddDependentStage(stage::Stage& stage) {
    return AddDependentStage(editedStage(stage));
}
void NamespaceEditor::RemoveDependentStage(std::size_t stage) {
    impl_->check("RemoveDependentStage");
    impl_->dependents_.erase(stage);
}

CanApplyResult NamespaceEditor::CanApplyEdits() { return impl_->canApply(); }
CanApplyResult NamespaceEditor::ApplyEdits() { return impl_->apply(); }
pxr::SdfLayerHandleVector NamespaceEditor::GetLayersToEdit() { return impl_->layersToEdit(); }
const NamespaceRecord& NamespaceEditor::GetRecord() const { return impl_->record_; }
void NamespaceEditor::Prepare() { impl_->prepare(); }

}  // namespace usdlive
