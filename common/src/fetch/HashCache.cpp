// Keeps fetched files on the disk.
#include "usdlive/common/fetch/HashCache.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <deque>
#include <fstream>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <thread>
#include <vector>

#include "usdlive/common/core/Descriptor.h"
#include "usdlive/common/core/Sha256.h"
#include "usdlive/common/core/Thread.h"

namespace usdlive::fetch {

namespace fs = std::filesystem;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

namespace {

constexpr std::uint64_t kMib = 1024 * 1024;
constexpr std::uint64_t kDefaultMib = 10 * 1024;
constexpr std::size_t kHashedPartBytes = 1024 * 1024, kArrivingBytes = 512 * 1024;
// The use of a file is noted at most this often.
constexpr std::int64_t kNotedSeconds = 600;
// The time to wait while another process fetches the same file. After it the file is fetched twice,
// which is harmless.
constexpr milliseconds kLockTime{30'000}, kLockPause{10};
constexpr std::size_t kHashDigits = 64, kOriginDigits = 16, kSealDigits = 16;
// Files are hashed when none was fetched for this time.
constexpr milliseconds kQuiet{500};

std::string hashOf(const std::string& text) { return sha256(asBytes(text)).hex(); }

OpenFile noFile() { return {nullptr, &std::fclose}; }

OpenFile opened(Descriptor file) {
    std::FILE* const stream = ::fdopen(file.get(), "rb");
    if (stream) (void)file.release();
    return {stream, &std::fclose};
}

/// Returns the seconds since 1970 when this machine was started, or the largest number if that is
/// not known: every file is hashed then before its first use.
std::int64_t startOfTheMachine() {
    std::ifstream file("/proc/stat");
    std::string name;
    std::int64_t seconds = 0;
    while (file >> name) {
        if (name == "btime" && file >> seconds) return seconds;
        file.ignore(std::numeric_limits<std::streamsize>::max(), '\n');
    }
    return std::numeric_limits<std::int64_t>::max();
}

/// Returns nothing if `goesOn` has returned false before the end.
std::optional<bool> hasHash(const Descriptor& file, const std::string& hash, auto goesOn) {
    Sha256 digest;
    std::vector<std::uint8_t> part(kHashedPartBytes);
    for (std::uint64_t at = 0;;) {
        if (!goesOn()) return std::nullopt;
        const auto count = readPart(file, at, part);
        if (!count) return false;
        if (*count == 0) return digest.finish().hex() == hash;
        digest.add(ByteView(part).first(*count));
        at += *count;
    }
}

bool hasHash(const Descriptor& file, const std::string& hash) {
    return *hasHash(file, hash, [] { return true; });
}

bool writeAll(int file, const void* from, std::size_t size) {
    const char* data = static_cast<const char*>(from);
    while (size > 0) {
        const ssize_t count = ::write(file, data, size);
        if (count < 0 && errno == EINTR) continue;
        if (count < 0) return false;
        data += count;
        size -= std::size_t(count);
    }
    return true;
}

/// Returns whether the file was used since the machine was started.
bool isOfThisStart(const struct stat& file) {
    static const std::int64_t kStart = startOfTheMachine();
    return file.st_mtim.tv_sec > kStart;
}

/// Returns the nanoseconds that the time of a file gets when it was compared with its hash. Whoever
/// writes the file later changes its time. Some file systems keep only microseconds.
std::int64_t markOf(const std::string& hash, std::uint64_t size, std::int64_t seconds) {
    constexpr std::uint64_t kMarks = 1'000'000, kNanosecondsInMark = 1'000;
    const std::string text = hash + "/" + std::to_string(size) + "/" + std::to_string(seconds);
    std::uint64_t mixed = 14'695'981'039'346'656'037u;  // FNV-1a
    for (const unsigned char c : text) mixed = (mixed ^ c) * 1'099'511'628'211u;
    return std::int64_t(mixed % kMarks * kNanosecondsInMark);
}

bool isMarked(const struct stat& file, const std::string& hash) {
    return file.st_mtim.tv_nsec == markOf(hash, std::uint64_t(file.st_size), file.st_mtim.tv_sec);
}

/// Notes that the file is used, and has the content with this hash.
void mark(const Descriptor& file, const std::string& hash) {
    struct stat found{};
    if (::fstat(file.get(), &found) != 0) return;
    timespec times[2]{{0, UTIME_OMIT}, {std::time(nullptr), 0}};
    times[1].tv_nsec = markOf(hash, std::uint64_t(found.st_size), times[1].tv_sec);
    ::futimens(file.get(), times);
}

/// Opens a file, and nothing else that may have its name.
Descriptor openFile(const fs::path& path) {
    Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
    struct stat found{};
    if (!file || ::fstat(file.get(), &found) != 0 || !S_ISREG(found.st_mode)) return Descriptor();
    return file;
}

/// Returns the content of a key's file. Another key's, or a damaged one, is not like it.
std::string sealed(const std::string& key, const std::string& hash, const std::string& note) {
    return hash + " " + hashOf(key + hash + note).substr(0, kSealDigits) + "\n" + note;
}

bool isHash(const std::string& text) {
    return text.size() == kHashDigits &&
           text.find_first_not_of("0123456789abcdef") == std::string::npos;
}

}  // namespace

// ---- Lock

/// A lock between threads and processes. It ends with the process that holds it.
class HashCache::Lock {
public:
    Lock(const fs::path& path, milliseconds time)
        : file_(::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600)) {
        if (!file_) return;
        const auto end = steady_clock::now() + time;
        while (::flock(file_.get(), LOCK_EX | LOCK_NB) != 0) {
            if (errno != EWOULDBLOCK || steady_clock::now() >= end) return;
            std::this_thread::sleep_for(kLockPause);
        }
        isHeld_ = true;
    }
    [[nodiscard]] bool isHeld() const { return isHeld_; }

private:
    const Descriptor file_;
    bool isHeld_ = false;
};

// ---- Checks

/// Hashes the large files of the cache, and gives them the names under which all find them.
class HashCache::Checks {
public:
    explicit Checks(const HashCache& cache) : cache_(cache) {}
    ~Checks() {
        stop();
        const std::lock_guard lock(running().mutex);
        running().checks.erase(this);
    }

