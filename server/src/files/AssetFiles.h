// The files of a project that an asset path may name, by path and by the hash of their content.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "project/CommitStore.h"

namespace usdlive::server {

class FolderWatch;

struct AssetFile {
    std::string path;  ///< relative to the project
    FileTrace trace;
    std::optional<Hash> hash = {};  ///< SHA-256 of the bytes; nothing: not known yet
    bool operator==(const AssetFile&) const = default;
};

/// The files of a project, sorted by path. Another list is another object.
using AssetList = std::shared_ptr<const std::vector<AssetFile>>;

/// Why a file cannot be read.
struct AssetRefusal {
    enum class Reason {
        NotFound,
        Outside,  ///< it is reached over a link that leads out of the project or to a hidden file
        Changed,  ///< it was written while it was read
        Unreadable
    };
    Reason reason = Reason::NotFound;
    std::string message;
};
template <class T>
using AssetResult = tl::expected<T, AssetRefusal>;

/// A file with the content that it had when it was opened. Any thread.
class OpenedAsset {
public:
    virtual ~OpenedAsset() = default;
    [[nodiscard]] virtual const Hash& hash() const = 0;
    [[nodiscard]] virtual const FileTrace& trace() const = 0;
    /// Fills `part` from `offset` on. Changed: the file was written since it was opened. (A file
    /// that was replaced by another one can still be read.)
    [[nodiscard]] virtual AssetResult<void> read(std::uint64_t offset,
                                                 std::span<std::uint8_t> part) const = 0;
};

/// The files in a project's folder and below, except hidden ones, also over links inside it (FI5).
/// Any thread. Remembers the hash of each file as long as the file looks the same.
class AssetFiles {
public:
    using Deadline = std::chrono::steady_clock::time_point;

    /// `folder` is absolute and without links.
    explicit AssetFiles(std::filesystem::path folder);
    ~AssetFiles();

    /// Returns all files. Reads those with an unknown hash until `hashUntil`, except files of more
    /// than `mostBytes`. Returns the last list if the system reports that nothing has changed
    /// since, for at most kMostReused. Error: LayerUnreadable if the folder cannot be listed.
    [[nodiscard]] Result<AssetList> list(Deadline hashUntil,
                                         std::uint64_t mostBytes = ~std::uint64_t(0));
    /// A change that the system does not report is seen after this time.
    static constexpr std::chrono::seconds kMostReused{10};
    [[nodiscard]] AssetResult<std::shared_ptr<const OpenedAsset>> open(const std::string& path);

    /// A file to be written.
    struct NewFile {
        std::string path;  ///< a valid name (FI7)
        Hash hash;         ///< names its content in a BlobStore
        std::uint64_t size = 0;
        bool overwrite = false;  ///< replaces a file with another content
    };
    /// Writes a file, which `list` shows at once, whole or not at all. Returns true if the project
    /// has the file with this content, also if it had it before; false if `blobs` does not have the
    /// content. `ready` is called directly before the file gets its name. Errors: InvalidFileName,
    /// FileExists, StorageFull, SaveFailed. The message names the file and the reason.
    [[nodiscard]] Result<bool> store(const NewFile& file, const BlobStore& blobs,
                                     const std::function<void()>& ready = {});

private:
    struct Known {
        FileTrace trace;
        Hash hash;
    };
    [[nodiscard]] std::optional<Hash> knownHash(const std::filesystem::path& real,
                                                const FileTrace& trace) const;
    void remember(const std::filesystem::path& real, const FileTrace& trace, const Hash& hash);
    [[nodiscard]] Result<bool> tryToStore(const NewFile& file, const BlobStore& blobs,
                                          const std::function<void()>& ready);
    [[nodiscard]] AssetResult<std::shared_ptr<const OpenedAsset>> openReal(
        const std::string& path, const std::filesystem::path& real);

    /// Calls `entered` for each folder before its entries are read.
    [[nodiscard]] Result<AssetList> walk(
        Deadline hashUntil, std::uint64_t mostBytes,
        const std::function<void(const std::filesystem::path& folder)>& entered);

    const std::filesystem::path folder_;
    std::mutex listMutex_;                          // held while files are listed; guards the next
    const std::unique_ptr<FolderWatch> watch_;      // since the last list
    AssetList last_;                                // nullptr: cannot be used again
    Deadline lastUntil_;                            // when it becomes too old
    mutable std::mutex mutex_;                      // guards the next member
    std::unordered_map<std::string, Known> known_;  // by real path
};

}  // namespace usdlive::server
