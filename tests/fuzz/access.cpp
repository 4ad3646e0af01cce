// Fuzzes what people write or paste to sign in and to grant access: invitations, accounts and
// rules.
#include "Fuzz.h"
#include "auth/Accounts.h"
#include "usdlive/common/access/AccessRules.h"
#include "usdlive/common/layer/SpecPath.h"
#include "usdlive/common/net/Invitation.h"

using namespace usdlive;
using fuzz::require;

namespace {

void checkInvitation(std::string_view text) {
    const auto invitation = parseInvitation(text);
    if (!invitation) return;
    require(isInvitation(text), "what can be parsed is an invitation");
    require(parseInvitation(invitation->text()) == *invitation, "an invitation is its text");
}

void checkServiceToken(std::string_view text) {
    const auto token = parseServiceToken(text);
    if (token) require(parseServiceToken(token->text()) == *token, "a token is its text");
}

void checkAccounts(std::string_view text) {
    const auto accounts = server::Accounts::parse(text);
    if (!accounts) return require(!accounts.error().message.empty(), "a refusal has a reason");
    const auto again = server::Accounts::parse(accounts->text());
    require(again && again->text() == accounts->text(), "accounts are their text");
    require(!accounts->find(text), "a file is no token");
}

void checkRules(std::string_view text, std::string_view path) {
    const auto rules = AccessRules::parse(text);
    if (!rules) return require(!rules.error().message.empty(), "a refusal has a reason");
    for (std::size_t rule = 1; rule <= rules->rules().size(); ++rule)
        require(!rules->describe(rule).empty(), "a rule has a sentence");
    if (!specpath::parse(path)) return;
    const UserName user{"ann"};
    const LayerId layer{"sets/a.usda"};
    for (const Role role : {Role::None, Role::Viewer, Role::Editor, Role::Admin}) {
        const AccessRules::Question question{user, role, layer, path, OpinionKind::Namespace};
        const auto decision = rules->decide(question);
        require(role != Role::Admin || decision.isAllowed, "nothing is taken from administrators");
        require(role != Role::None || !decision.isAllowed, "no rule lets a stranger in");
        for (std::size_t index = 0; index < kProjectActionNames.size(); ++index) {
            const auto action = ProjectAction(index);
            const auto done = rules->decide(AccessRules::ActionQuestion{user, role, action, layer});
            require(role != Role::Admin || done.isAllowed, "nothing is taken from administrators");
            require(role != Role::None || !done.isAllowed, "no rule lets a stranger act");
            require(done.rule || done.isAllowed == (role >= roleFor(action)),
                    "without a rule about it, the role decides");
        }
        if (rules->concern(user, role)) continue;
        require(!decision.rule && decision.isAllowed == (role >= Role::Editor),
                "without a rule for the user, the role decides");
        require(!rules->mayDenyBelow(question), "without a rule, nothing is denied");
    }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const std::string_view input(reinterpret_cast<const char*>(data), size);
    const std::string_view first = input.substr(0, input.find('\n'));
    const std::string_view rest =
        first.size() < input.size() ? input.substr(first.size() + 1) : std::string_view();
    checkInvitation(input);
    checkServiceToken(input);
    checkAccounts(input);
    checkRules(rest, first);
    const bool matches = matchesGlob(first, rest);
    require(!matches || matchesGlob("**", rest), "** matches what another glob does");
    return 0;
}

std::vector<Bytes> fuzz::seeds() {
    const std::string code(64, 'a');
    std::vector<Bytes> all;
    for (
        const std::string& text :
        {"usdlive-invitation://render:7447/" + code,
         "usdlive-invitation://[::1]:1/" + code + "?pin=sha256:" + code,
         "usdlive-token://farm@render:7447/" + code + "?tls",
         R"({"format": 1, "version": 2, "users": {"ann": {"role": "editor", "projects": {"p": "none"},
              "tokens": [{"hash": ")" +
             code + R"(", "madeAt": 1}],
              "invitations": [{"hash": ")" +
             code + R"(", "endsAt": 2}]}}})",
         std::string("/World/Props\n"
                     R"({"format": 1, "rules": [{"effect": "deny", "users": ["ann"],
                      "roles": ["editor"], "layers": ["sets/**"], "paths": ["/World/**"],
                      "kinds": ["namespace"]}, {"effect": "allow"},
                      {"effect": "deny", "actions": ["save", "takeOver"]}]})"),
         std::string("/A/**/B*c?\n/A/x/y/Bbbcd")})
        all.emplace_back(text.begin(), text.end());
    return all;
}
