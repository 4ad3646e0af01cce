// A library for LD_PRELOAD in a server: it records the server's calls on files below a folder, and
// makes one of the calls fail. tests/integration/crash_prefix_test.py and failing_io_test.py use it
// to rebuild the files that a crash may leave.
//
//   USDLIVE_IO_FOLDER  the folder
//   USDLIVE_IO_TRACE   the file to append to
//   USDLIVE_IO_FAULT   KIND:N:WHAT[+]: the N-th call of the kind in this process (with +, this and
//                      all later ones). KIND: write, sync, rename, create. WHAT: EIO, ENOSPC,
//                      SHORT (half of it is written), TORN (like SHORT, then ENOSPC), KILL (the
//                      process ends before the call).
//
// Calls are recorded one after the other: writes that the trace has before a sync happened before
// it. The library wraps only the calls that the server's libraries make today. The tests compare
// the rebuilt files with the real ones, and so notice other calls.

#include <dlfcn.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdarg>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <string>
#include <string_view>

namespace {

constexpr int kMostFiles = 65536;
constexpr int kKilled = 137;

enum class Did : std::uint8_t {
    Begin = 'b',  // a new process
    Open = 'o',   // file, path; number: 1 creates, 2 truncates
    Write = 'w',  // file, offset, bytes
    Size = 't',   // file, size
    Sync = 's',   // file
    Lost = 'l',   // file: its sync failed
    Rename = 'r',
    Remove = 'u',
    MakeFolder = 'm',
};

struct Header {
    Did did;
    std::uint8_t unused[3];
    std::int32_t file;
    std::uint64_t number;
    std::uint32_t firstBytes, secondBytes;
};

enum class What { Nothing, Error, Half, Kill };

template <class Function>
Function* next(const char* name) {
    return reinterpret_cast<Function*>(::dlsym(RTLD_NEXT, name));
}
// Returns the next function of this name, which does the real work.
#define NEXT(name) (next<decltype(name)>(#name))

class Recorder {
public:
    std::mutex mutex;

    [[nodiscard]] bool isBelow(const char* path) const {
        if (folder_.empty() || !path) return false;
        const std::string_view text(path);
        return text.starts_with(folder_) || text == folder_.substr(0, folder_.size() - 1);
    }
    [[nodiscard]] bool has(int file) const {
        return file >= 0 && file < kMostFiles && files_[file];
    }
    void add(int file, const char* path, int flags) {
        if (file < 0 || file >= kMostFiles) return;
        files_[file] = true;
        const std::uint64_t what = (flags & O_CREAT ? 1 : 0) | (flags & O_TRUNC ? 2 : 0);
        record(Did::Open, file, what, inFolder(path));
    }
    void forget(int file) {
        if (file >= 0 && file < kMostFiles) files_[file] = false;
    }

    void record(Did did, int file, std::uint64_t number, std::string_view first = {},
                std::string_view second = {}) {
        if (trace_ < 0) return;
        if (!begun_) {
            begun_ = true;
            record(Did::Begin, -1, 0);
        }
        Header header{
            did, {}, file, number, std::uint32_t(first.size()), std::uint32_t(second.size())};
        iovec parts[] = {{&header, sizeof(header)},
                         {const_cast<char*>(first.data()), first.size()},
                         {const_cast<char*>(second.data()), second.size()}};
        const auto bytes = ssize_t(sizeof(header) + first.size() + second.size());
        if (::writev(trace_, parts, 3) != bytes) std::abort();
    }

    /// Decides the fault of this call. Sets errno for Error; Kill does not return.
    What fault(std::string_view kind) {
        if (kind != kind_) return What::Nothing;
        ++count_;
        if (what_ == "TORN" && count_ == at_ + 1) return errno = ENOSPC, What::Error;
        if (count_ != at_ && !(goesOn_ && count_ > at_)) return What::Nothing;
        if (what_ == "KILL") ::_exit(kKilled);
        if (what_ == "SHORT" || what_ == "TORN") return What::Half;
        errno = what_ == "ENOSPC" ? ENOSPC : EIO;
        return What::Error;
    }

