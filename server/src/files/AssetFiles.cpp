// Lists, hashes and opens the files of a project.
#include "files/AssetFiles.h"

#include <fcntl.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <unordered_set>

#include "files/AssetWriter.h"
#include "files/FileStamps.h"
#include "files/FolderWalk.h"
#include "files/FolderWatch.h"
#include "usdlive/common/core/Descriptor.h"
#include "usdlive/common/core/FilePath.h"
#include "usdlive/common/core/Sha256.h"
#include "usdlive/common/core/Utf8.h"

namespace usdlive::server {

namespace fs = std::filesystem;

namespace {

using Reason = AssetRefusal::Reason;
using std::chrono::steady_clock;

constexpr int kReadAttempts = 3;
constexpr std::size_t kHashBufferBytes = 1024 * 1024;
// A file that was written so recently may be written again without any change of its times, which
// have the resolution of the system's clock. Its hash is not remembered.
constexpr std::int64_t kSettledNs = 2'000'000'000;
// The times of files are exact to a tick of the kernel's clock, which is 10 ms at most.
constexpr std::int64_t kTickNs = 20'000'000;

tl::unexpected<AssetRefusal> refuse(Reason reason, const std::string& path,
                                    const std::string& why) {
    return tl::unexpected(AssetRefusal{reason, inQuotes(path) + " " + why});
}

tl::unexpected<AssetRefusal> cannotRead(const std::string& path) {
    const bool isMissing =
        errno == ENOENT || errno == ENOTDIR || errno == ELOOP || errno == ENAMETOOLONG;
    if (isMissing) return refuse(Reason::NotFound, path, "does not exist in the project");
    return refuse(Reason::Unreadable, path, std::string("cannot be read: ") + std::strerror(errno));
}

/// Compares what changes when the file's bytes change. Other attributes of an open file change when
/// another file takes its name.
bool isUnchanged(const Descriptor& file, const FileTrace& trace) {
    struct stat now{};
    if (::fstat(file.get(), &now) != 0) return false;
    const FileTrace present = traceOf(now);
    return present.size == trace.size && present.modifiedNs == trace.modifiedNs;
}

class HashedFile final : public OpenedAsset {
public:
    HashedFile(Descriptor file, std::string path, FileTrace trace, Hash hash)
        : file_(std::move(file)), path_(std::move(path)), trace_(trace), hash_(hash) {}

