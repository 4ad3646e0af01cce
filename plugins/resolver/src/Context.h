// The revisions that the addresses of a stage name.
#pragma once

#include <pxr/usd/ar/defineResolverContext.h>

#include <cstddef>
#include <map>
#include <memory>
#include <mutex>
#include <string>

#include "Remote.h"

namespace usdlive::resolver {

/// The revision of each project that a stage uses. A stage gets one when it is opened by an
/// address, so that all its layers belong together. Copies share their state; two contexts are
/// equal if they do.
class Context {
public:
    /// `root` is the address of the stage's root layer. Its server and pin say for which server the
    /// context has a fixed revision; both may be empty.
    Context(Url root, std::string user);

    /// Makes contexts known to Python, once there is an interpreter: reading one there would fail
    /// otherwise.
    static void wrapForPython();

    /// Returns the project's snapshot in this context, which is the newest one when it is first
    /// needed.
    [[nodiscard]] Fetched<SnapshotPtr> of(const Located& located, const Url& url) const;
    void set(const ProjectPtr& project, SnapshotPtr snapshot) const;
    /// Takes the newest snapshots. Returns true if one is another than before.
    [[nodiscard]] bool refresh() const;
    /// Returns the address of the stage's root layer.
    [[nodiscard]] const Url& root() const { return state_->root; }
    [[nodiscard]] std::string text() const;

    friend bool operator==(const Context& a, const Context& b) { return a.state_ == b.state_; }
    friend bool operator<(const Context& a, const Context& b) { return a.state_ < b.state_; }
    friend std::size_t hash_value(const Context& context) {
        return std::hash<const void*>()(context.state_.get());
    }
    friend std::string ArGetDebugString(const Context& context) { return context.text(); }

private:
    struct State {
        Url root;
        std::string user;
        std::mutex mutex;  // guards the next member
        std::map<ProjectPtr, SnapshotPtr> snapshots;
    };
    std::shared_ptr<State> state_;
};

}  // namespace usdlive::resolver

AR_NAMESPACE_OPEN_SCOPE
AR_DECLARE_RESOLVER_CONTEXT(usdlive::resolver::Context);
AR_NAMESPACE_CLOSE_SCOPE
