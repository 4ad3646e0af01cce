// Finds the user of a request, and slows down those who guess.
#include "auth/SignIn.h"

#include <algorithm>

namespace usdlive::server {

namespace {

using std::chrono::milliseconds;

constexpr std::string_view kBearer = "Bearer ";
constexpr const char* kOwner = "owner";
constexpr milliseconds kLeastDelay{100};
// An address that was not refused for this time is forgotten.
constexpr std::chrono::minutes kMemory{1};
constexpr std::size_t kMostAddresses = 10'000;

/// Returns an id for the log.
std::string idOfIssued(std::string_view token) {
    constexpr std::size_t kIdDigits = 8;
    return "issued " + hashOfSecret(token).hex().substr(0, kIdDigits);
}

}  // namespace

Result<void> SignIn::start() {
    auto accounts = file_.read();
    if (!accounts) return tl::unexpected(accounts.error());
    if (*accounts || issuer_)
        accounts_ = std::make_shared<const Accounts>(std::move(*accounts).value_or(Accounts()));
    return {};
}

void SignIn::letOwnerIn(std::uint16_t port) {
    if (isRequired()) owner_.emplace(port);
}

bool SignIn::take(Accounts accounts) {
    if (!isRequired() || accounts.version() < accounts_->version()) return false;
    accounts_ = std::make_shared<const Accounts>(std::move(accounts));
    return true;
}

tl::expected<SignedIn, Stranger> SignIn::find(std::string_view authorization,
                                              std::int64_t now) const {
    using Why = Stranger::Why;
    if (!isRequired() || !authorization.starts_with(kBearer))
        return tl::unexpected(Stranger{authorization.empty() ? Why::NoToken : Why::UnknownToken});
    const std::string_view token = authorization.substr(kBearer.size());
    if (issuer_ && isIssuedToken(token)) return findIssued(token, now);
    if (owner_ && owner_->is(token)) return SignedIn{{}, Role::Admin, kOwner};
    const auto proved = accounts_->find(token);
    if (!proved) return tl::unexpected(Stranger{Why::UnknownToken});
    if (proved->endsAt && now >= *proved->endsAt)
        return tl::unexpected(Stranger{Why::EndedToken, {}, proved->user});
    return SignedIn{proved->user, Role::None, proved->token, {}, proved->endsAt};
}

tl::expected<SignedIn, Stranger> SignIn::findIssued(std::string_view token,
                                                    std::int64_t now) const {
    using Why = Stranger::Why;
    if (!keys_) return tl::unexpected(Stranger{Why::NoKeys});
    auto checked = checkIssuedToken(token, *keys_, issuer_->rules, now);
    if (!checked) return tl::unexpected(Stranger{Why::IssuedToken, checked.error()});
    const auto account = accounts_->users().find(checked->user);
    if (account != accounts_->users().end() && account->second.isService)
        return tl::unexpected(Stranger{Why::IsService, {}, std::move(checked->user)});
    if (issuer_->role == Role::None && account == accounts_->users().end())
        return tl::unexpected(Stranger{Why::NoRole, {}, std::move(checked->user)});
    return SignedIn{std::move(checked->user), Role::None, idOfIssued(token),
                    IssuedSignIn{std::move(checked->groups), checked->endsAt, issuer_->role}};
}

SignedIn SignIn::in(const Accounts& accounts, SignedIn user, const std::string& project) {
    if (user.issued)
        user.role = accounts.roleOf(user.user, project).value_or(user.issued->role);
    else if (user.token == kByCertificate)
        user.role = accounts.roleOf(user.user, project).value_or(Role::None);
    else if (user.token != kOwner)
        user.role = accounts.roleOf(user.user, user.token, project);
    return user;
}

milliseconds SignIn::refused(const std::string& address,
                             std::chrono::steady_clock::time_point now) {
    ++refusals_;
    if (failures_.size() >= kMostAddresses)
        std::erase_if(failures_,
                      [&](const auto& entry) { return now - entry.second.last > kMemory; });
    if (failures_.size() >= kMostAddresses && !failures_.contains(address)) return kMostDelay;
    Failures& failures = failures_[address];
    if (now - failures.last > kMemory) failures.delay = milliseconds(0);
    failures.last = now;
    failures.delay = std::clamp(2 * failures.delay, kLeastDelay, kMostDelay);
    return failures.delay;
}

}  // namespace usdlive::server
