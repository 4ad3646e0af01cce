#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "ChildProcess.h"
#include "usdlive/common/core/Bytes.h"

namespace usdlive::bench {

/// How a kind of server is spoken to.
class Dialect {
public:
    virtual ~Dialect() = default;
    [[nodiscard]] virtual std::string path() const = 0;
    /// The first message of a connection; empty: none, and it is ready at once.
    [[nodiscard]] virtual Bytes greeting(int connection) = 0;
    /// The transaction, framed.
    [[nodiscard]] virtual Bytes submission(int writer, std::uint64_t sequence) = 0;

    struct Delivery {
        int writer;
        std::uint64_t sequence;
    };
    /// Adds what a frame (without its length) brings. True: the connection is ready now. Throws on
    /// an error or a refusal.
    virtual bool read(ByteView frame, std::vector<Delivery>& deliveries) = 0;
};

/// The real protocol: writers set `edits` double3 a transaction, all over the `fields` of a layer
/// made by writeLayer(). Only the first connection opens it: commits come to all (SE1).
class UsdliveDialect final : public Dialect {
public:
    UsdliveDialect(int edits, int fields, std::string path = "/live")
        : edits_(edits), fields_(fields), path_(std::move(path)) {}
    [[nodiscard]] std::string path() const override { return path_; }
    [[nodiscard]] Bytes greeting(int connection) override;
    [[nodiscard]] Bytes submission(int writer, std::uint64_t sequence) override;
    bool read(ByteView frame, std::vector<Delivery>& deliveries) override;

private:
    const int edits_;
    const int fields_;
    const std::string path_;
    bool greeted_ = false;        // the first connection was
    std::uint64_t revision_ = 0;  // the newest that anybody has
    int next_ = 0;                // field to be set
};

/// What the broadcaster speaks.
class RelayDialect final : public Dialect {
public:
    explicit RelayDialect(std::size_t submissionBytes) : submissionBytes_(submissionBytes) {}
    [[nodiscard]] std::string path() const override { return "/"; }
    [[nodiscard]] Bytes greeting(int) override { return {}; }
    [[nodiscard]] Bytes submission(int writer, std::uint64_t sequence) override;
    bool read(ByteView frame, std::vector<Delivery>& deliveries) override;

private:
    const std::size_t submissionBytes_;
};

struct LoadPlan {
    int connections = 2;  ///< all of them read; the first `writers` write, too
    int writers = 4;
    double perSecond = 60;  ///< transactions of each writer, at even distances from the others'
    int window = 0;         ///< instead: as many as are unacknowledged at a time
    double warmUpSeconds = 1;
    double seconds = 5;
};
struct LoadFigures {
    double seconds = 0;
    double cpuSeconds = 0;        ///< of the server
    std::uint64_t delivered = 0;  ///< transactions, each as often as somebody got it
    double p50Ms = 0, p99Ms = 0;  ///< from writing it to its delivery
    std::size_t frameBytes = 0;   ///< of a delivered one, with its length
    std::size_t submissionBytes = 0;
};
/// Runs in this thread until the plan is fulfilled.
[[nodiscard]] LoadFigures runLoad(const LoadPlan& plan, Dialect& dialect, std::uint16_t port,
                                  const ChildProcess& server);

}  // namespace usdlive::bench
