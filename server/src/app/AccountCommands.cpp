// Parses and runs the commands of `usdlive user`.
#include "app/AccountCommands.h"

#include <signal.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <charconv>
#include <chrono>
#include <ctime>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "app/AdminCommands.h"
#include "app/RunningServer.h"
#include "app/TlsOptions.h"
#include "auth/Accounts.h"
#include "usdlive/common/core/OwnedFile.h"
#include "usdlive/common/net/Invitation.h"
#include "usdlive/common/net/KnownServers.h"

namespace usdlive::server {

namespace fs = std::filesystem;

namespace {

using Json = nlohmann::json;

constexpr std::chrono::milliseconds kConfirmTime{3'000}, kLook{20};
constexpr const char* kUserFooter = R"(
DIR is the folder that is served, or the one that `usdlive serve --projects` names. Users have to sign in
as soon as the server was started with at least one user. Its owner, on its machine, never has to.

Examples:
  usdlive user add ann --at render:7447 shots/s010  prints an invitation for ann
  usdlive user role ann viewer shots/s010           from now on ann can only look
  usdlive user remove ann shots/s010                ends her sessions within a second
  usdlive user add farm --service --expires 90d shots/s010   prints a token for a render farm

Roles: viewer (look), reviewer (and create checkpoints), editor (and edit, save, lock), admin (and edit
what others have locked, replace the history), none (nothing).)";

struct Words {
    std::string user, role = "editor", project, token, url;
    fs::path folder;
    bool json = false, isService = false;
    std::int64_t expiresIn = 0;  ///< seconds; 0: never
};

std::optional<FollowedAccounts> readFollowed(const fs::path& folder) {
    std::ifstream file(followedAccountsFile(folder));
    const Json json = Json::parse(file, nullptr, false);
    if (!json.is_object()) return std::nullopt;
    try {
        FollowedAccounts found{json.at("process").get<std::int64_t>(),
                               json.at("version").get<std::uint64_t>(), json.at("url"),
                               json.at("pin")};
        if (found.process <= 0 || ::kill(pid_t(found.process), 0) != 0) return std::nullopt;
        return found;
    } catch (const Json::exception&) {
        return std::nullopt;
    }
}

/// Waits until the running server has taken the accounts, and prints whether it has.
void confirm(const fs::path& folder, std::uint64_t version) {
    const auto end = std::chrono::steady_clock::now() + kConfirmTime;
    auto followed = readFollowed(folder);
    while (followed && followed->version < version && std::chrono::steady_clock::now() < end) {
        std::this_thread::sleep_for(kLook);
        followed = readFollowed(folder);
    }
    if (followed && followed->version >= version) {
        std::cout << "The running server has taken the change.\n";
    } else if (followed) {
        std::cout << "The running server has not confirmed the change yet; look at its log.\n";
    } else if (RunningServer::find(folder)) {
        std::cout
            << "The running server asks nobody to sign in, because it had no users when it was "
               "started. Start it again.\n";
    }
}

struct Address {
    std::string host;
    std::uint16_t port = 0;
    std::optional<bool> isTls;  ///< nothing: the text has no scheme
};

std::optional<Address> addressOf(std::string_view url) {
    Address address;
    const auto scheme = url.find("://");
    if (scheme != std::string_view::npos) {
        const std::string_view name = url.substr(0, scheme);
        if (name != "ws" && name != "wss" && name != "usdlive") return std::nullopt;
        address.isTls = name == "wss";
        url.remove_prefix(scheme + 3);
    }
    url = url.substr(0, url.find('/'));
    const auto colon = url.rfind(':');
    if (colon == std::string_view::npos) return std::nullopt;
    address.host = url.substr(0, colon);
    if (address.host.starts_with('[') && address.host.ends_with(']'))
        address.host = address.host.substr(1, address.host.size() - 2);
    const char* const end = url.data() + url.size();
    const auto [read, error] = std::from_chars(url.data() + colon + 1, end, address.port);
    if (error != std::errc{} || read != end || address.host.empty()) return std::nullopt;
    return address;
}

/// Returns where users reach the server.
Result<Invitation> inviteTo(const Words& words) {
    std::string url = words.url;
    const auto followed = readFollowed(words.folder);
    if (followed) {
        if (url.empty()) url = followed->url;
    } else if (const auto running = RunningServer::find(words.folder); running && url.empty()) {
        url = running->url;
    }
    if (url.empty())
        return fail(ErrorCode::InvalidArgument,
                    "the server does not run, so its address is not known: add --at HOST:PORT");
    const auto address = addressOf(url);
    if (!address)
        return fail(ErrorCode::InvalidArgument,
                    url + " is not the address of a server; expected HOST:PORT or wss://HOST:PORT");
    Invitation invitation{address->host, address->port, {}, false, {}};
    if (followed) {
        invitation.isTls = followed->url.starts_with("wss:");
        invitation.pin = followed->pin;
        return invitation;
    }
    // A server that others reach has to encrypt. Its certificate is made now, so that the
    // invitation can name it.
    invitation.isTls = address->isTls.value_or(!isLoopbackHost(address->host));
    if (!invitation.isTls) return invitation;
    auto pin = ownFingerprint(words.folder, address->host);
    if (!pin) return tl::unexpected(pin.error());
    invitation.pin = std::move(*pin);
    return invitation;
}

/// Changes the accounts. `event` and `detail` are for the audit log.
Result<void> change(const Words& words, const std::function<Result<void>(Accounts&)>& edit,
                    std::string_view event, const std::string& detail) {
    const auto accounts = AccountsFile(words.folder).change(edit);
    if (!accounts) return tl::unexpected(accounts.error());
    auto recorded = recordCommand(words.folder, event, detail);
    confirm(words.folder, accounts->version());
    return recorded;
}

Result<void> printInvitation(const Words& words, const std::function<Result<void>(Accounts&)>& edit,
                             std::string_view event, const std::string& detail) {
    auto invitation = inviteTo(words);
    if (!invitation) return tl::unexpected(invitation.error());
    const auto changed = AccountsFile(words.folder).change([&](Accounts& accounts) -> Result<void> {
        if (auto edited = edit(accounts); !edited) return edited;
        return accounts.invite({words.user}, std::time(nullptr)).map([&](std::string code) {
            invitation->code = std::move(code);
        });
    });
    if (!changed) return tl::unexpected(changed.error());
    auto recorded = recordCommand(words.folder, event, detail);
    std::cout << "Send this to " << words.user
              << ". It can be used once, within a day:\n\n  usdlive join " << invitation->text()
              << "\n\n";
    confirm(words.folder, changed->version());
    return recorded;
}

std::string dateOf(std::int64_t seconds) {
    const auto time = std::time_t(seconds);
    std::tm parts{};
    char text[32] = {};
    if (!::gmtime_r(&time, &parts) || std::strftime(text, sizeof text, "%F", &parts) == 0)
        return "?";
    return text;
}

/// Prints a new token of a service account, after `edit`.
Result<void> printToken(const Words& words, const std::function<Result<void>(Accounts&)>& edit,
                        std::string_view event, const std::string& detail) {
    auto place = inviteTo(words);
    if (!place) return tl::unexpected(place.error());
    const std::int64_t now = std::time(nullptr);
    const auto end = words.expiresIn > 0 ? std::optional(now + words.expiresIn) : std::nullopt;
    const auto changed = AccountsFile(words.folder).change([&](Accounts& accounts) -> Result<void> {
        if (auto edited = edit(accounts); !edited) return edited;
        return accounts.makeToken({words.user}, now, end).map([&](std::string token) {
            place->code = std::move(token);
        });
    });
    if (!changed) return tl::unexpected(changed.error());
    const std::string until = end ? ", until " + dateOf(*end) : "";
    auto recorded = recordCommand(words.folder, event, detail + until);
    std::cout
        << "The token of " << words.user << until
        << ". Give it to the program in a file that USDLIVE_TOKEN_FILE names (chmod 600), or in "
           "USDLIVE_TOKEN. It is not shown again:\n\n  "
        << ServiceToken{words.user, *place}.text() << "\n\n";
    confirm(words.folder, changed->version());
    return recorded;
}

Result<void> makeToken(const Words& words) {
    return printToken(words, [](Accounts&) { return Result<void>(); }, "token made", words.user);
}

Result<void> add(const Words& words) {
    if (words.isService)
        return printToken(
            words,
            [&](Accounts& accounts) {
                return accounts.add({words.user}, *roleNamed(words.role), true);
            },
            "user added", words.user + " as " + words.role + ", a service account");
    return printInvitation(
        words,
        [&](Accounts& accounts) { return accounts.add({words.user}, *roleNamed(words.role)); },
        "user added", words.user + " as " + words.role);
}

Result<void> invite(const Words& words) {
    return printInvitation(
        words, [](Accounts&) { return Result<void>(); }, "user invited", words.user);
}

Result<void> setRole(const Words& words) {
    return change(
        words,
        [&](Accounts& accounts) {
            return accounts.setRole({words.user}, *roleNamed(words.role), words.project);
        },
        "role set",
        words.user + " is " + words.role + (words.project.empty() ? "" : " in " + words.project));
}

Result<void> remove(const Words& words) {
    return change(
        words, [&](Accounts& accounts) { return accounts.remove({words.user}); }, "user removed",
        words.user);
}

Result<void> revoke(const Words& words) {
    return change(
        words,
        [&](Accounts& accounts) {
            return accounts.revoke(words.token).map([](const UserName&) {});
        },
        "token revoked", words.token);
}

void print(const UserName& name, const Account& account, std::int64_t now) {
    std::cout << name.value << "  " << nameOf(account.role)
              << (account.isService ? ", a service account" : "");
    for (const auto& [project, role] : account.projects)
        std::cout << ", " << nameOf(role) << " in " << project;
    for (const AccountToken& token : account.tokens)
        std::cout << "\n  token " << token.id << " of " << dateOf(token.madeAt)
                  << (!token.endsAt          ? ""
                      : *token.endsAt <= now ? ", which has ended on "
                                             : ", until ")
                  << (token.endsAt ? dateOf(*token.endsAt) : "");
    for (const AccountInvitation& one : account.invitations)
        if (one.endsAt > now) std::cout << "\n  an invitation that was not used yet";
    std::cout << "\n";
}

Json jsonOf(const UserName& name, const Account& account) {
    Json tokens = Json::array(), projects = Json::object();
    for (const AccountToken& token : account.tokens) {
        tokens.push_back({{"id", token.id}, {"madeAt", token.madeAt}});
        if (token.endsAt) tokens.back()["endsAt"] = *token.endsAt;
    }
    for (const auto& [project, role] : account.projects) projects[project] = nameOf(role);
    return {{"user", name.value},
            {"role", nameOf(account.role)},
            {"service", account.isService},
            {"projects", projects},
            {"tokens", tokens}};
}

Result<void> list(const Words& words) {
    const auto accounts = AccountsFile(words.folder).read();
    if (!accounts) return tl::unexpected(accounts.error());
    const Accounts present = accounts->value_or(Accounts());
    if (words.json) {
        for (const auto& [name, account] : present.users())
            std::cout << jsonOf(name, account).dump() << "\n";
        return {};
    }
    if (!*accounts)
        std::cout << "There are no users: whoever reaches the server may edit, unless an "
                     "issuer signs users in.\n";
    for (const auto& [name, account] : present.users()) print(name, account, std::time(nullptr));
    return {};
}

class Commands {
public:
    Commands(CLI::App& app, Words& words, std::function<Result<void>()>& chosen)
        : app_(app), words_(words), chosen_(chosen) {}

