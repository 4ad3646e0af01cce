// Notices when the files in folders change, with inotify.
#include "files/FolderWatch.h"

#include <linux/magic.h>
#include <sys/inotify.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <algorithm>
#include <array>

namespace usdlive::server {

namespace {

constexpr std::uint32_t kChanges = IN_ATTRIB | IN_CREATE | IN_DELETE | IN_DELETE_SELF | IN_MODIFY |
                                   IN_MOVE_SELF | IN_MOVED_FROM | IN_MOVED_TO | IN_ONLYDIR;

/// On other file systems, other machines may change files, which inotify does not report.
bool isLocal(const std::filesystem::path& folder) {
    constexpr std::array<long, 6> kLocal{EXT4_SUPER_MAGIC, XFS_SUPER_MAGIC, BTRFS_SUPER_MAGIC,
                                         F2FS_SUPER_MAGIC, TMPFS_MAGIC,     OVERLAYFS_SUPER_MAGIC};
    struct statfs found{};
    return ::statfs(folder.c_str(), &found) == 0 &&
           std::ranges::find(kLocal, long(found.f_type)) != kLocal.end();
}

}  // namespace

FolderWatch::FolderWatch() : events_(::inotify_init1(IN_NONBLOCK | IN_CLOEXEC)) {}

void FolderWatch::begin() {
    static_cast<void>(isUnchanged());
    isUnknown_ = false;
    count_ = 0;
}

void FolderWatch::add(const std::filesystem::path& folder) {
    if (isUnknown_) return;
    const int watch = ++count_ <= kMostFolders && isLocal(folder)
                          ? ::inotify_add_watch(events_.get(), folder.c_str(), kChanges)
                          : -1;
    isUnknown_ = watch < 0;
}

bool FolderWatch::isUnchanged() {
    alignas(inotify_event) std::array<char, 4096> events;
    while (::read(events_.get(), events.data(), events.size()) > 0) isUnknown_ = true;
    return events_ && !isUnknown_;
}

}  // namespace usdlive::server
