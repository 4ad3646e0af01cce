// The audit log: who did what, and what was refused.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "usdlive/common/core/Hash.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::server {

/// One action. All texts but `event` may be empty, and may be any bytes from a client.
struct AuditEvent {
    std::string_view event;    ///< one of a few fixed texts, for example "sign-in refused"
    std::string user = {};     ///< the one who did it
    std::string from = {};     ///< the address, or "command line" on the server's machine
    std::string project = {};  ///< its name
    std::string layer = {};    ///< the layer, for actions on one
    std::string detail = {};   ///< anything else
    std::int64_t timeMs = 0;   ///< since 1970
};

/// Returns the time of an event that happens now.
[[nodiscard]] std::int64_t auditTime();

/// The files `.usdlive/audit*.jsonl` of a folder (AU1-AU4). Each record has the hash of the one
/// before it, so that a changed or removed record is found. Several processes may append at the
/// same time. Any thread; blocks for the disk.
class AuditFile {
public:
    static constexpr std::uint64_t kMostBytes = 16 * 1024 * 1024;  ///< then a new file begins
    static constexpr std::size_t kMostFiles = 20;                  ///< older ones are removed
    static constexpr std::size_t kMostText = 1'000;                ///< bytes; longer texts are cut

    explicit AuditFile(const std::filesystem::path& folder, std::uint64_t mostBytes = kMostBytes);

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    /// Appends all events or none. They are on the disk when it returns. Error: StorageFailed.
    [[nodiscard]] Result<void> append(std::span<const AuditEvent> events) const;

    /// The result of read().
    struct Found {
        std::uint64_t records = 0;
        std::uint64_t last = 0;             ///< the number of the last record
        Hash head;                          ///< the hash of the last record
        std::optional<std::string> damage;  ///< the first one, with file and line
    };
    /// Passes all records to `use`, from the oldest, as the lines of the files, and checks the
    /// chain. `use` gets damaged lines, too. Error: StorageFailed names the file.
    [[nodiscard]] Result<Found> read(
        const std::function<void(std::uint64_t number, const Hash& hash, std::string_view line)>&
            use) const;

private:
    [[nodiscard]] std::vector<std::filesystem::path> olderFiles() const;

    const std::filesystem::path path_;
    const std::uint64_t mostBytes_;
};

}  // namespace usdlive::server