    void addAll() {
        CLI::App& added = verb("add", "Add a user and print an invitation", add);
        user(added);
        role(
            added.add_option("--role", words_.role, "What the user may do")->default_str("editor"));
        at(added);
        auto* service = added.add_flag("--service", words_.isService,
                                       "For a program: print a token in place of an invitation");
        expires(added)->needs(service);
        CLI::App& made = verb("token", "Print another token of a service account", makeToken);
        user(made);
        at(made);
        expires(made);
        CLI::App& invited =
            verb("invite", "Print another invitation, for one more machine", invite);
        user(invited);
        at(invited);
        CLI::App& listed = verb("list", "List users, roles and tokens", list);
        listed.add_flag("--json", words_.json, "Print one JSON object per user");
        CLI::App& changed = verb("role", "Change what a user may do", setRole);
        user(changed);
        role(changed.add_option("ROLE", words_.role)->required());
        changed.add_option("--project", words_.project, "Only in this project")->type_name("NAME");
        user(verb("remove", "Remove a user and end all sessions of it", remove));
        verb("revoke", "Remove one token and end its sessions", revoke)
            .add_option("TOKEN", words_.token, "As `usdlive user list` names it")
            ->required();
        for (CLI::App* one : app_.get_subcommands({}))
            one->add_option("DIR", words_.folder, "The served folder")
                ->required()
                ->check(CLI::ExistingDirectory.description(""))
                ->type_name("");
    }

private:
    CLI::App& verb(const char* name, const char* what, Result<void> (*run)(const Words&)) {
        CLI::App& added = *app_.add_subcommand(name, what);
        added.callback([this, run] { chosen_ = [this, run] { return run(words_); }; });
        return added;
    }
    void user(CLI::App& app) {
        app.add_option("NAME", words_.user, "The name of the user")->required()->type_name("");
    }
    static void role(CLI::Option* option) {
        option
            ->check(CLI::IsMember(std::vector<std::string>(kRoleNames.begin(), kRoleNames.end()))
                        .description(""))
            ->type_name("ROLE");
    }
    CLI::Option* expires(CLI::App& app) {
        constexpr std::int64_t kMinute = 60, kHour = 60 * kMinute, kDay = 24 * kHour;
        const std::map<std::string, std::int64_t> units{{"m", kMinute}, {"h", kHour}, {"d", kDay}};
        return app
            .add_option("--expires", words_.expiresIn,
                        "When the token ends, for example 90d or 12h;\ndefault: when it is revoked")
            ->transform(CLI::AsNumberWithUnit(units, CLI::AsNumberWithUnit::UNIT_REQUIRED, ""))
            ->check(CLI::Range(std::int64_t(1), 3'650 * kDay).description(""))
            ->type_name("TIME");
    }
    void at(CLI::App& app) {
        app.add_option("--at", words_.url,
                       "Where the user reaches the server, encrypted if that is\n"
                       "not this machine; default: the address of the running one")
            ->type_name("HOST:PORT");
    }

    CLI::App& app_;
    Words& words_;
    std::function<Result<void>()>& chosen_;
};

}  // namespace

fs::path followedAccountsFile(const fs::path& folder) {
    return folder / ".usdlive" / "users.followed";
}

void write(const FollowedAccounts& followed, const fs::path& file) {
    const Json json{{"process", followed.process},
                    {"version", followed.version},
                    {"url", followed.url},
                    {"pin", followed.pin}};
    (void)replaceFile(file, json.dump() + "\n", kOwnerOnly);
}

int runAccountCommand(int argc, const char* const* argv) {
    CLI::App app("Adds and removes the users of a server, on its machine.", kAccountCommands);
    app.get_formatter()->column_width(30);
    app.require_subcommand(1);
    app.footer(kUserFooter);
    Words words;
    std::function<Result<void>()> chosen;
    Commands(app, words, chosen).addAll();
    return runAdminCommand(app, argc, argv, [&chosen] { return chosen(); });
}

}  // namespace usdlive::server
