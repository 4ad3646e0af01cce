// Puts load on a server over WebSockets.
#include "Load.h"

#include <openssl/ssl.h>

#include <algorithm>
#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <stdexcept>
#include <utility>

#include "Broadcaster.h"
#include "Figures.h"
#include "Server.h"
#include "usdlive/common/net/NetStream.h"
#include "usdlive/common/protocol/Control.h"
#include "usdlive/common/protocol/Frame.h"
#include "usdlive/common/protocol/frames_generated.h"

namespace usdlive::bench {

namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
using asio::ip::tcp;

std::string clientName(int connection) {
    std::string digits = std::to_string(connection);
    return std::string(32 - digits.size(), '0') + digits;
}

void append(Bytes& to, const Bytes& what) { to.insert(to.end(), what.begin(), what.end()); }

/// State that all connections share.
struct Run {
    Run(const LoadPlan& plan, Dialect& dialect) : plan(plan), dialect(dialect) {
        sent.resize(static_cast<std::size_t>(plan.writers));
    }

    const LoadPlan& plan;
    Dialect& dialect;
    asio::io_context io{1};
    std::vector<std::vector<Clock::time_point>> sent;  // by writer and sequence - 1
    int ready = 0;
    bool measuring = false;
    std::uint64_t frameBytes = 0;
    std::vector<float> latenciesMs;
    std::size_t submissionBytes = 0;
};

class Line {
public:
    Line(Run& run, int number, std::uint16_t port)
        : run_(run), number_(number), stream_(NetStream(run.io)), pace_(run.io) {
        // One connection after the other: nothing is measured yet.
        NetStream& net = stream_.next_layer();
        net.socket().connect({asio::ip::make_address("127.0.0.1"), port});
        net.socket().set_option(tcp::no_delay(true));
        if (run.plan.isEncrypted) {
            TlsState tls(SSL_new(createTlsContext().get()));  // accepts any certificate
            SSL_set_connect_state(tls.get());
            net.encrypt(std::move(tls));
            await([&](auto done) { net.async_handshake(std::move(done)); });
        }
        await([&](auto done) {
            stream_.async_handshake("127.0.0.1:" + std::to_string(port), run.dialect.path(),
                                    std::move(done));
        });
        stream_.binary(true);
        stream_.auto_fragment(false);
        stream_.read_message_max(0);
        const Bytes greeting = run.dialect.greeting(number);
        if (greeting.empty())
            ++run.ready;
        else
            await([&](auto done) {
                stream_.async_write(asio::buffer(greeting),
                                    [done](beast::error_code error, std::size_t) { done(error); });
            });
        read();
    }

    /// Writes at an even pace; the first transaction at `first`.
    void writePaced(Clock::time_point first) {
        next_ = first;
        pace();
    }
    void fillWindow() {
        auto& sent = run_.sent[static_cast<std::size_t>(number_)];
        while (sent.size() < acknowledged_ + static_cast<std::size_t>(run_.plan.window)) submit();
    }

private:
    /// Starts an operation, and runs the connections until it has ended.
    template <class Start>
    void await(Start start) {
        bool isDone = false;
        start([&isDone](beast::error_code error) {
            if (error) throw std::runtime_error("cannot connect: " + error.message());
            isDone = true;
        });
        while (!isDone) run_.io.run_one();
        run_.io.restart();  // it stops when there was nothing else to do
    }

    void pace() {
        pace_.expires_at(next_);
        pace_.async_wait([this](beast::error_code error) {
            if (error) return;
            submit();
            next_ += std::chrono::duration_cast<Clock::duration>(
                std::chrono::duration<double>(1 / run_.plan.perSecond));
            pace();
        });
    }

    void submit() {
        auto& sent = run_.sent[static_cast<std::size_t>(number_)];
        const Bytes frame = run_.dialect.submission(number_, sent.size() + 1);
        run_.submissionBytes = frame.size();
        append(waiting_, frame);
        sent.push_back(Clock::now());
        if (!writing_) write();
    }

