// Writes the seeds of a fuzz target to files.
#include "Fuzz.h"

#include <filesystem>
#include <fstream>
#include <string>

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
    const std::string_view option = *argc == 2 ? (*argv)[1] : "", name = "--seeds=";
    if (!option.starts_with(name)) return 0;
    const std::filesystem::path folder(option.substr(name.size()));
    int number = 0;
    for (const auto& seed : usdlive::fuzz::seeds()) {
        std::ofstream file(folder / ("seed" + std::to_string(number++)), std::ios::binary);
        file << usdlive::asText(seed);
        if (!file.flush()) std::exit(1);
    }
    std::exit(0);
}
