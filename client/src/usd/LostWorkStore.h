#pragma once

#include <cstdint>
#include <deque>
#include <filesystem>
#include <vector>

#include "session/Session.h"
#include "usd/RecordFile.h"

namespace usdlive::client {

/// Work of one's own that is not in the project (M12), by an index that never changes. The newest
/// is in memory; older work is moved to a file, which is removed with this.
class LostWorkStore {
public:
    /// `folder` is made when it is first needed. `inMemory`: more than so many go to the file.
    explicit LostWorkStore(std::filesystem::path folder, std::size_t inMemory = 1'000);
    ~LostWorkStore();

    /// Its index is size() - 1 then. StorageFailed: older work could not be moved to the file; it
    /// stays in memory.
    Result<void> add(LostWork work);
    [[nodiscard]] std::uint64_t size() const { return places_.size() + newest_.size(); }
    /// InvalidArgument: there is none of this index.
    [[nodiscard]] Result<LostWork> at(std::uint64_t index) const;
    /// A new file name for content of a layer that cannot be kept as edits.
    [[nodiscard]] std::filesystem::path fileFor(const LayerId& layer);

private:
    Result<void> spill();

    const std::filesystem::path folder_;
    const std::size_t inMemory_;
    std::deque<LostWork> newest_;
    RecordFile file_;
    std::vector<std::uint64_t> places_;  // in the file, by index
    unsigned files_ = 0;
};

[[nodiscard]] Bytes encodeLostWork(const LostWork& work);
[[nodiscard]] Result<LostWork> decodeLostWork(ByteView bytes);

/// Edits as their author made them, as bytes and back: a submit frame with absolute paths.
[[nodiscard]] Bytes encodeAuthored(std::uint64_t sequence, const std::vector<AuthoredEdit>& edits);
[[nodiscard]] Result<std::vector<AuthoredEdit>> decodeAuthored(ByteView bytes);

}  // namespace usdlive::client
