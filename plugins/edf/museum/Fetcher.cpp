// Gets answers with several connections.
#include "Fetcher.h"

#include <algorithm>
#include <charconv>
#include <ctime>
#include <exception>
#include <mutex>
#include <optional>
#include <string_view>
#include <thread>
#include <utility>

#include "usdlive/common/core/Thread.h"
#include "usdlive/common/fetch/Http.h"

namespace usdlive::edf::museum {

namespace {

using fetch::failed;

constexpr unsigned kOk = 200, kNotModified = 304;
// A service may say "never ask again"; we ask again after a day.
constexpr std::int64_t kMaxFreshSeconds = 24 * 3600;

std::int64_t now() { return std::time(nullptr); }

// Seconds for which the answer needs no revalidation; 0 if the service does not say so.
std::int64_t freshSeconds(std::string_view cacheControl) {
    constexpr std::string_view kMaxAge = "max-age=";
    if (cacheControl.find("no-cache") != std::string_view::npos) return 0;
    const auto at = cacheControl.find(kMaxAge);
    if (at == std::string_view::npos) return 0;
    std::int64_t seconds = 0;
    const char* begin = cacheControl.data() + at + kMaxAge.size();
    std::from_chars(begin, cacheControl.data() + cacheControl.size(), seconds);
    return std::clamp<std::int64_t>(seconds, 0, kMaxFreshSeconds);
}

// All requests of one Fetcher::get().
class Download {
public:
    Download(const Address& address, const FetchLimits& limits, AnswerCache* cache,
             const std::vector<std::string>& targets, const std::function<bool()>& isCancelled)
        : address_(address),
          limits_(limits),
          cache_(cache),
          targets_(targets),
          isCancelled_(isCancelled) {
        result_.answers.assign(targets.size(), failed("not requested"));
    }

    Fetcher::Result run() {
        const auto lines = std::min<std::size_t>(std::max(limits_.parallel, 1), targets_.size());
        std::vector<std::thread> others;
        others.reserve(lines);
        try {
            while (others.size() + 1 < lines)
                others.push_back(startThread("usdlive museum", [this] { work(); }));
        } catch (const ThreadRefused&) {
            // Fewer connections do the same.
        }
        work();
        for (std::thread& other : others) other.join();
        if (fault_) std::rethrow_exception(fault_);
        return std::move(result_);
    }

private:
    // Takes the next targets one after the other, over one connection.
    void work() try {
        fetch::HttpLimits limits;
        limits.answer = limits.stall = limits_.request;
        limits.whole = limits_.request;
        limits.bodyBytes = limits_.bodyBytes;
        fetch::HttpClient connection(limits, isCancelled_);
        while (const auto index = next()) {
            Body fetched = answer(connection, targets_[*index]);
            const std::lock_guard lock(mutex_);
            if (fetched) bytes_ += fetched->size();
            result_.answers[*index] = std::move(fetched);
        }
    } catch (...) {
        const std::lock_guard lock(mutex_);
        fault_ = std::current_exception();
    }

    // Returns nothing at the end, and when nobody waits for the rest.
    std::optional<std::size_t> next() {
        if (isCancelled_()) return std::nullopt;
        const std::lock_guard lock(mutex_);
        if (next_ < targets_.size() && bytes_ <= limits_.totalBytes) return next_++;
        for (; next_ < targets_.size(); ++next_)
            result_.answers[next_] = failed("not requested, because the others are too large");
        return std::nullopt;
    }

    Body answer(fetch::HttpClient& connection, const std::string& target) {
        const std::string url = address_.text() + target;
        const auto cached = cache_ ? cache_->find(url) : std::nullopt;
        if (cached && cached->freshUntil > now()) return cached->body;
        if (const auto why = whyDown()) {
            if (cached) return stale(*cached);
            return failed(url + ": not requested, because " + *why);
        }
        auto answer = connection.get(requestFor(target, cached));
        noteReached(answer);
        if (answer) return keep(url, cached, std::move(*answer));
        if (cached && answer.error().isUnreachable) return stale(*cached);
        return failed(url + ": " + answer.error().cause);
    }

    // Returns the last failure if the service does not answer any more.
    std::optional<std::string> whyDown() {
        const std::lock_guard lock(mutex_);
        if (failures_ < limits_.failures) return std::nullopt;
        return lastFailure_;
    }

    void noteReached(const fetch::Fetched<fetch::HttpAnswer>& answer) {
        const std::lock_guard lock(mutex_);
        const bool isReached = answer || !answer.error().isUnreachable;
        failures_ = isReached ? 0 : failures_ + 1;
        if (!answer) lastFailure_ = answer.error().cause;
    }

    std::string stale(const CachedAnswer& cached) {
        const std::lock_guard lock(mutex_);
        ++result_.stale;
        return cached.body;
    }

    // Stores a new answer, or confirms that of the cache.
    Body keep(const std::string& url, const std::optional<CachedAnswer>& cached,
              fetch::HttpAnswer message) {
        CachedAnswer answer;
        if (message.status == kNotModified && cached)
            answer = *cached;
        else if (message.status != kOk)
            return failed(url + ": HTTP " + std::to_string(message.status));
        else
            answer = {std::string(message.header("ETag")),
                      std::string(message.header("Last-Modified")), 0, std::move(message.body)};
        const std::string_view control = message.header("Cache-Control");
        answer.freshUntil = now() + freshSeconds(control);
        if (cache_ && control.find("no-store") != std::string_view::npos)
            cache_->remove(url);
        else if (cache_)
            cache_->store(url, answer);
        return std::move(answer.body);
    }

    fetch::HttpRequest requestFor(const std::string& target,
                                  const std::optional<CachedAnswer>& cached) const {
        fetch::HttpRequest request{address_.origin, address_.path + target};
        request.headers.emplace_back("Accept", "application/json");
        if (cached && !cached->etag.empty())
            request.headers.emplace_back("If-None-Match", cached->etag);
        if (cached && !cached->lastModified.empty())
            request.headers.emplace_back("If-Modified-Since", cached->lastModified);
        return request;
    }

    const Address& address_;
    const FetchLimits& limits_;
    AnswerCache* const cache_;
    const std::vector<std::string>& targets_;
    const std::function<bool()>& isCancelled_;
    std::mutex mutex_;  // guards the next members
    Fetcher::Result result_;
    std::size_t next_ = 0, bytes_ = 0;
    int failures_ = 0;
    std::string lastFailure_;
    std::exception_ptr fault_;
};

}  // namespace

Fetcher::Fetcher(Address address, FetchLimits limits, AnswerCache* cache)
    : address_(std::move(address)), limits_(limits), cache_(cache) {}

Fetcher::Result Fetcher::get(const std::vector<std::string>& targets,
                             const std::function<bool()>& isCancelled) const {
    return Download(address_, limits_, cache_, targets, isCancelled).run();
}

}  // namespace usdlive::edf::museum
