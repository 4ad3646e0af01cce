// Prints and changes access rules, and decides as the server does.
#include "app/AccessCommands.h"

#include <stdlib.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "app/AdminCommands.h"
#include "app/RunningServer.h"
#include "auth/AccessRulesFile.h"
#include "auth/Accounts.h"
#include "files/LayerFiles.h"
#include "files/PrimSearch.h"
#include "usdlive/common/core/PercentEncoding.h"
#include "usdlive/common/core/Utf8.h"
#include "usdlive/common/fetch/UsdliveServer.h"
#include "usdlive/common/layer/SpecPath.h"

namespace usdlive::server {

namespace {

constexpr std::chrono::milliseconds kTakenTime{3'000}, kTakenLook{20};
constexpr unsigned kHttpOk = 200;
constexpr const char* kUnless = ". With --unchecked it is added nevertheless";

struct Asked {
    std::filesystem::path folder;
    std::string user, layer, path, kind;
    std::string role;  ///< empty: that of the account
    std::set<std::string> groups;
};

struct Changed {
    std::filesystem::path folder;
    std::vector<std::string> users, groups, roles, layers, paths, kinds, actions;
    std::size_t number = 0;
    bool isUnchecked = false;
};

tl::unexpected<Error> unknownUser(const std::string& user, const AccountsFile& file) {
    return fail(ErrorCode::InvalidArgument,
                "there is no user " + inQuotes(user) + " in " + file.path().string());
}

/// Returns the role of the user in the project of the folder.
Result<Role> roleOf(const Asked& asked) {
    if (!asked.role.empty()) return *roleNamed(asked.role);
    const AccountsFile file(accountsFolderOf(asked.folder));
    const auto accounts = file.read();
    if (!accounts) return tl::unexpected(accounts.error());
    if (*accounts) {
        const auto found = (*accounts)->users().find(UserName{asked.user});
        if (found == (*accounts)->users().end()) return unknownUser(asked.user, file);
        const auto own = found->second.projects.find(projectNameOf(asked.folder));
        return own == found->second.projects.end() ? found->second.role : own->second;
    }
    return Role::Editor;  // nobody signs in
}

void print(const AccessRules& rules, const AccessRules::Decision& decision, std::string_view what) {
    std::cout << (decision.isAllowed ? "yes  " : "no   ") << what << "  ("
              << (decision.rule ? rules.describe(*decision.rule) : "the role decides") << ")\n";
}

void explainActions(const AccessRules& rules, const Asked& asked, Role role) {
    const UserName user{asked.user};
    const LayerId layer{asked.layer}, project;
    for (std::size_t index = 0; index < kProjectActionNames.size(); ++index) {
        const auto action = ProjectAction(index);
        const LayerId& place = concernsProject(action) ? project : layer;
        print(rules,
              rules.decide(AccessRules::ActionQuestion{user, role, action, place, asked.groups}),
              kProjectActionNames[index]);
    }
}

void explainKinds(const AccessRules& rules, const Asked& asked, Role role) {
    const UserName user{asked.user};
    const LayerId layer{asked.layer};
    for (std::size_t index = 0; index < kOpinionKindNames.size(); ++index) {
        if (!asked.kind.empty() && asked.kind != kOpinionKindNames[index]) continue;
        print(rules,
              rules.decide({user, role, layer, asked.path, OpinionKind(index), asked.groups}),
              kOpinionKindNames[index]);
    }
}

Result<void> answer(const Asked& asked) {
    const AccessRulesFile file(asked.folder);
    const auto rules = file.read();
    if (!rules) return tl::unexpected(rules.error());
    const AccessRules present = rules->value_or(AccessRules());
    if (!asked.user.empty()) {
        if (!asked.path.empty())
            if (auto path = specpath::parse(asked.path); !path) return tl::unexpected(path.error());
        return roleOf(asked).map([&](Role role) {
            std::cout << asked.user << " is " << nameOf(role) << "\n";
            asked.path.empty() ? explainActions(present, asked, role)
                               : explainKinds(present, asked, role);
        });
    }
    if (present.rules().empty())
        std::cout << "There are no rules: roles alone decide. " << file.path().string()
                  << " would have them.\n";
    for (std::size_t number = 1; number <= present.rules().size(); ++number)
        std::cout << present.describe(number) << "\n";
    return {};
}

/// A folder for files of this process, until it is destroyed.
class TemporaryFolder {
public:
    TemporaryFolder() {
        std::error_code ignored;
        std::string name = (std::filesystem::temp_directory_path(ignored) / "usdlive-XXXXXX");
        if (::mkdtemp(name.data())) path_ = name;
    }
    ~TemporaryFolder() {
        std::error_code ignored;
        if (!path_.empty()) std::filesystem::remove_all(path_, ignored);
    }
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;

    /// Returns the path of a new file with the content; nothing if it cannot be written.
    [[nodiscard]] std::optional<std::filesystem::path> write(const std::string& name,
                                                             const std::string& content) const {
        if (path_.empty()) return std::nullopt;
        const std::filesystem::path file = path_ / name;
        std::ofstream stream(file, std::ios::binary);
        stream << content;
        stream.close();
        return stream ? std::optional(file) : std::nullopt;
    }

private:
    std::filesystem::path path_;
};

/// Returns the layer's content as the running server has it; nothing if none answers.
std::optional<std::string> servedContent(const std::filesystem::path& folder,
                                         const LayerId& layer) {
    const auto server = RunningServer::find(folder);
    const std::size_t scheme = server ? server->url.find("://") : std::string::npos;
    if (scheme == std::string::npos) return std::nullopt;
    const std::string_view address = std::string_view(server->url).substr(scheme + 3);
    const std::size_t slash = std::min(address.find('/'), address.size());
    auto origin = fetch::parseOrigin(address.substr(0, slash), 0);
    if (!origin) return std::nullopt;
    origin->isSecure = server->url.starts_with("wss");
    const std::string target =
        std::string(address.substr(slash)) + "/files/" + percentEncoded(layer.value);
    auto answer = fetch::getFromServer({*origin, target}, {});
    if (!answer || answer->status != kHttpOk) return std::nullopt;
    return std::move(answer->body);
}

/// Returns an error if no layer that the rule is about has a prim that it names.
Result<void> checkPaths(const Changed& changed, const std::vector<LayerId>& layers) {
    std::vector<std::string> missing;
    for (const std::string& glob : changed.paths)
        if (glob.starts_with('/')) missing.push_back(glob);  // AccessRulesFile refuses others
    const auto isLast = [&](std::string_view path) {
        std::erase_if(missing, [&](const std::string& glob) { return matchesGlob(glob, path); });
        return missing.empty();
    };
    const TemporaryFolder folder;
    for (const LayerId& layer : layers) {
        if (missing.empty()) break;
        const auto isOf = [&](const std::string& glob) { return matchesGlob(glob, layer.value); };
        if (!changed.layers.empty() && std::ranges::none_of(changed.layers, isOf)) continue;
        std::filesystem::path file = changed.folder / layer.value;
        if (const auto served = servedContent(changed.folder, layer))
            file = folder.write("layer" + file.extension().string(), *served).value_or(file);
        // A layer that cannot be read has no prims that a rule could be about.
        static_cast<void>(hasPrim(layer, file, isLast));
    }
    if (missing.empty()) return {};
    return fail(ErrorCode::InvalidArgument, "no prim in the layers of " + changed.folder.string() +
                                                " matches " + inQuotes(missing.front()) + kUnless);
}

/// Returns an error if the rule names a user, layers or prims that do not exist.
Result<void> check(const Changed& changed) {
    const AccountsFile file(accountsFolderOf(changed.folder));
    const auto accounts = file.read();
    if (!accounts) return tl::unexpected(accounts.error());
    for (const std::string& user : changed.users)
        if (*accounts && !(*accounts)->users().contains(UserName{user}))
            return fail(ErrorCode::InvalidArgument,
                        unknownUser(user, file).value().message + kUnless);
    if (changed.layers.empty() && changed.paths.empty()) return {};
    const auto layers = layersIn(changed.folder);
    if (!layers) return tl::unexpected(layers.error());
    for (const std::string& glob : changed.layers)
        if (std::ranges::none_of(
                *layers, [&](const LayerId& layer) { return matchesGlob(glob, layer.value); }))
            return fail(ErrorCode::InvalidArgument, "no layer in " + changed.folder.string() +
                                                        " matches " + inQuotes(glob) + kUnless);
    return checkPaths(changed, *layers);
}

/// Waits until the running server has taken the rules, and prints whether it has.
void confirmTaken(const std::filesystem::path& folder, const AccessRulesFile& file) {
    if (!RunningServer::find(folder)) return;
    const auto end = std::chrono::steady_clock::now() + kTakenTime;
    while (file.taken() != file.stamp()) {
        if (std::chrono::steady_clock::now() > end) {
            std::cout << "The running server has not confirmed the change yet; look at its log.\n";
            return;
        }
        std::this_thread::sleep_for(kTakenLook);
    }
    std::cout << "The running server has taken the change.\n";
}

/// Records and prints a change of the rules.
Result<void> changed(const Changed& words, std::string_view event, const std::string& sentence) {
    auto recorded =
        recordCommand(accountsFolderOf(words.folder), event, sentence, projectNameOf(words.folder));
    std::cout << sentence << "\n";
    confirmTaken(words.folder, AccessRulesFile(words.folder));
    return recorded;
}

Result<void> addRule(const Changed& words, bool allows) {
    if (!words.isUnchecked)
        if (auto checked = check(words); !checked) return checked;
    AccessRule rule;
    rule.allows = allows;
    rule.users.insert(words.users.begin(), words.users.end());
    rule.groups.insert(words.groups.begin(), words.groups.end());
    for (const std::string& role : words.roles) rule.roles.insert(*roleNamed(role));
    rule.layers = words.layers;
    rule.paths = words.paths;
    for (const std::string& kind : words.kinds) rule.kinds.insert(*opinionKindNamed(kind));
    for (const std::string& action : words.actions)
        rule.actions.insert(*projectActionNamed(action));
    const auto rules = AccessRulesFile(words.folder).add(rule);
    if (!rules) return tl::unexpected(rules.error());
    return changed(words, "access rule added", rules->describe(rules->rules().size()));
}

Result<void> removeRule(const Changed& words) {
    const AccessRulesFile file(words.folder);
    const auto before = file.read();
    if (!before) return tl::unexpected(before.error());
    const auto after = file.remove(words.number);
    if (!after) return tl::unexpected(after.error());
    std::string sentence = "rule " + std::to_string(words.number);
    if (*before && words.number <= (*before)->rules().size())
        sentence = (*before)->describe(words.number);
    return changed(words, "access rule removed", sentence);
}

template <std::size_t N>
std::string joined(const std::array<std::string_view, N>& names, std::string_view between) {
    std::string list;
    for (const std::string_view name : names) list.append(list.empty() ? "" : between).append(name);
    return list;
}

template <std::size_t N>
CLI::Validator oneOf(const std::array<std::string_view, N>& names) {
    return CLI::IsMember(std::vector<std::string>(names.begin(), names.end())).description("");
}

void addFolder(CLI::App& app, std::filesystem::path& folder) {
    app.add_option("DIR", folder, "The folder of the project")
        ->required()
        ->check(CLI::ExistingDirectory.description(""))
        ->type_name("");
}

constexpr const char* kRuleFooter = R"(
An option that is left out means all; but a rule with --kind is about no action, and one with --action about no
edit, unless it has both. Each option can be given several times. The most specific rule decides;
among equals, one that denies.

Examples:
  usdlive deny  DIR --user ann
  usdlive grant DIR --user ann --path '/World/Characters/**' --kind animation
  usdlive grant DIR --user ann --action save
  usdlive access DIR            lists the rules with their numbers
  usdlive revoke DIR 2          removes rule 2)";

int runRuleCommand(const char* name, bool allows, int argc, const char* const* argv) {
    Changed words;
    CLI::App app(allows ? "Adds a rule that allows edits and actions in a project."
                        : "Adds a rule that denies edits and actions in a project.",
                 name);
    app.footer(kRuleFooter);
    addFolder(app, words.folder);
    app.add_option("--user", words.users, "The user who edits")->type_name("NAME");
    app.add_option("--group", words.groups, "A group that the issuer gives the user")
        ->type_name("NAME");
    app.add_option("--role", words.roles, "The role of the user")
        ->check(oneOf(kRoleNames))
        ->type_name("ROLE");
    app.add_option("--layer", words.layers, "Layers, for example 'shot/*.usda'")->type_name("GLOB");
    app.add_option("--path", words.paths, "Prims, for example '/World/Props/**'")
        ->type_name("GLOB");
    app.add_option("--kind", words.kinds, "A kind of opinion, see usdlive access --help")
        ->check(oneOf(kOpinionKindNames))
        ->type_name("KIND");
    app.add_option("--action", words.actions,
                   "What else the user does: " + joined(kProjectActionNames, ", "))
        ->check(oneOf(kProjectActionNames))
        ->type_name("ACTION");
    app.add_flag("--unchecked", words.isUnchecked,
                 "Also if there is no such user, layer or prim yet");
    for (CLI::Option* option : app.get_options())
        if (option->get_expected_max() > 1) option->expected(1)->take_all();
    return runAdminCommand(app, argc, argv, [&] { return addRule(words, allows); });
}

int runRevoke(int argc, const char* const* argv) {
    Changed words;
    CLI::App app("Removes an access rule of a project.", "usdlive revoke");
    addFolder(app, words.folder);
    app.add_option("NUMBER", words.number, "Its number, as `usdlive access DIR` lists it")
        ->required()
        ->type_name("");
    return runAdminCommand(app, argc, argv, [&] { return removeRule(words); });
}

int runAccess(int argc, const char* const* argv) {
    Asked asked;
    CLI::App app(
        "Prints the access rules of a project, what a user may do with a layer, or what a "
        "user may write\nat a place.",
        "usdlive access");
    addFolder(app, asked.folder);
    auto* user = app.add_option("USER", asked.user)->type_name("");
    auto* layer = app.add_option("LAYER", asked.layer, "For example shot.usda")->type_name("");
    auto* path = app.add_option("PATH", asked.path, "For example /World/Props")->type_name("");
    app.add_option("KIND", asked.kind,
                   "A kind of opinion; default: all of them: " + joined(kOpinionKindNames, " "))
        ->check(oneOf(kOpinionKindNames))
        ->type_name("");
    app.add_option("--group", asked.groups, "A group that the issuer gives the user")
        ->type_name("NAME")
        ->allow_extra_args(false)
        ->needs(layer);
    app.add_option("--role", asked.role,
                   "The role of a user who has no account; default: that of\nthe account")
        ->check(oneOf(kRoleNames))
        ->type_name("ROLE")
        ->needs(layer);
    user->needs(layer);
    layer->needs(user);
    path->needs(layer);
    return runAdminCommand(app, argc, argv, [&] { return answer(asked); });
}

}  // namespace

std::optional<int> runAccessCommand(int argc, const char* const* argv) {
    const std::string_view name = argc > 0 ? argv[0] : "";
    if (name == "usdlive access") return runAccess(argc, argv);
    if (name == "usdlive grant") return runRuleCommand("usdlive grant", true, argc, argv);
    if (name == "usdlive deny") return runRuleCommand("usdlive deny", false, argc, argv);
    if (name == "usdlive revoke") return runRevoke(argc, argv);
    return std::nullopt;
}

}  // namespace usdlive::server
