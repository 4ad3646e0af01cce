// Puts load on a server over DDS, and runs Cyclone's ddsperf for comparison.
#include "DdsLoad.h"

#include <stdlib.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <memory>
#include <mutex>
#include <regex>
#include <stdexcept>
#include <thread>

#include "Figures.h"
#include "Server.h"
#include "transport/Connection.h"
#include "usdlive/common/dds/DomainConfig.h"

namespace usdlive::bench {

namespace {

using client::Connection;
using std::chrono::milliseconds;

constexpr auto kWaitForAll = std::chrono::seconds(60);
// The index of ddsperf's writer; each process has a port that follows from its index.
constexpr int kWriterIndex = 100;

/// State that all connections share.
struct Run {
    std::mutex mutex;
    Dialect& dialect;
    std::vector<std::vector<Clock::time_point>> sent;  // by writer and sequence - 1
    bool measuring = false;
    std::uint64_t frameBytes = 0;
    std::vector<float> latenciesMs;
    std::string fault;
};

class Line {
public:
    Line(Run& run, int number, std::unique_ptr<Connection> connection)
        : run_(run), number_(number), connection_(std::move(connection)) {
        thread_ = std::thread([this] { work(); });
    }
    ~Line() {
        leaving_ = true;
        thread_.join();
    }

