// Fuzzes addresses of the resolver, and relative paths in layers that have such an address.
#include "Url.h"

#include "Fuzz.h"

using namespace usdlive;
using namespace usdlive::resolver;
using fuzz::require;

namespace {

void checkUrl(const Url& url) {
    require(!url.host.empty() && url.port != 0, "an address has a host and a port");
    Url plain = url;
    plain.version.clear();
    require(parseUrl(plain.identifier()) == plain, "an identifier is the same address");
    require(parseUrl(url.resolvedPath()) == url, "a resolved path is the same address");
    require(url.path.find("/../") == std::string::npos || url.leadsOut(),
            "a path is normalized, or leads out");
    require(!url.path.starts_with('/') && url.path.find("//") == std::string::npos,
            "a path has no empty parts");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const std::string_view input(reinterpret_cast<const char*>(data), size);
    const std::string_view first = input.substr(0, input.find('\n'));
    const std::string_view second =
        first.size() < input.size() ? input.substr(first.size() + 1) : std::string_view();
    std::string why;
    const auto url = parseUrl(first, &why);
    require(url || !why.empty(), "a refusal has a reason");
    if (!url) return 0;
    checkUrl(*url);
    if (second.find('\0') != std::string_view::npos) return 0;
    const Url beside = anchored(*url, second);
    require(beside.pin == url->pin, "a relative path keeps the revision");
    require(beside.version == (url->isLive() ? url->version : std::string()),
            "a relative path has no version, unless its layer is live");
    checkUrl(beside);
    return 0;
}

std::vector<Bytes> fuzz::seeds() {
    std::vector<Bytes> all;
    for (const std::string_view text :
         {"usdlive://localhost:7447/a/shot.usda@1234\n./tex/a@2x.png", "usdlive://h/a%20b.usda",
          "usdlive://h/@12~12-abc/p/a.usda\n../../../x", "usdlive://h/@~0123/a@b/c@d.e\n@x@y",
          "USDLIVE://H:1/..//./%2E%2E/%40a@v1%2E2\n%41@1", "usdlive://h:99999/",
          "usdlive://h/a@1@2", "usdlive://h/@~live/a/shot.usda\n./tex/a.png"})
        all.emplace_back(text.begin(), text.end());
    return all;
}
