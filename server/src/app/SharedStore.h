// Shares a project's open store between threads.
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <shared_mutex>
#include <utility>

#include "project/CommitStore.h"

namespace usdlive::server {

using StoreOpener = std::function<Result<std::unique_ptr<CommitStore>>()>;

/// The open store, shared by all threads. After a failure it can be opened again; until then it is
/// missing.
class SharedStore {
public:
    explicit SharedStore(StoreOpener opener) : opener_(std::move(opener)) {}

    /// Opens the store. First closes an open one, which waits for its users.
    Result<void> open() {
        const std::unique_lock lock(mutex_);
        store_.reset();  // only one may have the folder open
        auto opened = opener_();
        if (!opened) return tl::unexpected(opened.error());
        store_ = std::move(*opened);
        return {};
    }
    void close() {
        const std::unique_lock lock(mutex_);
        store_.reset();
    }

    /// Returns the result of `function(CommitStore&)`, a Result, or StorageFailed while the store
    /// is missing.
    template <class Function>
    auto use(Function&& function) -> decltype(function(std::declval<CommitStore&>())) {
        const std::shared_lock lock(mutex_);
        if (!store_) return fail(ErrorCode::StorageFailed, "the store is closed because it failed");
        return function(*store_);
    }

private:
    const StoreOpener opener_;
    std::shared_mutex mutex_;
    std::unique_ptr<CommitStore> store_;
};

}  // namespace usdlive::server