    /// Adds a file that this process has fetched, for the thread.
    void add(const fs::path& path, const std::string& hash, const std::string& origin) {
        const std::lock_guard lock(mutex_);
        last_ = steady_clock::now();
        trusted_.insert(path);
        if (isStopped_) return;
        waiting_.emplace(path, std::pair(hash, origin));
        if (thread_.joinable() || start()) changed_.notify_one();
    }

    /// Call it while files are fetched.
    void wait() {
        const std::lock_guard lock(mutex_);
        last_ = steady_clock::now();
    }

    /// Returns whether this process has fetched or hashed the file, and others do not find it yet.
    [[nodiscard]] bool isTrusted(const fs::path& path) const {
        const std::lock_guard lock(mutex_);
        return trusted_.contains(path);
    }

    /// Hashes a file that another process has left.
    void checkNow(const fs::path& path, const std::string& hash, const std::string& origin) {
        check(path, hash, origin, LOCK_EX, [] { return true; });
    }

private:
    /// The threads of this process, which are stopped before OpenSSL ends with it.
    struct Running {
        ~Running() {
            for (Checks* one : std::exchange(checks, {})) one->stop();
        }
        std::mutex mutex;  // guards the next member
        std::set<Checks*> checks;
    };
    static Running& running() {
        static Running checks;
        return checks;
    }

    /// Returns false if the system refuses the thread. The next file tries it again.
    [[nodiscard]] bool start() try {
        (void)Sha256().finish();  // OpenSSL is started first, so it ends last
        {
            const std::lock_guard lock(running().mutex);
            running().checks.insert(this);
        }
        thread_ = startThread("usdlive hashes", [this] { work(); });
        return true;
    } catch (const ThreadRefused&) {
        return false;
    }

