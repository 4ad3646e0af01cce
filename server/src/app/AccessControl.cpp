// Follows the accounts, and answers those who sign in.
#include "app/AccessControl.h"

#include <unistd.h>

#include <algorithm>
#include <boost/asio/post.hpp>
#include <ctime>
#include <nlohmann/json.hpp>
#include <utility>

namespace usdlive::server {

namespace asio = boost::asio;

namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr unsigned kUnauthorized = 401, kForbiddenUser = 403, kNotThere = 404, kInternal = 500,
                   kNotNow = 503;
constexpr std::string_view kInvitation = "Invitation ";
// A removed user is out within a second.
constexpr milliseconds kFollowPause{200};

HttpReply signInFirst(const std::string& why) {
    return {"text/plain", why + "\n", kUnauthorized, {{"WWW-Authenticate", "Bearer"}}};
}

HttpReply jsonPage(const nlohmann::json& json) { return {"application/json", json.dump() + "\n"}; }

}  // namespace

AccessControl::AccessControl(asio::io_context& io, const std::filesystem::path& folder,
                             std::optional<IssuerSettings> issuer, Workers& workers,
                             AuditLog& audit, Log& log)
    : io_(io),
      log_(log),
      audit_(audit),
      workers_(workers.files.share()),
      signIn_(folder, std::move(issuer)),
      accountsFile_(io, workers_, signIn_.file(), kFollowPause,
                    [this](const std::string&, Result<std::optional<Accounts>> read) {
                        if (!read)
                            log_.write(LogLevel::Error, "accounts stay as they were",
                                       {{"error", read.error().message}});
                        else if (*read)
                            take(std::move(**read));
                    }),
      followedFile_(followedAccountsFile(folder)) {
    if (const auto& from = signIn_.issuer())
        keys_ = std::make_unique<PublishedKeys>(
            io, from->rules.issuer, from->keysFile, workers, log,
            [this](std::optional<IssuerKeys> keys) { signIn_.setIssuerKeys(std::move(keys)); });
}

AccessControl::~AccessControl() { stop(); }

Result<void> AccessControl::start() {
    auto started = signIn_.start();
    if (started && isRequired()) audit_.begin();
    if (!started || !keys_) return started;
    return keys_->start();
}

void AccessControl::serve(std::uint16_t port, const std::string& url, const std::string& pin,
                          Spread spread) {
    if (!isRequired()) return;
    spread_ = std::move(spread);
    signIn_.letOwnerIn(port);
    followed_ = {::getpid(), signIn_.accounts()->version(), url, pin};
    write(followed_, followedFile_);
    accountsFile_.start({});
    spread_(signIn_.accounts(), [] {});  // for users whom DDS brings, with a certificate
}

void AccessControl::stop() {
    accountsFile_.stop();
    if (keys_) keys_->stop();
    workers_->stop();
    if (std::exchange(spread_, nullptr)) ::unlink(followedFile_.c_str());
}

void AccessControl::take(Accounts accounts) {
    if (!signIn_.take(std::move(accounts))) return;
    log_.write(LogLevel::Info, "accounts changed", {{"users", signIn_.accounts()->users().size()}});
    spread_(signIn_.accounts(), [io = &io_, weak = std::weak_ptr(life_), this,
                                 version = signIn_.accounts()->version()] {
        asio::post(*io, [weak, this, version] {
            if (weak.expired() || !spread_) return;
            followed_.version = std::max(followed_.version, version);
            write(followed_, followedFile_);
        });
    });
}

void AccessControl::entered(const HttpTarget& target, const SignedIn& user,
                            const std::string& project) {
    audit_.record({.event = "signed in",
                   .user = user.user.value,
                   .from = std::string(target.peer),
                   .project = project,
                   .detail = user.user.value.empty() ? "as the owner of the server"
                                                     : "with the token " + user.token});
}

HttpPage AccessControl::refused(std::string_view peer, std::string_view why, HttpReply reply,
                                std::string_view reason) {
    audit_.record({.event = why, .from = std::string(peer), .detail = std::string(reason)});
    const milliseconds delay = signIn_.refused(std::string(peer), steady_clock::now());
    if (delay < SignIn::kMostDelay && reason.empty())
        log_.write(LogLevel::Warning, why, {{"from", peer}, {"answeredAfterMs", delay.count()}});
    else if (delay < SignIn::kMostDelay)
        log_.write(LogLevel::Warning, why,
                   {{"from", peer}, {"answeredAfterMs", delay.count()}, {"reason", reason}});
    const auto timer = std::make_shared<asio::steady_timer>(io_, delay);
    return [timer, reply = std::move(reply)](const HttpAnswer& answer) {
        timer->async_wait([timer, reply, answer](const boost::system::error_code& error) {
            if (!error) answer(reply);
        });
    };
}

void AccessControl::cannotWrite(const Error& error, const HttpAnswer& answer) {
    log_.write(LogLevel::Error, "accounts cannot be changed", {{"error", error.message}});
    answer({"text/plain", "the server cannot change its accounts; its log says why\n", kInternal});
}

tl::expected<SignedIn, Stranger> AccessControl::find(const HttpTarget& target) const {
    return signIn_.find(target.authorization, std::time(nullptr));
}

std::optional<HttpAgain> AccessControl::newerKeys(const Stranger& stranger) {
    const bool mayHelp =
        stranger.why == Stranger::Why::NoKeys || stranger.problem == TokenProblem::UnknownKey;
    if (!mayHelp || !keys_ || !keys_->canLook()) return std::nullopt;
    return HttpAgain{[this](std::function<void()> ready) { keys_->look(std::move(ready)); }};
}

