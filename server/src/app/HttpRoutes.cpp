// Routes requests, and makes the pages about the projects.
#include "app/HttpRoutes.h"

#include <algorithm>
#include <boost/asio/post.hpp>
#include <charconv>
#include <nlohmann/json.hpp>
#include <utility>

#include "app/Metrics.h"
#include "transport/FileRequest.h"
#include "usdlive/common/core/PercentEncoding.h"

namespace usdlive::server {

namespace asio = boost::asio;

namespace {

using Json = nlohmann::json;
using State = ServedProject::State;

constexpr std::string_view kSessions = "/live", kFiles = "/files", kLiveSessions = "/sessions",
                           kUsers = "/users";
constexpr const char* kJson = "application/json";
constexpr unsigned kBadRequest = 400, kForbiddenPage = 403, kNotFound = 404, kUnavailable = 503;
constexpr std::size_t kMostNamed = 20;

std::string text(const Json& json) {
    return json.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

struct FilesPath {
    std::string_view project;  ///< percent-encoded
    std::string_view rest;     ///< empty, or begins with a slash
};
/// Splits `/NAME/files...`. Returns nothing for any other path.
std::optional<FilesPath> splitFilesPath(std::string_view path) {
    const std::size_t slash = path.find('/', 1);
    if (slash == std::string_view::npos || !path.substr(slash).starts_with(kFiles))
        return std::nullopt;
    const FilesPath split{path.substr(1, slash - 1), path.substr(slash + kFiles.size())};
    if (!split.rest.empty() && !split.rest.starts_with('/')) return std::nullopt;
    return split;
}

/// Returns whether the path is `part`, or goes on with a slash.
bool startsPath(std::string_view path, std::string_view part) {
    return path.starts_with(part) && (path.size() == part.size() || path[part.size()] == '/');
}

/// Reads a whole number into one of the types of a query.
template <class Number>
bool isRead(const std::string& text, Number& number) {
    const char* const end = text.data() + text.size();
    const auto [stop, error] = std::from_chars(text.data(), end, number);
    return error == std::errc() && stop == end;
}

/// The query of a request that changes a live session (LV4): `user=NAME&merged=REVISION`.
struct SessionQuery {
    std::string user;
    LiveSessions::Wanted wanted;
};
std::optional<SessionQuery> queryOf(std::string_view query) {
    constexpr std::size_t kMostClientBytes = 200;
    SessionQuery read;
    LiveSessions::Wanted& wanted = read.wanted;
    while (!query.empty()) {
        const std::string_view one = query.substr(0, query.find('&'));
        query.remove_prefix(std::min(one.size() + 1, query.size()));
        const std::size_t equals = std::min(one.find('='), one.size());
        const auto value = percentDecoded(one.substr(std::min(equals + 1, one.size())));
        const std::string_view key = one.substr(0, equals);
        if (!value) return std::nullopt;
        bool isValid = false;
        if (key == "user") {
            read.user = *value;
            isValid = true;
        } else if (key == "client") {
            wanted.merge.client = {*value};
            isValid = value->size() <= kMostClientBytes;
        } else if (key == "target") {
            wanted.merge.isIntoMain = *value == "main";
            isValid = wanted.merge.isIntoMain || *value == "session";
        } else if (key == "merged") {
            isValid = isRead(*value, wanted.merged);
        } else if (key == "from") {
            isValid = isRead(*value, wanted.from);
        } else if (key == "into") {
            isValid = isRead(*value, wanted.merge.into);
        } else if (key == "known") {
            isValid = isRead(*value, wanted.known);
        }
        if (!isValid) return std::nullopt;
    }
    wanted.merge.from = wanted.from;
    return read;
}

/// Returns whether a list of names with commas has the name.
bool offers(std::string_view list, std::string_view name) {
    while (!list.empty()) {
        const std::size_t comma = std::min(list.find(','), list.size());
        std::string_view one = list.substr(0, comma);
        while (one.starts_with(' ')) one.remove_prefix(1);
        while (one.ends_with(' ')) one.remove_suffix(1);
        if (one == name) return true;
        list.remove_prefix(std::min(comma + 1, list.size()));
    }
    return false;
}

}  // namespace

HttpRoutes::Visible HttpRoutes::visibleTo(const User& user) const {
    Visible visible = projects_.mainLines();
    if (user)
        std::erase_if(visible, [&](const ServedProject* project) {
            return access_.in(project->name(), *user).role == Role::None;
        });
    return visible;
}

ServedProject* HttpRoutes::named(std::string_view encoded, const Visible& visible) const {
    auto name = percentDecoded(encoded);
    if (!name) return nullptr;
    if (name->starts_with('?') && visible.size() == 1) *name = visible.front()->name() + *name;
    ServedProject* const found = projects_.find(*name);
    const bool isVisible = found && std::ranges::any_of(visible, [&](const ServedProject* one) {
                               return one->name() == found->place().project;
                           });
    return isVisible ? found : nullptr;
}

std::optional<HttpRoute> HttpRoutes::liveSessions(const HttpTarget& target, const User& user,
                                                  const Visible& visible) {
    // /sessions..., or /NAME/sessions...
    std::string_view rest = target.path, name;
    if (!startsPath(rest, kLiveSessions)) {
        const std::size_t slash = rest.find('/', 1);
        if (slash == std::string_view::npos) return std::nullopt;
        name = rest.substr(1, slash - 1);
        rest.remove_prefix(slash);
        if (!startsPath(rest, kLiveSessions)) return std::nullopt;
    }
    rest.remove_prefix(kLiveSessions.size());
    ServedProject* const project = !name.empty()         ? named(name, visible)
                                   : visible.size() == 1 ? visible.front()
                                                         : nullptr;
    if (!project || project->place().isLiveSession())
        return name.empty() ? notHere("the address names no project", visible)
                            : noSuchProject(percentDecoded(name).value_or(""), visible);
    if (rest.empty()) return HttpRoute(liveSessions_.list(*project));
    const std::size_t slash = rest.find('/', 1);
    const auto liveSession = percentDecoded(rest.substr(1, slash - 1));
    auto query = queryOf(target.query);
    if (slash == std::string_view::npos || !liveSession || !query)
        return HttpReply{"text/plain", "POST to sessions/NAME/VERB\n", kBadRequest};
    LiveSessions::Asking asking{{query->user}, Role::Admin, std::string(target.peer)};
    if (user) {
        const SignedIn here = access_.in(project->name(), *user);
        // The owner of the server acts in the name of any user.
        if (!here.user.value.empty()) asking.user = here.user;
        asking.role = here.role;
    }
    query->wanted.name = *liveSession;
    query->wanted.verb = rest.substr(slash + 1);
    return liveSessions_.change(*project, query->wanted, asking);
}

HttpRoute HttpRoutes::route(const HttpTarget& target) {
    const std::string_view path = target.path;
    if (path == "/join") return HttpAction{access_.join(target)};
    const bool asksHowToSignIn = path == "/sign-in";
    if (asksHowToSignIn && target.authorization.empty()) return access_.signInPage(std::nullopt);
    User user;
    if (access_.isRequired()) {
        auto found = access_.find(target);
        if (found) {
            user = std::move(*found);
        } else if (path != "/healthz") {
            if (auto sessions = sessionsBeforeSignIn(target)) return std::move(*sessions);
            if (auto again = access_.newerKeys(found.error())) return std::move(*again);
            return access_.refusal(target, found.error());
        }
    }
    const bool isStranger = access_.isRequired() && !user;
    if (asksHowToSignIn) return access_.signInPage(user);
    const Visible visible = visibleTo(user);
    const auto page = [&](HttpReply (HttpRoutes::*make)(const ProjectReports&) const) {
        return HttpPage([this, make, visible](const HttpAnswer& answer) {
            gatherReports(io_, visible, make == &HttpRoutes::metrics,
                          [this, make, answer](const ProjectReports& reports) {
                              answer((this->*make)(reports));
                          });
        });
    };
    if (path == "/") return page(&HttpRoutes::welcome);
    if (path == "/healthz")
        return page(isStranger ? &HttpRoutes::briefHealth : &HttpRoutes::health);
    if (path == "/metrics") return page(&HttpRoutes::metrics);
    if (path == "/projects") return page(&HttpRoutes::list);
    // `part` of the only project, or of the one that the path names.
    const auto ofProject = [&](std::string_view part, const auto& answer) -> HttpRoute {
        const std::string_view name = path.substr(0, path.size() - part.size());
        ServedProject* const project = !name.empty()         ? named(name.substr(1), visible)
                                       : visible.size() == 1 ? visible.front()
                                                             : nullptr;
        if (project) return answer(*project);
        if (name.empty()) return notHere("the address names no project", visible);
        return noSuchProject(percentDecoded(name.substr(1)).value_or(""), visible);
    };
    const auto ofSessions = [&] {
        return ofProject(kSessions,
                         [&](ServedProject& project) { return sessionsOf(project, user, target); });
    };
    // Files come first, because a file may have the name "live", unless a project is called
    // "files".
    if (path.size() > kSessions.size() && path.ends_with(kSessions) &&
        named(path.substr(1, path.size() - kSessions.size() - 1), visible))
        return ofSessions();
    if (const auto files = splitFilesPath(path))
        if (ServedProject* project = named(files->project, visible))
            return filesOf(*project, {.path = files->rest, .query = target.query});
    if (path.starts_with(kFiles)) {
        const std::string_view rest = path.substr(kFiles.size());
        if (rest.empty() || rest.starts_with('/')) {
            if (visible.size() == 1)
                return filesOf(*visible.front(), {.path = rest, .query = target.query});
            return notHere("the address names no project", visible);
        }
    }
    if (path.ends_with(kSessions)) return ofSessions();
    if (auto found = liveSessions(target, user, visible)) return std::move(*found);
    if (path.ends_with(kUsers))
        return ofProject(kUsers,
                         [&](const ServedProject& project) { return usersOf(project, user); });
    return HttpReply{"text/plain", "there is nothing here\n", kNotFound};
}

HttpRoute HttpRoutes::usersOf(const ServedProject& project, const User& user) const {
    if (!user)
        return HttpReply{"text/plain",
                         "this server asks nobody to sign in: it has no users. `usdlive user add` "
                         "adds the first one\n",
                         kNotFound};
    const SignedIn here = access_.in(project.place().project, *user);
    if (here.role == Role::Admin) return access_.usersPage(project.place().project);
    return HttpReply{"text/plain",
                     here.user.value + " is a " + std::string(nameOf(here.role)) +
                         " here; an admin can list the users\n",
                     kForbiddenPage};
}

HttpRoute HttpRoutes::filesOf(ServedProject& project, const HttpTarget& target) {
    auto request = parseFileRequest(target.path, target.query);
    if (!request) return HttpReply{"text/plain", request.error().message + "\n", kBadRequest};
    if (project.status().state != State::Serving) return unavailable(project);
    return HttpPage([&project, request = std::move(*request)](const HttpAnswer& answer) {
        project.answerFile(request, answer);
    });
}

HttpRoute HttpRoutes::sessionsOf(ServedProject& project, const User& user,
                                 const HttpTarget& target) const {
    WebSocketTransport* sessions = project.sessions();
    if (!sessions) return unavailable(project);
    if (!user) return HttpSessions{sessions, std::nullopt};
    access_.entered(target, *user, project.name());
    return HttpSessions{sessions, access_.in(project.place().project, *user)};
}

std::optional<HttpSessions> HttpRoutes::sessionsBeforeSignIn(const HttpTarget& target) {
    if (!target.authorization.empty() || !target.path.ends_with(kSessions) ||
        !offers(target.subprotocols, kShowsToken))
        return std::nullopt;
    // Whether the project exists is told after the sign-in. Until then any transport serves.
    std::string_view name = target.path.substr(0, target.path.size() - kSessions.size());
    if (name.starts_with('/')) name.remove_prefix(1);
    const Visible all = projects_.mainLines();
    const ServedProject* const wanted = named(name, all);
    WebSocketTransport* transport = wanted ? wanted->sessions() : nullptr;
    for (const ServedProject* project : all)
        if (!transport) transport = project->sessions();
    if (!transport) return std::nullopt;
    const auto arrival = std::make_shared<Arrival>(
        Arrival{std::string(target.path), {}, std::string(target.peer), transport});
    return HttpSessions{transport, std::nullopt,
                        [this, arrival](const std::string& token,
                                        const std::function<void(Result<SignedIn>)>& found) {
                            asio::post(io_, [this, arrival, token, found] {
                                Arrival shown = *arrival;
                                shown.authorization = "Bearer " + token;
                                signIn(std::make_shared<Arrival>(std::move(shown)), found, true);
                            });
                        }};
}

void HttpRoutes::signIn(const std::shared_ptr<const Arrival>& arrival,
                        const std::function<void(Result<SignedIn>)>& found, bool mayWait) {
    const auto refuse = [found](const HttpReply& reply) {
        const ErrorCode code = reply.status == kUnavailable ? ErrorCode::ShuttingDown
                               : reply.status == kNotFound  ? ErrorCode::InvalidArgument
                                                            : ErrorCode::SignInRequired;
        found(fail(code, reply.body.substr(0, reply.body.find_last_not_of('\n') + 1)));
    };
    const HttpRoute routed = route(
        {.path = arrival->path, .authorization = arrival->authorization, .peer = arrival->peer});
    if (const auto* sessions = std::get_if<HttpSessions>(&routed)) {
        if (sessions->transport == arrival->transport && sessions->user)
            return found(*sessions->user);
        return refuse({"text/plain", "the project was opened again; connect again", kUnavailable});
    }
    if (const auto* page = std::get_if<HttpPage>(&routed)) return (*page)(refuse);
    const auto* again = std::get_if<HttpAgain>(&routed);
    if (again && mayWait)
        return again->wait([this, arrival, found] {
            asio::post(io_, [this, arrival, found] { signIn(arrival, found, false); });
        });
    const auto* reply = std::get_if<HttpReply>(&routed);
    refuse(reply ? *reply : HttpReply{"text/plain", "the server is busy; try again", kUnavailable});
}

HttpReply HttpRoutes::unavailable(const ServedProject& project) {
    const ServedProject::Status status = project.status();
    const std::string why = status.error
                                ? "cannot be opened: " + project.texts()(*status.error).message
                            : status.state == State::Opening ? "is being opened"
                                                             : "is being closed";
    return HttpReply{"text/plain", "the project \"" + project.name() + "\" " + why + "\n",
                     kUnavailable};
}

HttpReply HttpRoutes::noSuchProject(const std::string& name, const Visible& visible) {
    const std::size_t session = name.find("?session=");
    if (session == std::string::npos)
        return notHere("there is no project \"" + name + "\" here", visible);
    return {"text/plain",
            "there is no live session in use with the address " + name.substr(session) +
                ": it was ended, or never created. `usdlive session list` lists them\n",
            kNotFound};
}

HttpReply HttpRoutes::notHere(const std::string& what, const Visible& visible) {
    std::string names;
    for (std::size_t named = 0; named < visible.size(); ++named) {
        if (named == kMostNamed) {
            names += ", ...";
            break;
        }
        names += (names.empty() ? "" : ", ") + visible[named]->name();
    }
    return {"text/plain",
            what + (names.empty() ? "; the server has none yet" : "; the server has " + names) +
                ". Connect to ws://HOST:PORT/PROJECT\n",
            kNotFound};
}

/// Answers somebody who opens the address in a browser.
HttpReply HttpRoutes::welcome(const ProjectReports& reports) const {
    const auto urlOf = [this](const std::string& name) {
        return projects_.areSeveral() ? url_ + "/" + percentEncoded(name) : url_;
    };
    std::string page = "usdlive " USDLIVE_VERSION
                       ": people edit OpenUSD stages of this server together, at the same time.\n"
                       "\nProjects\n";
    std::size_t named = 0;
    for (const auto& [name, report] : reports) {
        if (named++ == kMostNamed) {
            page += "  and " + std::to_string(reports.size() - kMostNamed) + " more: /projects\n";
            break;
        }
        page += "  " + urlOf(name) + "  " + report.status + ", revision " +
                std::to_string(report.revision) + ", sessions " + std::to_string(report.sessions) +
                "\n";
    }
    if (reports.empty()) page += "  none yet\n";
    const std::string url = reports.empty() ? url_ : urlOf(reports.front().first);
    return {"text/plain; charset=utf-8",
            page + "\nConnect\n  shell:    usdlive ls " + url + "\n  Python:   usdlive.connect(\"" +
                url + "\", user=\"ada\")\n  OpenUSD:  Usd.Stage.Open(\"usdlive" +
                url.substr(url.find(':')) + "/LAYER.usda\"), to read\n" + "  Browser:  " +
                pageHint_ + "\nOther pages\n  /projects  /files  /healthz  /metrics\n"};
}

HttpReply HttpRoutes::health(const ProjectReports& reports) const {
    Json projects = Json::object();
    bool isWell = true;
    for (const auto& [name, report] : reports) {
        if (!projects_.areSeveral())
            return {kJson, text({{"status", report.status},
                                 {"project", name},
                                 {"revision", report.revision}})};
        isWell = isWell && report.status == "ok";
        projects[name] = report.status;
    }
    return {kJson, text({{"status", isWell ? "ok" : "degraded"}, {"projects", projects}})};
}

HttpReply HttpRoutes::briefHealth(const ProjectReports& reports) const {
    const bool isWell =
        std::ranges::all_of(reports, [](const auto& one) { return one.second.status == "ok"; });
    return {kJson, text({{"status", isWell ? "ok" : "degraded"}})};
}

HttpReply HttpRoutes::list(const ProjectReports& reports) const {
    Json all = Json::array();
    for (const auto& [name, report] : reports) {
        Json one{{"name", name},
                 {"path", projects_.areSeveral() ? "/" + percentEncoded(name) : ""},
                 {"status", report.status},
                 {"revision", report.revision},
                 {"sessions", report.sessions}};
        if (!report.reason.empty()) one["reason"] = report.reason;
        all.push_back(std::move(one));
    }
    return {kJson, text({{"projects", all}, {"several", projects_.areSeveral()}})};
}

HttpReply HttpRoutes::metrics(const ProjectReports& reports) const {
    MetricsOfProjects all;
    for (const auto& [name, report] : reports)
        if (report.metrics) all.emplace_back(projects_.areSeveral() ? name : "", report.metrics);
    return {"text/plain; version=0.0.4",
            metricsPage(http_ ? http_->counters() : HttpCounters(), access_.refusals(), all)};
}

}  // namespace usdlive::server
