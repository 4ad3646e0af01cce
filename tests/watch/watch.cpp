// A library of C functions over Stage, which Python loads with ctypes beside pxr.Usd. Both then
// work on the same layers, in one process.
#include <pxr/base/tf/errorMark.h>
#include <pxr/usd/sdf/layer.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "client/src/cli/StageDump.h"
#include "usdlive/client/usd/stage/Stage.h"

using namespace usdlive;
using nlohmann::json;

namespace {

struct Watched {
    Watched(const pxr::SdfLayerRefPtr& root, const pxr::SdfLayerRefPtr& session)
        : stage(root, session) {
        subscription = stage.subscribe(
            [this](const stage::StageChanges& changes) { rounds.push_back(record(changes)); });
    }

    // Paths inside prototypes are listed as they are seen from the instances: other programs number
    // prototypes differently.
    [[nodiscard]] json record(const stage::StageChanges& changes) const {
        json resynced = json::array(), info = json::object(), assets = json::array();
        for (const auto& path : changes.resynced)
            for (const auto& at : seen(path)) resynced.push_back(at);
        for (const auto& [path, fields] : changes.changedInfo) {
            json names = json::array();
            for (const auto& field : fields) names.push_back(field.GetString());
            for (const auto& at : seen(path)) info[at] = names;
        }
        for (const auto& path : changes.assetPathsResynced)
            for (const auto& at : seen(path)) assets.push_back(at);
        return {{"resynced", resynced}, {"info", info}, {"assets", assets}};
    }

    [[nodiscard]] std::vector<std::string> seen(const pxr::SdfPath& path) const {
        for (const auto& prototype : stage.prototypes()) {
            if (!path.HasPrefix(prototype.path())) continue;
            std::vector<std::string> paths;
            for (const auto& instance : stage.instances(prototype))
                for (auto& one : seen(path.ReplacePrefix(prototype.path(), instance.path())))
                    paths.push_back(std::move(one));
            return paths;
        }
        if (path.GetString().starts_with("/__Prototype_")) return {};
        return {path.GetString()};
    }

    stage::Stage stage;
    json rounds = json::array();
    stage::Stage::Subscription subscription;
    std::vector<stage::Property> attributes;
    std::string answer;
};

Watched& watched(void* stage) { return *static_cast<Watched*>(stage); }

const char* answered(Watched& stage, const json& answer) {
    stage.answer = answer.dump(-1, ' ', false, json::error_handler_t::replace);
    return stage.answer.c_str();
}

}  // namespace

#define WATCH_EXPORT extern "C" __attribute__((visibility("default")))

// The layers are open already. `session` may be empty.
WATCH_EXPORT void* watch_open(const char* root, const char* session) {
    pxr::TfErrorMark mark;
    pxr::SdfLayerRefPtr ofSession;
    if (*session) ofSession = pxr::SdfLayer::Find(session);
    auto* opened = new Watched(pxr::SdfLayer::Find(root), ofSession);
    mark.Clear();
    return opened;
}
WATCH_EXPORT void watch_close(void* stage) { delete &watched(stage); }

// Everything that the stage shows, as `usdlive dump --composed` prints it.
WATCH_EXPORT const char* watch_dump(void* stage, const char* base) {
    return answered(watched(stage), cli::dumpStage(watched(stage).stage, {.base = base}));
}
// The changes since the last call, one entry for each notice.
WATCH_EXPORT const char* watch_changes(void* stage) {
    return answered(watched(stage), std::exchange(watched(stage).rounds, json::array()));
}
WATCH_EXPORT void watch_load(void* stage, const char* prim, int loads) {
    const auto rule = loads ? stage::LoadRules::Rule::All : stage::LoadRules::Rule::None;
    watched(stage).stage.load(pxr::SdfPath(prim), rule);
}
// Identifiers of layers, one on each line.
WATCH_EXPORT void watch_mute(void* stage, const char* identifiers) {
    std::istringstream lines(identifiers);
    std::vector<std::string> muted;
    for (std::string line; std::getline(lines, line);) muted.push_back(line);
    watched(stage).stage.setMutedLayers(muted);
}

// --- for bench/compose.py ---

// How many prims a traversal visits.
WATCH_EXPORT std::size_t watch_traverse(void* stage) {
    std::size_t prims = 0;
    watched(stage).stage.traverse(stage::PrimPredicate::normal(), [&](const stage::Prim&) {
        ++prims;
        return true;
    });
    return prims;
}
// Keeps all attributes for watch_resolve(). Returns how many there are.
WATCH_EXPORT std::size_t watch_gather(void* stage) {
    auto& attributes = watched(stage).attributes;
    attributes.clear();
    for (const auto& prim : watched(stage).stage.traverse())
        for (const auto& property : prim.properties())
            if (property.isAttribute()) attributes.push_back(property);
    return attributes.size();
}
// Resolves all attributes that are kept; without a time at the default time. Returns how many have
// a value.
WATCH_EXPORT std::size_t watch_resolve(void* stage, const double* time) {
    const auto at = time ? std::optional(*time) : std::nullopt;
    std::size_t values = 0;
    for (const auto& attribute : watched(stage).attributes)
        values += !attribute.value(at).IsEmpty();
    return values;
}
