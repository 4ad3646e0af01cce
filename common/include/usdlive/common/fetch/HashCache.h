// Files on the local disk, by the SHA-256 of their content, shared by all processes of
// a user.
#pragma once

#include <sys/stat.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <system_error>
#include <unordered_map>

#include "usdlive/common/fetch/BodySink.h"
#include "usdlive/common/fetch/Fetched.h"

namespace usdlive {
class Descriptor;
}

namespace usdlive::fetch {

/// An open file. It can be read to its end, whatever happens to the cache.
using OpenFile = std::unique_ptr<std::FILE, int (*)(std::FILE*)>;

/// The cache folder. Any thread, any number of processes. Nobody finds a file with a wrong content,
/// also if a process is killed:
/// - a file gets its name when it is complete and its hash is right;
/// - the process that has fetched a large file uses it before, but only for the origin that it came
///   from. A thread hashes it when nothing has been fetched for a moment. If the process ends
///   before, the next one hashes it before it uses it;
/// - no file is synced. A file that was used last before the machine was started is hashed again
///   before it is used;
/// - a file that something else has written, cut or replaced is hashed again, too: a file that was
///   hashed has a time that only this class gives. A small file is hashed once in each process. A
///   file with a wrong content is removed and fetched again.
/// If the folder cannot be written, or is full, this process keeps files in memory: the newest
/// ones, and those that are open. If it was removed, it is created again.
class HashCache {
public:
    struct Options {
        std::filesystem::path folder;
        /// When the files take more, the ones that were not used for the longest time are removed.
        std::uint64_t maxBytes = 0;
    };
    /// From the environment: USDLIVE_CACHE, else a folder in XDG_CACHE_HOME or ~/.cache;
    /// USDLIVE_CACHE_MIB.
    [[nodiscard]] static Options optionsFromEnvironment();

    explicit HashCache(Options options);
    ~HashCache();

    /// Writes the content into the sink. Returns the SHA-256 that the server names, or why there is
    /// none.
    using Download = std::function<Fetched<std::string>(BodySink& sink)>;

    /// Files up to this size are hashed before their first use.
    static constexpr std::uint64_t kHashedAtOnce = 256 * 1024;

    /// Returns the file with this content if it is here, or nothing. Does not wait while it is
    /// fetched. `origin` is a text that names the server.
    [[nodiscard]] OpenFile find(const std::string& origin, const std::string& hash);
    /// Returns whether find() finds it without hashing more than kHashedAtOnce.
    [[nodiscard]] bool isReady(const std::string& origin, const std::string& hash) const;
    /// Returns the file with this content, which `download` fetches if it is missing. Of several
    /// threads and processes that need the same file, one fetches it.
    [[nodiscard]] Fetched<OpenFile> file(const std::string& origin, const std::string& hash,
                                         const Download& download);
    /// Returns the file that was stored under `key`, any text that identifies a content. `download`
    /// fetches it if it is missing.
    [[nodiscard]] Fetched<OpenFile> keyedFile(const std::string& origin, const std::string& key,
                                              const Download& download);
    /// Returns the file that was stored under `key` if it is here, or nothing.
    [[nodiscard]] OpenFile findKeyed(const std::string& origin, const std::string& key);
    /// Returns whether findKeyed() finds it without hashing more than kHashedAtOnce.
    [[nodiscard]] bool isKeyedReady(const std::string& origin, const std::string& key) const;

    /// A content that belongs to a key until another one is stored, and what is noted about it.
    struct Noted {
        std::string content, note;
    };
    static constexpr std::size_t kMostNoteBytes = 4 * 1024;
    /// Returns what was stored last, if it is here.
    [[nodiscard]] std::optional<Noted> noted(const std::string& key);
    /// Stores it. Does nothing if the note is too long, or the folder takes no more.
    void note(const std::string& key, const Noted& noted);
    void forget(const std::string& key);

    /// Called by any thread when a large file from this origin was removed, because it has another
    /// content. It may have been used.
    std::function<void(const std::string& hash, const std::string& origin)> onWrongFile;
    /// Called once, when the cache cannot be written, with the reason.
    std::function<void(const std::string&)> onProblem;

private:
    class Checks;
    class Lock;
    class Memory;
    class NewFile;
    /// Identifies the content of a file in this process: whoever writes it changes its times.
    struct Stamp {
        explicit Stamp(const struct stat& file);
        std::uint64_t device, number, size;
        std::array<std::int64_t, 4> times;  ///< when content and file changed, in s and ns
        bool operator==(const Stamp&) const = default;
    };
    [[nodiscard]] OpenFile openAt(const std::filesystem::path& path, const std::string& hash);
    [[nodiscard]] bool isKnown(const std::filesystem::path& path, const struct stat& found,
                               const std::string& hash) const;
    void noteHashed(const Descriptor& file, const std::string& hash);
    [[nodiscard]] std::filesystem::path pathOf(const std::string& hash) const;
    [[nodiscard]] std::filesystem::path uncheckedPathOf(const std::string& origin,
                                                        const std::string& hash) const;
    [[nodiscard]] Fetched<std::pair<OpenFile, std::string>> fetch(const std::string& origin,
                                                                  const std::string& hash,
                                                                  const Download& download);
    // By the hash of a key.
    [[nodiscard]] OpenFile findNamed(const std::string& origin, const std::string& name);
    [[nodiscard]] std::string readKey(const std::string& name, std::string* note = nullptr) const;
    /// Returns false if the folder takes no more.
    [[nodiscard]] bool writeKey(const std::string& name, const std::string& hash,
                                const std::string& note = {});
    [[nodiscard]] std::filesystem::path keyPathOf(const std::string& name) const;
    [[nodiscard]] bool keepBytes(const std::string& hash, const std::string& content);
    void report(const std::string& problem);
    void added(std::uint64_t bytes);
    void removeOldFiles();
    [[nodiscard]] std::error_code makeFolders() const;
    /// Returns a new file in the folder `new`, whose path is written into `name`, or errno.
    [[nodiscard]] Descriptor newFile(std::string& name) const;

    const Options options_;
    std::once_flag reported_;
    std::atomic<std::uint64_t> added_;  // bytes that were added since the size was checked
    std::unique_ptr<Checks> checks_;
    const std::unique_ptr<Memory> memory_;
    mutable std::mutex mutex_;                       // guards the next member
    std::unordered_map<std::string, Stamp> hashed_;  // by hash: files that this process has hashed
};

}  // namespace usdlive::fetch
