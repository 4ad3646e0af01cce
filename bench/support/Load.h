// Loads a server with many connections and measures the delivery of edits.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "ChildProcess.h"
#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/protocol/CompactFrame.h"

namespace usdlive::bench {

/// The protocol of a kind of server.
class Dialect {
public:
    virtual ~Dialect() = default;
    [[nodiscard]] virtual std::string path() const = 0;
    /// The first message of a connection. Empty: there is none, and the connection is ready at
    /// once.
    [[nodiscard]] virtual Bytes greeting(int connection) = 0;
    /// Returns the transaction as a frame.
    [[nodiscard]] virtual Bytes submission(int writer, std::uint64_t sequence) = 0;

    struct Delivery {
        int writer;
        std::uint64_t sequence;
    };
    /// Adds the deliveries of a frame (without its length). Returns true when the connection
    /// becomes ready. Throws on an error or a refusal.
    virtual bool read(int connection, ByteView frame, std::vector<Delivery>& deliveries) = 0;
};

/// The real protocol: writers set `edits` double3 in a transaction, in turn over all `fields` of a
/// layer from writeLayer(). Only the first connection opens the layer: commits are sent to all
/// (SE1). `compact`: with compact frames (FR9).
class UsdliveDialect final : public Dialect {
public:
    UsdliveDialect(int edits, int fields, bool compact, std::string path = "/live")
        : edits_(edits), fields_(fields), compact_(compact), path_(std::move(path)) {}
    [[nodiscard]] std::string path() const override { return path_; }
    [[nodiscard]] Bytes greeting(int connection) override;
    [[nodiscard]] Bytes submission(int writer, std::uint64_t sequence) override;
    bool read(int connection, ByteView frame, std::vector<Delivery>& deliveries) override;

private:
    void readCompact(int connection, ByteView frame, std::vector<Delivery>& deliveries);

    const int edits_;
    const int fields_;
    const bool compact_;
    const std::string path_;
    struct Names {
        CompactReader received;
        NameNumbers numbers;
        KnownNames sent;
    };
    std::map<int, Names> names_;  // by connection
    bool greeted_ = false;        // the first connection has been greeted
    std::uint64_t revision_ = 0;  // the newest that any connection has received
    int next_ = 0;                // the next field to set
};

/// The protocol of the broadcaster.
class RelayDialect final : public Dialect {
public:
    explicit RelayDialect(std::size_t submissionBytes) : submissionBytes_(submissionBytes) {}
    [[nodiscard]] std::string path() const override { return "/"; }
    [[nodiscard]] Bytes greeting(int) override { return {}; }
    [[nodiscard]] Bytes submission(int writer, std::uint64_t sequence) override;
    bool read(int connection, ByteView frame, std::vector<Delivery>& deliveries) override;

private:
    const std::size_t submissionBytes_;
};

struct LoadPlan {
    int connections = 2;  ///< all of them read; the first `writers` also write
    int writers = 4;
    double perSecond = 60;  ///< transactions of each writer, evenly spaced with those of the others
    int window = 0;         ///< instead of a rate: the number of unacknowledged transactions
    double warmUpSeconds = 1;
    double seconds = 5;
    bool isEncrypted = false;  ///< with TLS
};
struct LoadFigures {
    double seconds = 0;
    double cpuSeconds = 0;        ///< CPU time of the server
    std::uint64_t delivered = 0;  ///< transactions, counted once for each receiver
    double p50Ms = 0, p99Ms = 0;  ///< from writing a transaction to its delivery
    std::size_t frameBytes = 0;   ///< a delivered frame, with its length
    std::size_t submissionBytes = 0;
};
/// Runs in this thread until the plan is done.
[[nodiscard]] LoadFigures runLoad(const LoadPlan& plan, Dialect& dialect, std::uint16_t port,
                                  const ChildProcess& server);

}  // namespace usdlive::bench
