// The place of a served line of history: a project, or a live session of one.
#pragma once

#include <filesystem>
#include <string>

namespace usdlive::server {

/// The name and the folders of a project's main line, or of one of its live sessions (LV1).
struct ProjectPlace {
    std::string project;           ///< the name of the project
    std::filesystem::path folder;  ///< that of the project
    std::string liveSession = {};  ///< empty: the main line

    [[nodiscard]] bool isLiveSession() const { return !liveSession.empty(); }
    /// Returns the name in addresses: `shots`, `shots?session=dusk`.
    [[nodiscard]] std::string name() const {
        return isLiveSession() ? project + "?session=" + liveSession : project;
    }
    /// Returns the folder of the line's history.
    [[nodiscard]] std::filesystem::path history() const {
        const std::filesystem::path main = folder / ".usdlive";
        return isLiveSession() ? main / "sessions" / liveSession : main;
    }
};

}  // namespace usdlive::server