HttpReply AccessControl::usersPage(const std::string& project) const {
    const auto accounts = signIn_.accounts();
    nlohmann::json users = nlohmann::json::array();
    for (const auto& [user, account] : accounts->users()) {
        const Role role = accounts->roleOf(user, project).value_or(Role::None);
        if (role == Role::None) continue;
        users.push_back({{"name", user.value}, {"role", nameOf(role)}});
    }
    return jsonPage({{"project", project}, {"users", users}});
}

HttpReply AccessControl::signInPage(const std::optional<SignedIn>& user) const {
    if (user) return jsonPage({{"user", user->user.value}});
    const auto& issuer = signIn_.issuer();
    if (!issuer)
        return {"text/plain",
                isRequired() ? "this server has no issuer: sign in with an invitation\n"
                             : "this server asks nobody to sign in: connect without it\n",
                kNotThere};
    return jsonPage({{"issuer", issuer->rules.issuer},
                     {"clientId", issuer->clientId},
                     {"scopes", issuer->scopes}});
}

HttpPage AccessControl::refusal(const HttpTarget& target, const Stranger& stranger) {
    const std::string join = "Ask for an invitation and run `usdlive join INVITATION`";
    const std::string howTo =
        keys_ ? "Run `usdlive login HOST:PORT`, or ask for an invitation and run `usdlive join "
                "INVITATION`"
              : join;
    switch (stranger.why) {
        case Stranger::Why::NoToken:
            return refused(target.peer, "sign-in refused",
                           signInFirst("this server asks users to sign in. " + howTo));
        case Stranger::Why::IssuedToken:
            return refused(target.peer, "token of the issuer refused",
                           signInFirst("this server does not accept the sign-in of the issuer: it "
                                       "has ended, or is not for this server. Run `usdlive login "
                                       "HOST:PORT`; the log of the server says more"),
                           describe(*stranger.problem));
        case Stranger::Why::NoKeys:
            return refused(target.peer, "sign-in refused",
                           {"text/plain",
                            "the issuer does not answer this server, which cannot check sign-ins "
                            "now. Try again later; the log of the server says more\n",
                            kNotNow},
                           "the issuer's keys are not known");
        case Stranger::Why::EndedToken:
            return refused(
                target.peer, "sign-in refused",
                signInFirst("the token of " + stranger.user.value +
                            " has ended. Its administrator can run `usdlive user token " +
                            stranger.user.value + " DIR`"),
                "the token of " + stranger.user.value + " has ended");
        case Stranger::Why::IsService:
            return refused(
                target.peer, "sign-in refused",
                {"text/plain",
                 stranger.user.value +
                     " is a service account of this server, with which nobody signs in\n",
                 kForbiddenUser},
                stranger.user.value + " is a service account");
        case Stranger::Why::NoRole:
            return refused(target.peer, "sign-in refused",
                           {"text/plain",
                            stranger.user.value +
                                " is not a user of this server. Its administrator can run "
                                "`usdlive user add " +
                                stranger.user.value + " DIR`\n",
                            kForbiddenUser},
                           stranger.user.value + " has no account, and --oidc-role gives no role");
        default:
            return refused(target.peer, "sign-in refused",
                           signInFirst("this server does not know the token: it was revoked, or is "
                                       "that of another server (`usdlive forget HOST:PORT` removes "
                                       "it). " +
                                       howTo));
    }
}

HttpPage AccessControl::join(const HttpTarget& target) {
    if (!isRequired())
        return [](const HttpAnswer& answer) {
            answer({"text/plain", "this server asks nobody to sign in: connect without it\n", 404});
        };
    if (!target.authorization.starts_with(kInvitation))
        return refused(target.peer, "invitation refused",
                       signInFirst("the request has no invitation"));
    // The answer to a wrong code waits like that to a wrong token. It is not known yet whether this
    // one is wrong.
    return [this, code = std::string(target.authorization.substr(kInvitation.size())),
            peer = std::string(target.peer)](const HttpAnswer& answer) {
        workers_->post([this, weak = std::weak_ptr(life_), file = signIn_.file(), io = &io_, code,
                        peer, answer] {
            Result<Accounts::Joined> joined = fail(ErrorCode::Internal, "not tried");
            auto changed = file.change([&](Accounts& accounts) -> Result<void> {
                joined = accounts.join(code, std::time(nullptr));
                if (!joined) return tl::unexpected(joined.error());
                return {};
            });
            if (!changed) joined = tl::unexpected(changed.error());
            asio::post(*io, [this, weak, joined, changed = std::move(changed), peer,
                             answer]() mutable {
                if (weak.expired() || !spread_) return;
                if (joined) {
                    take(std::move(*changed));  // so that the token is known when it arrives
                    log_.write(LogLevel::Info, "invitation used",
                               {{"user", joined->user.value}, {"from", peer}});
                    audit_.record(
                        {.event = "invitation used", .user = joined->user.value, .from = peer});
                    return answer(
                        {"application/json",
                         nlohmann::json{{"user", joined->user.value}, {"token", joined->token}}
                                 .dump() +
                             "\n",
                         200,
                         {{"Cache-Control", "no-store"}}});
                }
                if (joined.error().code != ErrorCode::SignInRequired)
                    return cannotWrite(joined.error(), answer);
                refused(peer, "invitation refused", signInFirst(joined.error().message))(answer);
            });
        });
    };
}

}  // namespace usdlive::server
