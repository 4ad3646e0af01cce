// Prints access rules, and decides as the server does.
#include "usdlive/server/app/AccessCommands.h"

#include <CLI/CLI.hpp>
#include <filesystem>
#include <iostream>
#include <optional>

#include "usdlive/common/core/Utf8.h"
#include "usdlive/common/layer/SpecPath.h"
#include "usdlive/server/auth/AccessRulesFile.h"
#include "usdlive/server/auth/Accounts.h"

namespace usdlive::server {

namespace {

constexpr int kNotReadable = 1, kNotUnderstood = 2;

struct Asked {
    std::filesystem::path folder;
    std::string user, layer, path, kind;
};

/// Returns the role of the user in the project of the folder. The accounts are in the folder, or in
/// the one of `--projects` above it.
Result<Role> roleOf(const Asked& asked) {
    std::error_code ignored;
    const auto folder = std::filesystem::canonical(asked.folder, ignored);
    for (const auto& place : {folder, folder.parent_path()}) {
        const auto accounts = AccountsFile(place).read();
        if (!accounts) return tl::unexpected(accounts.error());
        if (!*accounts) continue;
        const auto found = (*accounts)->users().find(UserName{asked.user});
        if (found == (*accounts)->users().end())
            return fail(ErrorCode::InvalidArgument, "there is no user " + inQuotes(asked.user) +
                                                        " in " +
                                                        AccountsFile(place).path().string());
        const auto own = found->second.projects.find(folder.filename().string());
        return own == found->second.projects.end() ? found->second.role : own->second;
    }
    return Role::Editor;  // nobody signs in
}

void explain(const AccessRules& rules, const Asked& asked, Role role) {
    const UserName user{asked.user};
    const LayerId layer{asked.layer};
    std::cout << asked.user << " is " << nameOf(role) << "\n";
    for (std::size_t index = 0; index < kOpinionKindNames.size(); ++index) {
        if (!asked.kind.empty() && asked.kind != kOpinionKindNames[index]) continue;
        const auto decision = rules.decide({user, role, layer, asked.path, OpinionKind(index)});
        std::cout << (decision.isAllowed ? "yes  " : "no   ") << kOpinionKindNames[index] << "  ("
                  << (decision.rule ? rules.describe(*decision.rule) : "the role decides") << ")\n";
    }
}

/// Returns the exit code, or that of an error if the output could not be written.
int accessCommandEnded(int code) {
    if (std::cout.flush()) return code;
    std::cerr << kAccessCommands << ": standard output cannot be written\n";
    return kNotReadable;
}

Result<void> answer(const Asked& asked) {
    const AccessRulesFile file(asked.folder);
    const auto rules = file.read();
    if (!rules) return tl::unexpected(rules.error());
    const AccessRules present = rules->value_or(AccessRules());
    if (!asked.user.empty()) {
        if (auto path = specpath::parse(asked.path); !path) return tl::unexpected(path.error());
        return roleOf(asked).map([&](Role role) { explain(present, asked, role); });
    }
    if (present.rules().empty())
        std::cout << "There are no rules: roles alone decide. " << file.path().string()
                  << " would have them.\n";
    for (std::size_t number = 1; number <= present.rules().size(); ++number)
        std::cout << present.describe(number) << "\n";
    return {};
}

}  // namespace

int runAccessCommand(int argc, const char* const* argv) {
    Asked asked;
    CLI::App app("Prints the access rules of a project, or what a user may write at a place.",
                 kAccessCommands);
    app.add_option("DIR", asked.folder, "The folder of the project")
        ->required()
        ->check(CLI::ExistingDirectory.description(""))
        ->type_name("");
    auto* user = app.add_option("USER", asked.user)->type_name("");
    auto* layer = app.add_option("LAYER", asked.layer, "For example shot.usda")->type_name("");
    auto* path = app.add_option("PATH", asked.path, "For example /World/Props")->type_name("");
    app.add_option("KIND", asked.kind, "A kind of opinion; default: all of them")
        ->check(CLI::IsMember(
                    std::vector<std::string>(kOpinionKindNames.begin(), kOpinionKindNames.end()))
                    .description(""))
        ->type_name("");
    user->needs(path);
    layer->needs(user);
    path->needs(layer);
    try {
        app.parse(argc, argv);
    } catch (const CLI::Success& help) {
        return accessCommandEnded(app.exit(help));
    } catch (const CLI::Error& error) {
        std::cerr << kAccessCommands << ": " << error.what() << "\n";
        return kNotUnderstood;
    }
    const auto done = answer(asked);
    if (!done) std::cerr << kAccessCommands << ": " << done.error().message << "\n";
    return accessCommandEnded(done ? 0 : kNotReadable);
}

}  // namespace usdlive::server
