#include "usdlive/server/project/StateChanges.h"

#include <gtest/gtest.h>

#include <random>

namespace usdlive::server {
namespace {

/// The least a store has to do with changes.
class StoredState {
public:
    void apply(const std::vector<StateChange>& changes) {
        for (const StateChange& change : changes)
            std::visit([this](const auto& one) { apply(one); }, change);
    }
    [[nodiscard]] LayerDoc doc() const {
        LayerDoc::Builder builder;
        std::vector<NodeId> open{kRootNode};
        while (!open.empty()) {
            const NodeId parent = open.back();
            open.pop_back();
            for (const auto& [node, put] : nodes_) {
                if (put.parent != parent) continue;
                const auto added = builder.addSpec(node, parent, put.order, put.kind, put.name);
                EXPECT_TRUE(added) << added.error().message;
                open.push_back(node);
            }
        }
        for (const auto& [key, value] : fields_) {
            const auto added = builder.addField(key.first, key.second, value);
            EXPECT_TRUE(added) << added.error().message;
        }
        return builder.finish();
    }

private:
    using Key = std::pair<NodeId, std::string>;

    void apply(const PutNode& put) { nodes_[put.node] = put; }
    void apply(const EraseNodes& erased) {
        for (const NodeId node : erased.nodes) {
            nodes_.erase(node);
            std::erase_if(fields_, [node](const auto& field) { return field.first.first == node; });
        }
    }
    void apply(const PutField& put) { fields_[{put.node, put.field}] = put.value; }
    void apply(const server::EraseField& erased) { fields_.erase({erased.node, erased.field}); }
    void apply(const PutLayer&) { FAIL() << "edits do not bring in a layer"; }
    void apply(const PutSample& put) {
        auto& field = fields_[{put.node, put.field}];
        if (!field.as<TimeSamples>()) field = TimeSamples{};
        auto& samples = field.as<TimeSamples>()->samples;
        std::erase_if(samples, [&](const auto& sample) { return sample.first == put.time; });
        samples.emplace_back(put.time, put.value);
        std::sort(samples.begin(), samples.end(),
                  [](const auto& left, const auto& right) { return left.first < right.first; });
    }
    void apply(const EraseSample& erased) {
        auto& samples = fields_.at({erased.node, erased.field}).as<TimeSamples>()->samples;
        std::erase_if(samples, [&](const auto& sample) { return sample.first == erased.time; });
    }