    void write() {
        writing_ = true;
        leaving_.swap(waiting_);
        waiting_.clear();
        stream_.async_write(asio::buffer(leaving_), [this](beast::error_code error, std::size_t) {
            writing_ = false;
            if (error) throw std::runtime_error("cannot write: " + error.message());
            if (!waiting_.empty()) write();
        });
    }

    void read() {
        stream_.async_read(buffer_, [this](beast::error_code error, std::size_t) {
            if (error) throw std::runtime_error("cannot read: " + error.message());
            onMessage();
            buffer_.consume(buffer_.size());
            read();
        });
    }

    void onMessage() {
        const auto now = Clock::now();
        const auto data = buffer_.cdata();
        const ByteView message(static_cast<const std::uint8_t*>(data.data()), data.size());
        for (std::size_t at = 0; at + 4 <= message.size();) {
            std::uint32_t size = 0;
            std::memcpy(&size, message.data() + at, sizeof size);
            deliveries_.clear();
            if (run_.dialect.read(number_, message.subspan(at + 4, size), deliveries_))
                ++run_.ready;
            for (const auto& delivery : deliveries_) onDelivery(delivery, now, size + 4);
            at += 4 + size;
        }
        if (number_ < run_.plan.writers && run_.plan.window > 0 && acknowledged_ > 0) fillWindow();
    }

    void onDelivery(const Dialect::Delivery& delivery, Clock::time_point now, std::size_t bytes) {
        if (delivery.writer == number_) ++acknowledged_;
        if (!run_.measuring) return;
        const auto& sent = run_.sent.at(static_cast<std::size_t>(delivery.writer));
        const std::chrono::duration<float, std::milli> latency =
            now - sent.at(delivery.sequence - 1);
        run_.latenciesMs.push_back(latency.count());
        run_.frameBytes += bytes;
    }

    Run& run_;
    const int number_;
    beast::websocket::stream<NetStream, false> stream_;
    beast::flat_buffer buffer_;
    std::vector<Dialect::Delivery> deliveries_;
    Bytes waiting_, leaving_;
    bool writing_ = false;
    std::size_t acknowledged_ = 0;
    asio::steady_timer pace_;
    Clock::time_point next_;
};

void runFor(Run& run, double seconds) {
    run.io.run_for(
        std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds)));
}

}  // namespace

Bytes UsdliveDialect::greeting(int connection) {
    Hello hello;
    hello.protocol = kProtocolVersion;
    hello.oldestProtocol = kOldestProtocolVersion;
    hello.client = {clientName(connection)};
    hello.user = {"bench"};
    hello.application = "bench";
    if (compact_) hello.features = {kCompactFeature};
    Bytes message = encodeFrame(ControlFrame{encodeControl(hello)});
    if (connection == 0)
        append(message, encodeFrame(ControlFrame{encodeControl(OpenLayer{1, kLayer, 0})}));
    return message;
}

Bytes UsdliveDialect::submission(int writer, std::uint64_t sequence) {
    SubmitFrame frame;
    frame.transaction.id = {{clientName(writer)}, sequence};
    frame.transaction.base = revision_;
    for (int edit = 0; edit < edits_; ++edit) {
        next_ = (next_ + 7919) % fields_;
        const std::array numbers{double(writer), double(sequence), double(edit)};
        Bytes bytes(sizeof numbers);
        std::memcpy(bytes.data(), numbers.data(), sizeof numbers);
        SetField set{"default", {}, Value(ValueType::Double3, std::move(bytes)), ValueType::None};
        frame.transaction.edits.push_back({kLayer, {attributePath(next_), {}}, std::move(set)});
    }
    if (!compact_) return encodeFrame(frame);
    Names& names = names_[writer];
    const auto compact = encodeCompact(frame.transaction, names.numbers).value();
    Bytes message;
    if (const SharedBytes introduction = names.sent.introduce(compact)) message = *introduction;
    append(message, *compact.bytes);
    return message;
}

void UsdliveDialect::readCompact(int connection, ByteView frame,
                                 std::vector<Delivery>& deliveries) {
    const auto content = names_[connection].received.read(frame);
    if (!content) throw std::runtime_error(content.error().message);
    if (const auto* accepted = std::get_if<Acceptance>(&*content)) {
        revision_ = std::max(revision_, accepted->revision);
        deliveries.push_back({connection, accepted->sequence});
    } else if (const auto* compact = std::get_if<CompactCommit>(&*content)) {
        const Commit& commit = compact->commit;
        revision_ = std::max(revision_, commit.revision);
        deliveries.push_back({std::atoi(commit.id.client.value.c_str()), commit.id.sequence});
    }
}

