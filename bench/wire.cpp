// Measures the bytes on the connection for each kind of edit, beside the raw size of what was
// written.
//
//   --times=200
//
// An author and a colleague are connected through relays that count the bytes of the sockets. The
// author writes `times` frames of each kind, and waits after each until both have the commit.
// `up` and `down` are the author's bytes for each edit, `downToOthers` the colleague's. `first` is
// the first frame of its kind, whose names the connection does not know.
#include <pxr/base/gf/vec3d.h>
#include <pxr/usd/sdf/attributeSpec.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/path.h>
#include <pxr/usd/sdf/primSpec.h>

#include <chrono>
#include <cmath>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <thread>

#include "support/Figures.h"
#include "support/LiveClient.h"
#include "support/Relay.h"
#include "support/Server.h"

using namespace usdlive::bench;

namespace {

constexpr int kPrims = 100;

std::string primPath(int index) {
    return "/World/Set/Chair_" + std::to_string(1'000 + index % kPrims);
}

void writeScene(const std::filesystem::path& folder) {
    std::ofstream file(folder / usdlive::bench::kLayer.value);
    file << "#usda 1.0\n\ndef Xform \"World\"\n{\n    def Xform \"Set\"\n    {\n";
    for (int index = 0; index < kPrims; ++index)
        file << "        def Xform \"" << pxr::SdfPath(primPath(index)).GetName() << "\"\n"
             << "        {\n            double3 xformOp:translate = (0, 0, 0)\n        }\n";
    file << "    }\n}\n";
    file.close();
    if (!file) throw std::runtime_error("cannot write the layer");
}

struct Bytes {
    std::uint64_t up, down, others;
};

class Pair {
public:
    explicit Pair(std::uint16_t port)
        : toAuthor_(port), toOther_(port), author_(toAuthor_.url()), other_(toOther_.url()) {
        author_.open();
        other_.open();
        settle();
    }

    [[nodiscard]] pxr::SdfLayer& layer() { return *author_.layer; }

    /// Sends what the author wrote. Returns the bytes that it took.
    Bytes send() {
        const Bytes before = bytes();
        settle();
        const Bytes after = bytes();
        return {after.up - before.up, after.down - before.down, after.others - before.others};
    }

private:
    [[nodiscard]] Bytes bytes() const {
        return {toAuthor_.bytesUp(), toAuthor_.bytesDown(), toOther_.bytesDown()};
    }
    void settle() {
        const auto begin = Clock::now();
        author_.client->tick(100);
        while (author_.client->pendingTransactions() > 0 ||
               other_.client->revision() != author_.client->revision()) {
            author_.client->tick(100);
            other_.client->tick(100);
            std::this_thread::sleep_for(std::chrono::microseconds(200));
            if (millisecondsSince(begin) > 10'000) throw std::runtime_error("an edit is missing");
        }
    }

    Relay toAuthor_, toOther_;
    LiveClient author_, other_;
};

struct Kind {
    const char* name;
    int edits;  ///< in a frame
    int raw;    ///< bytes of the content of an edit
    std::function<void(pxr::SdfLayer&, int time)> write;
};

pxr::SdfPath translateOf(int index) { return pxr::SdfPath(primPath(index) + ".xformOp:translate"); }

void setTranslate(pxr::SdfLayer& layer, int index, int time) {
    layer.SetField(translateOf(index), pxr::SdfFieldKeys->Default,
                   pxr::VtValue(pxr::GfVec3d(time + 0.5, index, 0.25)));
}

void setAll(pxr::SdfLayer& layer, int count, int time) {
    const pxr::SdfChangeBlock block;
    for (int index = 0; index < count; ++index) setTranslate(layer, index, time);
}

std::vector<Kind> kinds() {
    return {
        {"transform", 1, 24, [](auto& layer, int time) { setTranslate(layer, 1, time); }},
        {"transformOfAnother", 1, 24,
         [](auto& layer, int time) { setTranslate(layer, time, time); }},
        {"transforms", 50, 24, [](auto& layer, int time) { setAll(layer, 50, time); }},
        {"key", 1, 32,
         [](auto& layer, int time) {
             layer.SetTimeSample(translateOf(2), double(time), pxr::GfVec3d(time, 1, 2));
         }},
        {"text", 1, 10,
         [](auto& layer, int time) {
             layer.SetField(pxr::SdfPath(primPath(3)), pxr::SdfFieldKeys->Comment,
                            pxr::VtValue("version " + std::to_string(10 + time % 90)));
         }},
        {"rename", 1, 10,
         [](auto& layer, int time) {
             const auto from = time % 2 == 0 ? primPath(4) : "/World/Set/Table_1004";
             const char* to = time % 2 == 0 ? "Table_1004" : "Chair_1004";
             layer.GetPrimAtPath(pxr::SdfPath(from))->SetName(to);
         }},
        {"newPrim", 1, 10,
         [](auto& layer, int time) {
             const auto parent = layer.GetPrimAtPath(pxr::SdfPath("/World/Set"));
             pxr::SdfPrimSpec::New(parent, "Lamp_" + std::to_string(10'000 + time),
                                   pxr::SdfSpecifierDef, "Xform");
         }},
    };
}

void measure(Pair& pair, const Kind& kind, int times) {
    const auto frame = [&](int time) {
        kind.write(pair.layer(), time);
        return pair.send();
    };
    const Bytes first = frame(0);
    constexpr int kWarmUp = 2 * kPrims;  // until the connection knows the names
    for (int time = 1; time <= kWarmUp; ++time) frame(time);
    Bytes sum{};
    for (int time = 1; time <= times; ++time) {
        const Bytes one = frame(kWarmUp + time);
        sum = {sum.up + one.up, sum.down + one.down, sum.others + one.others};
    }
    const double edits = double(times) * kind.edits;
    const auto each = [](double bytes, double count) {
        return std::round(bytes / count * 10) / 10;
    };
    print(nlohmann::ordered_json{{"bench", "wire"},
                                 {"edit", kind.name},
                                 {"editsInAFrame", kind.edits},
                                 {"raw", kind.raw},
                                 {"up", each(double(sum.up), edits)},
                                 {"down", each(double(sum.down), edits)},
                                 {"downToOthers", each(double(sum.others), edits)},
                                 {"firstUp", each(double(first.up), kind.edits)},
                                 {"firstDown", each(double(first.down), kind.edits)},
                                 {"firstDownToOthers", each(double(first.others), kind.edits)}}
              .dump());
}

}  // namespace

int main(int argc, char** argv) {
    return runBench("wire", [&] {
        Arguments arguments(argc, argv);
        const int times = arguments.number("--times", 200);
        arguments.finish();
        const TemporaryFolder folder;
        writeScene(folder.path());
        ServerProcess server(folder.path(), {"--min-free-mib=1"}, {});
        Pair pair(server.port());
        for (const Kind& kind : kinds()) measure(pair, kind, times);
    });
}
