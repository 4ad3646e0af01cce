// Detects changes of layer files.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>

namespace usdlive::layers {

/// Detects changes of files. A file is hashed at the first look and again when its time or size has
/// changed, so that merely touching it is no change. For files beyond kMaxHashedBytes only the time
/// counts.
class FileWatch {
public:
    struct Seen {
        bool exists = false;
        bool changed = false;
        bool readOnly = false;
        std::string owner;
    };
    /// Checks the file.
    Seen look(const std::string& path);
    /// Checks the file without reading it: `changed` stays false.
    [[nodiscard]] static Seen glance(const std::string& path);
    /// Call when the present content of the file is in memory: after saving or reading it.
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
        std::optional<Stamp> changedTo;  // state in which the file was found to differ
    };
    [[nodiscard]] static std::optional<std::uint64_t> hashOf(const std::string& path,
                                                             std::int64_t size);

    std::map<std::string, Known> files_;
};

}  // namespace usdlive::layers
