// Uploads files of this machine that become files of the project (FI7).
#include "values/FileUploads.h"

#include <fcntl.h>
#include <sys/stat.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <mutex>
#include <utility>

#include "basics/Clocks.h"
#include "usdlive/common/core/Descriptor.h"
#include "usdlive/common/core/FilePath.h"
#include "usdlive/common/core/Sha256.h"
#include "usdlive/common/core/Thread.h"
#include "usdlive/common/core/Utf8.h"

namespace usdlive::client {

namespace fs = std::filesystem;

namespace {

constexpr std::size_t kHashedAtOnce = 1024 * 1024;
// The parts that wait in memory. More are prepared when half of them are sent.
constexpr std::size_t kPartsAhead = 16;
// The server may drop a value before the upload names it.
constexpr int kMostTransfers = 3;
constexpr std::int64_t kUploadReportMs = 500;
// A call that waits fails if the server says nothing for this time, and its disk is slower than
// this.
constexpr double kSilentUploadMs = 60'000;
constexpr double kSlowDiskBytesPerMs = 5'000;
constexpr std::size_t kMostInterrupted = 1'000;

Error cannotUpload(const fs::path& from, ErrorCode code, const std::string& why) {
    return {code, inQuotes(from.native()) + " cannot be uploaded: " + why};
}

}  // namespace

/// A file of this machine: the worker hashes it, and then reads it again in parts.
class FileUploads::Source {
public:
    struct Content {
        Hash hash;
        std::uint64_t size = 0;
    };
    /// `mostBytes` is the limit of the server.
    Source(fs::path from, std::uint64_t mostBytes)
        : from_(std::move(from)), mostBytes_(mostBytes) {}
    Source(const Source&) = delete;
    Source& operator=(const Source&) = delete;

    // The worker.
    void hash() {
        auto content = readAll();
        const std::lock_guard lock(mutex_);
        content_ = std::move(content);
    }
    void prepare(const Content& content) {
        for (;;) {
            {
                const std::lock_guard lock(mutex_);
                if (isStopped || failure_ || at_ >= content.size || parts_.size() >= kPartsAhead) {
                    isPreparing_ = false;
                    return;
                }
            }
            auto part = readPart(content);
            const std::lock_guard lock(mutex_);
            if (part)
                parts_.push_back(std::move(*part));
            else
                failure_ = part.error();
        }
    }

    // The thread of the uploads.
    [[nodiscard]] std::optional<Result<Content>> content() const {
        const std::lock_guard lock(mutex_);
        return content_;
    }
    struct Part {
        SharedBytes frame;
        std::size_t bytes = 0;
    };
    [[nodiscard]] std::optional<Result<Part>> take() {
        const std::lock_guard lock(mutex_);
        if (failure_) return tl::unexpected(*failure_);
        if (parts_.empty()) return std::nullopt;
        Part part = std::move(parts_.front());
        parts_.pop_front();
        return part;
    }
    /// Returns whether the worker has to prepare more parts, once. They have at most `partBytes`.
    [[nodiscard]] bool needsMore(const Content& content, std::size_t partBytes) {
        const std::lock_guard lock(mutex_);
        partBytes_ = partBytes;
        if (isPreparing_ || at_ >= content.size || parts_.size() > kPartsAhead / 2) return false;
        return isPreparing_ = true;
    }
    /// Continues at `offset`. Precondition: no part is prepared, and none is being prepared.
    void seek(std::uint64_t offset) {
        const std::lock_guard lock(mutex_);
        at_ = offset;
    }

    std::atomic<bool> isStopped = false;
    std::atomic<std::uint64_t> hashed = 0;  ///< bytes

private:
    [[nodiscard]] tl::unexpected<Error> refuse(ErrorCode code, const std::string& why) const {
        return tl::unexpected(cannotUpload(from_, code, why));
    }
    [[nodiscard]] tl::unexpected<Error> unreadable() const {
        return refuse(ErrorCode::InvalidArgument, std::strerror(errno));
    }

