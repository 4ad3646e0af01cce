// Decides about edits, locks and mutes by the rules of a project (AC6, AC7, AC11).
#include <algorithm>
#include <utility>

#include "project/access/AccessPolicy.h"
#include "usdlive/common/layer/GlobalMuteness.h"
#include "usdlive/common/layer/SpecPath.h"

namespace usdlive::server {

bool AccessPolicy::areRulesFor(const Subject& subject) const {
    return rules_->concern(subject.user, subject.role, subject.groups());
}

std::optional<Error> AccessPolicy::toOpinionAt(const AccessRules::Question& question) const {
    const auto decision = rules_->decide(question);
    if (decision.isAllowed) return std::nullopt;
    const std::string why = decision.rule ? rules_->describe(*decision.rule)
                                          : "a " + std::string(nameOf(question.role)) +
                                                " may not, and no rule allows it";
    return Error{ErrorCode::Forbidden, question.user.value + " may not write " +
                                           std::string(nameOf(question.kind)) + " at " +
                                           std::string(question.path) + " of " +
                                           question.layer.value + ": " + why};
}

/// Decides about all prims below one, for edits that concern them, too.
std::optional<Error> AccessPolicy::toAllBelow(const AccessRules::Question& question,
                                              const LayerDoc& doc) const {
    std::vector<std::string> waiting{std::string(question.path)};
    const auto addChildren = [&](const std::string& path, ChildList list) {
        for (const std::string& name : doc.children(path, list))
            waiting.push_back(specpath::child(path, list, name));
    };
    while (!waiting.empty()) {
        const std::string path = std::move(waiting.back());
        waiting.pop_back();
        AccessRules::Question below = question;
        below.path = path;
        if (auto denied = toOpinionAt(below)) return denied;
        if (!rules_->mayDenyBelow(below)) continue;
        if (doc.kind(path) == SpecKind::VariantSet) {
            addChildren(path, ChildList::Variants);
            continue;
        }
        addChildren(path, ChildList::Prims);
        addChildren(path, ChildList::VariantSets);
    }
    return std::nullopt;
}

std::optional<Error> AccessPolicy::toLockOrMute(const Subject& subject, const LayerId& layer,
                                                ProjectAction action,
                                                const LayerDoc* before) const {
    if (action == ProjectAction::Mute)
        return toAction(subject, action, layer, "mute layers for everybody in " + layer.value);
    const LayerLock lock = before ? lockOf(*before) : LayerLock();
    const bool isForeign = lock.locked && !lock.holder.empty() && lock.holder != subject.user;
    // toTransaction() has asked about the lock of somebody else.
    if (isForeign && decide(subject, ProjectAction::TakeOver, layer).isAllowed) return std::nullopt;
    return toAction(subject, ProjectAction::Lock, layer, "lock in " + layer.value);
}

std::optional<Error> AccessPolicy::toChangedLocks(const Subject& subject, const LayerId& layer,
                                                  const LayerDoc& before) const {
    const LayerDoc& now = facts_->loadedLayers().at(layer);
    std::optional<Error> error;
    if (lockOf(before) != lockOf(now) || specLocksOf(before) != specLocksOf(now))
        error = toLockOrMute(subject, layer, ProjectAction::Lock, &before);
    if (!error && globallyMuted(layer, before) != globallyMuted(layer, now))
        error = toLockOrMute(subject, layer, ProjectAction::Mute, &before);
    return error;
}

std::optional<Error> AccessPolicy::toOpinion(const Subject& subject, const Edit& edit,
                                             const LayerDoc* doc) const {
    const std::string& path = edit.address.path;
    if (const auto action = projectActionOf(path, edit.action))
        return toLockOrMute(subject, edit.layer, *action, doc);
    const bool exists = doc && doc->has(path);
    const auto kind = opinionKindOf(path, edit.action, exists);
    AccessRules::Question question{
        subject.user,    subject.role, edit.layer, path, kind.value_or(OpinionKind::Namespace),
        subject.groups()};
    if (!kind) {  // it states nothing: whoever may write anything there may do it
        for (std::size_t other = 0; other < kOpinionKindNames.size(); ++other) {
            question.kind = OpinionKind(other);
            if (rules_->decide(question).isAllowed) return std::nullopt;
        }
        return toOpinionAt(question);
    }
    if (auto denied = toOpinionAt(question)) return denied;
    const auto* move = std::get_if<MoveSpec>(&edit.action);
    if (!move && !std::holds_alternative<DeleteSpec>(edit.action)) return std::nullopt;
    const bool isProperty = specpath::last(path).list == ChildList::Properties;
    if (doc && exists && !isProperty && rules_->mayDenyBelow(question))
        if (auto denied = toAllBelow(question, *doc)) return denied;
    if (!move || move->parent.creation) return std::nullopt;
    const std::string newPath = destination(path, *move);
    question.path = newPath;
    return toOpinionAt(question);
}

}  // namespace usdlive::server
