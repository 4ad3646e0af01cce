// Writes a layer to a folder and runs the real server for it.
#include "Server.h"

#include <stdlib.h>

#include <chrono>
#include <fstream>
#include <stdexcept>
#include <thread>

namespace usdlive::bench {

TemporaryFolder::TemporaryFolder() {
    std::string name = std::filesystem::temp_directory_path() / "usdlive-bench-XXXXXX";
    if (!::mkdtemp(name.data())) throw std::runtime_error("cannot create a temporary folder");
    path_ = name;
}

TemporaryFolder::~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
}

std::string attributePath(int index) {
    return "/World/p" + std::to_string(index / kAttributesPerPrim) + ".a" +
           std::to_string(index % kAttributesPerPrim);
}

void writeLayer(const std::filesystem::path& folder, int fields) {
    std::ofstream file(folder / kLayer.value);
    file << "#usda 1.0\n\ndef Scope \"World\"\n{\n";
    for (int prim = 0; prim * kAttributesPerPrim < fields; ++prim) {
        file << "    def Scope \"p" << prim << "\"\n    {\n";
        for (int i = 0; i < kAttributesPerPrim && prim * kAttributesPerPrim + i < fields; ++i)
            file << "        custom double3 a" << i << " = (" << prim << ", " << i << ", 0.5)\n";
        file << "    }\n";
    }
    file << "}\n";
    file.close();
    if (!file) throw std::runtime_error("cannot write the layer");
}

std::uint16_t awaitPort(ChildProcess& child, const std::filesystem::path& portFile) {
    for (;;) {
        int port = 0;
        if (std::ifstream(portFile) >> port) return static_cast<std::uint16_t>(port);
        if (!child.isRunning()) throw std::runtime_error("the server ended before it listened");
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
}

ServerProcess::ServerProcess(const std::filesystem::path& folder,
                             const std::vector<std::string>& options, const std::vector<int>& cores,
                             std::uint16_t port) {
    const auto portFile = folder / "port";
    std::filesystem::remove(portFile);
    std::vector<std::string> command{besideThisProgram("usdlive-server"), folder,
                                     "--port=" + std::to_string(port),
                                     "--port-file=" + portFile.string(), "--log-level=error"};
    command.insert(command.end(), options.begin(), options.end());
    process_.emplace(command, cores);
    port_ = awaitPort(*process_, portFile);
}

std::string ServerProcess::url() const { return "ws://127.0.0.1:" + std::to_string(port_); }

}  // namespace usdlive::bench
