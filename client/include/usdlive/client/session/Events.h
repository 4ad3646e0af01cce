// What a client reports to its editor: the events, and the work that they are about.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <variant>
#include <vector>

#include "usdlive/common/protocol/Control.h"
#include "usdlive/common/protocol/Frame.h"

namespace usdlive::client {

/// An edit as the editor made it: absolute path in the layer as the editor sees it, each valid
/// after the ones before.
struct AuthoredEdit {
    LayerId layer;
    std::string path;
    EditAction action;  ///< MoveSpec::parent absolute, likewise
};

/// Why work of one's own is not in the project (M12).
struct LostWork {
    std::uint64_t sequence = 0;
    std::uint64_t gesture = 0;  ///< that it was, 0 for none
    Error reason;
    bool refused = false;  ///< the whole transaction; otherwise single edits were dropped
    std::vector<AuthoredEdit> edits;  ///< as the editor made them
};

/// Work of an earlier connection of the same user that the server has not acknowledged. It is kept
/// in a journal on this machine.
struct UnsentWork {
    ClientId client;          ///< of that connection; names the work
    std::int64_t timeMs = 0;  ///< of the newest of it, milliseconds since 1970
    std::size_t transactions = 0, edits = 0;
    std::vector<LayerId> layers;
    std::string file;  ///< the journal
};

/// The outcome of Client::sendUnsent().
struct SentWork {
    std::size_t committed = 0;  ///< transactions committed now
    std::size_t before = 0;     ///< committed already: only their acknowledgement had been lost
    std::size_t lost = 0;       ///< pieces of work that were refused or dropped
};

struct JoinProgress {
    LayerId layer;
    std::uint64_t specs = 0, specsTotal = 0;
};

/// What has happened, in order, for the editor's callbacks. Fetched by takeEvents().
namespace event {
struct Connected {
    Welcome welcome;
    bool resumed = false;
};
struct Disconnected {
    Error reason;
};
/// The project has other layers than before; these are all of them now.
struct LayersChanged {
    std::vector<LayerId> layers;
};
struct Joining {
    JoinProgress progress;
};
struct Joined {
    LayerId layer;
    Revision revision = 0;
};
struct JoinFailed {
    LayerId layer;
    Error reason;
};
/// A layer that Client::requestOpenLayer() asked for is open, with the layers that it uses.
struct LayerOpened {
    std::uint64_t request = 0;
    LayerId layer;
};
/// It is not opened. LayerNotOpen: it was closed meanwhile.
struct LayerOpenFailed {
    std::uint64_t request = 0;
    LayerId layer;
    Error reason;
};
/// Anybody's commit, own ones too, after it was applied. In the order of revisions, without gaps
/// since Connected, but for those that were missed.
struct Committed {
    Commit commit;
    /// One's own, of before Connected: it was made while the line was lost, and the layers held it
    /// when they were joined anew (M9).
    bool missed = false;
};
struct Lost {
    LostWork work;
    std::uint64_t index = 0;  ///< for Client::lostWork(); set by the client, not by the session
    /// Of so many losts in a row of the same registers for the same reason, within a second, this
    /// is the newest; the others are kept as well, before it.
    std::uint64_t count = 1;
};  ///< refused or dropped work of one's own
struct PreviewChanged {
    ClientId author;
    std::uint64_t gesture = 0;
    bool withdrawn = false;
};
struct Saved {
    LayersSaved outcome;
};
struct Reloaded {
    LayersReloaded outcome;
};
struct CheckpointMade {
    CheckpointCreated answer;
};
struct CheckpointsListed {
    Checkpoints answer;
};
struct LayerMade {
    LayerCreated answer;
};
struct SkippedListed {
    SkippedFiles answer;
};
/// How far something is that takes long: told about twice a second after the first half second
/// of an import or save, on the server, or an upload. The content of a layer on its way here is
/// told by Joining; that of a peek by Task::Fetch.
struct Progress {
    enum class Task { Import, Save, Upload, Fetch, Open };
    Task task{};
    LayerId layer;              ///< that it is at; empty for Upload
    std::uint64_t done = 0;     ///< Save: layers; Upload: bytes; Fetch: specs
    std::uint64_t total = 0;    ///< of the same; 0: not known, as with an Import
    std::uint64_t request = 0;  ///< Save: the number that Session::save() returned
};
struct ServerError {
    ErrorMessage message;
};
/// There is unsent work of earlier connections: see Client::sendUnsent() and what follows it.
struct UnsentFound {
    std::vector<UnsentWork> work;
};
/// These layers are in another state than before; Session::layerStates() has all.
struct LayerStatesChanged {
    std::vector<LayerState> layers;
};
/// Others are elsewhere, or gone; Session::presences() has all.
struct PresenceChanged {
    std::vector<Presence> shown;
    std::vector<ClientId> gone;
};
}  // namespace event
using Event =
    std::variant<event::Connected, event::Disconnected, event::LayersChanged, event::Joining,
                 event::Joined, event::JoinFailed, event::Committed, event::Lost,
                 event::PreviewChanged, event::Saved, event::Reloaded, event::CheckpointMade,
                 event::CheckpointsListed, event::ServerError, event::LayerStatesChanged,
                 event::PresenceChanged, event::UnsentFound, event::LayerMade, event::SkippedListed,
                 event::Progress, event::LayerOpened, event::LayerOpenFailed>;

}  // namespace usdlive::client
