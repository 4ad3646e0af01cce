// The placeholder files of layers in the cache folder.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "basics/Worker.h"
#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::client {

/// The placeholder files of the project's layers in the cache folder. They have no content, and let
/// composition open the layers. Creating many takes seconds: a worker creates those that do not fit
/// into a frame, and make() creates one that is needed at once.
class Placeholders {
public:
    explicit Placeholders(std::filesystem::path folder);
    ~Placeholders();
    Placeholders(Placeholders&&) noexcept;

    /// Creates the files of layers that have none: as many as fit into `budgetMs` before it
    /// returns, and the rest by `worker`, which is used until isComplete().
    void add(std::vector<LayerId> layers, double budgetMs, Worker& worker);
    [[nodiscard]] bool isComplete() const;
    /// Creates the layer's file unless it exists. Returns whether it was created.
    Result<bool> make(const LayerId& layer);
    void remove(const LayerId& layer);

    /// Returns the first error since the last call.
    [[nodiscard]] std::optional<Error> takeError();

private:
    struct State;
    std::shared_ptr<State> state_;  // shared with the worker's tasks
};

}  // namespace usdlive::client
