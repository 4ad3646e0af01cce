#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>

namespace usdlive::layers {

/// Whether files are other than when they were read. A file is hashed when it is first looked at
/// and again when its time or size has changed, so that one that was merely touched counts as the
/// same; beyond kMaxHashedBytes the time alone tells.
class FileWatch {
public:
    struct Seen {
        bool exists = false;
        bool changed = false;
        bool readOnly = false;
        std::string owner;
    };
    /// Looks at the file.
    Seen look(const std::string& path);
    /// The same without reading the file: `changed` stays false.
    [[nodiscard]] static Seen glance(const std::string& path);
    /// The file, as it is now, is what is in memory: it was saved, or read again.
    void accept(const std::string& path);

private:
    struct Stamp {
        std::int64_t time = 0;
        std::int64_t size = 0;
        bool operator==(const Stamp&) const = default;
    };
    struct Known {
        Stamp stamp;
        std::optional<std::uint64_t> hash;
        std::optional<Stamp> changedTo;  // looked at, and found to differ
    };
    [[nodiscard]] static std::optional<std::uint64_t> hashOf(const std::string& path,
                                                             std::int64_t size);

    std::map<std::string, Known> files_;
};

}  // namespace usdlive::layers
