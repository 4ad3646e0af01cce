// Finds the user of a request, and slows down those who guess.
#include "usdlive/server/auth/SignIn.h"

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

}  // namespace

Result<void> SignIn::start() {
    auto accounts = file_.read();
    if (!accounts) return tl::unexpected(accounts.error());
    if (*accounts) accounts_ = std::make_shared<const Accounts>(std::move(**accounts));
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

std::optional<SignedIn> SignIn::find(std::string_view authorization) const {
    if (!isRequired() || !authorization.starts_with(kBearer)) return std::nullopt;
    const std::string_view token = authorization.substr(kBearer.size());
    if (owner_ && owner_->is(token)) return SignedIn{{}, Role::Admin, kOwner};
    const auto proved = accounts_->find(token);
    if (!proved) return std::nullopt;
    return SignedIn{proved->user, Role::None, proved->token};
}

SignedIn SignIn::in(const Accounts& accounts, SignedIn user, const std::string& project) {
    if (user.token != kOwner) user.role = accounts.roleOf(user.user, user.token, project);
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
