// The rules that add to the roles of users, or take from them.
#pragma once

#include <cstddef>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "usdlive/common/access/OpinionKind.h"
#include "usdlive/common/access/ProjectAction.h"
#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"
#include "usdlive/common/protocol/Control.h"
#include "usdlive/common/protocol/Role.h"

namespace usdlive {

/// One rule. An empty list means all; but a rule with kinds and without actions is about no action,
/// and one with actions and without kinds about no edit.
struct AccessRule {
    std::size_t number = 0;  ///< its place in the file, from 1
    bool allows = false;
    std::set<std::string> users;
    std::set<Role> roles;
    std::set<std::string> groups;     ///< those of the issuer (AC22)
    std::vector<std::string> layers;  ///< globs: `*` within a name, `**` over several
    std::vector<std::string>
        paths;  ///< the same, of prims: `/World/Props/**` has /World/Props, too
    std::set<OpinionKind> kinds;
    std::set<ProjectAction> actions = {};  ///< a rule with actions has no paths
};

/// Returns the rule as the JSON object that parse() reads.
[[nodiscard]] std::string textOf(const AccessRule& rule);

inline const std::set<std::string> kNoGroups;

/// AC6, AC7: decides which opinions a user may write, and what else they may do. A value; immutable
/// after parse(), any thread.
class AccessRules {
public:
    /// Without rules, editors and administrators may write everything.
    AccessRules() = default;
    /// Parses the content of `.usdlive/access.json`. Error: InvalidConfiguration names the line or
    /// the rule.
    [[nodiscard]] static Result<AccessRules> parse(std::string_view text);

    /// Returns the rules that concern a user, without the names of others (AC8).
    [[nodiscard]] std::vector<SentRule> of(const UserName& user, Role role,
                                           const std::set<std::string>& groups = kNoGroups) const;
    /// Returns rules that a server has sent. Names of a later version are left out.
    [[nodiscard]] static AccessRules received(const std::vector<SentRule>& sent);

    struct Question {
        const UserName& user;
        Role role;
        const LayerId& layer;
        std::string_view path;  ///< names a spec; variants and properties count as their prim
        OpinionKind kind;
        const std::set<std::string>& groups = kNoGroups;  ///< to which the user belongs
    };
    struct Decision {
        bool isAllowed = false;
        std::optional<std::size_t> rule;  ///< its number, from 1; nothing: the role decided
    };
    [[nodiscard]] Decision decide(const Question& question) const;

    struct ActionQuestion {
        const UserName& user;
        Role role;
        ProjectAction action;
        const LayerId& layer;  ///< or a file; empty for an action that concerns the project
        const std::set<std::string>& groups = kNoGroups;
    };
    /// Decides about an action by the rules that are about it and by the role (AC11).
    [[nodiscard]] Decision decide(const ActionQuestion& question) const;

    /// Returns whether a rule names the user, a group or the role. If not, the role alone decides.
    [[nodiscard]] bool concern(const UserName& user, Role role,
                               const std::set<std::string>& groups = kNoGroups) const;
    /// Returns whether a rule may deny the user something below the prim, which decide() does not
    /// deny at the prim itself.
    [[nodiscard]] bool mayDenyBelow(const Question& question) const;

    /// Returns whether the user may write opinions of some kind somewhere in the layer.
    [[nodiscard]] bool mayWriteIn(const UserName& user, Role role, const LayerId& layer,
                                  const std::set<std::string>& groups = kNoGroups) const;

    [[nodiscard]] const std::vector<AccessRule>& rules() const { return rules_; }
    /// Returns the rule with this number as a sentence: "rule 2 denies transform in /World/Props/**
    /// to editors".
    [[nodiscard]] std::string describe(std::size_t rule) const;

private:
    template <class Asked, class FitOf>
    [[nodiscard]] Decision decideBy(const Asked& question, bool byRole, const FitOf& fitOf) const;

    std::vector<AccessRule> rules_;
};

/// Returns whether the glob matches a name with slashes. Between two slashes, `*` stands for any
/// characters and `?` for one; `**` stands for any number of parts, also none.
[[nodiscard]] bool matchesGlob(std::string_view glob, std::string_view name);

}  // namespace usdlive
