// Parses requests for a project's files.
#include "transport/FileRequest.h"

#include <charconv>

#include "usdlive/common/core/PercentEncoding.h"
#include "usdlive/common/core/Utf8.h"
#include "usdlive/common/protocol/Requests.h"

namespace usdlive::server {

namespace {

constexpr std::size_t kMaxPathBytes = 4'096;

tl::unexpected<Error> malformed(const std::string& what) {
    return fail(ErrorCode::InvalidArgument, what);
}

Result<void> setPart(FileRequest& request, std::string_view name, const std::string& value) {
    if (name == "hash") {
        request.hash = hashFromHex(value);
        if (!request.hash)
            return malformed("hash is not a SHA-256 of 64 hexadecimal digits: " + inQuotes(value));
    } else if (name == "revision") {
        Revision revision = 0;
        const char* const end = value.data() + value.size();
        const auto [stop, error] = std::from_chars(value.data(), end, revision);
        if (error != std::errc() || stop != end)
            return malformed("revision is not a number: " + inQuotes(value));
        request.revision = revision;
    } else if (name == "checkpoint") {
        if (value.empty() || value.size() > kMaxCheckpointNameBytes || !isUtf8(value))
            return malformed("checkpoint is not the name of a checkpoint: " + inQuotes(value));
        request.checkpoint = value;
    } else if (name == "layers") {
        if (value != "no") return malformed("layers is not \"no\": " + inQuotes(value));
        request.layers = false;
    }
    return {};
}

Result<void> parseQuery(FileRequest& request, std::string_view query) {
    while (!query.empty()) {
        const std::string_view part = query.substr(0, query.find('&'));
        query.remove_prefix(std::min(query.size(), part.size() + 1));
        const std::size_t equals = part.find('=');
        if (equals == std::string_view::npos) continue;
        const auto value = percentDecoded(part.substr(equals + 1));
        if (!value) return malformed("the query is malformed: " + inQuotes(part));
        if (auto set = setPart(request, part.substr(0, equals), *value); !set) return set;
    }
    if (request.revision && request.checkpoint)
        return malformed("name a revision or a checkpoint, not both");
    return {};
}

}  // namespace

bool isFilePath(std::string_view path) {
    if (path.empty() || path.size() > kMaxPathBytes || !isUtf8(path)) return false;
    if (path.find('\0') != std::string_view::npos) return false;
    for (;;) {
        const std::size_t slash = path.find('/');
        const std::string_view part = path.substr(0, slash);
        if (part.empty() || part.front() == '.') return false;
        if (slash == std::string_view::npos) return true;
        path.remove_prefix(slash + 1);
    }
}

Result<FileRequest> parseFileRequest(std::string_view path, std::string_view query) {
    FileRequest request;
    if (!path.empty() && path != "/") {
        const auto decoded = percentDecoded(path.substr(1));
        if (!decoded || !path.starts_with('/') || !isFilePath(*decoded))
            return malformed("the path " + inQuotes(path) +
                             " cannot be that of a file in the project");
        request.path = *decoded;
    }
    if (auto parsed = parseQuery(request, query); !parsed) return tl::unexpected(parsed.error());
    return request;
}

}  // namespace usdlive::server
