// Notices when the files in folders change.
#pragma once

#include <cstddef>
#include <filesystem>

#include "usdlive/common/core/Descriptor.h"

namespace usdlive::server {

/// Notices when something in folders changes, as far as Linux reports it (inotify): not on a
/// network disk, for a write through a mapping, or beyond the system's number of watches. Not
/// thread-safe.
class FolderWatch {
public:
    /// With more folders, changes are not noticed: other programs need watches, too.
    static constexpr std::size_t kMostFolders = 10'000;

    FolderWatch();

    /// Forgets the changes up to now.
    void begin();
    /// Watches a folder, without those below it. Call it after begin() and before the entries are
    /// read, also when the folder is watched already.
    void add(const std::filesystem::path& folder);
    /// Returns true if nothing has changed in the added folders since begin(). If false, they may
    /// have changed.
    [[nodiscard]] bool isUnchanged();

private:
    Descriptor events_;
    bool isUnknown_ = false;
    std::size_t count_ = 0;  // added folders
};

}  // namespace usdlive::server