    Result<Content> readAll() {
        file_ = Descriptor(::open(from_.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
        if (!file_) return unreadable();
        struct stat found{};
        if (::fstat(file_.get(), &found) != 0) return unreadable();
        if (S_ISDIR(found.st_mode))
            return refuse(ErrorCode::InvalidArgument,
                          "it is a folder. Upload its files one by one");
        if (!S_ISREG(found.st_mode))
            return refuse(ErrorCode::InvalidArgument, "it is no regular file");
        size_ = std::uint64_t(found.st_size);
        if (size_ > mostBytes_)
            return refuse(ErrorCode::BlobTooLarge,
                          "it has " + std::to_string(size_) + " bytes, and the server takes " +
                              std::to_string(mostBytes_) +
                              ". Serve with a larger --max-blob-mib, or put it into the folder "
                              "that the server serves");
        modified_ = found.st_mtim;
        Sha256 sha;
        Bytes part(std::size_t(std::min<std::uint64_t>(size_, kHashedAtOnce)));
        for (std::uint64_t at = 0; at < size_ && !isStopped;) {
            const auto count = fill(at, part);
            if (!count) return tl::unexpected(count.error());
            sha.add(ByteView(part.data(), *count));
            at += *count;
            hashed = at;
        }
        if (auto same = checkSame(); !same) return tl::unexpected(same.error());
        return Content{sha.finish(), size_};
    }

    Result<Part> readPart(const Content& content) {
        Bytes bytes(std::size_t(std::min<std::uint64_t>(content.size - at_, partBytes_)));
        const auto count = fill(at_, bytes);
        if (!count) return tl::unexpected(count.error());
        if (*count < bytes.size()) return changed();
        if (auto same = checkSame(); !same) return tl::unexpected(same.error());
        const BlobFrame frame{content.hash, content.size, at_, std::uint32_t(bytes.size()),
                              deflate(bytes)};
        Part part{std::make_shared<const Bytes>(encodeFrame(frame)), bytes.size()};
        const std::lock_guard lock(mutex_);
        at_ += bytes.size();
        return part;
    }

    /// Reads as many bytes as the file has.
    Result<std::size_t> fill(std::uint64_t offset, Bytes& part) {
        const auto count = usdlive::readPart(file_, offset, part);
        if (!count) return unreadable();
        if (*count == 0) return changed();
        return *count;
    }
    Result<void> checkSame() {
        struct stat now{};
        if (::fstat(file_.get(), &now) != 0) return unreadable();
        if (std::uint64_t(now.st_size) == size_ && now.st_mtim.tv_sec == modified_.tv_sec &&
            now.st_mtim.tv_nsec == modified_.tv_nsec)
            return {};
        return changed();
    }
    [[nodiscard]] tl::unexpected<Error> changed() const {
        return refuse(ErrorCode::InvalidArgument,
                      "it was changed while it was read. Upload it when it is complete");
    }

    // Used by the worker only.
    const fs::path from_;
    const std::uint64_t mostBytes_;
    Descriptor file_;
    std::uint64_t size_ = 0;
    timespec modified_{};

    mutable std::mutex mutex_;  // guards the next members
    std::optional<Result<Content>> content_;
    std::deque<Part> parts_;
    std::optional<Error> failure_;
    std::uint64_t at_ = 0;  // begins the next part
    std::atomic<std::size_t> partBytes_ = kChunkBytes;
    bool isPreparing_ = false;
};

FileUploads::FileUploads(Session& session, SessionHost& host) : session_(session), host_(host) {}

FileUploads::~FileUploads() {
    if (source_) source_->isStopped = true;
}

std::uint64_t FileUploads::add(fs::path from, std::string path, bool overwrite) {
    uploads_.push_back({++last_, std::move(from), std::move(path), overwrite});
    return last_;
}

// Ends an upload without an outcome.
void FileUploads::drop(std::uint64_t number) {
    if (source_ && uploads_.front().number == number) leave();
    std::erase_if(uploads_, [&](const Upload& upload) { return upload.number == number; });
}

std::vector<FileUploads::Ended> FileUploads::takeEnded() { return std::exchange(ended_, {}); }

// A counter that grows with the progress of uploads.
std::uint64_t FileUploads::steps() const {
    return steps_ + (source_ ? source_->hashed.load() / kHashedAtOnce : 0);
}

Result<void> FileUploads::finish(std::uint64_t number, const std::string& path,
                                 const std::function<bool()>& step) {
    auto& outcome = awaited_[number];
    Stopwatch silent;
    for (auto seen = steps(); !outcome;) {
        if (step() || std::exchange(seen, steps()) != steps()) silent = Stopwatch();
        const double most = kSilentUploadMs + double(beingWritten()) / kSlowDiskBytesPerMs;
        if (outcome || silent.ms() <= most) continue;
        drop(number);
        outcome =
            fail(ErrorCode::NotConnected, "the server did not report in time whether " + path +
                                              " was written; upload it again to find out");
    }
    return *awaited_.extract(number).mapped();
}

std::optional<Event> FileUploads::report(Ended ended) {
    if (const auto awaited = awaited_.find(ended.number); awaited != awaited_.end()) {
        awaited->second = std::move(ended.outcome);
        return std::nullopt;
    }
    if (ended.outcome) return event::Uploaded{ended.number, std::move(ended.path)};
    return event::UploadFailed{ended.number, std::move(ended.path),
                               std::move(ended.outcome.error())};
}

// The size of the file that the server is writing at this moment; 0: none.
std::uint64_t FileUploads::beingWritten() const {
    if (!source_ || stage_ == Stage::Hash) return 0;
    return (*source_->content())->size;
}

std::optional<event::Progress> FileUploads::progress(std::int64_t nowMs) {
    if (!source_) {
        reportedMs_.reset();
        return std::nullopt;
    }
    if (!reportedMs_) reportedMs_ = nowMs;
    if (nowMs - *reportedMs_ < kUploadReportMs) return std::nullopt;
    reportedMs_ = nowMs;
    const auto content = source_->content();
    const std::uint64_t total = content && *content ? (*content)->size : 0;
    return event::Progress{
        event::Progress::Task::Upload, {}, sent_, total, uploads_.front().number};
}

// ---- the way of an upload

void FileUploads::advance() {
    while (!uploads_.empty()) {
        if (!source_) begin();
        if (source_ && !advanceStage()) return;
    }
}

void FileUploads::begin() {
    const Upload& upload = uploads_.front();
    if (auto valid = checkFilePath(upload.path); !valid) return end(valid);
    if (!session_.isConnected())
        return end(tl::unexpected(
            cannotUpload(upload.from, ErrorCode::NotConnected,
                         "there is no connection to the server. Try again when it is connected")));
    try {
        if (!reader_) reader_ = std::make_unique<Worker>();
    } catch (const ThreadRefused& refused) {
        return end(tl::unexpected(
            cannotUpload(upload.from, ErrorCode::InvalidConfiguration, refused.what())));
    }
    stage_ = Stage::Hash;
    transfers_ = 0;
    sent_ = 0;
    source_ = std::make_shared<Source>(upload.from, session_.welcome()->maxBlobBytes);
    reader_->post([source = source_] { source->hash(); });
}

/// Returns false if the present upload has to wait.
bool FileUploads::advanceStage() {
    if (stage_ == Stage::Parts) return sendParts();
    if (stage_ != Stage::Hash) return false;
    const auto content = source_->content();
    if (!content) return false;
    if (!*content) {
        end(tl::unexpected(content->error()));
        return true;
    }
    ask();
    return false;
}

void FileUploads::ask() {
    const Upload& upload = uploads_.front();
    const auto content = **source_->content();
    ++steps_;
    stage_ = Stage::Answer;
    request_ = session_.request(
        UploadFile{.path = upload.path,
                   .hash = content.hash,
                   .size = content.size,
                   .overwrite = upload.overwrite ? std::optional(true) : std::nullopt});
}

void FileUploads::answered(bool complete) {
    ++steps_;
    if (complete) return end({});
    if (++transfers_ > kMostTransfers)
        return end(tl::unexpected(cannotUpload(
            uploads_.front().from, ErrorCode::BlobNotFound,
            "the server dropped the content before it could write the file. Serve with a larger "
            "--keep-unused-blobs")));
    stage_ = Stage::Parts;
    const Hash hash = (*source_->content())->hash;
    const auto interrupted = interrupted_.extract(hash);
    isContinued_ = !interrupted.empty();
    sent_ = isContinued_ ? interrupted.mapped() : 0;
    source_->seek(sent_);
    transferred_.insert(hash);
}

bool FileUploads::sendParts() {
    const auto content = **source_->content();
    for (std::size_t most; sent_ < content.size && (most = host_.bulkBytes()) > 0;) {
        if (source_->needsMore(content, most))
            reader_->post([source = source_, content] { source->prepare(content); });
        const auto part = source_->take();
        if (!part) return false;
        if (!*part) {
            end(tl::unexpected(part->error()));
            return true;
        }
        parts_.add(content.hash, sent_, (*part)->frame->size());
        host_.send((*part)->frame);
        sent_ += (*part)->bytes;
        ++steps_;
    }
    if (sent_ == content.size) stage_ = Stage::Stored;
    return false;
}

void FileUploads::blobStored(const Hash& hash) {
    // If the server has it already, it answers the first part, too.
    if (source_ && stage_ == Stage::Stored && (*source_->content())->hash == hash) ask();
}

bool FileUploads::note(const Event& event) {
    if (std::holds_alternative<event::Disconnected>(event)) {
        interrupt();
        endAll({ErrorCode::NotConnected, "the connection to the server was lost"});
        transferred_.clear();
        return false;
    }
    if (const auto* answer = std::get_if<event::Answered<UploadFile>>(&event)) {
        if (request_ == 0 || answer->answer.request != request_) return false;
        request_ = 0;
        answered(answer->answer.complete);
        return true;
    }
    const auto* error = std::get_if<event::ServerError>(&event);
    if (!error) return false;
    const ErrorMessage& message = error->message;
    const bool isAnswer = request_ != 0 && message.request == request_;
    const bool isAboutParts = message.blob && transferred_.contains(*message.blob);
    const bool isTransferring = source_ && (stage_ == Stage::Parts || stage_ == Stage::Stored);
    if (isAnswer) {
        request_ = 0;
        failed(toError(message));
    } else if (isAboutParts && isTransferring && (*source_->content())->hash == *message.blob) {
        // Each part that was sent before the first error has an error of its own.
        failed(toError(message));
    }
    return isAnswer || isAboutParts;
}

/// TL2: another upload of the same content continues where this connection was lost.
void FileUploads::interrupt() {
    if (source_ && (stage_ == Stage::Parts || stage_ == Stage::Stored) && sent_ > 0) {
        const auto content = **source_->content();
        const auto first = parts_.firstOf(session_.unconfirmed());
        const auto part = first.find(content.hash);
        const std::uint64_t confirmed = sent_ < content.size ? sent_ : parts_.lastOf(content.hash);
        if (interrupted_.size() >= kMostInterrupted) interrupted_.clear();
        interrupted_[content.hash] = part == first.end() ? confirmed : part->second;
    }
    parts_.clear();
}

void FileUploads::failed(const Error& error) {
    if (error.code == ErrorCode::BlobMismatch && isContinued_) {
        // The server does not have the beginning any more.
        return leave();  // advance() begins again
    }
    const Upload& upload = uploads_.front();
    if (error.code == ErrorCode::NotConnected)
        return endAll({error.code, "the connection to the server was lost"});
    if (error.code == ErrorCode::BlobMismatch)
        return end(tl::unexpected(
            cannotUpload(upload.from, ErrorCode::InvalidArgument,
                         "it was changed while it was read. Upload it when it is complete")));
    end(tl::unexpected(Error{error.code, error.message}));
}

void FileUploads::leave() {
    if (source_) source_->isStopped = true;
    source_.reset();
    request_ = 0;
}

void FileUploads::end(Result<void> outcome) {
    ++steps_;
    leave();
    Upload upload = std::move(uploads_.front());
    uploads_.pop_front();
    ended_.push_back({upload.number, std::move(upload.path), std::move(outcome)});
}

void FileUploads::endAll(const Error& why) {
    while (!uploads_.empty())
        end(tl::unexpected(cannotUpload(
            uploads_.front().from, why.code,
            why.message + ". The project has the whole file or none of it: upload it again when "
                          "it is connected")));
}

}  // namespace usdlive::client
