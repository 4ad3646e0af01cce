#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/protocol/Frame.h"

namespace usdlive {

/// SN1: a layer's content as records, parents before children, cut into chunks of about
/// kChunkBytes. Any thread; `doc` is a copy and costs nothing.
class SnapshotEncoder {
public:
    SnapshotEncoder(LayerDoc doc, std::uint64_t request);
    ~SnapshotEncoder();
    /// The next chunk; nothing after the last.
    [[nodiscard]] std::optional<SnapshotFrame> next();

private:
    struct State;
    std::unique_ptr<State> state_;
};

/// The other end. Any thread.
class SnapshotDecoder {
public:
    SnapshotDecoder();
    ~SnapshotDecoder();
    /// Chunks in order; MalformedFrame, InvalidValue otherwise. True after the last.
    Result<bool> add(const SnapshotFrame& frame);
    [[nodiscard]] std::uint64_t specs() const;  ///< so far
    /// Precondition: add() returned true. Once.
    [[nodiscard]] LayerDoc take();

private:
    struct State;
    std::unique_ptr<State> state_;
};

}  // namespace usdlive
