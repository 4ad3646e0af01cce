// Starts a server in a temporary folder, for benchmarks.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "ChildProcess.h"
#include "usdlive/common/core/Id.h"

namespace usdlive::bench {

/// A folder below the system's temporary folder. The destructor removes it.
class TemporaryFolder {
public:
    TemporaryFolder();
    ~TemporaryFolder();
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;
    [[nodiscard]] const std::filesystem::path& path() const { return path_; }

private:
    std::filesystem::path path_;
};

inline const LayerId kLayer{"shot.usda"};
inline constexpr int kAttributesPerPrim = 10;

/// The path of attribute number `index` in the layer that writeLayer() creates.
[[nodiscard]] std::string attributePath(int index);
/// Writes a layer kLayer with `fields` attributes to the folder, a double3 each, ten for a prim.
void writeLayer(const std::filesystem::path& folder, int fields);

/// Waits for the port that a program writes into a file. Throws when the program ends instead.
[[nodiscard]] std::uint16_t awaitPort(ChildProcess& child, const std::filesystem::path& portFile);

/// The real server, which serves a folder on a port; 0: on a free one.
class ServerProcess {
public:
    ServerProcess(const std::filesystem::path& folder, const std::vector<std::string>& options,
                  const std::vector<int>& cores, std::uint16_t port = 0);
    [[nodiscard]] std::uint16_t port() const { return port_; }
    [[nodiscard]] std::string url() const;
    [[nodiscard]] ChildProcess& process() { return *process_; }

private:
    std::optional<ChildProcess> process_;
    std::uint16_t port_ = 0;
};

}  // namespace usdlive::bench
