// Measures the server's cost of importing a layer from its file, and of saving a big one.
//
//   --mib=100  --formats=usda,usdc  --fields=1000000
//
// save: an editor authors `mib` of points in four arrays and saves them; `plainMs` is Sdf's own
// Export of the same layer, which does not read the file back. `serverMib` is the server's peak
// memory minus its memory before. `saveAgainMs` is a second save, which replaces a file of that
// size. Meanwhile another author edits another layer, one edit after the other: `editMs` is from an
// edit to its acknowledgement, `quietEditMs` the same before the save. import: the server imports a
// `.usda` of `fields` double3 and serves it to another process.
#include <pxr/base/gf/vec3f.h>
#include <pxr/base/vt/array.h>
#include <pxr/usd/sdf/attributeSpec.h>
#include <pxr/usd/sdf/path.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/schema.h>

#include <chrono>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <thread>
#include <variant>
#include <vector>

#include "support/Figures.h"
#include "support/LiveClient.h"
#include "support/Server.h"

using namespace usdlive::bench;
namespace event = usdlive::client::event;

namespace {

namespace fs = std::filesystem;

constexpr int kArrays = 4;
constexpr const char* kOther = "other.usda";
const pxr::SdfPath kEdited("/Edited.value");

/// Reads the memory of a process as the kernel counts it.
class Memory {
public:
    explicit Memory(pid_t process) : folder_("/proc/" + std::to_string(process)) {
        std::ofstream(folder_ / "clear_refs") << "5";  // resets the peak
        before_ = mib("VmRSS");
    }
    [[nodiscard]] double before() const { return before_; }
    [[nodiscard]] double peak() const { return mib("VmHWM"); }

private:
    [[nodiscard]] double mib(const std::string& name) const {
        std::ifstream status(folder_ / "status");
        for (std::string line; std::getline(status, line);)
            if (line.starts_with(name)) return std::stod(line.substr(name.size() + 1)) / 1024;
        throw std::runtime_error("cannot read " + name + " from /proc");
    }