    [[nodiscard]] bool isReady() const { return ready_; }
    void submit() {
        Bytes frame;
        {
            const std::lock_guard lock(run_.mutex);
            auto& sent = run_.sent[std::size_t(number_)];
            frame = run_.dialect.submission(number_, sent.size() + 1);
            sent.push_back(Clock::now());
        }
        connection_->send(std::make_shared<const Bytes>(std::move(frame)));
    }

private:
    void work() {
        try {
            while (!leaving_) {
                if (!connection_->wait(milliseconds(20))) continue;
                for (const auto& happening : connection_->poll(1'024)) take(happening);
            }
        } catch (const std::exception& fault) {
            const std::lock_guard lock(run_.mutex);
            run_.fault = fault.what();
        }
    }

    void take(const Connection::Happening& happening) {
        const auto now = Clock::now();
        if (const auto* lost = std::get_if<Connection::Lost>(&happening))
            throw std::runtime_error(lost->reason.message);
        if (std::holds_alternative<Connection::Opened>(happening)) {
            const std::lock_guard lock(run_.mutex);
            connection_->send(std::make_shared<const Bytes>(run_.dialect.greeting(number_)));
            return;
        }
        const Bytes& message =
            *std::get<SharedBytes>(std::get<Connection::Message>(happening).content);
        const std::lock_guard lock(run_.mutex);
        for (std::size_t at = 0; at + 4 <= message.size();) {
            std::uint32_t size = 0;
            std::memcpy(&size, message.data() + at, sizeof size);
            std::vector<Dialect::Delivery> deliveries;
            if (run_.dialect.read(number_, ByteView(message).subspan(at + 4, size), deliveries))
                ready_ = true;
            for (const auto& delivery : deliveries) note(delivery, now, size + 4);
            at += 4 + size;
        }
    }

    void note(const Dialect::Delivery& delivery, Clock::time_point now, std::size_t bytes) {
        if (!run_.measuring) return;
        const std::chrono::duration<float, std::milli> latency =
            now - run_.sent.at(std::size_t(delivery.writer)).at(delivery.sequence - 1);
        run_.latenciesMs.push_back(latency.count());
        run_.frameBytes += bytes;
    }

    Run& run_;
    const int number_;
    const std::unique_ptr<Connection> connection_;
    std::atomic<bool> ready_ = false, leaving_ = false;
    std::thread thread_;
};

/// Writes in turns, evenly spaced, for `seconds`.
void write(const LoadPlan& plan, std::vector<std::unique_ptr<Line>>& lines, double seconds,
           std::size_t& turn) {
    const auto begin = Clock::now();
    const double pause = 1 / (plan.perSecond * plan.writers);
    for (int count = 0; count * pause < seconds; ++count) {
        std::this_thread::sleep_until(begin + std::chrono::duration_cast<Clock::duration>(
                                                  std::chrono::duration<double>(count * pause)));
        lines[turn++ % std::size_t(plan.writers)]->submit();
    }
}

}  // namespace

LoadFigures runDdsLoad(const LoadPlan& wanted, Dialect& dialect,
                       const dds::DomainSettings& settings, const std::string& project,
                       const ChildProcess& server) {
    LoadPlan plan = wanted;
    plan.writers = std::min(plan.writers, plan.connections);
    Run run{{}, dialect, {}, false, 0, {}, {}};
    run.sent.resize(std::size_t(plan.writers));
    client::ServerAddress address;
    address.dds = true;
    address.project = project;
    std::vector<std::unique_ptr<Line>> lines;
    for (int number = 0; number < plan.connections; ++number) {
        auto connection = client::createDdsConnection(address, settings);
        if (!connection) throw std::runtime_error(connection.error().message);
        lines.push_back(std::make_unique<Line>(run, number, std::move(*connection)));
        const auto end = Clock::now() + kWaitForAll;
        while (!lines.back()->isReady()) {
            if (Clock::now() > end) throw std::runtime_error("a client gets no welcome");
            std::this_thread::sleep_for(milliseconds(1));
        }
    }
    std::size_t turn = 0;
    write(plan, lines, plan.warmUpSeconds, turn);

    LoadFigures figures;
    const auto measure = [&](bool on) {
        const std::lock_guard lock(run.mutex);
        run.measuring = on;
        if (!run.fault.empty()) throw std::runtime_error(run.fault);
    };
    measure(true);
    const auto begin = Clock::now();
    const double cpu = server.cpuSeconds();
    write(plan, lines, plan.seconds, turn);
    figures.cpuSeconds = server.cpuSeconds() - cpu;
    figures.seconds = millisecondsSince(begin) / 1000;
    measure(false);
    figures.delivered = run.latenciesMs.size();
    if (figures.delivered == 0) throw std::runtime_error("nothing was delivered");
    figures.p50Ms = percentile(run.latenciesMs, 0.5);
    figures.p99Ms = percentile(run.latenciesMs, 0.99);
    figures.frameBytes = run.frameBytes / figures.delivered;
    return figures;
}

LoadFigures runDdsPerf(const LoadPlan& plan, std::size_t frameBytes,
                       const dds::DomainSettings& settings, const std::vector<int>& serverCores) {
    const std::string program = "/usr/bin/ddsperf";
    if (!std::filesystem::exists(program)) return {};
    const TemporaryFolder folder;
    const auto config = folder.path() / "cyclone.xml";
    std::ofstream(config) << dds::cycloneConfig(settings).value();
    // By default each process would discover each other one and create a writer to answer it; with
    // 52 processes the machine does nothing else. Therefore the readers search for others only at
    // the writer's address.
    const auto configure = [&](const std::string& discovery) {
        const std::string beside =
            "<CycloneDDS><Domain><General><AllowMulticast>asm"
            "</AllowMulticast></General><Discovery>" +
            discovery + "</Discovery></Domain></CycloneDDS>";
        ::setenv("CYCLONEDDS_URI", ("file://" + config.string() + "," + beside).c_str(), 1);
    };
    configure("<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>" +
              std::to_string(kWriterIndex - 1) +
              R"(</MaxAutoParticipantIndex><Peers><Peer Address="127.0.0.1:)" +
              std::to_string(7'410 + 250 * settings.domain + 2 * kWriterIndex) + R"("/></Peers>)");
    std::vector<std::unique_ptr<ChildProcess>> readers;
    for (int number = 0; number < plan.connections; ++number)
        readers.push_back(std::make_unique<ChildProcess>(
            std::vector<std::string>{program, "-D", "120", "sub"}, std::vector<int>{}));
    std::this_thread::sleep_for(std::chrono::seconds(2));
    configure("<ParticipantIndex>" + std::to_string(kWriterIndex) + "</ParticipantIndex>");

    const int perSecond = int(plan.perSecond * std::min(plan.writers, plan.connections));
    const std::vector<std::string> publish{"pub", std::to_string(perSecond) + "Hz", "size",
                                           std::to_string(frameBytes)};
    LoadFigures figures;
    {
        std::vector<std::string> command{program, "-D", "60"};
        command.insert(command.end(), publish.begin(), publish.end());
        const ChildProcess writer(command, serverCores);
        std::this_thread::sleep_for(std::chrono::seconds(2));
        const double cpu = writer.cpuSeconds();
        const auto begin = Clock::now();
        std::this_thread::sleep_for(std::chrono::duration<double>(plan.seconds));
        figures.cpuSeconds = writer.cpuSeconds() - cpu;
        figures.seconds = millisecondsSince(begin) / 1000;
        figures.delivered = std::uint64_t(figures.seconds * perSecond * plan.connections);
    }
    // The readers answer a tenth of the samples; ddsperf prints the latency of these only.
    std::string command = program + " -D " + std::to_string(int(plan.seconds) + 2);
    for (const std::string& word : publish) command += " " + word;
    command += " 10% 2>&1";
    const std::unique_ptr<FILE, int (*)(FILE*)> said(::popen(command.c_str(), "r"), ::pclose);
    if (!said) throw std::runtime_error("cannot run " + command);
    const std::regex latency(R"(50% ([\d.]+)us 90% [\d.]+us 99% ([\d.]+)us .*cnt (\d+))");
    char line[4'096];
    std::vector<float> middle, high;
    while (std::fgets(line, sizeof line, said.get())) {
        std::cmatch found;
        if (!std::regex_search(line, found, latency)) continue;
        middle.push_back(std::stof(found[1]) / 1000);
        high.push_back(std::stof(found[2]) / 1000);
    }
    // ddsperf prints figures for each second and reader; the median of them is the usual one.
    figures.p50Ms = percentile(middle, 0.5);
    figures.p99Ms = percentile(high, 0.5);
    figures.frameBytes = frameBytes;
    return figures;
}

}  // namespace usdlive::bench