bool UsdliveDialect::read(int connection, ByteView frame, std::vector<Delivery>& deliveries) {
    if (isCompact(frame)) {
        readCompact(connection, frame, deliveries);
        return false;
    }
    // Frames of our own server need no verification; only the names are read.
    const auto* root = wire::GetFrame(frame.data());
    if (const auto* commit = root->body_as_Commit()) {
        revision_ = std::max(revision_, commit->revision());
        if (!commit->imported())
            deliveries.push_back({std::atoi(commit->client()->c_str()), commit->sequence()});
        return false;
    }
    if (const auto* snapshot = root->body_as_Snapshot()) return snapshot->last();
    if (const auto* refusal = root->body_as_Refusal())
        throw std::runtime_error("refused: " + refusal->message()->str());
    if (const auto* control = root->body_as_Control()) {
        const auto message = decodeControl(control->json()->string_view());
        if (!message) throw std::runtime_error(message.error().message);
        if (const auto* error = std::get_if<ErrorMessage>(&*message))
            throw std::runtime_error("the server says: " + error->message);
        if (const auto* welcome = std::get_if<Welcome>(&*message)) {
            revision_ = std::max(revision_, welcome->revision);
            // Only the first connection waits for the layer.
            return std::exchange(greeted_, true);
        }
    }
    return false;
}

Bytes RelayDialect::submission(int writer, std::uint64_t sequence) {
    Bytes message(std::max(submissionBytes_, sizeof(RelayHead)));
    const RelayHead head{static_cast<std::uint32_t>(message.size() - 4),
                         static_cast<std::uint32_t>(writer), sequence};
    std::memcpy(message.data(), &head, sizeof head);
    return message;
}

bool RelayDialect::read(int /*connection*/, ByteView frame, std::vector<Delivery>& deliveries) {
    RelayHead head{};
    constexpr std::size_t kLength = sizeof head.length;
    std::memcpy(reinterpret_cast<char*>(&head) + kLength, frame.data(), sizeof head - kLength);
    deliveries.push_back({static_cast<int>(head.writer), head.sequence});
    return false;
}

LoadFigures runLoad(const LoadPlan& wanted, Dialect& dialect, std::uint16_t port,
                    const ChildProcess& server) {
    LoadPlan plan = wanted;
    plan.writers = std::min(plan.writers, plan.connections);
    Run run(plan, dialect);
    std::vector<std::unique_ptr<Line>> lines;
    for (int i = 0; i < plan.connections; ++i) {
        lines.push_back(std::make_unique<Line>(run, i, port));
        while (run.ready <= i) run.io.run_one();
    }
    const auto begin = Clock::now();
    for (int i = 0; i < plan.writers; ++i) {
        const std::chrono::duration<double> offset(i / (plan.perSecond * plan.writers));
        if (plan.window > 0)
            lines[static_cast<std::size_t>(i)]->fillWindow();
        else
            lines[static_cast<std::size_t>(i)]->writePaced(
                begin + std::chrono::duration_cast<Clock::duration>(offset));
    }
    runFor(run, plan.warmUpSeconds);

    LoadFigures figures;
    run.measuring = true;
    const auto measured = Clock::now();
    const double cpu = server.cpuSeconds();
    runFor(run, plan.seconds);
    figures.cpuSeconds = server.cpuSeconds() - cpu;
    figures.seconds = millisecondsSince(measured) / 1000;
    figures.delivered = run.latenciesMs.size();
    if (figures.delivered == 0) throw std::runtime_error("nothing was delivered");
    figures.p50Ms = percentile(run.latenciesMs, 0.5);
    figures.p99Ms = percentile(run.latenciesMs, 0.99);
    figures.frameBytes = run.frameBytes / figures.delivered;
    figures.submissionBytes = run.submissionBytes;
    return figures;
}

}  // namespace usdlive::bench