    [[nodiscard]] std::string_view inFolder(const char* path) const {
        const std::string_view text(path);
        return text.substr(std::min(text.size(), folder_.size()));  // empty: the folder itself
    }

    Recorder() {
        const char* folder = std::getenv("USDLIVE_IO_FOLDER");
        const char* trace = std::getenv("USDLIVE_IO_TRACE");
        if (!folder || !trace) return;
        folder_ = folder;
        trace_ = NEXT(open)(trace, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
        if (trace_ < 0) std::abort();
        if (const char* fault = std::getenv("USDLIVE_IO_FAULT")) choose(fault);
    }

private:
    void choose(std::string_view fault) {
        const auto first = fault.find(':'), second = fault.rfind(':');
        if (first == second) std::abort();
        kind_ = fault.substr(0, first);
        at_ = std::strtoull(fault.data() + first + 1, nullptr, 10);
        what_ = fault.substr(second + 1);
        goesOn_ = what_.ends_with('+');
        if (goesOn_) what_.pop_back();
    }

    std::string folder_, kind_, what_;
    std::uint64_t at_ = 0, count_ = 0;
    bool goesOn_ = false, begun_ = false;
    int trace_ = -1;
    bool files_[kMostFiles] = {};
};

// Never destroyed: other threads write until the process ends.
Recorder& recorder() {
    static auto* const recorder = new Recorder;
    return *recorder;
}

int sync(int file, int (*function)(int)) {
    Recorder& trace = recorder();
    const std::lock_guard lock(trace.mutex);
    if (!trace.has(file)) return function(file);
    if (trace.fault("sync") != What::Nothing) {
        const int error = errno;
        trace.record(Did::Lost, file, 0);
        errno = error;
        return -1;
    }
    const int done = function(file);
    if (done == 0) trace.record(Did::Sync, file, 0);
    return done;
}

/// `write` writes that many bytes; `offset` returns their position afterwards.
template <class Write, class Offset>
ssize_t written(int file, const void* data, size_t size, Write&& write, Offset&& offset) {
    Recorder& trace = recorder();
    const std::lock_guard lock(trace.mutex);
    if (!trace.has(file)) return write(size);
    const What what = trace.fault("write");
    if (what == What::Error) return -1;
    const ssize_t done = write(what == What::Half ? (size + 1) / 2 : size);
    if (done > 0)
        trace.record(Did::Write, file, offset(done),
                     {static_cast<const char*>(data), size_t(done)});
    return done;
}

void recordSize(int file) {
    struct stat status{};
    if (::fstat(file, &status) == 0)
        recorder().record(Did::Size, file, std::uint64_t(status.st_size));
}

}  // namespace

extern "C" {

int open(const char* path, int flags, ...) {
    mode_t mode = 0;
    if (flags & (O_CREAT | O_TMPFILE)) {
        va_list more;
        va_start(more, flags);
        mode = va_arg(more, mode_t);
        va_end(more);
    }
    Recorder& trace = recorder();
    if (!trace.isBelow(path)) return NEXT(open)(path, flags, mode);
    const std::lock_guard lock(trace.mutex);
    if ((flags & O_CREAT) && trace.fault("create") != What::Nothing) return -1;
    const int file = NEXT(open)(path, flags, mode);
    if (file >= 0) trace.add(file, path, flags);
    return file;
}

int close(int file) {
    Recorder& trace = recorder();
    if (trace.has(file)) {
        const std::lock_guard lock(trace.mutex);
        trace.forget(file);
    }
    return NEXT(close)(file);
}

ssize_t write(int file, const void* data, size_t size) {
    static auto* const real = NEXT(write);
    if (!recorder().has(file)) return real(file, data, size);
    return written(
        file, data, size, [&](size_t bytes) { return real(file, data, bytes); },
        [&](ssize_t done) { return std::uint64_t(::lseek(file, 0, SEEK_CUR) - done); });
}

ssize_t pwrite(int file, const void* data, size_t size, off_t offset) {
    return written(
        file, data, size, [&](size_t bytes) { return NEXT(pwrite)(file, data, bytes, offset); },
        [&](ssize_t) { return std::uint64_t(offset); });
}

int fsync(int file) { return sync(file, NEXT(fsync)); }
int fdatasync(int file) { return sync(file, NEXT(fdatasync)); }

int ftruncate(int file, off_t size) noexcept {
    Recorder& trace = recorder();
    const std::lock_guard lock(trace.mutex);
    const int done = NEXT(ftruncate)(file, size);
    if (done == 0 && trace.has(file)) recordSize(file);
    return done;
}

int fallocate(int file, int mode, off_t offset, off_t size) {
    Recorder& trace = recorder();
    const std::lock_guard lock(trace.mutex);
    const int done = NEXT(fallocate)(file, mode, offset, size);
    if (done == 0 && trace.has(file)) recordSize(file);
    return done;
}

int posix_fallocate(int file, off_t offset, off_t size) {
    Recorder& trace = recorder();
    const std::lock_guard lock(trace.mutex);
    const int done = NEXT(posix_fallocate)(file, offset, size);
    if (done == 0 && trace.has(file)) recordSize(file);
    return done;
}

int rename(const char* from, const char* to) noexcept {
    Recorder& trace = recorder();
    if (!trace.isBelow(from)) return NEXT(rename)(from, to);
    const std::lock_guard lock(trace.mutex);
    if (trace.fault("rename") != What::Nothing) return -1;
    const int done = NEXT(rename)(from, to);
    if (done == 0) trace.record(Did::Rename, -1, 0, trace.inFolder(from), trace.inFolder(to));
    return done;
}

int unlink(const char* path) noexcept {
    Recorder& trace = recorder();
    if (!trace.isBelow(path)) return NEXT(unlink)(path);
    const std::lock_guard lock(trace.mutex);
    const int done = NEXT(unlink)(path);
    if (done == 0) trace.record(Did::Remove, -1, 0, trace.inFolder(path));
    return done;
}

// std::filesystem::remove_all uses a file descriptor for the folder.
int unlinkat(int folder, const char* name, int flags) noexcept {
    std::string path = name;
    if (path.front() != '/') {
        char prefix[4096];
        const std::string link = "/proc/self/fd/" + std::to_string(folder);
        const ssize_t size =
            folder == AT_FDCWD ? 0 : ::readlink(link.c_str(), prefix, sizeof(prefix));
        if (size > 0) path = std::string(prefix, size_t(size)) + "/" + path;
    }
    Recorder& trace = recorder();
    const std::lock_guard lock(trace.mutex);
    const int done = NEXT(unlinkat)(folder, name, flags);
    if (done == 0 && trace.isBelow(path.c_str()))
        trace.record(Did::Remove, -1, 0, trace.inFolder(path.c_str()));
    return done;
}

int rmdir(const char* path) noexcept {
    Recorder& trace = recorder();
    if (!trace.isBelow(path)) return NEXT(rmdir)(path);
    const std::lock_guard lock(trace.mutex);
    const int done = NEXT(rmdir)(path);
    if (done == 0) trace.record(Did::Remove, -1, 0, trace.inFolder(path));
    return done;
}

int mkdir(const char* path, mode_t mode) noexcept {
    Recorder& trace = recorder();
    if (!trace.isBelow(path)) return NEXT(mkdir)(path, mode);
    const std::lock_guard lock(trace.mutex);
    const int done = NEXT(mkdir)(path, mode);
    if (done == 0) trace.record(Did::MakeFolder, -1, 0, trace.inFolder(path));
    return done;
}

}  // extern "C"
