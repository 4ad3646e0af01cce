// Requests the projects of a server over HTTP.
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http.hpp>
#include <nlohmann/json.hpp>

#include "transport/Connection.h"

namespace usdlive::client {

namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
using Json = nlohmann::json;

constexpr std::size_t kMostBytes = 16 * 1024 * 1024;

/// One GET request and its response.
class Request {
public:
    Request(const ServerAddress& server, std::string target)
        : server_(server), request_(http::verb::get, target, 11) {
        request_.set(http::field::host, server.hostAndPort());
        request_.set(http::field::user_agent, "usdlive");
        parser_.body_limit(kMostBytes);
    }

    Result<http::response<http::string_body>> run(std::chrono::milliseconds timeout) {
        // async_resolve() would start a thread, which may be refused.
        const auto found = resolver_.resolve(server_.host, std::to_string(server_.port), error_);
        if (!error_) connect(found);
        io_.run_for(timeout);
        if (!isDone_ && !error_) error_ = beast::error::timeout;
        if (!error_) return parser_.release();
        return fail(
            ErrorCode::NotConnected,
            "cannot reach " + server_.url() + ": " + error_.message() +
                (error_ == asio::error::connection_refused ? ". Is `usdlive serve` running there?"
                                                           : ""));
    }

private:
    bool step(beast::error_code error) {
        error_ = error;
        return !error;
    }
    void connect(const asio::ip::tcp::resolver::results_type& found) {
        stream_.async_connect(found, [this](beast::error_code error, const auto&) {
            if (step(error)) write();
        });
    }
    void write() {
        http::async_write(stream_, request_, [this](beast::error_code error, std::size_t) {
            if (step(error)) read();
        });
    }
    void read() {
        http::async_read(stream_, buffer_, parser_,
                         [this](beast::error_code error, std::size_t) { isDone_ = step(error); });
    }

    const ServerAddress server_;
    asio::io_context io_{1};
    asio::ip::tcp::resolver resolver_{io_};
    beast::tcp_stream stream_{io_};
    beast::flat_buffer buffer_;
    http::request<http::empty_body> request_;
    http::response_parser<http::string_body> parser_;
    beast::error_code error_;
    bool isDone_ = false;
};

std::string textOf(const Json& object, const char* name) {
    const auto found = object.find(name);
    return found != object.end() && found->is_string() ? found->get<std::string>() : "";
}

std::uint64_t numberOf(const Json& object, const char* name) {
    const auto found = object.find(name);
    return found != object.end() && found->is_number_unsigned() ? found->get<std::uint64_t>() : 0;
}

}  // namespace

Result<ListedProjects> listProjects(const ServerAddress& server,
                                    std::chrono::milliseconds timeout) {
    ServerAddress asked = server;
    asked.project.clear();
    asked.layer.clear();
    auto response = Request(asked, "/projects").run(timeout);
    if (!response) return tl::unexpected(response.error());
    if (response->result() == http::status::not_found) return ListedProjects{};
    const Json body = Json::parse(response->body(), nullptr, false);
    if (response->result() != http::status::ok || !body.is_object() || !body.contains("projects") ||
        !body["projects"].is_array())
        return fail(ErrorCode::Internal, asked.url() +
                                             " does not say which projects it has: HTTP " +
                                             std::to_string(response->result_int()));
    ListedProjects projects;
    projects.areSeveral = body.value("several", false);
    for (const Json& one : body["projects"])
        if (one.is_object())
            projects.all.push_back({textOf(one, "name"), textOf(one, "status"),
                                    textOf(one, "reason"), numberOf(one, "revision"),
                                    std::size_t(numberOf(one, "sessions"))});
    return projects;
}

ServerAddress findProject(ServerAddress address, std::chrono::milliseconds timeout) {
    const auto slash = address.layer.find('/');
    if (address.dds || !address.project.empty() || slash == std::string::npos) return address;
    const auto projects = listProjects(address, timeout);
    if (!projects || !projects->areSeveral) return address;
    const std::string first = address.layer.substr(0, slash);
    for (const ListedProject& project : projects->all) {
        if (project.name != first) continue;
        address.project = first;
        address.layer.erase(0, slash + 1);
        return address;
    }
    return address;
}

}  // namespace usdlive::client
