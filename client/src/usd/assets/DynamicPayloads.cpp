// Keeps ticks from waiting for the data providers of dynamic payloads.
#include "usd/assets/DynamicPayloads.h"

#include <dlfcn.h>
#include <pxr/base/plug/plugin.h>
#include <pxr/base/plug/registry.h>
#include <pxr/base/tf/errorMark.h>

#include <mutex>
#include <optional>

namespace usdlive::client {

using Function = void (*)();

struct DynamicPayloadFunctions {
    Function beginTick, endTick, reloadArrived;
};

namespace {

// Loads the plug-in: otherwise the first payload of a process would load it within a tick that it
// does not know of.
DynamicPayloadFunctions load(pxr::PlugPlugin& plugin) {
    pxr::TfErrorMark errors;  // the first payload reports them
    const bool isLoaded = plugin.Load();
    errors.Clear();
    void* const library =
        isLoaded ? ::dlopen(plugin.GetPath().c_str(), RTLD_NOW | RTLD_NOLOAD) : nullptr;
    const auto find = [library](const char* name) {
        return library ? reinterpret_cast<Function>(::dlsym(library, name)) : nullptr;
    };
    return {find("usdliveEdfBeginTick1"), find("usdliveEdfEndTick1"),
            find("usdliveEdfReloadArrived1")};
}

// Returns null if there is no plug-in, or one of another version, whose payloads are read at once.
const DynamicPayloadFunctions* findFunctions() {
    static std::mutex mutex;
    static std::optional<DynamicPayloadFunctions> functions;
    const std::lock_guard lock(mutex);
    if (!functions) {
        // It may be registered at any time.
        const auto plugin = pxr::PlugRegistry::GetInstance().GetPluginWithName("usdliveEdf");
        if (plugin) functions = load(*plugin);
    }
    return functions && functions->reloadArrived ? &*functions : nullptr;
}

}  // namespace

DynamicPayloadTick::DynamicPayloadTick() : functions_(findFunctions()) {
    if (functions_) functions_->beginTick();
}

DynamicPayloadTick::~DynamicPayloadTick() {
    if (functions_) functions_->endTick();
}

void DynamicPayloadTick::composeArrived() const {
    if (functions_) functions_->reloadArrived();
}

}  // namespace usdlive::client
