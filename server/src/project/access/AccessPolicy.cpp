// Decides about locks of layers (LK1 to LK4) and about actions of administrators. SpecLocks.cpp
// decides about locks of specs.
#include "project/access/AccessPolicy.h"

#include <map>

namespace usdlive::server {

namespace {

bool isOfPseudoRoot(const Edit& edit) { return edit.address.path == "/" && !edit.address.creation; }

Error lockedError(const LayerId& layer, const LayerLock& lock) {
    return {ErrorCode::Locked,
            layer.value + " is locked" + (lock.holder.empty() ? "" : " by " + lock.holder.value)};
}

}  // namespace

AccessPolicy::AccessPolicy(const Facts& facts, std::set<UserName> administrators,
                           std::int64_t takeoverMs)
    : facts_(facts),
      administrators_(std::move(administrators)),
      takeoverMs_(takeoverMs),
      startedMs_(facts.steadyMs()) {}

Subject AccessPolicy::subject(UserName user) const {
    const Role role = administrators_.contains(user) ? Role::Admin : Role::Editor;
    return {std::move(user), role};
}

Result<Subject> AccessPolicy::subject(const SignedIn& proof, UserName claimed) const {
    if (claimed.empty()) claimed = proof.user;
    if (!proof.user.empty() && claimed != proof.user)
        return fail(ErrorCode::SignInRequired, "you are signed in as " + proof.user.value +
                                                   ", not as " + claimed.value +
                                                   ". Connect without naming a user");
    return Subject{std::move(claimed), proof.role, proof};
}

std::optional<Error> AccessPolicy::needs(Role role, const Subject& subject,
                                         const std::string& action) {
    if (subject.role >= role) return std::nullopt;
    return Error{ErrorCode::Forbidden, subject.user.value + " is a " +
                                           std::string(nameOf(subject.role)) +
                                           " here and may not " + action +
                                           ". An administrator of the server can give the "
                                           "role " +
                                           std::string(nameOf(role)) + " (usdlive user role)"};
}

bool AccessPolicy::holds(const Subject& subject, const LayerLock& lock) {
    return subject.isAdministrator() || (!lock.holder.empty() && lock.holder == subject.user);
}

/// Returns whether others may take or end the lock: it names no holder, or its holder was not
/// connected for the takeover time.
bool AccessPolicy::isFree(const LayerLock& lock) const {
    if (lock.holder.empty()) return true;
    if (facts_->isUserConnected(lock.holder)) return false;
    const auto left = leftMs_.find(lock.holder);
    const std::int64_t since = left == leftMs_.end() ? startedMs_ : left->second;
    return facts_->steadyMs() - since >= takeoverMs_;
}

void AccessPolicy::left(const Session& session) {
    constexpr std::size_t kMostKept = 1'000;
    if (session.subject.user.empty()) return;
    const std::int64_t now = facts_->steadyMs();
    // Forgets users whose locks are free.
    if (leftMs_.size() >= kMostKept)
        std::erase_if(leftMs_,
                      [&](const auto& entry) { return now - entry.second >= takeoverMs_; });
    leftMs_[session.subject.user] = now;
}

std::vector<SentRule> AccessPolicy::rulesOf(const Session& session) const {
    const Subject& subject = session.subject;
    auto rules = rules_->of(subject.user, subject.role, subject.groups());
    // An older client would take a rule about actions only for one about all edits.
    if (!session.features.contains(kActionsFeature))
        std::erase_if(rules,
                      [](const SentRule& rule) { return rule.actions && rule.kinds.empty(); });
    return rules;
}

Error AccessPolicy::denied(const Subject& subject, const std::string& what,
                           std::size_t rule) const {
    return {ErrorCode::Forbidden,
            subject.user.value + " may not " + what + ": " + rules_->describe(rule)};
}

AccessRules::Decision AccessPolicy::decide(const Subject& subject, ProjectAction action,
                                           const LayerId& place) const {
    return rules_->decide(
        AccessRules::ActionQuestion{subject.user, subject.role, action, place, subject.groups()});
}

std::optional<Error> AccessPolicy::toAction(const Subject& subject, ProjectAction action,
                                            const LayerId& place, const std::string& what) const {
    const auto decision = decide(subject, action, place);
    if (decision.isAllowed) return std::nullopt;
    if (decision.rule) return denied(subject, what, *decision.rule);
    return needs(roleFor(action), subject, what);
}

std::optional<Error> AccessPolicy::toSave(const Subject& subject, const LayerId& layer) const {
    if (auto denied = toAction(subject, ProjectAction::Save, layer, "save " + layer.value))
        return denied;
    return toLock(subject, layer);
}

std::optional<Error> AccessPolicy::toReload(const Subject& subject, const LayerId& layer) const {
    if (auto denied = toAction(subject, ProjectAction::Reload, layer, "reload " + layer.value))
        return denied;
    return toLock(subject, layer);
}

std::optional<Error> AccessPolicy::toTakeOver(const Subject& subject, const LayerId& layer,
                                              const LayerLock& lock, const Error& locked) const {
    // A lock without a name is nobody's.
    const auto decision = lock.holder.empty() ? AccessRules::Decision{true, {}}
                                              : decide(subject, ProjectAction::TakeOver, layer);
    if (decision.isAllowed || (isFree(lock) && !decision.rule)) return std::nullopt;
    if (isFree(lock))
        return denied(subject, "end a lock of others in " + layer.value, *decision.rule);
    return locked;
}

std::optional<Error> AccessPolicy::toLock(const Subject& subject, const LayerId& layer) const {
    const LayerLock lock = facts_->lockAt(layer);
    if (!lock.locked || holds(subject, lock)) return std::nullopt;
    return lockedError(layer, lock);
}

std::optional<Refused> AccessPolicy::toTransaction(const Subject& subject,
                                                   const Transaction& transaction) const {
    if (subject.role < Role::Editor && !areRulesFor(subject) && !transaction.edits.empty())
        return Refused{
            *needs(Role::Editor, subject, "edit " + transaction.edits.front().layer.value), 0};
    const LayerDocs& docs = facts_->loadedLayers();
    const LayerId* known = nullptr;
    LayerLock lock;
    std::map<LayerId, LayerDoc> changed;  // layers whose lock the transaction may change
    for (std::size_t index = 0; index < transaction.edits.size(); ++index) {
        const Edit& edit = transaction.edits[index];
        if (!known || *known != edit.layer) {
            lock = lockOf(docs.at(edit.layer));
            known = &edit.layer;
        }
        const bool ofRoot = isOfPseudoRoot(edit);
        if (lock.locked && !holds(subject, lock)) {
            std::optional<Error> error = lockedError(edit.layer, lock);
            if (ofRoot && isLockEdit(edit.action))
                error = toTakeOver(subject, edit.layer, lock, *error);
            if (error) return Refused{*std::move(error), std::uint32_t(index)};
        }
        if (!ofRoot || !touchesLock(edit.action)) continue;
        const auto doc = changed.try_emplace(edit.layer, docs.at(edit.layer)).first;
        (void)doc->second.apply(edit.address.path, edit.action);
        const LayerLock after = lockOf(doc->second);
        if (after.locked && after.holder != lock.holder && !after.holder.empty() &&
            !holds(subject, after))
            return Refused{
                {ErrorCode::Locked, "users lock in their own name only, and " + subject.user.value +
                                        " is not " + after.holder.value},
                std::uint32_t(index)};
    }
    return std::nullopt;
}

std::optional<Error> AccessPolicy::toHistory(const Subject& subject) const {
    auto denied = toAction(subject, ProjectAction::Compact, {}, "replace the history");
    if (!denied || subject.proof) return denied;
    if (decide(subject, ProjectAction::Compact, {}).rule) return denied;
    if (administrators_.empty()) return std::nullopt;
    return Error{ErrorCode::InvalidArgument,
                 "only administrators (the --admin option of the server) may replace the history"};
}

std::optional<Error> AccessPolicy::toBigValue(const Subject& subject) const {
    if (areRulesFor(subject)) return std::nullopt;  // the edit that names it is asked about
    return needs(Role::Editor, subject, "edit");
}

}  // namespace usdlive::server
