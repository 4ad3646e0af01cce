// Layers of the past that a player moves.
#pragma once

#include <memory>
#include <optional>
#include <utility>

#include "basics/Raised.h"
#include "usd/editor/PastLayers.h"

namespace usdlive::client {

/// The layers of one player. Its client ends them when it ends.
class OpenPast {
public:
    explicit OpenPast(std::unique_ptr<PastLayers> layers) : layers_(std::move(layers)) {}

    /// Returns nullptr after close().
    [[nodiscard]] PastLayers* layers() const { return layers_.get(); }
    [[nodiscard]] bool isClosed() const { return !layers_ || closes_; }
    /// Returns whether a notice handler calls while the layers change.
    [[nodiscard]] bool isAdvancing() const { return isAdvancing_; }

    /// Calls PastLayers::advance(). Precondition: it is neither closed nor advancing.
    [[nodiscard]] Result<void> advance() {
        Result<void> done;
        {
            const Raised advancing(isAdvancing_);
            done = layers_->advance();
        }
        if (closes_) layers_.reset();
        return done;
    }
    /// Closes it, or, if it is advancing, after that.
    void close() {
        closes_ = true;
        if (!isAdvancing_) layers_.reset();
    }

private:
    std::unique_ptr<PastLayers> layers_;
    bool isAdvancing_ = false, closes_ = false;
};

}  // namespace usdlive::client
