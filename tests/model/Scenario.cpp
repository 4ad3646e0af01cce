// The scenarios that the model searches.
#include "Scenario.h"

#include "usdlive/common/core/ByteStream.h"

namespace usdlive::model {

using client::AuthoredEdit;

namespace {

constexpr const char* kValue = "default";

Value labelValue(Label label) {
    Bytes bytes;
    appendNumber<std::uint32_t>(bytes, label);
    return {ValueType::Int, std::move(bytes)};
}

AuthoredEdit edit(const std::string& path, EditAction action) {
    return {kLayer, path, std::move(action)};
}
AuthoredEdit set(const std::string& path, Label label) {
    return edit(path, SetField{kValue, {}, labelValue(label), {}});
}
// An edit for labels, in a register of its own, for an edit that has no value to carry the label.
AuthoredEdit note(Label label) {
    return edit("/", SetField{"customLayerData",
                              DictionaryKey{{"edit" + std::to_string(label)}},
                              labelValue(label),
                              {}});
}

const std::string* firstOf(const std::vector<std::string>& paths, const LayerDoc& seen) {
    for (const std::string& path : paths)
        if (seen.has(path)) return &path;
    return nullptr;
}

// Sets the first property of `paths` that exists.
Write sets(std::vector<std::string> paths) {
    return [paths](const LayerDoc& seen, Label label) -> std::vector<AuthoredEdit> {
        const std::string* path = firstOf(paths, seen);
        if (!path) return {};
        return {set(*path, label)};
    };
}
Write moves(std::string from, std::string name) {
    return [from, name](const LayerDoc& seen, Label label) -> std::vector<AuthoredEdit> {
        if (!seen.has(from) || seen.has("/" + name)) return {};
        return {edit(from, MoveSpec{{"/", {}}, name}), note(label)};
    };
}
Write deletes(std::vector<std::string> paths) {
    return [paths](const LayerDoc& seen, Label label) -> std::vector<AuthoredEdit> {
        const std::string* path = firstOf(paths, seen);
        if (!path) return {};
        return {note(label), edit(*path, DeleteSpec{})};
    };
}
// Creates a prim with a property that has a value.
Write creates(std::string prim) {
    return [prim](const LayerDoc& seen, Label label) -> std::vector<AuthoredEdit> {
        if (seen.has(prim)) return {};
        return {edit(prim, CreateSpec{SpecKind::Prim}),
                edit(prim + ".x", CreateSpec{SpecKind::Attribute}), set(prim + ".x", label)};
    };
}

}  // namespace

LayerDoc startingLayer() {
    LayerDoc doc;
    for (const char* prim : {"/P", "/Q"}) {
        (void)doc.apply(prim, CreateSpec{SpecKind::Prim});
        (void)doc.apply(std::string(prim) + ".x", CreateSpec{SpecKind::Attribute});
    }
    return doc;
}

std::optional<Label> labelOf(const EditAction& action) {
    const auto* set = std::get_if<SetField>(&action);
    const Value* value = set ? set->value.as<Value>() : nullptr;
    if (!value || value->type() != ValueType::Int) return std::nullopt;
    return Label(value->bytes()[0]);
}

const std::vector<Scenario>& scenarios() {
    static const std::vector<Scenario> all{
        // Both write one register, message by message and tick by tick.
        {.name = "ticks",
         .scripts = {{{sets({"/P.x"})}, {sets({"/P.x"})}}},
         .bounds = {.breaks = {1, 0}, .deaths = 1},
         .ownTicks = true},
        // More writes of this kind; both clients reconnect.
        {.name = "values",
         .scripts = {{{sets({"/P.x"}), sets({"/P.x"})}, {sets({"/P.x"})}}},
         .bounds = {.breaks = {1, 1}}},
        // Both move another prim to the same name; the second move is refused (M5), with later work
        // on the prim.
        {.name = "refusals",
         .scripts = {{{moves("/P", "R"), sets({"/R.x", "/P.x"})},
                      {moves("/Q", "R"), sets({"/R.x", "/Q.x"})}}},
         .bounds = {.breaks = {1, 0}}},
        // Work on a spec that is meanwhile moved and deleted (M3, M4).
        {.name = "names",
         .scripts = {{{moves("/P", "R"), deletes({"/R", "/P"})},
                      {sets({"/R.x", "/P.x"}), sets({"/R.x", "/P.x"})}}},
         .bounds = {.deaths = 1}},
        // Work on a spec that is not acknowledged yet and that another client deletes (M2-M4).
        {.name = "creations",
         .scripts = {{{creates("/N"), sets({"/N.x"})}, {deletes({"/N", "/P"}), creates("/N")}}},
         .bounds = {.deaths = 1}},
        // Begins with an unopened file, which is imported while it is already edited.
        {.name = "joining",
         .scripts = {{{sets({"/P.x"})}, {deletes({"/P"})}}},
         .bounds = {.deaths = 1, .diskFulls = 1},
         .joined = false},
        // A disk that takes no more, for a moment or until it is opened again (SE8, SE12).
        {.name = "disk",
         .scripts = {{{sets({"/P.x"}), moves("/P", "R")}, {sets({"/R.x", "/P.x"})}}},
         .bounds = {.breaks = {0, 1}, .diskFulls = 1, .diskFailures = 1}},
        // The server reads past commits from the store, and carries addresses over one revision
        // only: clients update all other addresses (SE6).
        {.name = "stale",
         .scripts = {{{sets({"/P.x"}), sets({"/P.x"})}, {moves("/P", "R"), sets({"/R.x"})}}},
         .bounds = {.breaks = {1, 0}},
         .readsBack = true,
         .forgetful = true},
        // The layer is closed and opened again while work is on its way.
        {.name = "closing",
         .scripts = {{{sets({"/P.x"}), sets({"/P.x"})}, {sets({"/P.x"})}}},
         .bounds = {.breaks = {1, 0}, .toggles = {2, 0}}},
        // A disk that reported a sync falsely, or an older copy of it: the history that clients
        // have seen is lost (ID2, ID4).
        {.name = "diverged",
         .scripts = {{{sets({"/P.x"}), moves("/P", "R")}, {sets({"/R.x", "/P.x"})}}},
         .bounds = {.rollBacks = 1}},
    };
    return all;
}

const std::vector<Scenario>& flawedScenarios() {
    static const auto flawed = [](const char* name, Flaw flaw, Bounds bounds) {
        return Scenario{.name = name,
                        .scripts = {{{sets({"/P.x"}), sets({"/P.x"})}, {deletes({"/P"})}}},
                        .bounds = bounds,
                        .flaw = flaw};
    };
    static const std::vector<Scenario> all{
        flawed("acksEarly", Flaw::AcksEarly, {.deaths = 1}),
        flawed("reorders", Flaw::Reorders, {}),
        flawed("forgets", Flaw::Forgets, {.breaks = {1, 0}}),
        flawed("hides", Flaw::Hides, {}),
    };
    return all;
}

}  // namespace usdlive::model
