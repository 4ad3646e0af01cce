// Takes the role and the access rules of this user from messages.
#include "session/OwnRights.h"

#include <algorithm>
#include <string>

namespace usdlive::client {

void OwnRights::welcomed(const Welcome& message) {
    // An older server knows no roles, and everybody may edit.
    role_ = roleNamed(message.role.value_or("")).value_or(Role::Editor);
    areActionsRuled_ =
        std::ranges::find(message.features, kActionsFeature) != message.features.end();
    take(message.rules.value_or(std::vector<SentRule>()));
}

void OwnRights::received(const AccessChanged& message) {
    take(message.rules);
    events_.push(event::RightsChanged{});
}

void OwnRights::take(const std::vector<SentRule>& rules) {
    rules_ = AccessRules::received(rules);
    groups_.clear();
    for (const SentRule& rule : rules) groups_.insert(rule.groups.begin(), rule.groups.end());
}

}  // namespace usdlive::client