    std::map<NodeId, PutNode> nodes_;
    std::map<Key, FieldValue> fields_;
};

const LayerId kEdited{"a.usda"};

class Random {
public:
    explicit Random(std::uint64_t seed) : engine_(seed) {}
    std::size_t below(std::size_t end) { return engine_() % end; }
    template <class T>
    const T& of(const std::vector<T>& values) {
        return values[below(values.size())];
    }

private:
    std::mt19937_64 engine_;
};

std::vector<std::string> pathsOf(const LayerDoc& doc, SpecKind kind) {
    std::vector<std::string> paths;
    doc.visit([&](const LayerDoc::SpecView& spec) {
        if (spec.kind == kind) paths.emplace_back(spec.path);
    });
    if (kind == SpecKind::Prim) paths.emplace_back("/");
    return paths;
}

std::string child(const std::string& parent, const std::string& name) {
    return parent == "/" ? "/" + name : parent + "/" + name;
}

/// Paths are those before the transaction, so that some edits are dropped or carried over its
/// moves.
Edit randomEdit(Random& random, const LayerDoc& doc) {
    static const std::vector<std::string> kNames{"A", "B", "C", "D", "E"};
    const auto prims = pathsOf(doc, SpecKind::Prim);
    const auto attributes = pathsOf(doc, SpecKind::Attribute);
    const std::string prim = random.of(prims);
    const std::string attribute = attributes.empty() ? prim : random.of(attributes);
    const auto number = doubleValue(double(random.below(4)));
    const double time = double(random.below(4));
    const Value token = tokenValue(random.of(kNames));
    switch (random.below(14)) {
        case 0:
        case 1:
            return {kEdited, {child(prim, random.of(kNames)), {}}, CreateSpec{SpecKind::Prim}};
        case 2:
        case 3:
            return {kEdited, {prim + ".x", {}}, CreateSpec{SpecKind::Attribute}};
        case 4:
            return {kEdited, {prim, {}}, DeleteSpec{}};
        case 5:
            return {kEdited, {prim, {}}, MoveSpec{{random.of(prims), {}}, random.of(kNames)}};
        case 6:
            return {kEdited, {prim, {}}, PlaceSpec{random.of(kNames)}};
        case 7:
            return {kEdited, {attribute, {}}, SetField{"default", {}, number, {}}};
        case 8:
            return {
                kEdited, {attribute, {}}, SetField{"timeSamples", SampleTime{time}, number, {}}};
        case 9:
            return {kEdited, {attribute, {}}, usdlive::EraseField{"timeSamples", SampleTime{time}}};
        case 10:
            return {kEdited,
                    {attribute, {}},
                    SetField{random.below(2) ? "timeSamples" : "customData",
                             DictionaryKey{{random.of(kNames)}},
                             number,
                             {}}};
        case 11:
            return {
                kEdited,
                {prim, {}},
                SetField{
                    "apiSchemas", ListItem{ListName::Appended, token, {}}, {}, ValueType::Token}};
        case 12:
            return {kEdited,
                    {prim, {}},
                    usdlive::EraseField{"apiSchemas", ListItem{ListName::Appended, token, {}}}};
        default:
            return {kEdited,
                    {attribute, {}},
                    usdlive::EraseField{random.below(2) ? "timeSamples" : "customData",
                                        std::monostate{}}};
    }
}

TEST(StateChanges, TheStateFollowsTheLayerWhateverIsExecuted) {
    std::size_t executedEdits = 0;
    for (std::uint64_t seed = 1; seed <= 60; ++seed) {
        Random random(seed);
        LayerDocs layers;
        layers[kEdited] = LayerDoc();
        NamespaceLog log;
        OwnCreations creations;
        StoredState state;
        for (Revision revision = 1; revision <= 40; ++revision) {
            Transaction transaction{{{"c"}, revision}, revision - 1, 0, {}};
            for (std::size_t count = random.below(12) + 1; count > 0; --count)
                transaction.edits.push_back(randomEdit(random, layers[kEdited]));
            const Outcome outcome = execute(layers, log, creations, transaction, revision);
            const auto* executed = std::get_if<Executed>(&outcome);
            if (!executed) continue;
            executedEdits += executed->edits.size();
            state.apply(stateChanges(layers, executed->edits));
            ASSERT_EQ(state.doc(), layers[kEdited])
                << "seed " << seed << ", revision " << revision << "\n"
                << state.doc().dump() << "\n"
                << layers[kEdited].dump();
        }
    }
    EXPECT_GT(executedEdits, 3'000u);
}

class StateOfOneLayer : public ::testing::Test {
protected:
    void SetUp() override { layers[kEdited] = LayerDoc(); }
    /// Executes, brings the state up and expects it to be right.
    std::vector<StateChange> execute(std::vector<Edit> edits) {
        const Transaction transaction{{{"c"}, ++revision}, revision - 1, 0, std::move(edits)};
        const Outcome outcome = usdlive::execute(layers, log, creations, transaction, revision);
        const auto changes = stateChanges(layers, std::get<Executed>(outcome).edits);
        state.apply(changes);
        EXPECT_EQ(state.doc(), layers[kEdited]);
        return changes;
    }
    static Edit edit(const std::string& path, EditAction action) {
        return {kEdited, {path, {}}, std::move(action)};
    }
    static std::string prim(int number) { return "/P" + std::to_string(number); }

    LayerDocs layers;
    NamespaceLog log;
    OwnCreations creations;
    StoredState state;
    Revision revision = 0;
};

TEST_F(StateOfOneLayer, AListIsWrittenAnewWhenItsNumbersAre) {
    for (int number = 0; number < 4; ++number) execute({edit(prim(number), CreateSpec{})});
    bool renumbered = false;
    for (int round = 0; round < 200; ++round) {
        // Each goes between the two before it.
        const std::string before = "P" + std::to_string((round + 1) % 3);
        renumbered |= execute({edit(prim(round % 3), PlaceSpec{before})}).size() > 1;
    }
    EXPECT_TRUE(renumbered);
}

TEST_F(StateOfOneLayer, ARenumberedListWhoseParentMovesLaterInTheCommit) {
    execute({edit("/A", CreateSpec{}), edit("/B", CreateSpec{})});
    for (int number = 0; number < 4; ++number) execute({edit("/A" + prim(number), CreateSpec{})});
    std::vector<Edit> edits;
    for (int round = 0; round < 200; ++round)
        edits.push_back(
            edit("/A" + prim(round % 3), PlaceSpec{"P" + std::to_string((round + 1) % 3)}));
    edits.push_back(edit("/A/P0", DeleteSpec{}));
    edits.push_back(edit("/A", MoveSpec{{"/B", {}}, "C"}));
    execute(std::move(edits));
}

TEST_F(StateOfOneLayer, ManyMovesAndPartsInOneCommit) {
    std::vector<Edit> create, change;
    for (int number = 0; number < 300; ++number) {
        create.push_back(edit(prim(number), CreateSpec{}));
        change.push_back(edit(
            prim(number), SetField{"customData", DictionaryKey{{"k"}}, doubleValue(number), {}}));
        change.push_back(edit(prim(number), MoveSpec{{"/", {}}, "Q" + std::to_string(number)}));
        if (number % 10 == 0) change.push_back(edit(prim(number), DeleteSpec{}));
    }
    execute(std::move(create));
    execute(std::move(change));
}

TEST_F(StateOfOneLayer, WhatIsSetInPartsIsWrittenOnce) {
    execute({edit("/A", CreateSpec{})});
    std::vector<Edit> edits;
    for (int number = 0; number < 100; ++number)
        edits.push_back(edit(
            "/A",
            SetField{
                "customData", DictionaryKey{{std::to_string(number)}}, doubleValue(number), {}}));
    EXPECT_EQ(execute(std::move(edits)).size(), 1u);
}

}  // namespace
}  // namespace usdlive::server
