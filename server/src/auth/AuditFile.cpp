// Appends to the audit log and checks its chain.
#include "auth/AuditFile.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <nlohmann/json.hpp>
#include <system_error>
#include <vector>

#include "usdlive/common/core/OwnedFile.h"

namespace usdlive::server {

namespace fs = std::filesystem;

namespace {

using OrderedRecord = nlohmann::ordered_json;

constexpr std::string_view kOlderName = "audit-", kAuditExtension = ".jsonl";
/// Longer than any record: six texts of kMostText, each byte of which may need six characters.
constexpr std::uint64_t kLongestRecord = 64 * 1024;

tl::unexpected<Error> auditError(const char* verb, const fs::path& path) {
    return fail(ErrorCode::StorageFailed, "cannot " + std::string(verb) + " the audit log " +
                                              path.string() + ": " +
                                              std::generic_category().message(errno));
}

Hash hashOfLine(std::string_view line) {
    return sha256(ByteView(reinterpret_cast<const std::uint8_t*>(line.data()), line.size()));
}

std::string timeText(std::int64_t timeMs) {
    constexpr std::int64_t kSecond = 1'000;
    const auto seconds = std::time_t(timeMs / kSecond);
    std::tm parts{};
    std::array<char, 40> text{};
    ::gmtime_r(&seconds, &parts);
    std::size_t size = std::strftime(text.data(), text.size(), "%FT%T", &parts);
    size += std::size_t(
        std::snprintf(text.data() + size, text.size() - size, ".%03dZ", int(timeMs % kSecond)));
    return {text.data(), size};
}

/// Returns the number of a record; 0 if the line is none.
std::uint64_t numberOf(const OrderedRecord& record) {
    const auto number = record.is_object() ? record.find("number") : record.end();
    return number != record.end() && number->is_number_unsigned() ? number->get<std::uint64_t>()
                                                                  : 0;
}

std::string lineOf(const AuditEvent& event, std::uint64_t number, const Hash& previous) {
    OrderedRecord record{
        {"number", number}, {"time", timeText(event.timeMs)}, {"event", event.event}};
    const auto add = [&](const char* name, const std::string& text) {
        if (!text.empty()) record[name] = text.substr(0, AuditFile::kMostText);
    };
    add("user", event.user);
    add("from", event.from);
    add("project", event.project);
    add("layer", event.layer);
    add("detail", event.detail);
    record["previous"] = previous.hex();
    return record.dump(-1, ' ', false, OrderedRecord::error_handler_t::replace);
}

/// The end of the chain in a file.
struct ChainEnd {
    std::uint64_t number = 0;
    Hash hash;
    std::uint64_t size = 0;  ///< without a record that was not written completely
};

/// Returns nothing if errno says why the file cannot be read.
std::optional<ChainEnd> chainEnd(const Descriptor& file) {
    struct stat found{};
    if (::fstat(file.get(), &found) != 0) return std::nullopt;
    const auto size = std::uint64_t(found.st_size);
    const std::uint64_t from = size - std::min(size, 2 * kLongestRecord);
    std::vector<std::uint8_t> bytes(size - from);
    const auto count = readPart(file, from, bytes);
    if (!count) return std::nullopt;
    const std::string_view text(reinterpret_cast<const char*>(bytes.data()), *count);
    const std::size_t end = text.rfind('\n');
    if (end == std::string_view::npos) return ChainEnd{};
    const std::size_t before = end == 0 ? std::string_view::npos : text.rfind('\n', end - 1);
    const std::size_t begin = before == std::string_view::npos ? 0 : before + 1;
    const std::string_view line = text.substr(begin, end - begin);
    return ChainEnd{numberOf(OrderedRecord::parse(line, nullptr, false)), hashOfLine(line),
                    from + end + 1};
}

Descriptor openAudit(const fs::path& path, int flags) {
    return Descriptor(::open(path.c_str(), flags | O_NOFOLLOW | O_CLOEXEC, kOwnerOnly));
}

bool appendTo(const Descriptor& file, std::string_view text, std::uint64_t at) {
    while (!text.empty()) {
        const ssize_t count = ::pwrite(file.get(), text.data(), text.size(), off_t(at));
        if (count < 0 && errno == EINTR) continue;
        if (count < 0) return false;
        text.remove_prefix(std::size_t(count));
        at += std::uint64_t(count);
    }
    return ::fdatasync(file.get()) == 0;
}

/// Checks records in their order.
class ChainCheck {
public:
    explicit ChainCheck(AuditFile::Found& found) : found_(found) {}

