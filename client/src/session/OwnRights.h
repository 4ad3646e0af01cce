// The rights of this user: what the server lets them write and do (AC3, AC6, AC8, AC11).
#pragma once

#include <optional>
#include <string_view>
#include <vector>

#include "session/SessionEvents.h"
#include "usdlive/common/access/AccessRules.h"

namespace usdlive::client {

/// The role and the access rules of this user, as the server sent them last. Locks are not among
/// them.
class OwnRights {
public:
    OwnRights(UserName user, SessionEvents& events) : user_(std::move(user)), events_(events) {}

    void welcomed(const Welcome& message);
    void received(const AccessChanged& message);

    [[nodiscard]] const UserName& user() const { return user_; }
    [[nodiscard]] Role role() const { return role_; }
    [[nodiscard]] const AccessRules& rules() const { return rules_; }
    [[nodiscard]] AccessRules::Decision decide(const LayerId& layer, std::string_view path,
                                               OpinionKind kind) const {
        return rules_.decide({user_, role_, layer, path, kind, groups_});
    }
    [[nodiscard]] AccessRules::Decision decide(ProjectAction action, const LayerId& place) const {
        const AccessRules::ActionQuestion question{user_, role_, action, place, groups_};
        return areActionsRuled_ ? rules_.decide(question) : AccessRules().decide(question);
    }
    /// Returns whether the user may write something in the layer.
    [[nodiscard]] bool mayWriteIn(const LayerId& layer) const {
        return rules_.mayWriteIn(user_, role_, layer, groups_);
    }

private:
    void take(const std::vector<SentRule>& rules);

    const UserName user_;
    SessionEvents& events_;
    Role role_ = Role::Editor;
    std::set<std::string> groups_;  // those that rules name
    AccessRules rules_;
    bool areActionsRuled_ = false;  // by an older server, the role alone decides about them
};

}  // namespace usdlive::client
