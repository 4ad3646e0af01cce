// Points at which tests kill the server.
#pragma once

#include <string_view>

#ifdef USDLIVE_FAULTS
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <string>
#endif

namespace usdlive::server {

/// Kills the process as kill -9 would. Only in usdlive-server-faults (tests/CMakeLists.txt), and if
/// the environment has USDLIVE_FAULT=<point> or <point>:<n>: at the n-th call. Points:
/// append-before, append-after, snapshot, save-before, save-after, import, upload-before,
/// upload-after, compact-before, compact-after, keeping (at each commit that compacting or
/// measuring reads).
#ifdef USDLIVE_FAULTS
inline void faultPoint(std::string_view point) {
    static const std::string chosen = [] {
        const char* text = std::getenv("USDLIVE_FAULT");
        return std::string(text ? text : "");
    }();
    static std::atomic<int> left = [] {
        const auto colon = chosen.find(':');
        return colon == std::string::npos ? 1 : std::atoi(chosen.c_str() + colon + 1);
    }();
    if (point == std::string_view(chosen).substr(0, chosen.find(':')) && --left == 0) ::_exit(9);
}
#else
inline void faultPoint(std::string_view) {}
#endif

}  // namespace usdlive::server
