// The file by which a command asks a running server for a copy of its store.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "usdlive/common/core/Result.h"

namespace usdlive::server {

/// The file `copy.json` beside the store of a project or a live session. `usdlive backup` writes
/// the name of a copy, and the server makes the copy beside its store, at copy(), so that whoever
/// writes the file chooses no other place. Any thread; blocks for the disk.
class StoreCopyFile {
public:
    /// `history`: see ProjectPlace::history().
    explicit StoreCopyFile(const std::filesystem::path& history)
        : folder_(history), path_(folder_ / "copy.json") {}

    // ---- the command

    /// Asks for a copy with a new name, which it returns. Error: StorageFailed.
    [[nodiscard]] Result<std::string> ask() const;
    /// Returns the server's answer for the name: the error, or nothing for a copy that is made.
    /// Nothing at all: there is no answer yet.
    [[nodiscard]] std::optional<Result<void>> answer(const std::string& name) const;

    // ---- the server

    /// Returns a value that differs when the file was changed; nothing if there is none.
    [[nodiscard]] std::optional<std::string> stamp() const;
    /// Returns the name of the wanted copy; nothing if the file says none.
    [[nodiscard]] std::optional<std::string> read() const;
    void writeAnswer(const std::string& name, const Result<void>& made) const;

    /// Returns the folder of a copy.
    [[nodiscard]] std::filesystem::path copy(const std::string& name) const {
        return folder_ / (kCopies + name);
    }
    /// Removes the copies that nobody has taken. Call it when nobody asks for one.
    void removeCopies() const;

private:
    static constexpr const char* kCopies = "copy-";
    [[nodiscard]] std::filesystem::path answerPath() const { return path_.string() + ".answer"; }

    std::filesystem::path folder_, path_;
};

}  // namespace usdlive::server
