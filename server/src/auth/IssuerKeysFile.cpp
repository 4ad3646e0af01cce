// Reads the file with the keys of an issuer.
#include "auth/IssuerKeysFile.h"

#include <fstream>

#include "auth/FileStamp.h"

namespace usdlive::server {

Result<IssuerKeys> IssuerKeysFile::read() const {
    const auto unusable = [this](const std::string& why) {
        return fail(ErrorCode::InvalidConfiguration, path_.string() + ": " + why);
    };
    std::error_code error;
    if (!std::filesystem::is_regular_file(path_, error))
        return unusable(error ? error.message() : "it is not a regular file");
    std::ifstream stream(path_, std::ios::binary);
    std::string text(IssuerKeys::kMostBytes + 1, '\0');
    stream.read(text.data(), std::streamsize(text.size()));
    if (stream.bad() || (!stream && !stream.eof())) return unusable("it cannot be read");
    text.resize(std::size_t(stream.gcount()));
    auto keys = IssuerKeys::parse(text);
    if (!keys) return unusable(keys.error().message);
    return keys;
}

std::optional<std::string> IssuerKeysFile::stamp() const { return changeStampOf(path_); }

}  // namespace usdlive::server