    void stop() {
        {
            const std::lock_guard lock(mutex_);
            isStopped_ = true;
        }
        changed_.notify_one();
        if (thread_.joinable()) thread_.join();
    }

    void work() {
        constexpr int kLeast = 19;
        (void)::setpriority(PRIO_PROCESS, 0, kLeast);  // only this thread
        std::unique_lock lock(mutex_);
        for (;;) {
            changed_.wait(lock, [this] { return isStopped_ || !waiting_.empty(); });
            if (!isQuiet(lock)) return;
            const auto next = *waiting_.begin();
            waiting_.erase(next.first);
            lock.unlock();
            // If another process has locked the file, that one hashes it.
            check(next.first, next.second.first, next.second.second, LOCK_EX | LOCK_NB, [this] {
                std::unique_lock wait(mutex_);
                return isQuiet(wait);
            });
            lock.lock();
        }
    }

    /// Waits until no file is fetched. Returns false if the thread has to end.
    bool isQuiet(std::unique_lock<std::mutex>& lock) {
        while (!isStopped_ && steady_clock::now() < last_ + kQuiet)
            changed_.wait_until(lock, last_ + kQuiet);
        return !isStopped_;
    }

    void check(const fs::path& path, const std::string& hash, const std::string& origin,
               int howToLock, auto goesOn) {
        const Descriptor file = openFile(path);
        if (!file || ::flock(file.get(), howToLock) != 0 || !isAt(path, file)) return;
        const auto isRight = hasHash(file, hash, goesOn);
        if (!isRight) return;
        if (*isRight) mark(file, hash);
        const bool isNamed = *isRight && name(file, hash);
        const bool isSame = isAt(path, file);
        const bool isGone = isSame && (isNamed || !*isRight) && ::unlink(path.c_str()) == 0;
        {
            const std::lock_guard lock(mutex_);
            if (*isRight && isSame && !isGone)
                trusted_.insert(path);  // a disk that is read-only, or has no links
            else
                trusted_.erase(path);
        }
        std::error_code ignored;
        if (isGone) fs::remove(path.parent_path(), ignored);  // only if it is empty
        if (!*isRight && cache_.onWrongFile) cache_.onWrongFile(hash, origin);
    }

    /// Returns whether the path is still that of the open file.
    [[nodiscard]] static bool isAt(const fs::path& path, const Descriptor& file) {
        struct stat open{}, present{};
        return ::fstat(file.get(), &open) == 0 && ::stat(path.c_str(), &present) == 0 &&
               open.st_ino == present.st_ino && open.st_dev == present.st_dev;
    }

    /// Gives the open file its name, whatever has its path by now.
    [[nodiscard]] bool name(const Descriptor& file, const std::string& hash) const {
        static std::atomic<std::uint64_t> count = 0;
        const fs::path place = cache_.pathOf(hash);
        const fs::path linked =
            cache_.options_.folder / "new" /
            (hash + "-" + std::to_string(::getpid()) + "-" + std::to_string(++count));
        std::error_code error;
        fs::create_directories(place.parent_path(), error);
        const std::string open = "/proc/self/fd/" + std::to_string(file.get());
        if (::linkat(AT_FDCWD, open.c_str(), AT_FDCWD, linked.c_str(), AT_SYMLINK_FOLLOW) != 0)
            return false;
        const bool isNamed = ::rename(linked.c_str(), place.c_str()) == 0;
        ::unlink(linked.c_str());  // still there if both were links of the same file
        return isNamed;
    }

