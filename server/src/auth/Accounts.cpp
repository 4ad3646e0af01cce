// Reads, changes and writes the accounts of a server.
#include "auth/Accounts.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "usdlive/common/core/ClientSecret.h"
#include "usdlive/common/core/Utf8.h"

namespace usdlive::server {

namespace {

using Json = nlohmann::json;

constexpr int kFormat = 1;
constexpr std::size_t kMostNameBytes = 64;
constexpr std::size_t kTokenIdDigits = 8;

std::string idOf(const Hash& hash) { return hash.hex().substr(0, kTokenIdDigits); }

std::string roles() {
    std::string all;
    for (const std::string_view name : kRoleNames)
        all += (all.empty() ? "" : ", ") + std::string(name);
    return all;
}

/// Raised while a file is parsed; the text says where.
struct Wrong {
    std::string text;
};

const Json& member(const Json& object, const char* name, const std::string& where) {
    if (!object.is_object()) throw Wrong{where + " is not an object"};
    const auto found = object.find(name);
    if (found == object.end()) throw Wrong{where + " has no \"" + name + "\""};
    return *found;
}

Role roleIn(const Json& json, const std::string& where) {
    const auto role =
        json.is_string() ? roleNamed(json.get_ref<const std::string&>()) : std::nullopt;
    if (!role) throw Wrong{"the role of " + where + " is none of " + roles()};
    return *role;
}

Hash hashIn(const Json& object, const std::string& where) {
    const Json& text = member(object, "hash", where);
    const auto hash =
        text.is_string() ? hashFromHex(text.get_ref<const std::string&>()) : std::nullopt;
    if (!hash) throw Wrong{"the hash in " + where + " is not a SHA-256"};
    return *hash;
}

std::int64_t timeIn(const Json& object, const char* name, const std::string& where) {
    const Json& time = member(object, name, where);
    if (!time.is_number_integer())
        throw Wrong{"\"" + std::string(name) + "\" in " + where + " is not a number"};
    return time.get<std::int64_t>();
}

const Json& listIn(const Json& object, const char* name, const std::string& where) {
    const Json& list = member(object, name, where);
    if (!list.is_array())
        throw Wrong{"\"" + std::string(name) + "\" of " + where + " is not a list"};
    return list;
}

Account accountIn(const Json& json, const std::string& where) {
    Account account;
    account.role = roleIn(member(json, "role", where), where);
    if (const auto projects = json.find("projects"); projects != json.end()) {
        if (!projects->is_object()) throw Wrong{"\"projects\" of " + where + " is not an object"};
        for (const auto& [project, role] : projects->items())
            account.projects[project] = roleIn(role, where + " in " + project);
    }
    if (const auto service = json.find("service"); service != json.end()) {
        if (!service->is_boolean()) throw Wrong{"\"service\" of " + where + " is no true or false"};
        account.isService = service->get<bool>();
    }
    for (const Json& token : listIn(json, "tokens", where)) {
        const Hash hash = hashIn(token, "a token of " + where);
        account.tokens.push_back(
            {idOf(hash), hash, timeIn(token, "madeAt", "a token of " + where)});
        if (token.contains("endsAt"))
            account.tokens.back().endsAt = timeIn(token, "endsAt", "a token of " + where);
    }
    for (const Json& one : listIn(json, "invitations", where))
        account.invitations.push_back({hashIn(one, "an invitation of " + where),
                                       timeIn(one, "endsAt", "an invitation of " + where)});
    return account;
}

Json jsonOf(const Account& account) {
    Json json{
        {"role", nameOf(account.role)}, {"tokens", Json::array()}, {"invitations", Json::array()}};
    for (const auto& [project, role] : account.projects) json["projects"][project] = nameOf(role);
    if (account.isService) json["service"] = true;
    for (const AccountToken& token : account.tokens) {
        json["tokens"].push_back({{"hash", token.hash.hex()}, {"madeAt", token.madeAt}});
        if (token.endsAt) json["tokens"].back()["endsAt"] = *token.endsAt;
    }
    for (const AccountInvitation& one : account.invitations)
        json["invitations"].push_back({{"hash", one.hash.hex()}, {"endsAt", one.endsAt}});
    return json;
}

}  // namespace

std::string newSecret() { return newClientSecret().hex(); }

Hash hashOfSecret(std::string_view secret) {
    return sha256(ByteView(reinterpret_cast<const std::uint8_t*>(secret.data()), secret.size()));
}

Result<void> checkUserName(std::string_view name) {
    const bool isName =
        !name.empty() && name.size() <= kMostNameBytes && std::ranges::all_of(name, [](char c) {
            return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                   std::string_view(".-_@").find(c) != std::string_view::npos;
        });
    if (isName) return {};
    return fail(ErrorCode::InvalidArgument,
                inQuotes(std::string(name)) +
                    " cannot be the name of a user: use 1 to 64 letters, digits and \".-_@\"");
}

Result<Accounts> Accounts::parse(std::string_view text) try {
    Json json;
    try {
        json = Json::parse(text);
    } catch (const Json::parse_error& error) {
        const std::size_t line = std::size_t(
            std::ranges::count(text.substr(0, std::min(text.size(), error.byte)), '\n'));
        throw Wrong{"line " + std::to_string(line + 1) + " is not JSON"};
    } catch (const Json::out_of_range&) {
        throw Wrong{"it has a number that is too large"};
    }
    const Json& format = member(json, "format", "the file");
    if (!format.is_number_integer() || format.get<std::int64_t>() != kFormat)
        throw Wrong{"its format is not " + std::to_string(kFormat) +
                    ": a newer usdlive may have written it"};
    Accounts accounts;
    const Json& version = member(json, "version", "the file");
    if (!version.is_number_unsigned()) throw Wrong{"\"version\" is not a number"};
    accounts.version_ = version.get<std::uint64_t>();
    const Json& users = member(json, "users", "the file");
    if (!users.is_object()) throw Wrong{"\"users\" is not an object"};
    for (const auto& [name, account] : users.items()) {
        if (const auto valid = checkUserName(name); !valid) throw Wrong{valid.error().message};
        accounts.users_.emplace(UserName{name}, accountIn(account, "the user " + name));
    }
    return accounts;
} catch (const Wrong& wrong) {
    return fail(ErrorCode::InvalidConfiguration, wrong.text);
}

std::string Accounts::text() const {
    Json users = Json::object();
    for (const auto& [name, account] : users_) users[name.value] = jsonOf(account);
    return Json{{"format", kFormat}, {"version", version_}, {"users", users}}.dump(2) + "\n";
}

std::optional<Accounts::Proved> Accounts::find(std::string_view token) const {
    const Hash hash = hashOfSecret(token);
    for (const auto& [name, account] : users_)
        for (const AccountToken& one : account.tokens)
            if (one.hash == hash) return Proved{name, one.id, one.endsAt};
    return std::nullopt;
}

std::optional<Role> Accounts::roleOf(const UserName& user, const std::string& project) const {
    const auto found = users_.find(user);
    if (found == users_.end()) return std::nullopt;
    const Account& account = found->second;
    const auto own = account.projects.find(project);
    return own == account.projects.end() ? account.role : own->second;
}

Role Accounts::roleOf(const UserName& user, const std::string& token,
                      const std::string& project) const {
    const auto found = users_.find(user);
    if (found == users_.end() || !std::ranges::any_of(found->second.tokens, [&](const auto& one) {
            return one.id == token;
        }))
        return Role::None;
    return *roleOf(user, project);
}

Result<Account*> Accounts::named(const UserName& user) {
    const auto found = users_.find(user);
    if (found != users_.end()) return &found->second;
    return fail(ErrorCode::InvalidArgument, "there is no user " + inQuotes(user.value) +
                                                "; `usdlive user list` names them, `usdlive user "
                                                "add` adds one");
}

Result<void> Accounts::add(const UserName& user, Role role, bool isService) {
    if (auto valid = checkUserName(user.value); !valid) return valid;
    if (users_.contains(user))
        return fail(ErrorCode::InvalidArgument,
                    "there is a user " + inQuotes(user.value) +
                        " already; `usdlive user invite` makes another invitation, `usdlive user "
                        "role` changes the role");
    users_[user].role = role;
    users_[user].isService = isService;
    return {};
}

Result<void> Accounts::remove(const UserName& user) {
    if (auto found = named(user); !found) return tl::unexpected(found.error());
    users_.erase(user);
    return {};
}

Result<void> Accounts::setRole(const UserName& user, Role role, const std::string& project) {
    auto found = named(user);
    if (!found) return tl::unexpected(found.error());
    (project.empty() ? (*found)->role : (*found)->projects[project]) = role;
    return {};
}

Result<std::string> Accounts::invite(const UserName& user, std::int64_t now) {
    auto found = named(user);
    if (!found) return tl::unexpected(found.error());
    if ((*found)->isService)
        return fail(ErrorCode::InvalidArgument,
                    inQuotes(user.value) +
                        " is a service account, with which nobody joins; `usdlive user token` "
                        "prints a token for a program");
    auto& invitations = (*found)->invitations;
    std::erase_if(invitations, [&](const auto& one) { return one.endsAt <= now; });
    const std::string code = newSecret();
    invitations.push_back({hashOfSecret(code), now + kInvitationSeconds});
    return code;
}

Result<std::string> Accounts::addToken(const UserName& user, Account& account, std::int64_t now,
                                       std::optional<std::int64_t> endsAt) {
    if (account.tokens.size() >= kMostTokens)
        return fail(ErrorCode::InvalidArgument,
                    user.value + " has " + std::to_string(kMostTokens) +
                        " tokens, which is the limit; `usdlive user revoke` removes one");
    std::string token = newSecret();
    const Hash hash = hashOfSecret(token);
    account.tokens.push_back({idOf(hash), hash, now, endsAt});
    return token;
}

Result<std::string> Accounts::makeToken(const UserName& user, std::int64_t now,
                                        std::optional<std::int64_t> endsAt) {
    auto found = named(user);
    if (!found) return tl::unexpected(found.error());
    if (!(*found)->isService)
        return fail(
            ErrorCode::InvalidArgument,
            inQuotes(user.value) + " is no service account; `usdlive user invite` lets them join");
    std::erase_if((*found)->tokens,
                  [&](const AccountToken& one) { return one.endsAt && *one.endsAt <= now; });
    return addToken(user, **found, now, endsAt);
}

Result<Accounts::Joined> Accounts::join(std::string_view code, std::int64_t now) {
    const Hash hash = hashOfSecret(code);
    for (auto& [name, account] : users_) {
        const auto found = std::ranges::find(account.invitations, hash, &AccountInvitation::hash);
        if (found == account.invitations.end()) continue;
        if (found->endsAt <= now) break;
        auto token = addToken(name, account, now, std::nullopt);
        if (!token) return tl::unexpected(token.error());
        account.invitations.erase(found);
        return Joined{name, *std::move(token)};
    }
    return fail(ErrorCode::SignInRequired,
                "the invitation was used already, or is older than a day; ask for another one "
                "(`usdlive user invite`)");
}

Result<UserName> Accounts::revoke(std::string_view token) {
    for (auto& [name, account] : users_)
        if (std::erase_if(account.tokens, [&](const auto& one) { return one.id == token; }) > 0)
            return name;
    return fail(ErrorCode::InvalidArgument, "there is no token " + inQuotes(std::string(token)) +
                                                "; `usdlive user list` names them");
}

}  // namespace usdlive::server
