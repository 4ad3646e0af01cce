// Tests which opinions access rules let a user write (AC6, AC7).
#include "usdlive/common/access/AccessRules.h"

#include <gtest/gtest.h>

#include <random>

#include "unit/Seeds.h"

namespace usdlive {
namespace {

AccessRules rules(const std::string& list) {
    auto parsed = AccessRules::parse(R"({"format": 1, "rules": [)" + list + "]}");
    if (!parsed) throw std::runtime_error(parsed.error().message);
    return *parsed;
}

bool may(const AccessRules& rules, const std::string& path, OpinionKind kind,
         const std::string& layer = "shot.usda", Role role = Role::Editor,
         const std::string& user = "ann") {
    const UserName name{user};
    const LayerId id{layer};
    return rules.decide({name, role, id, path, kind}).isAllowed;
}

std::string problem(const std::string& text) {
    const auto parsed = AccessRules::parse(text);
    return parsed ? "" : parsed.error().message;
}

using enum OpinionKind;

TEST(AccessRules, WithoutRulesTheRoleDecides) {
    for (const auto& [role, allowed] : {std::pair(Role::None, false),
                                        {Role::Viewer, false},
                                        {Role::Reviewer, false},
                                        {Role::Editor, true},
                                        {Role::Admin, true}})
        EXPECT_EQ(may({}, "/World", Namespace, "a.usda", role), allowed) << nameOf(role);
}

TEST(AccessRules, AC6EachPartOfARuleLimitsIt) {
    const auto denies = [](const std::string& part) {
        return rules(R"({"effect": "deny")" + part + "}");
    };
    EXPECT_FALSE(may(denies(""), "/World", Transform));
    const AccessRules users = denies(R"(, "users": ["ann"])");
    EXPECT_FALSE(may(users, "/World", Transform));
    EXPECT_TRUE(may(users, "/World", Transform, "shot.usda", Role::Editor, "bob"));
    const AccessRules roles = denies(R"(, "roles": ["editor"])");
    EXPECT_FALSE(may(roles, "/World", Transform));
    EXPECT_TRUE(may(roles, "/World", Transform, "shot.usda", Role::Admin));
    const AccessRules layers = denies(R"(, "layers": ["sets/**", "*.usdc"])");
    EXPECT_TRUE(may(layers, "/World", Transform));
    EXPECT_FALSE(may(layers, "/World", Transform, "sets/a/b.usda"));
    EXPECT_FALSE(may(layers, "/World", Transform, "b.usdc"));
    EXPECT_TRUE(may(layers, "/World", Transform, "a/b.usdc"));
    const AccessRules paths = denies(R"(, "paths": ["/World/Props/**"])");
    EXPECT_TRUE(may(paths, "/World", Transform));
    EXPECT_FALSE(may(paths, "/World/Props", Transform));
    EXPECT_FALSE(may(paths, "/World/Props.xformOp:translate", Transform));
    EXPECT_FALSE(may(paths, "/World{v=one}Props/A{w=two}B.x", Transform));
    EXPECT_TRUE(may(paths, "/World/PropsOfOthers", Transform));
    const AccessRules kinds = denies(R"(, "kinds": ["namespace", "schema"])");
    EXPECT_FALSE(may(kinds, "/World", Namespace));
    EXPECT_FALSE(may(kinds, "/World", Schema));
    EXPECT_TRUE(may(kinds, "/World", Transform));
}

TEST(AccessRules, AC6TheMostSpecificRuleWins) {
    // Only animation, and only of characters.
    const AccessRules animator = rules(R"(
        {"effect": "deny", "users": ["ann"]},
        {"effect": "allow", "users": ["ann"], "paths": ["/World/Characters/**"], "kinds": ["animation"]})");
    EXPECT_TRUE(may(animator, "/World/Characters/Hero.xformOp:translate", Animation));
    EXPECT_FALSE(may(animator, "/World/Characters/Hero.xformOp:translate", Transform));
    EXPECT_FALSE(may(animator, "/World/Props/Box.xformOp:translate", Animation));
    // A rule that names the user comes before one with a longer path.
    const AccessRules except = rules(R"(
        {"effect": "deny", "paths": ["/World/Props/**"]},
        {"effect": "allow", "users": ["ann"]})");
    EXPECT_TRUE(may(except, "/World/Props", Transform));
    EXPECT_FALSE(may(except, "/World/Props", Transform, "a.usda", Role::Editor, "bob"));
    // A denial wins among equals, in both orders.
    for (const char* both : {R"({"effect": "deny"}, {"effect": "allow"})",
                             R"({"effect": "allow"}, {"effect": "deny"})"})
        EXPECT_FALSE(may(rules(both), "/World", Transform));
    // Nobody locks administrators out.
    EXPECT_TRUE(may(rules(R"({"effect": "deny"})"), "/", Metadata, "a.usda", Role::Admin));
}

TEST(AccessRules, AC6ARuleAddsToARole) {
    const AccessRules added = rules(R"(
        {"effect": "allow", "roles": ["reviewer"], "paths": ["/Notes/**"], "kinds": ["metadata"]})");
    EXPECT_TRUE(may(added, "/Notes/One", Metadata, "a.usda", Role::Reviewer));
    EXPECT_FALSE(may(added, "/World", Metadata, "a.usda", Role::Reviewer));
    EXPECT_FALSE(may(added, "/Notes/One", Metadata, "a.usda", Role::Viewer));
    EXPECT_TRUE(added.concern({"ann"}, Role::Reviewer));
    EXPECT_FALSE(added.concern({"ann"}, Role::Editor));
}

TEST(AccessRules, AC6GroupsAreBetweenUsersAndRoles) {
    const std::set<std::string> lighting{"lighting", "all"};
    const LayerId layer{"a.usda"};
    const auto mayAs = [&](const AccessRules& by, const char* name, Role role,
                           const std::set<std::string>& groups) {
        const UserName user{name};
        return by.decide({user, role, layer, "/World", Shading, groups}).isAllowed;
    };
    const AccessRules added = rules(R"({"effect": "allow", "groups": ["lighting"]})");
    EXPECT_TRUE(mayAs(added, "ann", Role::Viewer, lighting));
    EXPECT_FALSE(mayAs(added, "ann", Role::Viewer, {"lighting2"}));
    EXPECT_FALSE(mayAs(added, "lighting", Role::Viewer, kNoGroups));
    EXPECT_FALSE(mayAs(added, "ann", Role::None, lighting));
    EXPECT_TRUE(added.concern({"ann"}, Role::Viewer, lighting));
    EXPECT_FALSE(added.concern({"ann"}, Role::Viewer));
    EXPECT_EQ(added.describe(1), "rule 1 allows everything to the group lighting");
    const AccessRules both = rules(R"(
        {"effect": "allow", "roles": ["editor"]}, {"effect": "deny", "groups": ["lighting"]},
        {"effect": "allow", "users": ["ann"]})");
    EXPECT_TRUE(mayAs(both, "ann", Role::Editor, lighting));
    EXPECT_FALSE(mayAs(both, "bob", Role::Editor, lighting));
    EXPECT_TRUE(mayAs(both, "bob", Role::Editor, kNoGroups));
    const AccessRules deep = rules(R"({"effect": "deny", "groups": ["all"], "paths": ["/A/B"]})");
    const UserName bob{"bob"};
    EXPECT_TRUE(deep.mayDenyBelow({bob, Role::Editor, layer, "/A", Namespace, lighting}));
    EXPECT_FALSE(deep.mayDenyBelow({bob, Role::Editor, layer, "/A", Namespace}));
}

using enum ProjectAction;

bool mayDo(const AccessRules& rules, ProjectAction action, Role role = Role::Editor,
           const std::string& layer = "shot.usda") {
    const UserName ann{"ann"};
    const LayerId place{concernsProject(action) ? "" : layer};
    return rules.decide(AccessRules::ActionQuestion{ann, role, action, place}).isAllowed;
}

std::vector<ProjectAction> allActions() {
    std::vector<ProjectAction> all;
    for (std::size_t one = 0; one < kProjectActionNames.size(); ++one)
        all.push_back(ProjectAction(one));
    return all;
}

TEST(AccessRules, AC11WithoutRulesTheRoleDecidesAboutActions) {
    for (const auto action : allActions())
        for (const Role role :
             {Role::None, Role::Viewer, Role::Reviewer, Role::Editor, Role::Admin})
            EXPECT_EQ(mayDo({}, action, role), role >= roleFor(action))
                << nameOf(action) << " " << nameOf(role);
}

TEST(AccessRules, AC11ARuleIsAboutTheActionsThatItNames) {
    for (const auto named : allActions()) {
        const std::string rest = R"("actions": [")" + std::string(nameOf(named)) + R"("]})";
        const AccessRules denied = rules(R"({"effect": "deny", )" + rest);
        const AccessRules allowed = rules(R"({"effect": "allow", )" + rest);
        for (const auto action : allActions()) {
            EXPECT_EQ(mayDo(denied, action), action != named && roleFor(action) <= Role::Editor);
            EXPECT_EQ(mayDo(allowed, action, Role::Viewer), action == named);
            EXPECT_TRUE(mayDo(denied, action, Role::Admin));
            EXPECT_FALSE(mayDo(allowed, action, Role::None));
        }
        EXPECT_TRUE(may(denied, "/World", Transform));
        EXPECT_FALSE(may(allowed, "/World", Transform, "shot.usda", Role::Viewer));
        EXPECT_FALSE(allowed.mayWriteIn({"ann"}, Role::Viewer, {"shot.usda"}));
        const UserName ann{"ann"};
        const LayerId layer{"a.usda"};
        EXPECT_FALSE(denied.mayDenyBelow({ann, Role::Editor, layer, "/", Namespace}));
    }
}

TEST(AccessRules, AC11ARuleAboutNothingSpecialIsAboutActionsToo) {
    const AccessRules none = rules(R"({"effect": "deny", "users": ["ann"]})");
    const AccessRules all = rules(R"({"effect": "allow", "users": ["ann"]})");
    for (const auto action : allActions()) {
        EXPECT_FALSE(mayDo(none, action)) << nameOf(action);
        // Rules give actions of administrators by their names only.
        EXPECT_EQ(mayDo(all, action, Role::Viewer), roleFor(action) < Role::Admin);
    }
    // One about kinds or prims is about edits; but locks and mutes are metadata of the layer.
    const AccessRules kinds = rules(R"({"effect": "deny", "kinds": ["animation"]})");
    const AccessRules metadata = rules(R"({"effect": "deny", "kinds": ["metadata"]})");
    const AccessRules props = rules(R"({"effect": "deny", "paths": ["/World/**"]})");
    for (const auto action : allActions()) {
        EXPECT_EQ(mayDo(kinds, action), roleFor(action) <= Role::Editor) << nameOf(action);
        EXPECT_EQ(mayDo(props, action), roleFor(action) <= Role::Editor) << nameOf(action);
        EXPECT_EQ(mayDo(metadata, action),
                  !isDoneByEdits(action) && roleFor(action) <= Role::Editor);
    }
    // One with both is about these edits and these actions.
    const AccessRules both =
        rules(R"({"effect": "deny", "kinds": ["animation"], "actions": ["save"]})");
    EXPECT_FALSE(mayDo(both, Save) || may(both, "/World", Animation));
    EXPECT_TRUE(mayDo(both, Reload) && may(both, "/World", Transform));
    EXPECT_EQ(both.describe(1), "rule 1 denies animation, save to everybody");
}

TEST(AccessRules, AC11TheMostSpecificRuleDecidesAboutActions) {
    // An animator who may only animate, and save what she has animated.
    const AccessRules animator = rules(R"(
        {"effect": "deny", "users": ["ann"], "layers": ["**"]},
        {"effect": "deny", "users": ["ann"], "paths": ["/**"]},
        {"effect": "allow", "users": ["ann"], "actions": ["save"]})");
    EXPECT_TRUE(mayDo(animator, Save));
    EXPECT_FALSE(mayDo(animator, Reload));
    EXPECT_FALSE(may(animator, "/World", Transform));
    for (const char* list : {R"({"effect": "deny", "actions": ["save"]},
                                {"effect": "allow", "actions": ["save"], "kinds": ["schema"]})",
                             R"({"effect": "allow", "actions": ["save"]},
                                {"effect": "deny", "actions": ["save", "lock"]})"})
        EXPECT_FALSE(mayDo(rules(list), Save)) << list;
    const AccessRules layers = rules(R"(
        {"effect": "deny", "actions": ["save", "checkpoint"], "layers": ["sets/*"]})");
    EXPECT_FALSE(mayDo(layers, Save, Role::Editor, "sets/a.usda"));
    EXPECT_TRUE(mayDo(layers, Save));
    EXPECT_TRUE(mayDo(layers, Checkpoint)) << "it concerns the project, and no layer";
    const AccessRules everywhere =
        rules(R"({"effect": "deny", "actions": ["checkpoint"], "layers": ["**"]})");
    EXPECT_FALSE(mayDo(everywhere, Checkpoint));
}

TEST(AccessRules, AC11EditsThatLockOrMute) {
    const auto actionOf = [](std::vector<std::string> key, const char* path = "/") {
        return projectActionOf(path, EraseField{"customLayerData", DictionaryKey{std::move(key)}});
    };
    for (const char* key : {"locked", "locked_by", "locked_at", "specs_locking"})
        EXPECT_EQ(actionOf({"omni_layer", key}), Lock) << key;
    EXPECT_EQ(actionOf({"omni_layer", "specs_locking", "/World"}), Lock);
    EXPECT_EQ(actionOf({"omni_layer", "muteness", "./a.usda"}), Mute);
    EXPECT_FALSE(actionOf({"omni_layer"}));
    EXPECT_FALSE(actionOf({"omni_layer", "note"}));
    EXPECT_FALSE(actionOf({"other", "locked"}));
    EXPECT_FALSE(actionOf({"omni_layer", "locked"}, "/World"));
    EXPECT_FALSE(projectActionOf("/", EraseField{"customLayerData", {}}));
}

TEST(AccessRules, MayDenyBelowAPrim) {
    const AccessRules deep = rules(R"(
        {"effect": "deny", "paths": ["/World/Props/**", "/Sets/*/Rig"], "kinds": ["namespace"]})");
    const UserName ann{"ann"};
    const LayerId layer{"a.usda"};
    const auto below = [&](std::string_view path) {
        return deep.mayDenyBelow({ann, Role::Editor, layer, path, Namespace});
    };
    EXPECT_TRUE(below("/"));
    EXPECT_TRUE(below("/World"));
    EXPECT_TRUE(below("/Sets/A"));
    EXPECT_FALSE(below("/Wor"));
    EXPECT_FALSE(below("/Cameras"));
}

/// A user with what the rules of others hide.
struct Somebody {
    UserName user;
    Role role;
    std::set<std::string> groups;
};

TEST(AccessRules, AUserIsSentWhatDecidesAboutThem) {
    const std::vector<std::string> users{"ann", "bob"}, groups{"fx", "rig"},
        layers{"a.usda", "b/*.usda", "**"},
        paths{"/", "/World", "/World/**", "/*/Rig", "/World/Props/Box"};
    const std::vector<LayerId> allLayers{{"a.usda"}, {"b/c.usda"}, {"d.usdc"}};
    std::mt19937 random(7);
    const auto chance = [&](unsigned one) { return random() % one == 0; };
    const auto some = [&](const std::vector<std::string>& from) {
        std::vector<std::string> chosen;
        if (chance(2)) return chosen;
        for (const std::string& text : from)
            if (chance(2)) chosen.push_back(text);
        return chosen;
    };
    std::size_t denied = 0, allowed = 0;
    for (unsigned round = 0; round < seedsOf(500); ++round) {
        std::string text;
        for (std::size_t count = random() % 6; count > 0; --count) {
            AccessRule rule;
            rule.allows = chance(2);
            for (const auto& user : some(users)) rule.users.insert(user);
            for (const auto& group : some(groups)) rule.groups.insert(group);
            if (chance(3)) rule.roles.insert(chance(2) ? Role::Editor : Role::Reviewer);
            rule.layers = some(layers);
            rule.paths = some(paths);
            if (chance(2)) rule.kinds.insert(OpinionKind(random() % kOpinionKindNames.size()));
            if (rule.paths.empty() && chance(2))
                rule.actions.insert(ProjectAction(random() % kProjectActionNames.size()));
            text += (text.empty() ? "" : ", ") + textOf(rule);
        }
        const AccessRules all = rules(text);
        for (const Somebody& one :
             {Somebody{{"ann"}, Role::Editor, {"fx"}},
              Somebody{{"bob"}, Role::Reviewer, {"fx", "rig"}}, Somebody{{"eve"}, Role::Viewer, {}},
              Somebody{{"eve"}, Role::Admin, {"rig"}}}) {
            const auto sent = all.of(one.user, one.role, one.groups);
            for (const SentRule& rule : sent) {
                for (const auto& name : rule.users) EXPECT_EQ(name, one.user.value);
                for (const auto& name : rule.groups) EXPECT_TRUE(one.groups.contains(name));
            }
            const AccessRules own = AccessRules::received(sent);
            for (const LayerId& layer : allLayers) {
                bool any = false;
                for (const char* path :
                     {"/", "/World", "/World/Props/Box.size", "/Other", "/X/Rig"})
                    for (std::size_t kind = 0; kind < kOpinionKindNames.size(); ++kind) {
                        const auto ask = [&](const AccessRules& whom) {
                            return whom.decide(
                                {one.user, one.role, layer, path, OpinionKind(kind), one.groups});
                        };
                        const auto decision = ask(all);
                        EXPECT_EQ(ask(own).isAllowed, decision.isAllowed) << text;
                        EXPECT_EQ(ask(own).rule, decision.rule) << text;
                        any = any || decision.isAllowed;
                        ++(decision.isAllowed ? allowed : denied);
                    }
                for (const auto action : allActions()) {
                    const AccessRules::ActionQuestion question{one.user, one.role, action, layer,
                                                               one.groups};
                    EXPECT_EQ(own.decide(question).isAllowed, all.decide(question).isAllowed);
                    EXPECT_EQ(own.decide(question).rule, all.decide(question).rule) << text;
                }
                if (any) {
                    EXPECT_TRUE(own.mayWriteIn(one.user, one.role, layer, one.groups)) << text;
                }
            }
        }
    }
    EXPECT_GT(denied, 1'000);
    EXPECT_GT(allowed, 1'000);
}

TEST(AccessRules, MayWriteInALayer) {
    const UserName ann{"ann"};
    const LayerId layer{"a.usda"};
    const auto may = [&](const std::string& text, Role role = Role::Editor) {
        return rules(text).mayWriteIn(ann, role, layer);
    };
    EXPECT_TRUE(may(""));
    EXPECT_FALSE(may("", Role::Reviewer));
    EXPECT_TRUE(may(R"({"effect": "allow", "paths": ["/A"]})", Role::Viewer));
    EXPECT_FALSE(may(R"({"effect": "allow", "layers": ["b.usda"]})", Role::Viewer));
    EXPECT_FALSE(may(R"({"effect": "deny"})"));
    EXPECT_FALSE(may(R"({"effect": "deny", "paths": ["/**"]})"));
    EXPECT_TRUE(may(R"({"effect": "deny", "paths": ["/A/**"]})"));
    EXPECT_TRUE(may(R"({"effect": "deny", "layers": ["b.usda"]})"));
    EXPECT_TRUE(may(R"({"effect": "deny"})", Role::Admin));
}

TEST(AccessRules, NamesOfALaterVersionAreLeftOut) {
    const SentRule later{1, true, {}, {"director"}, {}, {}, {}, {"smell"}};
    EXPECT_TRUE(AccessRules::received({later}).rules().empty());
    EXPECT_FALSE(AccessRules::received({later}).mayWriteIn({"ann"}, Role::Viewer, {"a.usda"}));
    SentRule actions{1, true, {}, {}, {}, {}, {}, {}};
    actions.actions = {"dance"};
    EXPECT_TRUE(AccessRules::received({actions}).rules().empty());
    actions.actions = {"dance", "save"};
    EXPECT_EQ(AccessRules::received({actions}).describe(1), "rule 1 allows save to everybody");
}

TEST(AccessRules, Globs) {
    for (const auto& [glob, name, matches] :
         std::vector<std::tuple<const char*, const char*, bool>>{
             {"**", "/", true},
             {"/**", "/", true},
             {"/**", "/A/B", true},
             {"/*", "/A", true},
             {"/*", "/A/B", false},
             {"/A/**", "/A", true},
             {"/A/**/D", "/A/D", true},
             {"/A/**/D", "/A/B/C/D", true},
             {"/A/**/D", "/A/B/C", false},
             {"/A*B?", "/AxxBy", true},
             {"/A*B?", "/AxxB", false},
             {"*.usda", "a/b.usda", false},
             {"**/*.usda", "a/b.usda", true},
             {"/a*a*a*a*a*a*a*a*b", "/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", false}})
        EXPECT_EQ(matchesGlob(glob, name), matches) << glob << " " << name;
}

TEST(AccessRules, BadInputIsNamed) {
    EXPECT_NE(problem("{\n\"format\": 1,\n}").find("line 3"), std::string::npos);
    EXPECT_NE(problem(R"({"format": 2, "rules": []})").find("format"), std::string::npos);
    const auto wrong = [](const std::string& rule) {
        return problem(R"({"format": 1, "rules": [{"effect": "allow"}, )" + rule + "]}");
    };
    EXPECT_NE(wrong(R"({"effect": "maybe"})").find("rule 2"), std::string::npos);
    EXPECT_NE(wrong(R"({"effect": "deny", "role": ["editor"]})").find("role"), std::string::npos);
    EXPECT_NE(wrong(R"({"effect": "deny", "roles": ["boss"]})").find("boss"), std::string::npos);
    EXPECT_NE(wrong(R"({"effect": "deny", "kinds": ["shaders"]})").find("shading"),
              std::string::npos);
    EXPECT_NE(wrong(R"({"effect": "deny", "actions": ["saves"]})").find("reload"),
              std::string::npos);
    EXPECT_NE(
        wrong(R"({"effect": "deny", "actions": ["save"], "paths": ["/A"]})").find("two rules"),
        std::string::npos);
    EXPECT_NE(wrong(R"({"effect": "deny", "paths": ["World"]})").find("begin"), std::string::npos);
    EXPECT_NE(wrong(R"({"effect": "deny", "users": []})").find("leave it out"), std::string::npos);
    EXPECT_NE(wrong("7").find("not an object"), std::string::npos);
    EXPECT_FALSE(problem("[]").empty());
    EXPECT_FALSE(problem("").empty());
}

}  // namespace
}  // namespace usdlive
