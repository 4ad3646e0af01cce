// The lost edits of a client.
#pragma once

#include <cstdint>
#include <deque>
#include <filesystem>
#include <vector>

#include "basics/RecordFile.h"
#include "session/Session.h"

namespace usdlive::client {

/// The lost edits of a client (M12), by an index that never changes. The newest ones are in memory;
/// older ones are moved to a file, which is removed with this object.
class LostWorkStore {
public:
    /// `folder` is created when it is first needed. At most `inMemory` entries stay in memory.
    explicit LostWorkStore(std::filesystem::path folder, std::size_t inMemory = 1'000);
    ~LostWorkStore();

    /// Adds an entry with the index size(). Error: StorageFailed (older entries could not be moved
    /// to the file; they stay in memory).
    Result<void> add(LostWork work);
    [[nodiscard]] std::uint64_t size() const { return places_.size() + newest_.size(); }
    /// Error: InvalidArgument (there is no entry with this index).
    [[nodiscard]] Result<LostWork> at(std::uint64_t index) const;
    /// Returns a new file name for content that cannot be kept as edits.
    [[nodiscard]] std::filesystem::path fileFor(const LayerId& layer);

private:
    Result<void> spill();

    const std::filesystem::path folder_;
    const std::size_t inMemory_;
    std::deque<LostWork> newest_;
    RecordFile file_;
    std::vector<std::uint64_t> places_;  // positions in the file, by index
    unsigned files_ = 0;
};

[[nodiscard]] Bytes encodeLostWork(const LostWork& work);
[[nodiscard]] Result<LostWork> decodeLostWork(ByteView bytes);

/// Encode and decode edits with absolute paths, as a submit frame.
[[nodiscard]] Bytes encodeAuthored(std::uint64_t sequence, const std::vector<AuthoredEdit>& edits);
[[nodiscard]] Result<std::vector<AuthoredEdit>> decodeAuthored(ByteView bytes);

}  // namespace usdlive::client