    const fs::path folder_;
    double before_ = 0;
};

void writePoints(const pxr::SdfLayerHandle& layer, int mib) {
    const auto mesh = pxr::SdfCreatePrimInLayer(layer, pxr::SdfPath("/Mesh"));
    const std::size_t count = std::size_t(mib) * 1024 * 1024 / sizeof(pxr::GfVec3f) / kArrays;
    for (int part = 0; part < kArrays; ++part) {
        pxr::VtArray<pxr::GfVec3f> points(count);
        for (std::size_t i = 0; i < count; ++i)
            points[i] = pxr::GfVec3f(float(i) * 0.1f + float(part), float(i % 1000) / 7.0f,
                                     -float(i) * 0.001f);
        pxr::SdfAttributeSpec::New(mesh, "points" + std::to_string(part),
                                   pxr::SdfValueTypeNames->Point3fArray)
            ->SetDefaultValue(pxr::VtValue::Take(points));
    }
}

/// Another author, who sets one number again and again.
class Author {
public:
    explicit Author(const std::string& url) : live_(url) {
        live_.layer = live_.client->openLayer({kOther}).value();
    }
    /// Makes one edit. Returns the time until the server has acknowledged it.
    double edit() {
        const auto begin = Clock::now();
        live_.layer->SetField(kEdited, pxr::SdfFieldKeys->Default, pxr::VtValue(++number_));
        if (!live_.client->flush()) throw std::runtime_error("an edit is not acknowledged");
        return millisecondsSince(begin);
    }

private:
    LiveClient live_;
    double number_ = 0;
};

struct Latencies {
    std::vector<float> edits;
    [[nodiscard]] nlohmann::ordered_json figures() {
        return {{"median", percentile(edits, 0.5)},
                {"longest", percentile(edits, 1)},
                {"edits", edits.size()}};
    }
};
template <class Done>
Latencies editUntil(Author& author, const Done& done) {
    Latencies latencies;
    while (!done()) {
        latencies.edits.push_back(float(author.edit()));
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return latencies;
}

void measureSave(const std::string& format, int mib) {
    const TemporaryFolder folder;
    const usdlive::LayerId id{"points." + format};
    const fs::path file = folder.path() / id.value;
    pxr::SdfLayer::CreateNew(file.string())->Save();
    std::ofstream(folder.path() / kOther)
        << "#usda 1.0\ndef \"Edited\"\n{\n    custom double value = 0\n}\n";
    ServerProcess server(folder.path(), {"--min-free-mib=1"}, {});

    LiveClient editor(server.url());
    editor.layer = editor.client->openLayer(id).value();
    writePoints(editor.layer, mib);
    if (!editor.client->flush(120'000)) throw std::runtime_error("the points are not acknowledged");
    Author other(server.url());
    auto begin = Clock::now();
    Latencies quiet = editUntil(other, [&] { return millisecondsSince(begin) > 2'000; });

    std::optional<usdlive::LayersSaved> saved;
    editor.client->setEventHandler([&](const usdlive::client::Event& one) {
        if (const auto* done = std::get_if<event::Saved>(&one)) saved = done->answer;
    });
    const Memory memory(server.process().pid());
    const double cpu = server.process().cpuSeconds();
    begin = Clock::now();
    editor.client->save({id});
    Latencies beside = editUntil(other, [&] {
        editor.client->tick();
        return saved.has_value();
    });
    const double saveMs = millisecondsSince(begin);
    const double cpuMs = (server.process().cpuSeconds() - cpu) * 1000;
    if (!saved->failed.empty()) throw std::runtime_error(saved->failed[0].message);

    editor.layer->SetField(pxr::SdfPath("/Mesh"), pxr::SdfFieldKeys->Active, pxr::VtValue(true));
    begin = Clock::now();
    if (!editor.client->saveAndWait({id})) throw std::runtime_error("the second save failed");
    const double againMs = millisecondsSince(begin);

    begin = Clock::now();
    if (!editor.layer->Export((folder.path() / ("plain." + format)).string()))
        throw std::runtime_error("Sdf cannot export");
    const double plainMs = millisecondsSince(begin);
    const double fileMib = double(fs::file_size(file)) / (1 << 20);
    print(nlohmann::ordered_json{{"bench", "files"},
                                 {"what", "save"},
                                 {"format", format},
                                 {"mib", mib},
                                 {"fileMib", fileMib},
                                 {"serverMibBefore", memory.before()},
                                 {"serverMib", memory.peak() - memory.before()},
                                 {"saveMs", saveMs},
                                 {"saveAgainMs", againMs},
                                 {"serverCpuMs", cpuMs},
                                 {"plainMs", plainMs},
                                 {"timesPlain", saveMs / plainMs},
                                 {"quietEditMs", quiet.figures()},
                                 {"editMs", beside.figures()}}
              .dump());
}

void measureImport(int fields) {
    const TemporaryFolder folder;
    writeLayer(folder.path(), fields);
    ServerProcess server(folder.path(), {"--min-free-mib=1"}, {});
    const Memory memory(server.process().pid());
    const double cpu = server.process().cpuSeconds();
    const auto begin = Clock::now();
    joinElsewhere(server.url());
    print(nlohmann::ordered_json{
        {"bench", "files"},
        {"what", "import"},
        {"fields", fields},
        {"fileMib", double(fs::file_size(folder.path() / kLayer.value)) / (1 << 20)},
        {"serverMib", memory.peak() - memory.before()},
        {"serverCpuMs", (server.process().cpuSeconds() - cpu) * 1000},
        {"untilJoinedMs", millisecondsSince(begin)}}
              .dump());
}

}  // namespace

int main(int argc, char** argv) {
    return runBench("files", [&] {
        if (isJoin(argc, argv)) return runJoin(argv);
        Arguments arguments(argc, argv);
        const int mib = arguments.number("--mib", 100);
        const int fields = arguments.number("--fields", 1'000'000);
        std::istringstream formats(arguments.text("--formats", "usda,usdc"));
        arguments.finish();
        loadUsd();
        for (std::string format; std::getline(formats, format, ',');)
            if (mib > 0) measureSave(format, mib);
        if (fields > 0) measureImport(fields);
    });
}
