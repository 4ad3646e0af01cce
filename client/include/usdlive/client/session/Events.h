// The events that a client reports to its editor, and their contents.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <variant>
#include <vector>

#include "usdlive/common/protocol/Control.h"
#include "usdlive/common/protocol/Frame.h"

namespace usdlive::client {

/// An edit as the editor made it: the absolute path in the layer that the editor sees, after the
/// edits before it.
struct AuthoredEdit {
    LayerId layer;
    std::string path;
    EditAction action;  ///< MoveSpec::parent is absolute, too
};

/// Own edits that are not in the project, and the reason (M12).
struct LostWork {
    std::uint64_t sequence = 0;
    std::uint64_t gesture = 0;  ///< the gesture to which they belong; 0: none
    Error reason;
    /// True: the whole transaction was refused; false: single edits were dropped.
    bool refused = false;
    std::vector<AuthoredEdit> edits;  ///< the edits with the editor's own paths
};

/// The server at the client's address has another history than the editor shows (ID2): it serves
/// another project, or an older copy of this one. The client has stopped. It keeps its layers and
/// its unsent work, and tries again until the right server is back or Client::joinOtherHistory() is
/// called.
struct OtherHistory {
    std::string expectedProject, foundProject;
    StoreId expectedStore, foundStore;  ///< empty: of an earlier version, unknown
    Error reason;  ///< for the user: what was expected and found, and what to do

