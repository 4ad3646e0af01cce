// The HTTP addresses of the process and its pages.
#pragma once

#include <boost/asio/io_context.hpp>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "app/AccessControl.h"
#include "app/LiveSessions.h"
#include "app/ProjectReports.h"
#include "app/Projects.h"
#include "transport/HttpServer.h"

namespace usdlive::server {

/// Finds what a request asks for: `/live` and `/NAME/live` open sessions; `/files...` and
/// `/NAME/files...` are files of a project; `/`, `/healthz`, `/metrics` and `/projects` are pages;
/// `/NAME/sessions...` are its live sessions (LV3), and `/NAME/users` its users (AC27); `/join`
/// takes an invitation, and `/sign-in` says how to sign in. A user is shown the projects in which
/// they have a role. Belongs to the thread that runs `io`.
class HttpRoutes {
public:
    /// The other objects must outlive this one. `pageHint`: a line that says where the page is.
    HttpRoutes(boost::asio::io_context& io, const Projects& projects, LiveSessions& liveSessions,
               AccessControl& access, std::string pageHint)
        : io_(io),
          projects_(projects),
          liveSessions_(liveSessions),
          access_(access),
          pageHint_(std::move(pageHint)) {}

    /// Sets the URL of the process, and the server whose counters `/metrics` shows.
    void announce(std::string url, const HttpServer& http) {
        url_ = std::move(url);
        http_ = &http;
    }

    [[nodiscard]] HttpRoute route(const HttpTarget& target);

private:
    /// Nothing: users do not sign in.
    using User = std::optional<SignedIn>;
    using Visible = std::vector<ServedProject*>;

    /// Without live sessions.
    [[nodiscard]] Visible visibleTo(const User& user) const;
    /// Returns the project or live session with this name in addresses (encoded), if the user has a
    /// role there. A name without a project is that of a live session of the only project.
    [[nodiscard]] ServedProject* named(std::string_view encoded, const Visible& visible) const;
    /// Returns nothing if the path is not one of `/NAME/sessions...`.
    [[nodiscard]] std::optional<HttpRoute> liveSessions(const HttpTarget& target, const User& user,
                                                        const Visible& visible);
    [[nodiscard]] HttpRoute sessionsOf(ServedProject& project, const User& user,
                                       const HttpTarget& target) const;
    [[nodiscard]] HttpRoute usersOf(const ServedProject& project, const User& user) const;
    /// Returns the sessions of a client that shows its token later (AC13), if there are any.
    [[nodiscard]] std::optional<HttpSessions> sessionsBeforeSignIn(const HttpTarget& target);
    struct Arrival {
        std::string path, authorization, peer;
        const WebSocketTransport* transport = nullptr;  ///< that has the session
    };
    /// Routes an arrival again, with its token.
    void signIn(const std::shared_ptr<const Arrival>& arrival,
                const std::function<void(Result<SignedIn>)>& found, bool mayWait);
    [[nodiscard]] static HttpRoute filesOf(ServedProject& project, const HttpTarget& target);
    /// Says why a project that is not served cannot be used.
    [[nodiscard]] static HttpReply unavailable(const ServedProject& project);
    [[nodiscard]] static HttpReply noSuchProject(const std::string& name, const Visible& visible);
    [[nodiscard]] static HttpReply notHere(const std::string& what, const Visible& visible);
    [[nodiscard]] HttpReply welcome(const ProjectReports& reports) const;
    [[nodiscard]] HttpReply health(const ProjectReports& reports) const;
    /// The health for those who have not signed in: without names.
    [[nodiscard]] HttpReply briefHealth(const ProjectReports& reports) const;
    [[nodiscard]] HttpReply list(const ProjectReports& reports) const;
    [[nodiscard]] HttpReply metrics(const ProjectReports& reports) const;

    boost::asio::io_context& io_;
    const Projects& projects_;
    LiveSessions& liveSessions_;
    AccessControl& access_;
    const std::string pageHint_;
    std::string url_;  // empty before announce()
    const HttpServer* http_ = nullptr;
};

}  // namespace usdlive::server
