// Keeps the revisions that a stage uses.
#include "Context.h"

#include <pxr/base/tf/pyLock.h>
#include <pxr/base/tf/pyUtils.h>
#if __has_include(<pxr/external/boost/python.hpp>)
#include <pxr/external/boost/python.hpp>
#else  // in the wheels of pxr-boost-dev
#include <pxr/boost/python.hpp>
#endif
#include <pxr/usd/ar/pyResolverContext.h>

#include <utility>
#include <vector>

namespace usdlive::resolver {

namespace {

// The stage's root layer was opened just before, from the last snapshot.
constexpr std::chrono::milliseconds kIdle{1'000}, kAskServer{-1};

}  // namespace

Context::Context(Url root, std::string user) : state_(std::make_shared<State>()) {
    state_->root = std::move(root);
    state_->user = std::move(user);
}

void Context::wrapForPython() {
    if (!pxr::TfPyIsInitialized()) return;
    static bool isWrapped = false;  // guarded by Python's lock
    const pxr::TfPyLock lock;
    if (std::exchange(isWrapped, true)) return;
    namespace python = pxr::pxr_boost::python;
    try {
        const python::object module = python::import("types").attr("ModuleType")("usdliveResolver");
        const python::scope inside(module);
        python::class_<Context>("Context", python::no_init)
            .def("__repr__", &Context::text)
            .def(
                "__eq__", +[](const Context& a, const Context& b) { return a == b; })
            .def("__hash__", +[](const Context& context) { return hash_value(context); });
        pxr::ArWrapResolverContextForPython<Context>();
    } catch (const python::error_already_set&) {
        PyErr_Clear();
    }
}

Fetched<SnapshotPtr> Context::of(const Located& located, const Url& url) const {
    // A stage of live layers has no revision of its own.
    if (root().isLive()) {
        auto known = located.project->known();
        if (known) set(located.project, *known);  // for refresh()
        return known;
    }
    {
        const std::lock_guard lock(state_->mutex);
        const auto found = state_->snapshots.find(located.project);
        if (found != state_->snapshots.end()) return found->second;
    }
    const bool isPinned = !root().pin.empty() && url.server() == root().server();
    auto snapshot = isPinned ? located.project->at(root().pin) : located.project->newest(kIdle);
    if (!snapshot) return snapshot;
    const std::lock_guard lock(state_->mutex);
    // Another thread may have been first.
    return state_->snapshots.try_emplace(located.project, *snapshot).first->second;
}

void Context::set(const ProjectPtr& project, SnapshotPtr snapshot) const {
    const std::lock_guard lock(state_->mutex);
    state_->snapshots.insert_or_assign(project, std::move(snapshot));
}

bool Context::refresh() const {
    std::vector<std::pair<ProjectPtr, SnapshotPtr>> known;
    {
        const std::lock_guard lock(state_->mutex);
        known.assign(state_->snapshots.begin(), state_->snapshots.end());
    }
    bool isChanged = false;
    for (const auto& [project, snapshot] : known) {
        if (!snapshot->pin.empty()) continue;
        const auto now = project->newest(kAskServer);
        if (!now || *now == snapshot) continue;
        set(project, *now);
        isChanged = true;
    }
    return isChanged;
}

std::string Context::text() const {
    std::string text = "usdlive";
    if (!root().host.empty()) text += (root().isLive() ? " live " : " ") + root().server();
    if (!state_->user.empty()) text += ", user " + state_->user;
    const std::lock_guard lock(state_->mutex);
    if (!root().pin.empty() && state_->snapshots.empty()) text += ", @" + root().pin;
    for (const auto& [project, snapshot] : state_->snapshots)
        text += ", project " + project->name() + " at revision " +
                std::to_string(snapshot->revision) +
                (snapshot->pin.empty() ? "" : " (@" + snapshot->pin + ")");
    return text;
}

}  // namespace usdlive::resolver
