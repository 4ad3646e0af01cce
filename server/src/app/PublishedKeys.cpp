// Asks the issuer for its keys in pauses, or follows the file that has them.
#include "app/PublishedKeys.h"

#include <algorithm>
#include <boost/asio/post.hpp>
#include <utility>

#include "usdlive/common/fetch/Issuer.h"

namespace usdlive::server {

namespace asio = boost::asio;

namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr milliseconds kLookAtFile{500};
constexpr unsigned kAnswered = 200;

Result<IssuerKeys> keysOf(const std::string& issuer, const std::function<bool()>& isStopped) {
    const auto found = fetch::discover(issuer, isStopped);
    if (!found) return fail(ErrorCode::NotConnected, found.error().cause);
    const auto answer = fetch::get({.origin = found->keys.origin, .target = found->keys.target},
                                   fetch::issuerLimits(), isStopped);
    if (!answer) return fail(ErrorCode::NotConnected, "its keys: " + answer.error().cause);
    if (answer->status != kAnswered)
        return fail(ErrorCode::NotConnected, "its keys: HTTP " + std::to_string(answer->status));
    return IssuerKeys::parse(answer->body);
}

}  // namespace

PublishedKeys::PublishedKeys(asio::io_context& io, std::string issuer, std::filesystem::path file,
                             Workers& workers, Log& log, Take take)
    : io_(io),
      log_(log),
      issuer_(std::move(issuer)),
      file_(std::move(file)),
      take_(std::move(take)),
      workers_(workers.files.share()),
      timer_(io),
      follower_(io, workers_, file_, kLookAtFile,
                [this](const std::string&, Result<IssuerKeys> keys) {
                    if (!keys) {
                        log_.write(LogLevel::Error, "the issuer's keys stay as they were",
                                   {{"error", keys.error().message}});
                        return;
                    }
                    log_.write(LogLevel::Info, "the issuer's keys were read",
                               {{"file", file_.path().string()}, {"keys", keys->keys().size()}});
                    take_(std::move(*keys));
                }) {}

PublishedKeys::~PublishedKeys() { stop(); }

Result<void> PublishedKeys::start() {
    if (file_.path().empty()) {
        ask();
        return {};
    }
    const auto stamp = file_.stamp();
    auto keys = file_.read();
    if (!keys) return tl::unexpected(keys.error());
    take_(std::move(*keys));
    follower_.start(stamp);
    return {};
}

void PublishedKeys::stop() {
    *isStopped_ = true;
    timer_.cancel();
    follower_.stop();
    workers_->stop();
    waiting_.clear();
}

bool PublishedKeys::canLook() const {
    if (!file_.path().empty()) return false;
    return isAsking_ || schedule_.mayLook(steady_clock::now());
}

void PublishedKeys::look(std::function<void()> done) {
    waiting_.push_back(std::move(done));
    if (isAsking_) return;
    schedule_.looked(steady_clock::now());
    ask();
}

void PublishedKeys::askIn(steady_clock::duration pause) {
    timer_.expires_after(pause);
    timer_.async_wait([this](const boost::system::error_code& error) {
        if (!error && !*isStopped_ && !isAsking_) ask();
    });
}

void PublishedKeys::ask() {
    isAsking_ = true;
    // The issuer may take seconds. The threads that accept and edit never wait for it.
    workers_->post(
        [this, io = &io_, weak = std::weak_ptr(life_), issuer = issuer_, isStopped = isStopped_] {
            auto keys = keysOf(issuer, [isStopped] { return isStopped->load(); });
            asio::post(*io, [this, weak, keys = std::move(keys)]() mutable {
                if (weak.expired() || *isStopped_) return;
                answered(std::move(keys));
            });
        });
}

void PublishedKeys::answered(Result<IssuerKeys> keys) {
    isAsking_ = false;
    const auto now = steady_clock::now();
    const auto next = keys ? schedule_.read(now) : schedule_.failed(now);
    if (keys && next.isChange)
        log_.write(LogLevel::Info, "the issuer's keys were read",
                   {{"issuer", issuer_}, {"keys", keys->keys().size()}});
    if (!keys && next.isChange)
        log_.write(LogLevel::Error,
                   schedule_.hasKeys()
                       ? "the issuer does not give its keys; the last ones count for a day"
                       : "the issuer does not give its keys; nobody can sign in with it until it "
                         "does",
                   {{"issuer", issuer_}, {"error", keys.error().message}});
    if (next.endsKeys)
        log_.write(LogLevel::Error, "the issuer's keys are older than a day and do not count",
                   {{"issuer", issuer_}});
    if (keys)
        take_(std::move(*keys));
    else if (next.endsKeys)
        take_(std::nullopt);
    askIn(next.pause);
    for (const auto& done : std::exchange(waiting_, {})) done();
}

}  // namespace usdlive::server
