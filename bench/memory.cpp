// Measures the server's memory for a spec with one value.
//
//   --specs=1000000
//
// Creates attributes with a value each, ten for a prim; the prims count as specs, too, and have no
// value. The memory is measured by the server's allocator.
#include <jemalloc/jemalloc.h>

#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

#include "support/Figures.h"
#include "support/Server.h"
#include "usdlive/common/layer/LayerDoc.h"

using namespace usdlive;
using namespace usdlive::bench;

namespace {

std::size_t usedBytes() {
    std::uint64_t epoch = 1;  // makes jemalloc update its figures
    std::size_t bytes = 0, size = sizeof bytes;
    if (mallctl("epoch", nullptr, nullptr, &epoch, sizeof epoch) != 0 ||
        mallctl("stats.allocated", &bytes, &size, nullptr, 0) != 0)
        throw std::runtime_error("cannot read the allocator's figures");
    return bytes;
}

void apply(LayerDoc& doc, const std::string& path, const EditAction& action) {
    if (const auto applied = doc.apply(path, action); !applied)
        throw std::runtime_error(applied.error().message);
}

void measure(const char* name, int specs, const Value& value) {
    const auto before = usedBytes();
    LayerDoc doc;
    apply(doc, "/World", CreateSpec{SpecKind::Prim});
    for (int i = 0; doc.specCount() < static_cast<std::size_t>(specs); ++i) {
        const std::string path = attributePath(i);
        if (i % kAttributesPerPrim == 0)
            apply(doc, path.substr(0, path.find('.')), CreateSpec{SpecKind::Prim});
        apply(doc, path, CreateSpec{SpecKind::Attribute});
        // Values that share no memory, as they come from a file or the network.
        const Value own =
            value.type() == ValueType::Double ? doubleValue(i) : Value(value.type(), value.bytes());
        apply(doc, path, SetField{"default", {}, own, ValueType::None});
    }
    const double bytes = double(usedBytes() - before) / double(doc.specCount());
    print(nlohmann::ordered_json{
        {"bench", "memory"}, {"specs", doc.specCount()}, {"bytesPerSpec", bytes}, {"value", name}}
              .dump());
}

}  // namespace

int main(int argc, char** argv) {
    return runBench("memory", [&] {
        Arguments arguments(argc, argv);
        const int specs = arguments.number("--specs", 1'000'000);
        arguments.finish();
        measure("double", specs, doubleValue(0));
        measure("double3", specs, Value(ValueType::Double3, Bytes(24)));
    });
}
