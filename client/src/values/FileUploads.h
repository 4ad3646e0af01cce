// Uploads files of this machine that become files of the project (FI7).
#pragma once

#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "basics/Worker.h"
#include "session/BlobTransfer.h"
#include "session/Session.h"

namespace usdlive::client {

/// Uploads files, one after the other. A worker hashes a file and prepares its parts; advance()
/// sends what is ready, so that no frame waits for a disk. The server is asked first, so that a
/// name that it refuses costs no transfer.
///
/// Each upload ends once. A loss of the connection ends all of them: the server then has the whole
/// file or has changed nothing, and the same upload can be repeated.
class FileUploads {
public:
    FileUploads(Session& session, SessionHost& host);
    /// Stops reading.
    ~FileUploads();
    FileUploads(const FileUploads&) = delete;
    FileUploads& operator=(const FileUploads&) = delete;

    /// Adds an upload of the file `from`, which becomes `path` in the project. Returns its number.
    std::uint64_t add(std::filesystem::path from, std::string path, bool overwrite);
    /// Waits for the end of an upload to `path`. `step` works on what was received, waits a moment,
    /// and returns whether something was received. Gives up if nothing happens for too long; the
    /// server writes a large file without a word.
    [[nodiscard]] Result<void> finish(std::uint64_t number, const std::string& path,
                                      const std::function<bool()>& step);

    /// Continues with what is ready. Does not wait.
    void advance();
    /// Receives an event of the session. Returns true if it concerns nobody but an upload.
    bool note(const Event& event);
    /// Call it when the server has stored a big value.
    void blobStored(const Hash& hash);

    struct Ended {
        std::uint64_t number = 0;
        std::string path;
        Result<void> outcome;
    };
    [[nodiscard]] std::vector<Ended> takeEnded();
    /// Gives an end to the finish() that waits for it; otherwise returns the event.
    [[nodiscard]] std::optional<Event> report(Ended ended);
    /// Returns the progress of the present upload every 500 ms, first when it has taken so long.
    [[nodiscard]] std::optional<event::Progress> progress(std::int64_t nowMs);

private:
    class Source;
    struct Upload {
        std::uint64_t number = 0;
        std::filesystem::path from;
        std::string path;
        bool overwrite = false;
    };
    /// The event that the present upload waits for.
    enum class Stage { Hash, Answer, Parts, Stored };

    [[nodiscard]] std::uint64_t steps() const;
    [[nodiscard]] std::uint64_t beingWritten() const;
    void drop(std::uint64_t number);
    void begin();
    bool advanceStage();
    void ask();
    void answered(bool complete);
    bool sendParts();
    void interrupt();
    void failed(const Error& error);
    void end(Result<void> outcome);
    void endAll(const Error& why);
    void leave();

    Session& session_;
    SessionHost& host_;
    std::deque<Upload> uploads_;  // the first one is the present one if source_ is set
    std::shared_ptr<Source> source_;
    Stage stage_ = Stage::Hash;
    std::uint64_t request_ = 0;                  // awaited; 0: none
    int transfers_ = 0;                          // transfers of the present upload
    std::uint64_t sent_ = 0;                     // bytes of the present transfer
    bool isContinued_ = false;                   // the present transfer did not begin at 0
    SentParts parts_;                            // on this connection
    std::map<Hash, std::uint64_t> interrupted_;  // by content: the offset at which it continues
    std::set<Hash> transferred_;                 // errors about parts of them are expected here
    std::vector<Ended> ended_;
    std::map<std::uint64_t, std::optional<Result<void>>> awaited_;  // by finish()
    std::optional<std::int64_t> reportedMs_;
    std::uint64_t steps_ = 0;
    // Starts above the numbers of other requests, so that all numbers are distinct.
    std::uint64_t last_ = std::uint64_t(1) << 33;
    std::unique_ptr<Worker> reader_;  // made for the first upload
};

}  // namespace usdlive::client