    /// False: the same project, whose history lacks commits that the editor has seen.
    [[nodiscard]] bool isOtherProject() const { return isOtherStore(expectedStore, foundStore); }
};

/// Edits of an earlier connection of the same user that the server has not acknowledged. A journal
/// on this machine keeps them.
struct UnsentWork {
    ClientId client;          ///< client id of that connection; identifies the transactions
    std::int64_t timeMs = 0;  ///< time of the newest edit, milliseconds since 1970
    std::size_t transactions = 0, edits = 0;
    std::vector<LayerId> layers;
    std::string file;  ///< path of the journal
    /// They were made in another project of the same name (ID3), and cannot be sent to this one.
    bool otherProject = false;
};

/// The outcome of Client::sendUnsent().
struct SentWork {
    std::size_t committed = 0;  ///< transactions that were committed by this call
    /// Transactions that were committed before: only their acknowledgement was lost.
    std::size_t before = 0;
    std::size_t lost = 0;  ///< pieces of work that were refused or dropped
};

struct JoinProgress {
    LayerId layer;
    std::uint64_t specs = 0, specsTotal = 0;
};

/// Events for the editor, in order.
namespace event {
struct Connected {
    Welcome welcome;  ///< without the list of layers
    bool resumed = false;
    bool leftHistory = false;             ///< ID4: the editor has left its history for the server's
    std::vector<LayerId> newLayers = {};  ///< layers of the project that were not known before
};
struct Disconnected {
    Error reason;
};
/// Layers were added to the project, or removed from it. Session::projectLayers() has all.
struct LayersChanged {
    std::vector<LayerId> added, removed;
};
/// Files of the project that are not live were added, changed or removed: textures, packages, and
/// others that asset paths name. Loaded layers that were made from them are reloaded, except layers
/// with unsaved edits.
struct FilesChanged {
    std::vector<std::string> files;  ///< paths relative to the project
};
/// An own edit wrote a path that others cannot open: an absolute path of a file that is not in the
/// project, a relative path that leaves the project, or the identifier of an anonymous layer.
struct PathOutside {
    LayerId layer;
    std::string prim;      ///< the path of the prim, or "/" for the layer itself
    std::string property;  ///< empty: a reference, payload, sublayer or metadata
    std::string path;      ///< the asset path as it was written
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
/// A layer requested by Client::requestOpenLayer() is open, with the layers that it uses.
struct LayerOpened {
    std::uint64_t request = 0;
    LayerId layer;
};
/// A requested layer could not be opened. The reason LayerNotOpen means that it was closed
/// meanwhile.
struct LayerOpenFailed {
    std::uint64_t request = 0;
    LayerId layer;
    Error reason;
};
/// A file of Client::requestUpload() is in the project, and everybody can open it.
struct Uploaded {
    std::uint64_t request = 0;
    std::string path;  ///< relative to the project
};
struct UploadFailed {
    std::uint64_t request = 0;
    std::string path;
    Error reason;
};
/// A commit of any client, also an own one, was applied. The revisions are in order and without
/// gaps since Connected, except for `missed` ones.
struct Committed {
    Commit commit;
    /// An own commit from before Connected. It was made while the connection was lost, and the
    /// layers contained it when they were joined again (M9).
    bool missed = false;
};
/// Own edits were refused or dropped.
struct Lost {
    LostWork work;
    /// Index for Client::lostWork(); set by the client, not by the session.
    std::uint64_t index = 0;
    /// The number of losses of the same registers for the same reason within a second. The event
    /// has the newest one; the others have lower indices.
    std::uint64_t count = 1;
};
struct PreviewChanged {
    ClientId author;
    std::uint64_t gesture = 0;
    bool withdrawn = false;
};
/// The answer to a request: Client::request(), Session::request().
template <IsSingleRequest Request>
struct Answered {
    typename Request::Answer answer;
};
using Saved = Answered<SaveLayers>;
using Reloaded = Answered<ReloadLayers>;
using LayerMade = Answered<CreateLayer>;
using SkippedListed = Answered<ListSkipped>;
using CheckpointMade = Answered<CreateCheckpoint>;
using CheckpointsListed = Answered<ListCheckpoints>;
/// The progress of a long operation: an import or save of the server, an upload, or the content for
/// which a peek waits (Fetch). Sent about twice a second, after the first half second. The event
/// Joining reports the content of layers that are being opened.
struct Progress {
    enum class Task { Import, Save, Upload, Fetch, Open };
    Task task{};
    LayerId layer;              ///< the layer in progress; empty for Upload
    std::uint64_t done = 0;     ///< Save: layers; Upload: bytes; Fetch: specs
    std::uint64_t total = 0;    ///< in the same unit; 0: unknown, for example for an Import
    std::uint64_t request = 0;  ///< Save, and Upload of a file: the number of the request
};
struct ServerError {
    ErrorMessage message;
};
/// There are unsent edits of earlier connections. See Client::sendUnsent().
struct UnsentFound {
    std::vector<UnsentWork> work;
};
/// The states of these layers have changed. Session::layerStates() has all states.
struct LayerStatesChanged {
    std::vector<LayerState> layers;
};
/// Presences of others have changed or ended. Session::presences() has all presences.
struct PresenceChanged {
    std::vector<Presence> shown;
    std::vector<ClientId> gone;
};
/// An administrator has changed what this user may do: Client::mayEdit() and mayDo() answer
/// anew.
struct RightsChanged {};
}  // namespace event

/// The answer to Client::mayEdit() and Client::mayDo(). `why` is a sentence if the user may not.
struct Permission {
    bool isAllowed = false;
    std::string why;
};

/// The events above, and event::Answered for each request.
template <class Events, class Requests>
struct WithAnswers;
template <class... Events, class... Requests>
struct WithAnswers<std::variant<Events...>, std::variant<Requests...>> {
    using Type = std::variant<Events..., event::Answered<Requests>...>;
};
using Event = WithAnswers<
    std::variant<event::Connected, event::Disconnected, event::LayersChanged, event::Joining,
                 event::Joined, event::JoinFailed, event::Committed, event::Lost,
                 event::PreviewChanged, event::ServerError, event::LayerStatesChanged,
                 event::PresenceChanged, event::UnsentFound, event::Progress, event::LayerOpened,
                 event::LayerOpenFailed, event::FilesChanged, event::PathOutside, event::Uploaded,
                 event::UploadFailed, event::RightsChanged>,
    AnyRequest>::Type;

}  // namespace usdlive::client
