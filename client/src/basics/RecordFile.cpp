// Reads and appends checked records of a file.
#include "basics/RecordFile.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/core/Hash.h"

namespace usdlive::client {

namespace {

constexpr std::size_t kCheckBytes = 8;
constexpr std::size_t kHeaderBytes = sizeof(std::uint32_t) + kCheckBytes;

void appendRecord(Bytes& out, ByteView payload) {
    appendNumber<std::uint32_t>(out, std::uint32_t(payload.size()));
    appendBytes(out, ByteView(sha256(payload).bytes).first(kCheckBytes));
    appendBytes(out, payload);
}

bool readFully(const Descriptor& file, Bytes& bytes, std::uint64_t at) {
    return readPart(file, at, bytes) == bytes.size();
}

}  // namespace

RecordFile::RecordFile(RecordFile&& other) noexcept { *this = std::move(other); }

RecordFile& RecordFile::operator=(RecordFile&& other) noexcept {
    std::swap(path_, other.path_);
    std::swap(file_, other.file_);
    std::swap(size_, other.size_);
    return *this;
}

Error RecordFile::failed(const char* what) const {
    return {ErrorCode::StorageFailed,
            "cannot " + std::string(what) + " " + path_.string() + ": " + std::strerror(errno)};
}

Result<RecordFile> RecordFile::open(const std::filesystem::path& path, Mode mode) {
    RecordFile opened;
    opened.path_ = path;
    const int flags = O_RDWR | O_CLOEXEC | (mode == Mode::New ? O_CREAT | O_EXCL : 0);
    opened.file_ = Descriptor(::open(path.c_str(), flags, 0600));
    if (!opened.file_) return tl::unexpected(opened.failed("open"));
    std::error_code ignored;
    if (!std::filesystem::is_regular_file(path, ignored))
        return fail(ErrorCode::StorageFailed, path.string() + " is not a regular file");
    if (::flock(opened.file_.get(), LOCK_EX | LOCK_NB) != 0)
        return fail(ErrorCode::StorageLocked, path.string() + " is in use");
    struct stat status{};
    // The owner may have removed the file between the two calls.
    if (::fstat(opened.file_.get(), &status) != 0 || status.st_nlink == 0)
        return fail(ErrorCode::StorageLocked, path.string() + " was removed");
    opened.size_ = std::uint64_t(status.st_size);
    return opened;
}

Result<Bytes> RecordFile::read(std::uint64_t at) const {
    Bytes header(kHeaderBytes);
    const auto record = [this, at](ErrorCode code, const char* state) {
        return fail(code,
                    path_.string() + ": the record at byte " + std::to_string(at) + " is " + state);
    };
    const auto torn = [&record] { return record(ErrorCode::StorageFailed, "not complete"); };
    if (at + kHeaderBytes > size_ || !readFully(file_, header, at)) return torn();
    const std::uint32_t size = ByteReader(header).u32();
    if (size > size_ - at - kHeaderBytes) return torn();
    Bytes payload(size);
    if (!readFully(file_, payload, at + kHeaderBytes)) return torn();
    const Hash hash = sha256(ByteView(payload));
    if (!std::equal(hash.bytes.begin(), hash.bytes.begin() + kCheckBytes,
                    header.begin() + sizeof(std::uint32_t)))
        return record(ErrorCode::StorageCorrupt, "damaged");
    return payload;
}

Result<void> RecordFile::readAll(
    const std::function<void(std::uint64_t at, ByteView payload)>& each) {
    std::uint64_t at = 0;
    while (at < size_) {
        const auto payload = read(at);
        if (!payload && payload.error().code == ErrorCode::StorageCorrupt)
            return tl::unexpected(payload.error());
        if (!payload) break;
        each(at, *payload);
        at += kHeaderBytes + payload->size();
    }
    return at < size_ ? truncate(at) : Result<void>();
}

Result<std::vector<std::uint64_t>> RecordFile::append(const std::vector<Bytes>& payloads) {
    Bytes all;
    std::vector<std::uint64_t> places;
    for (const Bytes& payload : payloads) {
        places.push_back(size_ + all.size());
        appendRecord(all, payload);
    }
    std::size_t written = 0;
    while (written < all.size()) {
        const ssize_t put = ::pwrite(file_.get(), all.data() + written, all.size() - written,
                                     off_t(size_ + written));
        if (put < 0 && errno == EINTR) continue;
        if (put <= 0) {
            const Error error = failed("write");
            static_cast<void>(::ftruncate(file_.get(), off_t(size_)));
            return tl::unexpected(error);
        }
        written += std::size_t(put);
    }
    size_ += all.size();
    return places;
}

Result<void> RecordFile::sync() {
    if (::fdatasync(file_.get()) != 0) return tl::unexpected(failed("sync"));
    return {};
}

Result<void> RecordFile::truncate(std::uint64_t size) {
    if (::ftruncate(file_.get(), off_t(size)) != 0) return tl::unexpected(failed("shorten"));
    size_ = size;
    return {};
}

Result<void> RecordFile::moveTo(const std::filesystem::path& path) {
    if (::rename(path_.c_str(), path.c_str()) != 0) return tl::unexpected(failed("rename"));
    path_ = path;
    return {};
}

void RecordFile::remove() {
    if (!file_) return;
    ::unlink(path_.c_str());
    file_ = Descriptor();
    size_ = 0;
}

}  // namespace usdlive::client