    const HashCache& cache_;
    std::thread thread_;        // started with the first file
    mutable std::mutex mutex_;  // guards the next members
    std::condition_variable changed_;
    std::map<fs::path, std::pair<std::string, std::string>> waiting_;  // hashes and origins
    std::set<fs::path> trusted_;
    steady_clock::time_point last_;  // when a file was fetched
    bool isStopped_ = false;
};

// ---- Memory

/// Files for which the folder has no room. A stage that reads a file late opens it again after it
/// has come, so it must be found until then.
class HashCache::Memory {
public:
    /// Keeps the content of `file`, which is hashed. The oldest files are dropped.
    void add(const std::string& hash, const Descriptor& file, std::uint64_t bytes) {
        if (bytes > kMostBytes || has(hash)) return;
        auto kept = std::make_shared<Kept>();
        if (bytes <= kCopiedBytes) {
            kept->content.resize(bytes);
            if (readPart(file, 0, kept->content) != bytes) return;
        } else {
            kept->file = Descriptor(::fcntl(file.get(), F_DUPFD_CLOEXEC, 0));
            if (!kept->file) return;
        }
        const std::lock_guard lock(mutex_);
        if (!files_.emplace(hash, std::move(kept)).second) return;
        order_.emplace_back(hash, bytes);
        for (bytes_ += bytes; bytes_ > kMostBytes; order_.pop_front()) {
            const auto& [oldest, size] = order_.front();
            std::erase_if(keys_, [&](const auto& key) { return key.second == oldest; });
            files_.erase(oldest);
            bytes_ -= size;
        }
    }
    /// Called in a frame, so it copies no more than kCopiedBytes.
    [[nodiscard]] OpenFile find(const std::string& hash) const {
        std::shared_ptr<const Kept> kept;
        {
            const std::lock_guard lock(mutex_);
            const auto found = files_.find(hash);
            if (found == files_.end()) return noFile();
            kept = found->second;
        }
        if (kept->file) {
            // Opened again, because each reader has a position of its own.
            const std::string path = "/proc/self/fd/" + std::to_string(kept->file.get());
            return opened(Descriptor(::open(path.c_str(), O_RDONLY | O_CLOEXEC)));
        }
        Descriptor file(::memfd_create("usdlive", MFD_CLOEXEC));
        if (!file || !writeAll(file.get(), kept->content.data(), kept->content.size()))
            return noFile();
        ::lseek(file.get(), 0, SEEK_SET);
        return opened(std::move(file));
    }
    [[nodiscard]] bool has(const std::string& hash) const {
        const std::lock_guard lock(mutex_);
        return files_.contains(hash);
    }
    void addKey(const std::string& key, const std::string& hash) {
        const std::lock_guard lock(mutex_);
        if (files_.contains(hash)) keys_.insert_or_assign(key, hash);
    }
    /// Returns the hash of a file that has this key, or an empty text.
    [[nodiscard]] std::string hashOf(const std::string& key) const {
        const std::lock_guard lock(mutex_);
        const auto found = keys_.find(key);
        return found != keys_.end() ? found->second : "";
    }

private:
    static constexpr std::uint64_t kMostBytes = 256 * kMib, kCopiedBytes = kMib;

    // One of both. An open file for each small one would use up the descriptors of the process.
    struct Kept {
        std::vector<std::uint8_t> content;
        Descriptor file;
    };

    mutable std::mutex mutex_;                                            // guards all members
    std::unordered_map<std::string, std::shared_ptr<const Kept>> files_;  // by hash
    std::deque<std::pair<std::string, std::uint64_t>> order_;  // hashes and sizes, the oldest first
    std::unordered_map<std::string, std::string> keys_;        // hashes by the hashes of keys
    std::uint64_t bytes_ = 0;
};

// ---- NewFile

/// A file that arrives. It is in memory if the cache folder takes no more. The destructor removes
/// what is not complete.
class HashCache::NewFile final : public BodySink {
public:
    NewFile(HashCache& cache, std::string origin)
        : cache_(cache), origin_(std::move(origin)), file_(cache.newFile(name_)) {
        isOnDisk_ = bool(file_);
        if (isOnDisk_)
            ::flock(file_.get(), LOCK_EX | LOCK_NB);  // other processes see that it is in use
        else
            cache_.report(std::string("cannot be written: ") + std::strerror(errno));
        if (!file_) file_ = Descriptor(::memfd_create("usdlive", MFD_CLOEXEC));
    }
    ~NewFile() override {
        if (isOnDisk_) ::unlink(name_.c_str());
    }

    std::span<char> space() override { return {part_.get(), kArrivingBytes}; }

