// Makes the stamp of a file from its metadata.
#include "auth/FileStamp.h"

#include <sys/stat.h>

namespace usdlive::server {

std::optional<std::string> changeStampOf(const std::filesystem::path& path) {
    struct stat found{};
    if (::stat(path.c_str(), &found) != 0) return std::nullopt;
    return std::to_string(found.st_ino) + " " + std::to_string(found.st_size) + " " +
           std::to_string(found.st_mode) + " " + std::to_string(found.st_mtim.tv_sec) + " " +
           std::to_string(found.st_mtim.tv_nsec);
}

}  // namespace usdlive::server
