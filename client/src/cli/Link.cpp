// A session of the command line tool with a server.
#include "cli/Link.h"

#include <chrono>
#include <iostream>
#include <optional>

#include "cli/ProgressBar.h"
#include "cli/Text.h"

namespace usdlive::cli {

namespace {

using Clock = std::chrono::steady_clock;

std::int64_t nowMs() {
    return std::chrono::duration_cast<std::chrono::milliseconds>(Clock::now().time_since_epoch())
        .count();
}

std::optional<client::event::Progress> progressOf(const client::Event& event) {
    if (const auto* progress = std::get_if<client::event::Progress>(&event)) return *progress;
    const auto* joining = std::get_if<client::event::Joining>(&event);
    if (!joining) return std::nullopt;
    return client::event::Progress{client::event::Progress::Task::Fetch, joining->progress.layer,
                                   joining->progress.specs, joining->progress.specsTotal, 0};
}

}  // namespace

Result<std::unique_ptr<Link>> Link::connect(const client::ServerAddress& server, UserName user,
                                            double timeoutMs) {
    auto connection = client::createConnection(server);
    if (!connection) return tl::unexpected(connection.error());
    std::unique_ptr<Link> link(new Link(std::move(*connection), std::move(user)));
    if (auto done = link->waitForWelcome(server, timeoutMs); !done)
        return tl::unexpected(done.error());
    return link;
}

Result<void> Link::run(const std::function<bool(const std::vector<client::Event>&)>& done) {
    if (!showsProgress_) return LineLink::run(done);
    ProgressBar bar(std::cerr, Clock::now());
    std::optional<client::event::Progress> last;
    return LineLink::run([&](const std::vector<client::Event>& events) {
        for (const auto& one : events)
            if (auto progress = progressOf(one)) last = std::move(progress);
        if (last) bar.show(describe(*last), last->done, last->total, Clock::now());
        return done(events);
    });
}

Result<void> Link::upload(const std::string& file, const std::string& path, bool overwrite) {
    auto& uploads = uploads_.emplace(session(), *this);
    static_cast<void>(uploads.add(file, path, overwrite));
    std::vector<client::FileUploads::Ended> ended;
    ProgressBar bar(std::cerr, Clock::now());
    const auto ran = run([&](const std::vector<client::Event>& events) {
        for (const auto& one : events) static_cast<void>(uploads.note(one));
        uploads.advance();
        if (const auto progress = uploads.progress(nowMs()); progress && showsProgress_)
            bar.show(describe(*progress), progress->done, progress->total, Clock::now());
        ended = uploads.takeEnded();
        return !ended.empty();
    });
    uploads_.reset();
    if (ended.empty())
        return fail(ran.error().code,
                    file + " was not uploaded: " + ran.error().message +
                        ". The project has the whole file or none of it: upload it again");
    return std::move(ended.front().outcome);
}

}  // namespace usdlive::cli