    std::string add(std::size_t size) override {
        cache_.checks_->wait();
        size_ += size;
        if (size_ <= kHashedAtOnce) digest_.add(asBytes({part_.get(), size}));
        if (!writeAll(file_.get(), part_.get(), size))
            if (!isOnDisk_ || !moveToMemory(size_ - size) ||
                !writeAll(file_.get(), part_.get(), size))
                return std::string("the file cannot be kept: ") + std::strerror(errno);
        return {};
    }

    /// Gives the file its name if its hash is the one that the server named and the one that is
    /// wanted, which may be empty.
    Fetched<std::pair<OpenFile, std::string>> keep(const std::string& wanted,
                                                   const std::string& named) {
        const bool isHashed = size_ <= kHashedAtOnce || !isOnDisk_;
        if (!isHash(named) || (!wanted.empty() && wanted != named) ||
            (isHashed && !hasHashOf(named)))
            return failed("the file was changed while it was sent");
        ::lseek(file_.get(), 0, SEEK_SET);
        bool isKept = false;
        if (isOnDisk_) {
            std::error_code error;
            const fs::path path =
                isHashed ? cache_.pathOf(named) : cache_.uncheckedPathOf(origin_, named);
            fs::create_directories(path.parent_path(), error);
            if (isHashed) mark(file_, named);
            const auto rename = [&] { return ::rename(name_.c_str(), path.c_str()) == 0; };
            isKept = rename() || (fs::remove(path, error) && rename());  // an empty folder
            isOnDisk_ = !isKept;
            if (!isKept) cache_.report("cannot keep " + path.string());
            ::flock(file_.get(), LOCK_UN);
            if (!isHashed) cache_.checks_->add(path, named, origin_);
            cache_.added(size_);
        }
        if (!isKept && isHashed) cache_.memory_->add(named, file_, size_);
        OpenFile stream = opened(std::move(file_));
        if (!stream) return failed(std::strerror(errno));
        return std::pair<OpenFile, std::string>(std::move(stream), named);
    }

private:
    bool hasHashOf(const std::string& named) {
        return size_ <= kHashedAtOnce ? digest_.finish().hex() == named : hasHash(file_, named);
    }

    /// Continues in memory when the disk is full after `size` bytes.
    bool moveToMemory(std::uint64_t size) {
        cache_.report(std::string("takes no more: ") + std::strerror(errno));
        Descriptor memory(::memfd_create("usdlive", MFD_CLOEXEC));
        std::vector<std::uint8_t> part(kHashedPartBytes);
        for (std::uint64_t at = 0; at < size;) {
            const auto count = readPart(
                file_, at, std::span(part).first(std::min<std::uint64_t>(part.size(), size - at)));
            if (!count || *count == 0 || !writeAll(memory.get(), part.data(), *count)) return false;
            at += *count;
        }
        ::unlink(name_.c_str());
        isOnDisk_ = false;
        file_ = std::move(memory);
        return true;
    }

