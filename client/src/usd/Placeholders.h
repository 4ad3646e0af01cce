#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "usd/Worker.h"
#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::client {

/// The files without content that stand for the project's layers in the cache folder, so that
/// composition can open them. Making many takes seconds: a worker makes those that a frame has no
/// time for, and make() one that is needed at once.
class Placeholders {
public:
    explicit Placeholders(std::filesystem::path folder);
    ~Placeholders();
    Placeholders(Placeholders&&) noexcept;

    /// Makes the files of those layers that have none: as many as fit into `budgetMs` before it
    /// returns, the rest by `worker`, which is used until isComplete().
    void add(std::vector<LayerId> layers, double budgetMs, Worker& worker);
    [[nodiscard]] bool isComplete() const;
    /// Makes the layer's file unless there is one. True: made.
    Result<bool> make(const LayerId& layer);
    void remove(const LayerId& layer);

    /// The first failure since the last call.
    [[nodiscard]] std::optional<Error> takeError();

private:
    struct State;
    std::shared_ptr<State> state_;  // also of the worker's tasks
};

}  // namespace usdlive::client
