// Keeps the keys of the issuer up to date.
#pragma once

#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "app/FileFollower.h"
#include "app/Workers.h"
#include "auth/IssuerKeysFile.h"
#include "auth/KeySchedule.h"
#include "transport/Log.h"

namespace usdlive::server {

/// The keys that an issuer publishes over HTTP, or those in a file (AC24). Workers ask and read.
/// Belongs to the thread that runs `io`.
class PublishedKeys {
public:
    /// Receives the present keys; nothing if there are none any more.
    using Take = std::function<void(std::optional<IssuerKeys>)>;

    /// `file`: empty if the issuer is asked. `workers` and `log` must outlive this object.
    PublishedKeys(boost::asio::io_context& io, std::string issuer, std::filesystem::path file,
                  Workers& workers, Log& log, Take take);
    ~PublishedKeys();

    /// Reads the file, or begins to ask the issuer. Error: InvalidConfiguration names the file.
    [[nodiscard]] Result<void> start();
    void stop();

    /// Returns whether the issuer is being asked, or may be asked now because a token names an
    /// unknown key, or because there are no keys.
    [[nodiscard]] bool canLook() const;
    /// Asks the issuer, if that was not begun yet, and calls `done` after its answer.
    void look(std::function<void()> done);

private:
    void askIn(std::chrono::steady_clock::duration pause);
    void ask();
    void answered(Result<IssuerKeys> keys);

    boost::asio::io_context& io_;
    Log& log_;
    const std::string issuer_;
    const IssuerKeysFile file_;  ///< its path is empty if the issuer is asked
    const Take take_;
    const std::shared_ptr<WorkerShare> workers_;
    boost::asio::steady_timer timer_;
    /// Read by workers.
    const std::shared_ptr<std::atomic<bool>> isStopped_ = std::make_shared<std::atomic<bool>>();
    std::vector<std::function<void()>> waiting_;
    bool isAsking_ = false;
    KeySchedule schedule_;
    FileFollower<IssuerKeysFile> follower_;  ///< started if there is a file
    const std::shared_ptr<int> life_ = std::make_shared<int>();
};

}  // namespace usdlive::server