    HashCache& cache_;
    const std::string origin_;
    std::string name_;
    Descriptor file_;
    bool isOnDisk_ = false;  // and has no other name yet
    std::uint64_t size_ = 0;
    // Not filled with zeros: most files use little of it.
    const std::unique_ptr<char[]> part_ = std::make_unique_for_overwrite<char[]>(kArrivingBytes);
    Sha256 digest_;  // the first kHashedAtOnce bytes
};

// ---- Cache

HashCache::Stamp::Stamp(const struct stat& file)
    : device(file.st_dev),
      number(file.st_ino),
      size(std::uint64_t(file.st_size)),
      times{file.st_mtim.tv_sec, file.st_mtim.tv_nsec, file.st_ctim.tv_sec, file.st_ctim.tv_nsec} {}

HashCache::Options HashCache::optionsFromEnvironment() {
    const auto variable = [](const char* name) -> std::string {
        const char* value = std::getenv(name);
        return value ? value : "";
    };
    Options options;
    options.folder = variable("USDLIVE_CACHE");
    if (options.folder.empty()) {
        const std::string cache = variable("XDG_CACHE_HOME"), home = variable("HOME");
        const fs::path parent = !cache.empty()  ? fs::path(cache)
                                : !home.empty() ? fs::path(home) / ".cache"
                                                : fs::temp_directory_path();
        options.folder = parent / "usdlive";
    }
    const std::string mib = variable("USDLIVE_CACHE_MIB");
    const std::uint64_t count = std::strtoull(mib.c_str(), nullptr, 10);
    options.maxBytes = (count ? count : kDefaultMib) * kMib;
    return options;
}

// The size is checked when the first file is added.
HashCache::HashCache(Options options)
    : options_(std::move(options)),
      added_(options_.maxBytes),
      checks_(std::make_unique<Checks>(*this)),
      memory_(std::make_unique<Memory>()) {
    static_cast<void>(makeFolders());  // newFile() tries it again
}

std::error_code HashCache::makeFolders() const {
    std::error_code error;
    for (const char* part : {"files", "keys", "locks", "new", "unchecked"})
        if (!error) fs::create_directories(options_.folder / part, error);
    return error;
}

Descriptor HashCache::newFile(std::string& name) const {
    const auto create = [&] {
        name = (options_.folder / "new" / "XXXXXX").string();
        return Descriptor(::mkostemp(name.data(), O_CLOEXEC));
    };
    Descriptor file = create();
    if (file || (errno != ENOENT && errno != ENOTDIR)) return file;
    if (const std::error_code error = makeFolders()) {
        errno = error.value();
        return file;
    }
    return create();
}

HashCache::~HashCache() = default;

fs::path HashCache::pathOf(const std::string& hash) const {
    return options_.folder / "files" / hash.substr(0, 2) / hash;
}

fs::path HashCache::uncheckedPathOf(const std::string& origin, const std::string& hash) const {
    return options_.folder / "unchecked" / hashOf(origin).substr(0, kOriginDigits) / hash;
}

/// Opens a file of the cache, and notes that it is used. Removes a file with another content.
OpenFile HashCache::openAt(const fs::path& path, const std::string& hash) {
    Descriptor file = openFile(path);
    struct stat found{};
    if (!file || ::fstat(file.get(), &found) != 0) return noFile();
    const bool isRight = isKnown(path, found, hash);
    if (!isRight && !hasHash(file, hash)) {
        ::unlink(path.c_str());
        return noFile();
    }
    const bool isTrusted = checks_->isTrusted(path);  // and not hashed yet
    if (!isTrusted && (!isRight || found.st_mtim.tv_sec < std::time(nullptr) - kNotedSeconds)) {
        mark(file, hash);
        noteHashed(file, hash);
    }
    return opened(std::move(file));
}

/// Returns whether the file has its content without hashing it. A small file is hashed once in each
/// process: a damaged disk does not change the time of a file.
bool HashCache::isKnown(const fs::path& path, const struct stat& found,
                        const std::string& hash) const {
    if (checks_->isTrusted(path)) return isOfThisStart(found);
    {
        const std::lock_guard lock(mutex_);
        const auto noted = hashed_.find(hash);
        if (noted != hashed_.end() && noted->second == Stamp(found)) return true;
    }
    return std::uint64_t(found.st_size) > kHashedAtOnce && isOfThisStart(found) &&
           isMarked(found, hash);
}

void HashCache::noteHashed(const Descriptor& file, const std::string& hash) {
    struct stat found{};
    if (::fstat(file.get(), &found) != 0) return;
    const std::lock_guard lock(mutex_);
    hashed_.insert_or_assign(hash, Stamp(found));
}

OpenFile HashCache::find(const std::string& origin, const std::string& hash) {
    if (auto file = memory_->find(hash)) return file;
    if (auto file = openAt(pathOf(hash), hash)) return file;
    const fs::path path = uncheckedPathOf(origin, hash);
    if (checks_->isTrusted(path)) return openAt(path, hash);
    std::error_code ignored;
    if (!fs::exists(path, ignored)) return noFile();
    checks_->checkNow(path, hash, origin);
    if (auto file = openAt(pathOf(hash), hash)) return file;
    return checks_->isTrusted(path) ? openAt(path, hash) : noFile();
}

bool HashCache::isReady(const std::string& origin, const std::string& hash) const {
    const auto isReadyAt = [&](const fs::path& path) {
        struct stat found{};
        return ::stat(path.c_str(), &found) == 0 && S_ISREG(found.st_mode) &&
               (isKnown(path, found, hash) || (isOfThisStart(found) && isMarked(found, hash)));
    };
    if (memory_->has(hash)) return true;
    const fs::path unchecked = uncheckedPathOf(origin, hash);
    return isReadyAt(pathOf(hash)) || (checks_->isTrusted(unchecked) && isReadyAt(unchecked));
}

bool HashCache::isKeyedReady(const std::string& origin, const std::string& key) const {
    const std::string hash = readKey(hashOf(key));
    return !hash.empty() && isReady(origin, hash);
}

Fetched<OpenFile> HashCache::file(const std::string& origin, const std::string& hash,
                                  const Download& download) {
    if (auto found = find(origin, hash)) return found;
    // Files share a few thousand locks, so that no folder of locks grows.
    const Lock lock(options_.folder / "locks" / hash.substr(0, 3), kLockTime);
    if (auto found = find(origin, hash)) return found;
    auto fetched = fetch(origin, hash, download);
    if (!fetched) return tl::unexpected(fetched.error());
    return std::move(fetched->first);
}

OpenFile HashCache::findKeyed(const std::string& origin, const std::string& key) {
    return findNamed(origin, hashOf(key));
}

OpenFile HashCache::findNamed(const std::string& origin, const std::string& name) {
    const std::string hash = readKey(name);
    return hash.empty() ? noFile() : find(origin, hash);
}

Fetched<OpenFile> HashCache::keyedFile(const std::string& origin, const std::string& key,
                                       const Download& download) {
    const std::string name = hashOf(key);
    if (auto found = findNamed(origin, name)) return found;
    const Lock lock(options_.folder / "locks" / name.substr(0, 3), kLockTime);
    if (auto found = findNamed(origin, name)) return found;
    auto fetched = fetch(origin, "", download);
    if (!fetched) return tl::unexpected(fetched.error());
    if (!writeKey(name, fetched->second)) memory_->addKey(name, fetched->second);
    return std::move(fetched->first);
}

/// `hash` may be empty: it is then the one that the server names. Returns the hash with the file.
Fetched<std::pair<OpenFile, std::string>> HashCache::fetch(const std::string& origin,
                                                           const std::string& hash,
                                                           const Download& download) {
    NewFile file(*this, origin);
    const auto named = download(file);
    if (!named) return tl::unexpected(named.error());
    return file.keep(hash, *named);
}

fs::path HashCache::keyPathOf(const std::string& name) const {
    return options_.folder / "keys" / name.substr(0, 2) / name;
}

std::string HashCache::readKey(const std::string& key, std::string* note) const {
    if (std::string kept = memory_->hashOf(key); !kept.empty()) return kept;
    constexpr std::size_t kLineBytes = kHashDigits + 1 + kSealDigits + 1;
    std::array<std::uint8_t, kLineBytes + kMostNoteBytes> bytes;
    const Descriptor file = openFile(keyPathOf(key));
    const auto count = file ? readPart(file, 0, bytes) : std::nullopt;
    if (!count || *count < kLineBytes) return "";
    const std::string line(bytes.begin(), bytes.begin() + std::ptrdiff_t(*count));
    const std::string hash = line.substr(0, kHashDigits), found = line.substr(kLineBytes);
    if (!isHash(hash) || line != sealed(key, hash, found)) return "";
    if (note) *note = found;
    return hash;
}

bool HashCache::writeKey(const std::string& key, const std::string& hash, const std::string& note) {
    std::string name;
    const Descriptor file = newFile(name);
    if (!file) return false;
    ::flock(file.get(), LOCK_EX | LOCK_NB);
    std::error_code error;
    const fs::path path = keyPathOf(key);
    fs::create_directories(path.parent_path(), error);
    const std::string line = sealed(key, hash, note);
    if (writeAll(file.get(), line.data(), line.size()) &&
        ::rename(name.c_str(), path.c_str()) == 0) {
        added(line.size());
        return true;
    }
    ::unlink(name.c_str());
    return false;
}

std::optional<HashCache::Noted> HashCache::noted(const std::string& key) {
    Noted noted;
    const std::string hash = readKey(hashOf(key), &noted.note);
    const OpenFile file = hash.empty() ? noFile() : openAt(pathOf(hash), hash);
    struct stat found{};
    if (!file || ::fstat(::fileno(file.get()), &found) != 0) return std::nullopt;
    noted.content.resize(std::size_t(found.st_size));
    if (std::fread(noted.content.data(), 1, noted.content.size(), file.get()) !=
        noted.content.size())
        return std::nullopt;
    return noted;
}

void HashCache::note(const std::string& key, const Noted& noted) {
    if (noted.note.size() > kMostNoteBytes) return;
    const std::string hash = hashOf(noted.content);
    if (!openAt(pathOf(hash), hash) && !keepBytes(hash, noted.content)) return;
    (void)writeKey(hashOf(key), hash, noted.note);
}

/// Returns false if the folder takes no more.
bool HashCache::keepBytes(const std::string& hash, const std::string& content) {
    std::string name;
    const Descriptor file = newFile(name);
    if (!file) return false;
    ::flock(file.get(), LOCK_EX | LOCK_NB);
    std::error_code error;
    const fs::path path = pathOf(hash);
    fs::create_directories(path.parent_path(), error);
    if (writeAll(file.get(), content.data(), content.size())) {
        mark(file, hash);
        if (::rename(name.c_str(), path.c_str()) == 0) {
            added(content.size());
            return true;
        }
    }
    ::unlink(name.c_str());
    return false;
}

void HashCache::forget(const std::string& key) { ::unlink(keyPathOf(hashOf(key)).c_str()); }

void HashCache::report(const std::string& problem) {
    std::call_once(reported_, [&] {
        if (onProblem) onProblem("the cache " + options_.folder.string() + " " + problem);
    });
}

void HashCache::added(std::uint64_t bytes) {
    constexpr std::uint64_t kChecks = 16;  // until as much as the limit was added
    if ((added_ += bytes) < options_.maxBytes / kChecks) return;
    added_ = 0;
    removeOldFiles();
}

void HashCache::removeOldFiles() {
    const Lock lock(options_.folder / "locks" / "sweep", milliseconds(0));
    if (!lock.isHeld()) return;
    std::error_code error;
    // Files of processes that were killed: nobody has them locked.
    for (const auto& entry : fs::directory_iterator(options_.folder / "new", error)) {
        const Descriptor file(::open(entry.path().c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
        if (file && ::flock(file.get(), LOCK_EX | LOCK_NB) == 0) ::unlink(entry.path().c_str());
    }
    struct Kept {
        fs::path path;
        std::uint64_t bytes = 0;
        std::int64_t used = 0;
    };
    std::vector<Kept> all;
    std::uint64_t total = 0;
    for (const char* part : {"files", "keys", "unchecked"})
        for (fs::recursive_directory_iterator at(options_.folder / part, error), end;
             !error && at != end; at.increment(error)) {
            struct stat found{};
            if (::lstat(at->path().c_str(), &found) != 0 || !S_ISREG(found.st_mode)) continue;
            all.push_back({at->path(), std::uint64_t(found.st_blocks) * 512, found.st_mtim.tv_sec});
            total += all.back().bytes;
        }
    if (total <= options_.maxBytes) return;
    std::ranges::sort(all, {}, &Kept::used);
    for (const Kept& one : all) {
        if (total <= options_.maxBytes / 8 * 7) break;
        ::unlink(one.path.c_str());
        total -= std::min(total, one.bytes);
    }
}

}  // namespace usdlive::fetch
