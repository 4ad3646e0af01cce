// Measures the cost of a busy project for another project of the same server process.
//
//   --writers=8  --edits=20  --seconds=5  --huge=400000  --idle=50
//
// An editor writes one value at a time into a quiet project and waits for its acknowledgement.
// Meanwhile `writers` write 60 transactions a second, of `edits` edits each, into a busy project.
// Then one transaction of `huge` edits goes into the busy project. `same` has both projects in one
// process. `other` has a process for each, for comparison: they share only the machine. `alone` is
// without load. `kib` is the memory that each of `idle` projects without a session adds to a
// process.
#include <pxr/base/gf/vec3d.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/schema.h>

#include <chrono>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "support/Figures.h"
#include "support/LiveClient.h"
#include "support/Load.h"
#include "support/Server.h"

using namespace usdlive::bench;

namespace {

constexpr int kFields = 1000;
constexpr std::chrono::milliseconds kPause{16};

struct Plan {
    int writers = 8, edits = 20, seconds = 5, huge = 400'000, idle = 50;
};

/// The busy and the quiet project, in one process or in two.
class Setting {
public:
    Setting(bool isOneProcess, int busyFields) {
        for (const char* name : {"busy", "quiet"}) std::filesystem::create_directory(path(name));
        writeLayer(path("busy"), busyFields);
        writeLayer(path("quiet"), kFields);
        const std::vector<std::string> options{"--min-free-mib=1", "--max-transaction-mib=2000"};
        auto both = options;
        if (isOneProcess) both.push_back(path("quiet").string());
        busy_.emplace(path("busy"), both, std::vector<int>{});
        if (!isOneProcess) quiet_.emplace(path("quiet"), options, std::vector<int>{});
    }
    [[nodiscard]] std::string quietUrl() const {
        return quiet_ ? quiet_->url() : busy_->url() + "/quiet";
    }
    [[nodiscard]] std::string busyUrl() const {
        return quiet_ ? busy_->url() : busy_->url() + "/busy";
    }
    [[nodiscard]] ServerProcess& busy() { return *busy_; }
    [[nodiscard]] std::string busyPath() const { return quiet_ ? "/live" : "/busy/live"; }

private:
    [[nodiscard]] std::filesystem::path path(const char* name) const {
        return folder_.path() / name;
    }
    const TemporaryFolder folder_;
    std::optional<ServerProcess> busy_, quiet_;
};

/// Measures times from a write to its acknowledgement, one after the other, until `isOver`.
template <class IsOver>
std::vector<float> probe(LiveClient& editor, IsOver isOver) {
    std::vector<float> times;
    for (int round = 0; !isOver(); ++round) {
        const auto begin = Clock::now();
        editor.layer->SetField(pxr::SdfPath(attributePath(round % kFields)),
                               pxr::SdfFieldKeys->Default, pxr::VtValue(pxr::GfVec3d(round, 1, 2)));
        if (!editor.client->flush(30'000)) throw std::runtime_error("an edit is not acknowledged");
        times.push_back(float(millisecondsSince(begin)));
        std::this_thread::sleep_for(kPause);
    }
    return times;
}

auto after(double seconds) {
    return [seconds, begin = Clock::now()] { return millisecondsSince(begin) > seconds * 1000; };
}

nlohmann::ordered_json figures(std::vector<float> times) {
    const double longest = times.empty() ? 0 : *std::max_element(times.begin(), times.end());
    return {{"p50Ms", percentile(times, 0.5)},
            {"p99Ms", percentile(times, 0.99)},
            {"maxMs", longest},
            {"count", times.size()}};
}

nlohmann::ordered_json alone(const Plan& plan) {
    Setting setting(true, kFields);
    LiveClient editor(setting.quietUrl());
    editor.open();
    return figures(probe(editor, after(plan.seconds)));
}

nlohmann::ordered_json besideWriters(const Plan& plan, bool isOneProcess) {
    Setting setting(isOneProcess, kFields);
    LiveClient editor(setting.quietUrl());
    editor.open();
    LoadPlan load;
    load.connections = load.writers = plan.writers;
    load.seconds = plan.seconds + 1;
    std::thread writers([&] {
        UsdliveDialect dialect(plan.edits, kFields, true, setting.busyPath());
        (void)runLoad(load, dialect, setting.busy().port(), setting.busy().process());
    });
    std::this_thread::sleep_for(std::chrono::seconds(1));
    auto found = figures(probe(editor, after(plan.seconds)));
    writers.join();
    return found;
}

/// The other editor is this program, started again, so that its work delays nothing here.
void runHuge(char** argv) {
    LiveClient author(argv[2]);
    author.open();
    const int edits = std::stoi(argv[3]);
    {
        const pxr::SdfChangeBlock block;
        for (int i = 0; i < edits; ++i)
            author.layer->SetField(pxr::SdfPath(attributePath(i)), pxr::SdfFieldKeys->Default,
                                   pxr::VtValue(pxr::GfVec3d(i, 3, 4)));
    }
    if (!author.client->flush(300'000)) throw std::runtime_error("the huge edit is not committed");
}

nlohmann::ordered_json besideHuge(const Plan& plan, bool isOneProcess) {
    Setting setting(isOneProcess, plan.huge);
    joinElsewhere(setting.busyUrl());
    LiveClient editor(setting.quietUrl());
    editor.open();
    ChildProcess author({besideThisProgram("bench_projects"), "--huge-author", setting.busyUrl(),
                         std::to_string(plan.huge)},
                        {});
    auto found = figures(probe(editor, [&] { return !author.isRunning(); }));
    if (!author.succeeded()) throw std::runtime_error("the author of the huge edit failed");
    return found;
}

std::size_t residentKib(pid_t process) {
    std::ifstream file("/proc/" + std::to_string(process) + "/status");
    for (std::string word; file >> word;)
        if (std::size_t kib = 0; word == "VmRSS:" && file >> kib) return kib;
    return 0;
}

double idleKib(const Plan& plan) {
    const auto resident = [](int count) {
        const TemporaryFolder folder;
        std::vector<std::string> options{"--min-free-mib=1"};
        for (int index = 0; index <= count; ++index) {
            const auto path = folder.path() / ("p" + std::to_string(index));
            std::filesystem::create_directory(path);
            writeLayer(path, kFields);
            if (index > 0) options.push_back(path.string());
        }
        ServerProcess server(folder.path() / "p0", options, {});
        std::this_thread::sleep_for(std::chrono::seconds(3));
        return double(residentKib(server.process().pid()));
    };
    return (resident(plan.idle) - resident(0)) / plan.idle;
}

}  // namespace

int main(int argc, char** argv) {
    return runBench("projects", [&] {
        if (isJoin(argc, argv)) return runJoin(argv);
        if (argc == 4 && std::string_view(argv[1]) == "--huge-author") return runHuge(argv);
        Arguments arguments(argc, argv);
        Plan plan;
        plan.writers = arguments.number("--writers", plan.writers);
        plan.edits = arguments.number("--edits", plan.edits);
        plan.seconds = arguments.number("--seconds", plan.seconds);
        plan.huge = arguments.number("--huge", plan.huge);
        plan.idle = arguments.number("--idle", plan.idle);
        arguments.finish();
        loadUsd();
        using Json = nlohmann::ordered_json;
        print(Json{{"bench", "projects"}, {"load", "none"}, {"alone", alone(plan)}}.dump());
        print(Json{{"bench", "projects"},
                   {"load", "writers"},
                   {"same", besideWriters(plan, true)},
                   {"other", besideWriters(plan, false)}}
                  .dump());
        print(Json{{"bench", "projects"},
                   {"load", "huge"},
                   {"same", besideHuge(plan, true)},
                   {"other", besideHuge(plan, false)}}
                  .dump());
        print(Json{{"bench", "projects"}, {"idle", plan.idle}, {"kib", idleKib(plan)}}.dump());
    });
}
