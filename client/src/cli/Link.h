// A session for commands that query a server.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "lines/LineLink.h"

namespace usdlive::cli {

/// A session of the command line, which can show the server's progress. One thread.
class Link final : public client::LineLink {
public:
    /// Connects in the name of `user`. Fails after the first attempt, because a person is waiting.
    static Result<std::unique_ptr<Link>> connect(const client::ServerAddress& server, UserName user,
                                                 double timeoutMs);

    /// Makes run() show the server's progress if isForPeople().
    void showProgress() { showsProgress_ = true; }
    Result<void> run(const std::function<bool(const std::vector<client::Event>&)>& done) override;

    /// Uploads a file of this machine, which becomes `path` in the project.
    Result<void> upload(const std::string& file, const std::string& path, bool overwrite);

private:
    using client::LineLink::LineLink;

    bool showsProgress_ = false;
};

}  // namespace usdlive::cli
