// Follows the accounts, and answers those who sign in.
#include "usdlive/server/app/AccessControl.h"

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

constexpr unsigned kUnauthorized = 401, kInternal = 500;
constexpr std::string_view kInvitation = "Invitation ";
// A removed user is out within a second.
constexpr milliseconds kFollowPause{200};

HttpReply signInFirst(const std::string& why) {
    return {"text/plain", why + "\n", kUnauthorized, {{"WWW-Authenticate", "Bearer"}}};
}

}  // namespace

AccessControl::AccessControl(asio::io_context& io, const std::filesystem::path& folder,
                             Workers& workers, AuditLog& audit, Log& log)
    : io_(io),
      log_(log),
      audit_(audit),
      workers_(workers.files.share()),
      signIn_(folder),
      timer_(io),
      followedFile_(followedAccountsFile(folder)) {}

AccessControl::~AccessControl() { stop(); }

Result<void> AccessControl::start() {
    auto started = signIn_.start();
    if (started && isRequired()) audit_.begin();
    return started;
}

void AccessControl::serve(std::uint16_t port, const std::string& url, const std::string& pin,
                          Spread spread) {
    if (!isRequired()) return;
    spread_ = std::move(spread);
    signIn_.letOwnerIn(port);
    followed_ = {::getpid(), signIn_.accounts()->version(), url, pin};
    write(followed_, followedFile_);
    followIn(kFollowPause);
}

void AccessControl::stop() {
    timer_.cancel();
    workers_->stop();
    if (std::exchange(spread_, nullptr)) ::unlink(followedFile_.c_str());
}

void AccessControl::followIn(milliseconds pause) {
    timer_.expires_after(pause);
    timer_.async_wait([this](const boost::system::error_code& error) {
        if (error || !spread_) return;
        // A disk that does not answer must not stop the server from accepting connections.
        workers_->post(
            [this, io = &io_, weak = std::weak_ptr(life_), file = signIn_.file(), before = stamp_] {
                const auto stamp = file.stamp();
                Result<std::optional<Accounts>> read;
                if (stamp && stamp != before) read = file.read();
                asio::post(*io, [this, weak, stamp, read = std::move(read)]() mutable {
                    if (weak.expired() || !spread_) return;
                    if (stamp) stamp_ = stamp;
                    if (!read)
                        log_.write(LogLevel::Error, "accounts stay as they were",
                                   {{"error", read.error().message}});
                    else if (*read)
                        take(std::move(**read));
                    followIn(kFollowPause);
                });
            });
    });
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

HttpPage AccessControl::refused(std::string_view peer, std::string_view why, HttpReply reply) {
    audit_.record({.event = why, .from = std::string(peer)});
    const milliseconds delay = signIn_.refused(std::string(peer), steady_clock::now());
    if (delay < SignIn::kMostDelay)
        log_.write(LogLevel::Warning, why, {{"from", peer}, {"answeredAfterMs", delay.count()}});
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

HttpPage AccessControl::refusal(const HttpTarget& target) {
    return refused(target.peer, "sign-in refused",
                   signInFirst(target.authorization.empty()
                                   ? "this server asks users to sign in. Ask for an invitation and "
                                     "run `usdlive join INVITATION`"
                                   : "this server does not know the token: it was revoked, or is "
                                     "that of another server (`usdlive forget HOST:PORT` removes "
                                     "it). Ask for an invitation and run "
                                     "`usdlive join INVITATION`"));
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
