#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <shared_mutex>
#include <utility>

#include "usdlive/server/project/CommitStore.h"

namespace usdlive::server {

using StoreOpener = std::function<Result<std::unique_ptr<CommitStore>>()>;

/// The open store for all threads. It can be opened anew after it has failed; between, it is
/// missing.
class SharedStore {
public:
    explicit SharedStore(StoreOpener opener) : opener_(std::move(opener)) {}

    /// Opens it, closing the one before first, which waits for who is using it.
    Result<void> open() {
        const std::unique_lock lock(mutex_);
        store_.reset();  // two cannot have the folder open
        auto opened = opener_();
        if (!opened) return tl::unexpected(opened.error());
        store_ = std::move(*opened);
        return {};
    }
    void close() {
        const std::unique_lock lock(mutex_);
        store_.reset();
    }

    /// What `function(CommitStore&)` returns, a Result; StorageFailed while there is none.
    template <class Function>
    auto use(Function&& function) -> decltype(function(std::declval<CommitStore&>())) {
        const std::shared_lock lock(mutex_);
        if (!store_) return fail(ErrorCode::StorageFailed, "the store is closed since it failed");
        return function(*store_);
    }

private:
    const StoreOpener opener_;
    std::shared_mutex mutex_;
    std::unique_ptr<CommitStore> store_;
};

}  // namespace usdlive::server