    void begin(const fs::path& file) {
        file_ = file.filename().string();
        line_ = 0;
    }
    void check(const OrderedRecord& record, const Hash& hash) {
        ++line_;
        const std::uint64_t number = numberOf(record);
        if (number == 0) {
            damaged("is no record");
        } else if (found_.records == 0) {
            // Older files may have been removed, so the first record begins anywhere.
            if (number == 1 && previousOf(record) != Hash{}.hex())
                damaged("does not begin a chain");
        } else if (number != found_.last + 1) {
            damaged("has the number " + std::to_string(number) + " after " +
                    std::to_string(found_.last));
        } else if (previousOf(record) != found_.head.hex()) {
            damaged("does not follow the record before it: one of the two was changed");
        }
        ++found_.records;
        found_.last = number;
        found_.head = hash;
    }

private:
    static std::string previousOf(const OrderedRecord& record) {
        const auto previous = record.find("previous");
        return previous != record.end() && previous->is_string() ? previous->get<std::string>()
                                                                 : "";
    }
    void damaged(const std::string& what) {
        if (!found_.damage) found_.damage = file_ + ", line " + std::to_string(line_) + " " + what;
    }

    AuditFile::Found& found_;
    std::string file_;
    std::uint64_t line_ = 0;
};

}  // namespace

std::int64_t auditTime() {
    return std::chrono::duration_cast<std::chrono::milliseconds>(
               std::chrono::system_clock::now().time_since_epoch())
        .count();
}

AuditFile::AuditFile(const fs::path& folder, std::uint64_t mostBytes)
    : path_(folder / ".usdlive" / "audit.jsonl"), mostBytes_(mostBytes) {}

std::vector<fs::path> AuditFile::olderFiles() const {
    std::vector<fs::path> older;
    std::error_code ignored;
    for (const auto& entry : fs::directory_iterator(path_.parent_path(), ignored)) {
        const std::string name = entry.path().filename();
        if (name.starts_with(kOlderName) && name.ends_with(kAuditExtension))
            older.push_back(entry.path());
    }
    std::ranges::sort(older);
    return older;
}

Result<void> AuditFile::append(std::span<const AuditEvent> events) const {
    std::error_code ignored;
    fs::create_directories(path_.parent_path(), ignored);
    const auto lock = lockFile(path_.parent_path() / "audit.lock");
    if (!lock) return tl::unexpected(lock.error());
    auto file = openAudit(path_, O_RDWR | O_CREAT);
    if (!file) return auditError("open", path_);
    auto end = chainEnd(file);
    if (!end) return auditError("read", path_);
    std::vector<fs::path> older = olderFiles();
    if (end->size >= mostBytes_) {
        const auto number = std::to_string(end->number);
        const fs::path place =
            path_.parent_path() / (std::string(kOlderName) +
                                   std::string(12 - std::min<std::size_t>(number.size(), 12), '0') +
                                   number + std::string(kAuditExtension));
        if (std::rename(path_.c_str(), place.c_str()) != 0) return auditError("rename", path_);
        file = openAudit(path_, O_RDWR | O_CREAT);
        if (!file) return auditError("open", path_);
        older.push_back(place);
        end = ChainEnd{};
    }
    if (end->size == 0 && !older.empty()) {
        const auto last = openAudit(older.back(), O_RDONLY);
        const auto continued = last ? chainEnd(last) : std::nullopt;
        if (!continued) return auditError("read", older.back());
        end = ChainEnd{continued->number, continued->hash, 0};
    }
    std::string text;
    for (const AuditEvent& event : events) {
        const std::string line = lineOf(event, ++end->number, end->hash);
        end->hash = hashOfLine(line);
        text += line + "\n";
    }
    // Removes a record that a killed process has not written completely.
    if (::ftruncate(file.get(), off_t(end->size)) != 0) return auditError("write", path_);
    if (!appendTo(file, text, end->size)) {
        auto failed = auditError("write", path_);
        (void)!::ftruncate(file.get(), off_t(end->size));
        return failed;
    }
    for (std::size_t index = 0; index + kMostFiles < older.size() + 1; ++index)
        fs::remove(older[index], ignored);
    return {};
}

Result<AuditFile::Found> AuditFile::read(
    const std::function<void(std::uint64_t, const Hash&, std::string_view)>& use) const {
    Found found;
    std::error_code error;
    if (!fs::exists(path_, error)) return found;
    // Records that are appended meanwhile are left out.
    auto lock = lockFile(path_.parent_path() / "audit.lock");
    if (!lock) return tl::unexpected(lock.error());
    std::vector<fs::path> files = olderFiles();
    files.push_back(path_);
    std::vector<std::ifstream> opened;
    for (const fs::path& path : files)
        if (!opened.emplace_back(path, std::ios::binary)) return auditError("read", path);
    const auto size = fs::file_size(path_, error);
    *lock = Descriptor();
    ChainCheck chain(found);
    for (std::size_t index = 0; index < files.size(); ++index) {
        chain.begin(files[index]);
        std::uint64_t left = index + 1 == files.size() ? size : fs::file_size(files[index], error);
        for (std::string line; left > 0 && std::getline(opened[index], line);) {
            // A record without an end was not written completely.
            if (opened[index].eof() || left < line.size() + 1) break;
            left -= line.size() + 1;
            const Hash hash = hashOfLine(line);
            chain.check(OrderedRecord::parse(line, nullptr, false), hash);
            use(found.last, hash, line);
        }
        if (opened[index].bad()) return auditError("read", files[index]);
    }
    return found;
}

}  // namespace usdlive::server
