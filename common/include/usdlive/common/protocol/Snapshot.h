#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/protocol/Frame.h"

namespace usdlive {

/// SN1, SN4: a layer's content as records, parents before children, cut into chunks of about
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

/// What a snapshot's records say, in their order. An error ends the reading.
class SnapshotRecords {
public:
    virtual ~SnapshotRecords() = default;
    virtual Result<void> spec(NodeId node, NodeId parent, std::uint64_t order, SpecKind kind,
                              std::string_view name) = 0;
    /// Of the last spec.
    virtual Result<void> field(std::string_view name, FieldValue value) = 0;
};

/// The other end. Any thread.
class SnapshotReader {
public:
    explicit SnapshotReader(SnapshotRecords& records);
    ~SnapshotReader();
    /// Chunks in order; MalformedFrame, InvalidValue otherwise, or the error of `records`. True
    /// after the last.
    Result<bool> add(const SnapshotFrame& frame);
    [[nodiscard]] std::uint64_t specs() const;  ///< so far
    /// What the names of the last chunk's records are views of; else they end with the next add().
    [[nodiscard]] Bytes takeBytes();

private:
    struct State;
    std::unique_ptr<State> state_;
};

/// Likewise, into a doc.
class SnapshotDecoder {
public:
    SnapshotDecoder();
    ~SnapshotDecoder();
    Result<bool> add(const SnapshotFrame& frame) { return reader_.add(frame); }
    [[nodiscard]] std::uint64_t specs() const { return reader_.specs(); }
    /// Precondition: add() returned true. Once.
    [[nodiscard]] LayerDoc take();

private:
    class Records;
    std::unique_ptr<Records> records_;
    SnapshotReader reader_;
};

}  // namespace usdlive
