// Measures how long one edit of a LayerDoc takes.
#include "usdlive/common/layer/LayerDoc.h"

#include <benchmark/benchmark.h>

#include <string>
#include <vector>

#include "usdlive/common/layer/TransactionExecutor.h"

using namespace usdlive;

namespace {

const CreateSpec kPrim{SpecKind::Prim}, kAttribute{SpecKind::Attribute};

SetField setDouble(const char* field, double number) {
    return {field, {}, doubleValue(number), ValueType::None};
}

// Creates `wide` prims with one attribute each, below /World/set.
LayerDoc makeDoc(int wide, std::vector<std::string>* attributes = nullptr) {
    LayerDoc doc;
    (void)doc.apply("/World", kPrim);
    (void)doc.apply("/World/set", kPrim);
    for (int i = 0; i < wide; ++i) {
        const std::string prim = "/World/set/prim_" + std::to_string(i);
        (void)doc.apply(prim, kPrim);
        (void)doc.apply(prim + ".size", kAttribute);
        (void)doc.apply(prim + ".size", setDouble("default", i));
        if (attributes) attributes->push_back(prim + ".size");
    }
    return doc;
}

void setFieldInPlace(benchmark::State& state) {
    std::vector<std::string> attributes;
    LayerDoc doc = makeDoc(static_cast<int>(state.range(0)), &attributes);
    double number = 0;
    std::size_t at = 0;
    for (auto _ : state) {
        at = (at + 7919) % attributes.size();
        benchmark::DoNotOptimize(doc.apply(attributes[at], setDouble("default", ++number)));
    }
}
BENCHMARK(setFieldInPlace)->Arg(10)->Arg(1000)->Arg(100000);

void setFieldOfAFreshCopy(benchmark::State& state) {
    std::vector<std::string> attributes;
    LayerDoc doc = makeDoc(static_cast<int>(state.range(0)), &attributes);
    double number = 0;
    for (auto _ : state) {
        const LayerDoc copy = doc;
        benchmark::DoNotOptimize(doc.apply(attributes[0], setDouble("default", ++number)));
    }
}
BENCHMARK(setFieldOfAFreshCopy)->Arg(10)->Arg(1000)->Arg(100000);

void differenceOfOneValue(benchmark::State& state) {
    std::vector<std::string> attributes;
    const LayerDoc from = makeDoc(static_cast<int>(state.range(0)), &attributes);
    LayerDoc to = from;
    (void)to.apply(attributes[attributes.size() / 2], setDouble("default", -1));
    for (auto _ : state) benchmark::DoNotOptimize(difference(from, to));
}
BENCHMARK(differenceOfOneValue)->Arg(10)->Arg(1000)->Arg(100000);

void renameAmongMany(benchmark::State& state) {
    LayerDoc doc = makeDoc(static_cast<int>(state.range(0)));
    std::string name = "prim_1";
    bool flip = false;
    for (auto _ : state) {
        flip = !flip;
        const std::string next = flip ? "renamed" : "prim_1";
        benchmark::DoNotOptimize(
            doc.apply("/World/set/" + name, MoveSpec{{"/World/set", {}}, next}));
        name = next;
    }
}
BENCHMARK(renameAmongMany)->Arg(10)->Arg(1000)->Arg(100000);

void createAndDelete(benchmark::State& state) {
    LayerDoc doc = makeDoc(static_cast<int>(state.range(0)));
    for (auto _ : state) {
        benchmark::DoNotOptimize(doc.apply("/World/set/new", kPrim));
        benchmark::DoNotOptimize(doc.apply("/World/set/new", DeleteSpec{}));
    }
}
BENCHMARK(createAndDelete)->Arg(10)->Arg(1000)->Arg(100000);

void executeOneValue(benchmark::State& state) {
    std::vector<std::string> attributes;
    LayerDocs layers{{{"a.usda"}, makeDoc(1000, &attributes)}};
    NamespaceLog log;
    OwnCreations creations;
    Revision revision = 1;
    for (int i = 0; i < state.range(0); ++i)
        log.recordMove(revision, {"a.usda"}, "/Other/p" + std::to_string(i), "/Other/q");
    Transaction transaction{{{"me"}, 1}, 0, 0, {}};
    transaction.edits = {{{"a.usda"}, {attributes[500], {}}, setDouble("default", 0)}};
    double number = 0;
    for (auto _ : state) {
        std::get<SetField>(transaction.edits[0].action).value = doubleValue(++number);
        benchmark::DoNotOptimize(execute(layers, log, creations, transaction, revision + 1));
    }
}
BENCHMARK(executeOneValue)->ArgName("movesSinceBase")->Arg(0)->Arg(100)->Arg(10000);

void executeManyDeletes(benchmark::State& state) {
    std::vector<std::string> attributes;
    const LayerDoc doc = makeDoc(static_cast<int>(state.range(0)), &attributes);
    Transaction transaction{{{"me"}, 1}, 0, 0, {}};
    for (const auto& path : attributes)
        transaction.edits.push_back({{"a.usda"}, {specpath::parent(path), {}}, DeleteSpec{}});
    for (auto _ : state) {
        LayerDocs layers{{{"a.usda"}, doc}};
        NamespaceLog log;
        OwnCreations creations;
        benchmark::DoNotOptimize(execute(layers, log, creations, transaction, 1));
    }
}
BENCHMARK(executeManyDeletes)->Arg(100)->Arg(10000)->Unit(benchmark::kMillisecond);

}  // namespace

BENCHMARK_MAIN();