    const Hash& hash() const override { return hash_; }
    const FileTrace& trace() const override { return trace_; }
    AssetResult<void> read(std::uint64_t offset, std::span<std::uint8_t> part) const override {
        const auto count = readPart(file_, offset, part);
        if (!count) return cannotRead(path_);
        if (*count == part.size() && isUnchanged(file_, trace_)) return {};
        return refuse(Reason::Changed, path_, "was changed while it was read");
    }

private:
    const Descriptor file_;
    const std::string path_;
    const FileTrace trace_;
    const Hash hash_;
};

/// Returns nothing if the file was written meanwhile, or cannot be read.
std::optional<Hash> hashOf(const Descriptor& file, const FileTrace& trace) {
    Sha256 sha;
    Bytes part(std::size_t(std::min<std::uint64_t>(trace.size, kHashBufferBytes)));
    for (std::uint64_t at = 0; at < trace.size;) {
        const auto count = readPart(file, at, part);
        if (!count || *count == 0) return std::nullopt;
        sha.add(ByteView(part.data(), *count));
        at += *count;
    }
    if (!isUnchanged(file, trace)) return std::nullopt;
    return sha.finish();
}

/// Returns the real path of an open file.
fs::path pathOf(const Descriptor& file) {
    std::error_code problem;
    const fs::path path = fs::read_symlink("/proc/self/fd/" + std::to_string(file.get()), problem);
    return problem ? fs::path() : path;
}

}  // namespace

std::optional<Hash> AssetFiles::knownHash(const fs::path& real, const FileTrace& trace) const {
    const std::lock_guard lock(mutex_);
    const auto found = known_.find(real.native());
    if (found == known_.end() || found->second.trace != trace) return std::nullopt;
    return found->second.hash;
}

void AssetFiles::remember(const fs::path& real, const FileTrace& trace, const Hash& hash) {
    const auto now = std::chrono::duration_cast<std::chrono::nanoseconds>(
        std::chrono::system_clock::now().time_since_epoch());
    if (std::max(trace.modifiedNs, trace.changedNs) > now.count() - kSettledNs) return;
    const std::lock_guard lock(mutex_);
    known_.insert_or_assign(real.native(), Known{trace, hash});
}

AssetFiles::AssetFiles(fs::path folder)
    : folder_(std::move(folder)), watch_(std::make_unique<FolderWatch>()) {}
AssetFiles::~AssetFiles() = default;

Result<AssetList> AssetFiles::list(Deadline hashUntil, std::uint64_t mostBytes) {
    const std::unique_lock lock(listMutex_, std::try_to_lock);
    // Another thread makes a list, and may hash files for seconds.
    if (!lock) return walk(hashUntil, mostBytes, [](const fs::path&) {});
    if (last_ && steady_clock::now() < lastUntil_ && watch_->isUnchanged()) return last_;
    last_ = nullptr;
    watch_->begin();
    lastUntil_ = steady_clock::now() + kMostReused;
    auto made = walk(hashUntil, mostBytes, [this](const fs::path& folder) { watch_->add(folder); });
    const auto hasHash = [](const AssetFile& file) { return file.hash.has_value(); };
    if (made && std::ranges::all_of(**made, hasHash)) last_ = *made;
    return made;
}

Result<AssetList> AssetFiles::walk(
    Deadline hashUntil, std::uint64_t mostBytes,
    const std::function<void(const std::filesystem::path& folder)>& entered) {
    std::vector<AssetFile> files;
    std::unordered_set<std::string> seen;
    const FolderVisitor visitor{[&](const std::string& name, const fs::path& real) {
                                    struct stat found{};
                                    if (!isUtf8(name) || ::lstat(real.c_str(), &found) != 0) return;
                                    AssetFile file{name, traceOf(found)};
                                    file.hash = knownHash(real, file.trace);
                                    const bool isSmall = file.trace.size <= mostBytes;
                                    if (!file.hash && isSmall && steady_clock::now() < hashUntil)
                                        if (const auto opened = openReal(name, real)) {
                                            file.trace = (*opened)->trace();
                                            file.hash = (*opened)->hash();
                                        }
                                    seen.insert(real.native());
                                    files.push_back(std::move(file));
                                },
                                [](const std::string&, const std::string&) {}, entered};
    if (auto walked = walkFolder(folder_, visitor); !walked) return tl::unexpected(walked.error());
    {
        const std::lock_guard lock(mutex_);
        std::erase_if(known_, [&](const auto& one) { return !seen.contains(one.first); });
    }
    std::ranges::sort(files, {}, &AssetFile::path);
    return std::make_shared<const std::vector<AssetFile>>(std::move(files));
}

AssetResult<std::shared_ptr<const OpenedAsset>> AssetFiles::open(const std::string& path) {
    // Each link has to stay inside, also one that a later part of the path leads back from.
    fs::path real = folder_;
    for (const fs::path& part : fs::path(path)) {
        real /= part;
        std::error_code problem;
        if (fs::symlink_status(real, problem).type() == fs::file_type::symlink)
            real = fs::canonical(real, problem);
        if (problem) {
            errno = problem.value();
            return cannotRead(path);
        }
        if (const auto why = whyOutside(folder_, real.lexically_normal()); !why.empty())
            return refuse(Reason::Outside, path, "is reached over a link that leads " + why);
    }
    return openReal(path, real);
}

AssetResult<std::shared_ptr<const OpenedAsset>> AssetFiles::openReal(const std::string& path,
                                                                     const fs::path& real) {
    const auto outside = [&](const std::string& why) {
        return refuse(Reason::Outside, path, "is reached over a link that leads " + why);
    };
    if (const auto why = whyOutside(folder_, real); !why.empty()) return outside(why);
    for (int left = kReadAttempts; left > 0; --left) {
        Descriptor file(::open(real.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
        if (!file) return cannotRead(path);
        // A link may have been put in the place of a folder meanwhile.
        const fs::path opened = pathOf(file);
        if (const auto why = whyOutside(folder_, opened); !why.empty() && opened != real)
            return outside(why);
        struct stat found{};
        if (::fstat(file.get(), &found) != 0) return cannotRead(path);
        if (!S_ISREG(found.st_mode)) return refuse(Reason::NotFound, path, "is not a file");
        const FileTrace trace = traceOf(found);
        auto hash = knownHash(real, trace);
        if (!hash) {
            hash = hashOf(file, trace);
            if (!hash) continue;
            remember(real, trace, *hash);
        }
        return std::make_shared<const HashedFile>(std::move(file), path, trace, *hash);
    }
    return refuse(Reason::Changed, path, "is being written at this moment");
}

Result<bool> AssetFiles::store(const NewFile& file, const BlobStore& blobs,
                               const std::function<void()>& ready) {
    auto stored = tryToStore(file, blobs, ready);
    // Another program may have created the same file meanwhile.
    if (!stored && stored.error().code == ErrorCode::FileExists)
        stored = tryToStore(file, blobs, ready);
    if (stored) return stored;
    const Error& error = stored.error();
    if (error.code == ErrorCode::InvalidFileName) return stored;
    if (error.code == ErrorCode::FileExists)
        return fail(ErrorCode::FileExists,
                    "the project has another file " + inQuotes(file.path) +
                        ": choose another name, or ask to overwrite it (overwrite)");
    return fail(error.code, inQuotes(file.path) + " could not be written: " + error.message);
}

Result<bool> AssetFiles::tryToStore(const NewFile& file, const BlobStore& blobs,
                                    const std::function<void()>& ready) {
    if (auto valid = checkFilePath(file.path); !valid) return tl::unexpected(valid.error());
    const auto place = placeOfAsset(folder_, file.path);
    if (!place) return tl::unexpected(place.error());
    const fs::path real = folder_ / place->folder / place->name;
    if (place->present) {
        const auto present = openReal(file.path, real);
        if (present && (*present)->hash() == file.hash) return true;
        if (!file.overwrite) return fail(ErrorCode::FileExists, "there is another file");
    }
    const bool isEmpty = file.size == 0 && file.hash == sha256(ByteView());
    if (!isEmpty && !blobs.has(file.hash)) return false;
    if (!isEmpty) {
        const auto size = blobs.size(file.hash);
        if (!size) return false;  // dropped meanwhile
        if (*size != file.size)
            return fail(ErrorCode::BlobMismatch, "its content has " + std::to_string(*size) +
                                                     " bytes, and not " +
                                                     std::to_string(file.size));
    }
    const AssetContents contents{file.size, [&](std::uint64_t offset, std::size_t count) {
                                     return blobs.read(file.hash, offset, count);
                                 }};
    const auto written =
        writeAsset(folder_, *place, contents, file.overwrite, [&]() -> Result<void> {
            if (ready) ready();
            return {};
        });
    if (!written && written.error().code == ErrorCode::BlobNotFound) return false;
    if (!written) return tl::unexpected(written.error());
    // The file got its name well after the last byte was written: a later change shows in its
    // times.
    if (written->changedNs - written->modifiedNs > kTickNs) {
        const std::lock_guard lock(mutex_);
        known_.insert_or_assign(real.native(), Known{*written, file.hash});
    }
    return true;
}

}  // namespace usdlive::server
