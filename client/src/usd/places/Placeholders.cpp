// Creates the placeholder files of layers in the cache folder.
#include "usd/places/Placeholders.h"

#include <pxr/base/tf/stringUtils.h>
#include <pxr/usd/sdf/layer.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <fstream>
#include <mutex>
#include <sstream>
#include <system_error>

namespace usdlive::client {

namespace fs = std::filesystem;

namespace {

// The files of one task. Other tasks of the worker wait for it.
constexpr std::size_t kMadeInOneTask = 100;

Result<std::string> emptyCrate(const fs::path& folder) {
    const fs::path path = folder / ".usdlive-empty.usdc";
    const auto layer = pxr::SdfLayer::CreateAnonymous(".usdc");
    if (!layer || !layer->Export(path.string()))
        return fail(ErrorCode::InvalidArgument, "cannot write " + path.string());
    std::ostringstream content;
    content << std::ifstream(path, std::ios::binary).rdbuf();
    std::error_code ignored;
    fs::remove(path, ignored);
    return content.str();
}

// A fair mutex: a thread that locks it repeatedly, like the worker, lets waiting threads in.
class Turns {
public:
    void lock() {
        const std::lock_guard next(waiting_);
        taken_.lock();
    }
    void unlock() { taken_.unlock(); }

private:
    std::mutex waiting_, taken_;
};

}  // namespace

struct Placeholders::State : std::enable_shared_from_this<State> {
    explicit State(fs::path folder) : folder(std::move(folder)) {}

    // The caller holds the mutex, so that no thread finds an incomplete file.
    Result<bool> make(const LayerId& layer) {
        const fs::path place = folder / layer.value;
        std::error_code error;
        if (fs::exists(place, error)) return false;
        const bool isCrate = pxr::TfStringToLower(place.extension().string()) == ".usdc";
        if (isCrate && crate.empty()) {
            auto content = emptyCrate(folder);
            if (!content) return tl::unexpected(content.error());
            crate = std::move(*content);
        }
        fs::create_directories(place.parent_path(), error);
        std::ofstream file(place, std::ios::binary);
        if (!(file << (isCrate ? crate : "#usda 1.0\n")).flush())
            return fail(ErrorCode::InvalidArgument, "cannot write " + place.string());
        return true;
    }

    void makeNext() {
        const std::lock_guard lock(mutex);
        const LayerId layer = std::move(left.back());
        left.pop_back();
        const auto made = make(layer);
        if (!made && !failure) {
            failure = made.error();
            hasFailed = true;
        }
        isComplete = left.empty();
    }

    // Posts itself again, so that other tasks of the worker run in between.
    void work(Worker& worker) {
        for (std::size_t i = 0; i < kMadeInOneTask; ++i) {
            if (isComplete) break;
            makeNext();
        }
        const std::lock_guard lock(mutex);
        isAtWork = !left.empty();
        if (isAtWork) worker.post([self = shared_from_this(), &worker] { self->work(worker); });
    }

    const fs::path folder;
    // Read by each tick, which must not wait for files.
    std::atomic<bool> isComplete = true, hasFailed = false;
    Turns mutex;  // guards all members below
    std::string crate;
    std::vector<LayerId> left;  // the next one is last; only one thread at a time takes from it
    bool isAtWork = false;      // a task of the worker is in progress
    std::optional<Error> failure;
};

Placeholders::Placeholders(fs::path folder) : state_(std::make_shared<State>(std::move(folder))) {}
Placeholders::~Placeholders() = default;
Placeholders::Placeholders(Placeholders&&) noexcept = default;

void Placeholders::add(std::vector<LayerId> layers, double budgetMs, Worker& worker) {
    using Clock = std::chrono::steady_clock;
    const auto end = Clock::now() + std::chrono::duration<double, std::milli>(budgetMs);
    State& state = *state_;
    std::unique_lock<Turns> lock(state.mutex);
    state.left.insert(state.left.begin(), std::make_move_iterator(layers.rbegin()),
                      std::make_move_iterator(layers.rend()));
    state.isComplete = state.left.empty();
    while (!state.isAtWork && !state.left.empty()) {
        if (Clock::now() > end) {
            state.isAtWork = true;
            worker.post([self = state_, &worker] { self->work(worker); });
            return;
        }
        lock.unlock();
        state.makeNext();
        lock.lock();
    }
}

bool Placeholders::isComplete() const { return state_->isComplete; }

Result<bool> Placeholders::make(const LayerId& layer) {
    const std::lock_guard lock(state_->mutex);
    return state_->make(layer);
}

void Placeholders::remove(const LayerId& layer) {
    std::error_code ignored;
    fs::remove(state_->folder / layer.value, ignored);
}

std::optional<Error> Placeholders::takeError() {
    if (!state_->hasFailed.exchange(false)) return std::nullopt;
    const std::lock_guard lock(state_->mutex);
    return std::exchange(state_->failure, std::nullopt);
}

}  // namespace usdlive::client
