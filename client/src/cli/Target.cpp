// Parses the server and the layers of a command.
#include "cli/Target.h"

#include <cstdlib>

#include "usdlive/common/core/LayerPath.h"

namespace usdlive::cli {

namespace {

constexpr std::chrono::seconds kFindTime{5};

bool has(std::string_view text, char character) {
    return text.find(character) != std::string_view::npos;
}

}  // namespace

bool looksLikeAddress(std::string_view word) {
    if (word.find("://") != std::string_view::npos || word.starts_with('[')) return true;
    const std::string_view host = word.substr(0, word.find(':'));
    return has(word, ':') && !has(word, ' ') && !has(host, '/');
}

std::string defaultServer() {
    const char* url = std::getenv("USDLIVE_URL");
    return url && *url ? url : "ws://127.0.0.1:7447";
}

Result<Target> parseTarget(const std::vector<std::string>& words) {
    const bool named = !words.empty() && has(words.front(), ':');
    for (std::size_t i = 1; i < words.size(); ++i)
        if (looksLikeAddress(words[i]))
            return fail(ErrorCode::InvalidArgument,
                        "'" + words[i] +
                            "' looks like the address of a server, which is the first word after "
                            "the verb");
    auto server = client::parseServerAddress(named ? words.front() : defaultServer());
    if (!server) return tl::unexpected(server.error());
    *server = client::findProject(std::move(*server), kFindTime);
    Target target{std::move(*server), {}};
    if (!target.server.layer.empty()) target.layers.push_back({target.server.layer});
    for (std::size_t i = named ? 1 : 0; i < words.size(); ++i) {
        auto layer = parseLayerId(words[i]);
        if (!layer) return tl::unexpected(layer.error());
        target.layers.push_back(std::move(*layer));
    }
    return target;
}

}  // namespace usdlive::cli
