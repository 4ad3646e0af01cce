// Parses access rules, and decides by the most specific one.
#include "usdlive/common/access/AccessRules.h"

#include <algorithm>
#include <iterator>
#include <limits>
#include <nlohmann/json.hpp>

#include "usdlive/common/core/Utf8.h"

namespace usdlive {

namespace {

using Json = nlohmann::json;

constexpr int kFormat = 1;
constexpr std::size_t kMostRules = 1'000, kMostGlobBytes = 1'024;
constexpr std::string_view kAnyParts = "**";

struct Wrong {
    std::string text;
};

std::vector<std::string> textsIn(const Json& rule, const char* name, const std::string& where) {
    const auto found = rule.find(name);
    if (found == rule.end()) return {};
    if (!found->is_array() || found->empty())
        throw Wrong{"\"" + std::string(name) + "\" of " + where +
                    " is not a list with at least one text; leave it out to mean all"};
    std::vector<std::string> texts;
    for (const Json& one : *found) {
        if (!one.is_string())
            throw Wrong{"\"" + std::string(name) + "\" of " + where +
                        " has something else than texts"};
        texts.push_back(one.get<std::string>());
        if (texts.back().empty() || texts.back().size() > kMostGlobBytes)
            throw Wrong{"\"" + std::string(name) + "\" of " + where +
                        " has a text that is empty or longer than " +
                        std::to_string(kMostGlobBytes) + " bytes"};
    }
    return texts;
}

template <std::size_t N>
std::string noneOf(const std::string& name, const std::array<std::string_view, N>& names) {
    std::string all;
    for (const auto one : names) all += (all.empty() ? "" : ", ") + std::string(one);
    return inQuotes(name) + ", which is none of " + all;
}

AccessRule ruleIn(const Json& json, const std::string& where) {
    if (!json.is_object()) throw Wrong{where + " is not an object"};
    for (const auto& [name, value] : json.items())
        if (name != "effect" && name != "users" && name != "roles" && name != "groups" &&
            name != "layers" && name != "paths" && name != "kinds" && name != "actions")
            throw Wrong{where + " has an unknown member " + inQuotes(name)};
    AccessRule rule;
    const auto effect = json.find("effect");
    if (effect == json.end() || (*effect != "allow" && *effect != "deny"))
        throw Wrong{"the effect of " + where + " is neither \"allow\" nor \"deny\""};
    rule.allows = *effect == "allow";
    for (std::string& user : textsIn(json, "users", where)) rule.users.insert(std::move(user));
    for (const std::string& name : textsIn(json, "roles", where)) {
        const auto role = roleNamed(name);
        if (!role)
            throw Wrong{where + " names the role " + inQuotes(name) + ", which does not exist"};
        rule.roles.insert(*role);
    }
    for (std::string& group : textsIn(json, "groups", where)) rule.groups.insert(std::move(group));
    rule.layers = textsIn(json, "layers", where);
    rule.paths = textsIn(json, "paths", where);
    for (const std::string& path : rule.paths)
        if (!path.starts_with('/'))
            throw Wrong{"the path " + inQuotes(path) + " of " + where + " does not begin with /"};
    for (const std::string& name : textsIn(json, "kinds", where)) {
        const auto kind = opinionKindNamed(name);
        if (!kind) throw Wrong{where + " names the kind " + noneOf(name, kOpinionKindNames)};
        rule.kinds.insert(*kind);
    }
    for (const std::string& name : textsIn(json, "actions", where)) {
        const auto action = projectActionNamed(name);
        if (!action) throw Wrong{where + " names the action " + noneOf(name, kProjectActionNames)};
        rule.actions.insert(*action);
    }
    if (!rule.actions.empty() && !rule.paths.empty())
        throw Wrong{where +
                    " has both actions and paths. An action concerns a whole layer or the project; "
                    "write two rules"};
    return rule;
}

std::vector<std::string_view> partsOf(std::string_view text) {
    std::vector<std::string_view> parts;
    while (!text.empty()) {
        const std::size_t end = std::min(text.find('/'), text.size());
        if (end > 0) parts.push_back(text.substr(0, end));
        text.remove_prefix(std::min(end + 1, text.size()));
    }
    return parts;
}

/// Returns whether a pattern with `*` and `?` matches a text without slashes.
bool matchesPart(std::string_view pattern, std::string_view text) {
    std::size_t p = 0, t = 0, star = std::string_view::npos, from = 0;
    while (t < text.size()) {
        if (p < pattern.size() && pattern[p] == '*') {
            star = p++;
            from = t;
        } else if (p < pattern.size() && (pattern[p] == text[t] || pattern[p] == '?')) {
            ++p;
            ++t;
        } else if (star != std::string_view::npos) {
            p = star + 1;
            t = ++from;
        } else {
            return false;
        }
    }
    return pattern.find_first_not_of('*', p) == std::string_view::npos;
}

/// Returns the characters of a glob before its first wildcard.
std::string_view literalPart(std::string_view glob) {
    return glob.substr(0, glob.find_first_of("*?"));
}

/// Returns the prim that a spec belongs to, without the variants on the way: "/A{v=one}B.x" gives
/// "/A/B".
std::string primOf(std::string_view path) {
    std::string prim;
    std::size_t depth = 0;
    for (const char c : path) {
        if (c == '.' && depth == 0) break;
        if (c == '}') {
            --depth;
            prim += '/';
        } else if (c == '{') {
            ++depth;
        } else if (depth == 0 && !(c == '/' && prim.ends_with('/'))) {
            prim += c;
        }
    }
    while (prim.size() > 1 && prim.ends_with('/')) prim.pop_back();
    return prim;
}

/// Returns the count of literal characters of the longest glob that matches, plus one; 0 if none
/// does. A list without globs matches everything and gives 1.
std::size_t strengthOf(const std::vector<std::string>& globs, std::string_view name) {
    if (globs.empty()) return 1;
    std::size_t best = 0;
    for (const std::string& glob : globs)
        if (matchesGlob(glob, name)) best = std::max(best, literalPart(glob).size() + 2);
    return best;
}

/// The ways in which a rule names somebody. Of two rules, the one with the greater value decides.
enum class Named { Nobody, Everybody, Role, Group, User };

Named namedBy(const AccessRule& rule, const UserName& user, Role role,
              const std::set<std::string>& groups) {
    if (rule.users.contains(user.value)) return Named::User;
    if (std::ranges::any_of(rule.groups, [&](const auto& one) { return groups.contains(one); }))
        return Named::Group;
    if (rule.roles.contains(role)) return Named::Role;
    const bool isForAll = rule.users.empty() && rule.groups.empty() && rule.roles.empty();
    return isForAll ? Named::Everybody : Named::Nobody;
}

/// Returns whether the rule is about edits of this kind.
bool isAbout(const AccessRule& rule, OpinionKind kind) {
    return rule.kinds.empty() ? rule.actions.empty() : rule.kinds.contains(kind);
}

/// Returns whether the rule is about an action that it does not name. A lock or a mute is a
/// metadatum of the layer, and an action of administrators is allowed by its name only.
bool isAboutUnnamed(const AccessRule& rule, ProjectAction action) {
    if (rule.allows && roleFor(action) == Role::Admin) return false;
    if (isDoneByEdits(action)) return isAbout(rule, OpinionKind::Metadata);
    return rule.kinds.empty() && rule.actions.empty();
}

/// The weight of a rule, of which the heaviest decides. In this order: who, which action or where
/// in the namespace, which layer, which kind; then a denial.
struct Weight {
    Named who;
    std::size_t place, layer;
    bool byKind, denies;
    auto operator<=>(const Weight&) const = default;
};
/// How a rule fits a question. `place` 0: it does not.
struct Fit {
    std::size_t place = 0;
    bool byKind = false;
};
constexpr std::size_t kNamesTheAction = std::numeric_limits<std::size_t>::max();

std::string joined(const std::vector<std::string>& texts) {
    std::string all;
    for (const std::string& text : texts) all += (all.empty() ? "" : ", ") + text;
    return all;
}

}  // namespace

bool matchesGlob(std::string_view glob, std::string_view name) {
    const auto patterns = partsOf(glob), parts = partsOf(name);
    // matched[n]: the patterns so far match the first n parts.
    std::vector<bool> matched(parts.size() + 1, false);
    matched[0] = true;
    for (const std::string_view pattern : patterns) {
        std::vector<bool> next(parts.size() + 1, false);
        for (std::size_t n = 0; n <= parts.size(); ++n) {
            if (pattern == kAnyParts)
                next[n] = matched[n] || (n > 0 && next[n - 1]);
            else
                next[n] = n > 0 && matched[n - 1] && matchesPart(pattern, parts[n - 1]);
        }
        matched = std::move(next);
    }
    return matched.back();
}

std::string textOf(const AccessRule& rule) {
    nlohmann::ordered_json json{{"effect", rule.allows ? "allow" : "deny"}};
    const auto add = [&](const char* name, std::vector<std::string> texts) {
        if (!texts.empty()) json[name] = std::move(texts);
    };
    add("users", {rule.users.begin(), rule.users.end()});
    std::vector<std::string> roles, kinds, actions;
    for (const Role role : rule.roles) roles.emplace_back(nameOf(role));
    for (const OpinionKind kind : rule.kinds) kinds.emplace_back(nameOf(kind));
    for (const ProjectAction action : rule.actions) actions.emplace_back(nameOf(action));
    add("roles", std::move(roles));
    add("groups", {rule.groups.begin(), rule.groups.end()});
    add("layers", rule.layers);
    add("paths", rule.paths);
    add("kinds", std::move(kinds));
    add("actions", std::move(actions));
    return json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

Result<AccessRules> AccessRules::parse(std::string_view text) try {
    Json json;
    try {
        json = Json::parse(text);
    } catch (const Json::parse_error& error) {
        const auto before = text.substr(0, std::min(text.size(), error.byte));
        throw Wrong{"line " + std::to_string(std::ranges::count(before, '\n') + 1) +
                    " is not JSON"};
    }
    if (!json.is_object() || !json.contains("format") || json["format"] != kFormat)
        throw Wrong{"\"format\" is not " + std::to_string(kFormat)};
    for (const auto& [name, value] : json.items())
        if (name != "format" && name != "rules") throw Wrong{"unknown member " + inQuotes(name)};
    const auto rules = json.find("rules");
    if (rules == json.end() || !rules->is_array()) throw Wrong{"\"rules\" is not a list"};
    if (rules->size() > kMostRules)
        throw Wrong{"there are more than " + std::to_string(kMostRules) + " rules"};
    AccessRules all;
    for (const Json& rule : *rules) {
        const std::size_t number = all.rules_.size() + 1;
        all.rules_.push_back(ruleIn(rule, "rule " + std::to_string(number)));
        all.rules_.back().number = number;
    }
    return all;
} catch (const Wrong& wrong) {
    return fail(ErrorCode::InvalidConfiguration, wrong.text);
} catch (const Json::exception& error) {
    return fail(ErrorCode::InvalidConfiguration, error.what());
}

std::vector<SentRule> AccessRules::of(const UserName& user, Role role,
                                      const std::set<std::string>& groups) const {
    std::vector<SentRule> sent;
    for (const AccessRule& rule : rules_) {
        if (namedBy(rule, user, role, groups) == Named::Nobody) continue;
        SentRule& one = sent.emplace_back();
        one.number = rule.number;
        one.allows = rule.allows;
        if (rule.users.contains(user.value)) one.users = {user.value};
        if (rule.roles.contains(role)) one.roles = {std::string(nameOf(role))};
        std::ranges::set_intersection(rule.groups, groups, std::back_inserter(one.groups));
        one.layers = rule.layers;
        one.paths = rule.paths;
        for (const OpinionKind kind : rule.kinds) one.kinds.emplace_back(nameOf(kind));
        if (rule.actions.empty()) continue;
        one.actions.emplace();
        for (const ProjectAction action : rule.actions) one.actions->emplace_back(nameOf(action));
    }
    return sent;
}

AccessRules AccessRules::received(const std::vector<SentRule>& sent) {
    AccessRules rules;
    for (const SentRule& one : sent) {
        AccessRule rule{.number = std::size_t(one.number),
                        .allows = one.allows,
                        .users = {one.users.begin(), one.users.end()},
                        .roles = {},
                        .groups = {one.groups.begin(), one.groups.end()},
                        .layers = one.layers,
                        .paths = one.paths,
                        .kinds = {}};
        for (const std::string& name : one.roles)
            if (const auto role = roleNamed(name)) rule.roles.insert(*role);
        for (const std::string& name : one.kinds)
            if (const auto kind = opinionKindNamed(name)) rule.kinds.insert(*kind);
        for (const std::string& name : one.actions.value_or(std::vector<std::string>()))
            if (const auto action = projectActionNamed(name)) rule.actions.insert(*action);
        // A rule about unknown kinds or actions only is none about everything.
        const bool namesSome = !one.kinds.empty() || one.actions;
        if (namesSome && rule.kinds.empty() && rule.actions.empty()) continue;
        rules.rules_.push_back(std::move(rule));
    }
    return rules;
}

bool AccessRules::mayWriteIn(const UserName& user, Role role, const LayerId& layer,
                             const std::set<std::string>& groups) const {
    if (!concern(user, role, groups)) return role >= Role::Editor;
    const auto allowsSomewhere = [&](const AccessRule& rule) {
        const bool isAboutEdits = rule.actions.empty() || !rule.kinds.empty();
        return rule.allows && isAboutEdits && namedBy(rule, user, role, groups) != Named::Nobody &&
               strengthOf(rule.layers, layer.value) > 0;
    };
    if (std::ranges::any_of(rules_, allowsSomewhere)) return true;
    // Without a rule that allows something, a place that no path names has what is left.
    for (const std::string_view path : {"/", "/\x01"})
        for (std::size_t kind = 0; kind < kOpinionKindNames.size(); ++kind)
            if (decide({user, role, layer, path, OpinionKind(kind), groups}).isAllowed) return true;
    return false;
}

/// Decides by the heaviest rule. `fitOf` returns how a rule fits the question.
template <class Asked, class FitOf>
AccessRules::Decision AccessRules::decideBy(const Asked& question, bool byRole,
                                            const FitOf& fitOf) const {
    Decision decision{byRole, std::nullopt};
    if (question.role == Role::Admin || question.role == Role::None) return decision;
    std::optional<Weight> heaviest;
    for (const AccessRule& rule : rules_) {
        const Named who = namedBy(rule, question.user, question.role, question.groups);
        if (who == Named::Nobody) continue;
        const Fit fit = fitOf(rule);
        const std::size_t layer = strengthOf(rule.layers, question.layer.value);
        if (fit.place == 0 || layer == 0) continue;
        const Weight weight{who, fit.place, layer, fit.byKind, !rule.allows};
        if (heaviest && *heaviest >= weight) continue;
        heaviest = weight;
        decision = {rule.allows, rule.number};
    }
    return decision;
}

AccessRules::Decision AccessRules::decide(const Question& question) const {
    const std::string prim = primOf(question.path);
    return decideBy(question, question.role >= Role::Editor, [&](const AccessRule& rule) {
        return isAbout(rule, question.kind) ? Fit{strengthOf(rule.paths, prim), !rule.kinds.empty()}
                                            : Fit{};
    });
}

AccessRules::Decision AccessRules::decide(const ActionQuestion& question) const {
    return decideBy(question, question.role >= roleFor(question.action),
                    [&](const AccessRule& rule) {
                        if (rule.actions.contains(question.action))
                            return Fit{kNamesTheAction, false};
                        return isAboutUnnamed(rule, question.action)
                                   ? Fit{strengthOf(rule.paths, "/"), !rule.kinds.empty()}
                                   : Fit{};
                    });
}

bool AccessRules::concern(const UserName& user, Role role,
                          const std::set<std::string>& groups) const {
    if (role == Role::Admin || role == Role::None) return false;
    return std::ranges::any_of(rules_, [&](const auto& rule) {
        return namedBy(rule, user, role, groups) != Named::Nobody;
    });
}

bool AccessRules::mayDenyBelow(const Question& question) const {
    if (question.role == Role::Admin || question.role == Role::None) return false;
    const std::string prim = primOf(question.path);
    const std::string below = prim == "/" ? prim : prim + "/";
    return std::ranges::any_of(rules_, [&](const AccessRule& rule) {
        if (rule.allows ||
            namedBy(rule, question.user, question.role, question.groups) == Named::Nobody)
            return false;
        if (!isAbout(rule, question.kind)) return false;
        if (strengthOf(rule.layers, question.layer.value) == 0) return false;
        return std::ranges::any_of(rule.paths, [&](const std::string& glob) {
            const std::string_view literal = literalPart(glob);
            return literal.starts_with(below) || below.starts_with(literal);
        });
    });
}

std::string AccessRules::describe(std::size_t number) const {
    const auto found = std::ranges::find(rules_, number, &AccessRule::number);
    if (found == rules_.end()) return "rule " + std::to_string(number);
    const AccessRule& rule = *found;
    std::string what, who;
    for (const OpinionKind kind : rule.kinds)
        what += (what.empty() ? "" : ", ") + std::string(nameOf(kind));
    for (const ProjectAction action : rule.actions)
        what += (what.empty() ? "" : ", ") + std::string(nameOf(action));
    for (const std::string& user : rule.users) who += (who.empty() ? "" : ", ") + user;
    for (const std::string& group : rule.groups)
        who += (who.empty() ? "the group " : ", the group ") + group;
    for (const Role role : rule.roles) who += (who.empty() ? "" : ", ") + std::string(nameOf(role));
    return "rule " + std::to_string(number) + (rule.allows ? " allows " : " denies ") +
           (what.empty() ? "everything" : what) +
           (rule.paths.empty() ? "" : " in " + joined(rule.paths)) +
           (rule.layers.empty() ? "" : " of " + joined(rule.layers)) +
           (who.empty() ? " to everybody" : " to " + who);
}

}  // namespace usdlive
