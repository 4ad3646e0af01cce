// Shows a layer of a project at the revisions of its history.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <memory>

#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"

namespace usdlive {

class Client;

/// A root layer of a project and the layers that it uses, as they were at a revision, which can be
/// moved through the history. The layers are SdfLayers of their own, beside the live ones, and
/// refuse edits; a stage on the root layer shows them. Moving writes the difference into them, so
/// that the stage composes what has changed.
///
/// Belongs to the thread of the client that has made it. When the client has ended, or has joined
/// another history (Client::joinOtherHistory()), the layers stay as they are, and functions that
/// return a Result return NotConnected.
///
///     auto player = live.openPlayer(usdlive::LayerId{"shot.usda"});
///     auto moved = (*player)->seek((*player)->first());
///     (*player)->play(10);
///     for (;;) { live.tick(); (*player)->tick(); editAndDraw(); }
class HistoryPlayer {
public:
    HistoryPlayer(const HistoryPlayer&) = delete;
    HistoryPlayer& operator=(const HistoryPlayer&) = delete;
    /// Calls close().
    ~HistoryPlayer();

    /// Returns the root layer; null after close().
    [[nodiscard]] pxr::SdfLayerRefPtr layer() const;
    /// Returns the revision that the layers show; 0 after close().
    [[nodiscard]] Revision revision() const;
    /// Return the oldest and the newest revision of the history; 0 after close().
    [[nodiscard]] Revision first() const;
    [[nodiscard]] Revision last() const;

    /// Moves to a revision, and waits for what is not here. Playing goes on from there. Errors:
    /// InvalidArgument (0; a call within a tick or by a notice handler while the layers change),
    /// FutureRevision, HistoryReplaced, NotConnected (there is no connection and the commits are
    /// not here, or the player is closed).
    Result<void> seek(Revision revision);
    /// Lets tick() move the layers, `speed` times as fast as the commits were made; negative: back.
    /// Pauses of more than a second, as they are shown, take one second. A frame passes 128 commits
    /// at most, however high the speed is. 0 stops. It stops at both ends of the history.
    void play(double speed);
    [[nodiscard]] bool isPlaying() const;
    /// Moves the layers on if they are playing. Call it once per frame, beside Client::tick(),
    /// which receives what is needed. Never waits: it stays where it is until the commits are here.
    /// Returns whether the layers have changed. Errors: those of seek(); playing stops then, except
    /// for NotConnected.
    Result<bool> tick();

    /// Ends it. The layers keep their content. Does nothing if it was closed. Within a notice
    /// handler while the layers change, it is closed after that.
    void close();
    [[nodiscard]] bool isClosed() const;

private:
    friend class Client;
    struct State;
    explicit HistoryPlayer(std::unique_ptr<State> state);

    std::unique_ptr<State> state_;
};

}  // namespace usdlive
