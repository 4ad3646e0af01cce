// A layer's content as snapshot frames (SN1-SN4), and back.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/protocol/Frame.h"

namespace usdlive {

/// Encodes a layer's content as records, parents before children, in chunks of about kChunkBytes
/// (SN1, SN4). Can be used on any thread; `doc` is a cheap copy.
class SnapshotEncoder {
public:
    SnapshotEncoder(LayerDoc doc, std::uint64_t request);
    ~SnapshotEncoder();
    /// Returns the next chunk, and nothing after the last. It has about `most` bytes before
    /// compression, and never more than kChunkBytes.
    [[nodiscard]] std::optional<SnapshotFrame> next(std::size_t most = kChunkBytes);

private:
    struct State;
    std::unique_ptr<State> state_;
};

/// Receives the records of a snapshot, in order. An error ends the reading.
class SnapshotRecords {
public:
    virtual ~SnapshotRecords() = default;
    virtual Result<void> spec(NodeId node, NodeId parent, std::uint64_t order, SpecKind kind,
                              std::string_view name) = 0;
    /// A field of the last spec.
    virtual Result<void> field(std::string_view name, FieldValue value) = 0;
};

/// Reads the records of a snapshot. Can be used on any thread.
class SnapshotReader {
public:
    explicit SnapshotReader(SnapshotRecords& records);
    ~SnapshotReader();
    /// Reads the next chunk. Returns true after the last one. Errors: MalformedFrame, InvalidValue,
    /// or the error of `records`.
    Result<bool> add(const SnapshotFrame& frame);
    [[nodiscard]] std::uint64_t specs() const;  ///< so far
    /// Takes the bytes that the names of the last chunk's records refer to. Otherwise the names are
    /// valid until the next add().
    [[nodiscard]] Bytes takeBytes();

private:
    struct State;
    std::unique_ptr<State> state_;
};

/// Reads a snapshot into a LayerDoc.
class SnapshotDecoder {
public:
    SnapshotDecoder();
    ~SnapshotDecoder();
    Result<bool> add(const SnapshotFrame& frame) { return reader_.add(frame); }
    [[nodiscard]] std::uint64_t specs() const { return reader_.specs(); }
    /// Takes the doc, once. Precondition: add() returned true.
    [[nodiscard]] LayerDoc take();

private:
    class Records;
    std::unique_ptr<Records> records_;
    SnapshotReader reader_;
};

}  // namespace usdlive
