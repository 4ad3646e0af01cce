// The layers that the editor has opened, and their way into the session.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "session/MessageReader.h"
#include "session/Requests.h"
#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive::client {

/// A snapshot that was requested.
struct Incoming {
    std::uint64_t request = 0;  ///< 0: not requested on this connection
    std::optional<LayerOpened> opened;
    std::optional<LayerDoc> content;  ///< when it is complete

    [[nodiscard]] bool isComplete() const { return content && opened; }
    /// The number of its specs; 0: not known yet.
    [[nodiscard]] std::uint64_t specs() const { return opened ? opened->specs : 0; }
};

/// A layer whose content has not arrived.
struct JoiningLayer {
    Incoming snapshot;
    std::vector<std::pair<Revision, Edit>> later;  ///< committed since the request
    bool again = false;                            ///< it was joined before, in another history
};

/// A layer that the editor has opened.
struct OpenedLayer {
    bool wanted = true;                   ///< false: the editor has closed it
    std::optional<JoiningLayer> joining;  ///< nothing: joined

    /// Drops what has arrived so far.
    void restart() {
        const bool again = !joining || joining->again;
        joining.emplace().again = again;
    }
};

/// The layers that the editor has opened. A layer is *joining* until its content is here: it is
/// requested, arrives as a snapshot, and gets the commits that have come meanwhile. A layer that
/// the editor has closed stays until own work on it is answered.
class OpenedLayers {
public:
    /// `failed` is called when a layer cannot be joined, and is not opened any more.
    OpenedLayers(Channel& channel, Requests& requests, SessionEvents& events, LayerView& editor,
                 std::function<void(const LayerId&)> failed)
        : channel_(channel),
          requests_(requests),
          events_(events),
          editor_(editor),
          failed_(std::move(failed)) {}

    /// Returns true if the layer is joined still, although the editor had closed it.
    bool open(const LayerId& layer);
    void close(const LayerId& layer);
    [[nodiscard]] bool contains(const LayerId& layer) const { return layers_.contains(layer); }
    [[nodiscard]] bool isWanted(const LayerId& layer) const;
    /// Returns whether the layer is wanted and not joining.
    [[nodiscard]] bool isJoined(const LayerId& layer) const;
    template <class Visit>
    void forEachWanted(const Visit& visit) const {
        for (const auto& [layer, opened] : layers_)
            if (opened.wanted) visit(layer);
    }
    template <class Visit>
    void forEachJoined(const Visit& visit) const {
        for (const auto& [layer, opened] : layers_)
            if (opened.wanted && !opened.joining) visit(layer);
    }
    /// Returns whether layers that were joined in another history are joining again.
    [[nodiscard]] bool areJoiningAgain() const;

    // A connection.
    /// Drops what has arrived of layers that are joining.
    void restart();
    /// Returns the joined layers for the hello, as many as it has room for.
    [[nodiscard]] std::vector<LayerId> forHello();
    /// SE2: names the joined layers for which the hello had no room, and requests those that are
    /// joining.
    void welcomed(const Welcome& message);
    /// Requests again what the server could not read, when it is time.
    void askAgain(std::int64_t nowMs);

    /// All layers have to be joined again, because the confirmed layers are not valid any more.
    void restartAll();
    void joinAll();

    // Content.
    void received(const LayerOpened& message);
    /// Returns false if nobody here has requested it.
    bool received(ReceivedSnapshot& snapshot);
    /// Keeps the edits of joining layers.
    void received(const Commit& commit);
    /// Ends the joining of layers whose content is here. `arrived` is called with the snapshot of a
    /// wanted layer, and then `joined` with its content at `revision`, and whether the layer was
    /// joined before in another history. Returns whether there were any.
    bool complete(Revision revision,
                  const std::function<void(const LayerId&, const LayerDoc&)>& arrived,
                  const std::function<void(const LayerId&, LayerDoc content, bool again)>& joined);

    /// Closes the layers that are not wanted and have no own work. `dropped` is called with each.
    void dropClosed(const std::function<bool(const LayerId&)>& hasOwnWork,
                    const std::function<void(const LayerId&)>& dropped);

private:
    void join(const LayerId& layer);
    void sendJoins();
    void joinFailed(const OpenLayer& open, const ErrorMessage& message);
    [[nodiscard]] JoiningLayer* joiningOf(const LayerId& layer);
    [[nodiscard]] JoiningLayer* joiningOf(std::uint64_t request);
    [[nodiscard]] std::optional<LayerDoc> contentOf(
        const LayerId& layer, const std::function<void(const LayerId&, const LayerDoc&)>& arrived);

    Channel& channel_;
    Requests& requests_;
    SessionEvents& events_;
    LayerView& editor_;
    const std::function<void(const LayerId&)> failed_;

    std::map<LayerId, OpenedLayer> layers_;
    std::set<LayerId> closed_;                // those of layers_ that are not wanted
    std::map<std::uint64_t, LayerId> joins_;  // by unanswered request
    std::deque<LayerId> toJoin_;              // requested when others are answered
    // Layers that the server could not read, and when they are requested again.
    std::map<LayerId, std::optional<std::int64_t>> askAgainAt_;
    std::vector<LayerId> toKeep_;  // joined layers for which the hello had no room
};

}  // namespace usdlive::client
