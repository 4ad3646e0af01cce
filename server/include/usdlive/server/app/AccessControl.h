// Lets users sign in, and tells the projects when their roles change.
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "usdlive/server/app/AccountCommands.h"
#include "usdlive/server/app/AuditLog.h"
#include "usdlive/server/app/PublishedKeys.h"
#include "usdlive/server/app/Workers.h"
#include "usdlive/server/auth/SignIn.h"
#include "usdlive/server/transport/HttpServer.h"
#include "usdlive/server/transport/Log.h"

namespace usdlive::server {

/// The entrance of the process: who a request comes from, and the exchange of invitations. Follows
/// the file of the accounts, which `usdlive user` changes. Belongs to the thread that runs `io`.
class AccessControl {
public:
    /// Passes the accounts to all projects, then calls `done`, on any thread.
    using Spread = std::function<void(std::shared_ptr<const Accounts>, std::function<void()> done)>;

    /// `folder` contains `.usdlive/users.json`. `issuer`: nothing if there is none. `workers`,
    /// `audit` and `log` must outlive this object.
    AccessControl(boost::asio::io_context& io, const std::filesystem::path& folder,
                  std::optional<IssuerSettings> issuer, Workers& workers, AuditLog& audit,
                  Log& log);
    ~AccessControl();

    /// Reads the accounts and the keys of the issuer, or begins to ask for them. Begins the audit
    /// log if users have to sign in. Error:
    /// InvalidConfiguration.
    [[nodiscard]] Result<void> start();
    /// Lets the owner in at this port, and begins to follow the file.
    /// `url` is where users reach the server, and `pin` the fingerprint of its own certificate, or
    /// empty.
    void serve(std::uint16_t port, const std::string& url, const std::string& pin, Spread spread);
    void stop();

    [[nodiscard]] bool isRequired() const { return signIn_.isRequired(); }
    /// Returns who a request comes from; nothing if it proves nobody.
    [[nodiscard]] std::optional<SignedIn> find(const HttpTarget& target) const;
    /// Returns how to wait for newer keys of the issuer, if the request proves nobody and they
    /// might change that (AC24).
    [[nodiscard]] std::optional<HttpAgain> newerKeys(const HttpTarget& target);
    /// Says how to sign in, or as whom somebody has signed in (AC25).
    [[nodiscard]] HttpReply signInPage(const std::optional<SignedIn>& user) const;
    /// Records that a user opens a session.
    void entered(const HttpTarget& target, const SignedIn& user, const std::string& project);
    /// Returns the user with the role in a project.
    [[nodiscard]] SignedIn in(const std::string& project, SignedIn user) const {
        return SignIn::in(*signIn_.accounts(), std::move(user), project);
    }
    /// Answers a request that proves nobody, later with each one of the same address (AC5).
    [[nodiscard]] HttpPage refusal(const HttpTarget& target);
    /// Exchanges an invitation for a token (AC2).
    [[nodiscard]] HttpPage join(const HttpTarget& target);
    [[nodiscard]] std::uint64_t refusals() const { return signIn_.refusals(); }

private:
    void followIn(std::chrono::milliseconds pause);
    void take(Accounts accounts);
    void cannotWrite(const Error& error, const HttpAnswer& answer);
    /// `why` is the event in the log, which is not filled by somebody who goes on.
    /// `reason`: a sentence for the log; may be empty.
    [[nodiscard]] HttpPage refused(std::string_view peer, std::string_view why, HttpReply reply,
                                   std::string_view reason = {});

    boost::asio::io_context& io_;
    Log& log_;
    AuditLog& audit_;
    const std::shared_ptr<WorkerShare> workers_;
    SignIn signIn_;
    std::unique_ptr<PublishedKeys> keys_;  ///< nullptr: no issuer
    Spread spread_;
    boost::asio::steady_timer timer_;
    const std::filesystem::path followedFile_;
    FollowedAccounts followed_;
    std::optional<std::string> stamp_;  ///< that of the accounts that were read
    const std::shared_ptr<int> life_ = std::make_shared<int>();
};

}  // namespace usdlive::server
