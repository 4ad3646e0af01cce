// Lets users sign in, and tells the projects when their roles change.
#pragma once

#include <boost/asio/io_context.hpp>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "app/AccountCommands.h"
#include "app/AuditLog.h"
#include "app/FileFollower.h"
#include "app/PublishedKeys.h"
#include "app/Workers.h"
#include "auth/SignIn.h"
#include "transport/HttpServer.h"
#include "transport/Log.h"

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
    /// log if users have to sign in. Error: InvalidConfiguration.
    [[nodiscard]] Result<void> start();
    /// Lets the owner in at this port, and begins to follow the file.
    /// `url` is where users reach the server, and `pin` the fingerprint of its own certificate, or
    /// empty.
    void serve(std::uint16_t port, const std::string& url, const std::string& pin, Spread spread);
    void stop();

    [[nodiscard]] bool isRequired() const { return signIn_.isRequired(); }
    /// Returns who a request comes from, or why it proves nobody.
    [[nodiscard]] tl::expected<SignedIn, Stranger> find(const HttpTarget& target) const;
    /// Returns how to wait for newer keys of the issuer, if they might change that a request proves
    /// nobody (AC24).
    [[nodiscard]] std::optional<HttpAgain> newerKeys(const Stranger& stranger);
    /// Says how to sign in, or as whom somebody has signed in (AC25).
    [[nodiscard]] HttpReply signInPage(const std::optional<SignedIn>& user) const;
    /// Lists the users with a role in a project (AC27).
    [[nodiscard]] HttpReply usersPage(const std::string& project) const;
    /// Records that a user opens a session.
    void entered(const HttpTarget& target, const SignedIn& user, const std::string& project);
    /// Returns the user with the role in a project.
    [[nodiscard]] SignedIn in(const std::string& project, SignedIn user) const {
        return SignIn::in(*signIn_.accounts(), std::move(user), project);
    }
    /// Answers a request that proves nobody, later with each one of the same address (AC5).
    [[nodiscard]] HttpPage refusal(const HttpTarget& target, const Stranger& stranger);
    /// Exchanges an invitation for a token (AC2).
    [[nodiscard]] HttpPage join(const HttpTarget& target);
    [[nodiscard]] std::uint64_t refusals() const { return signIn_.refusals(); }

private:
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
    FileFollower<AccountsFile> accountsFile_;
    const std::filesystem::path followedFile_;
    FollowedAccounts followed_;
    const std::shared_ptr<int> life_ = std::make_shared<int>();
};

}  // namespace usdlive::server
