// The live sessions of a project, for programs.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"
#include "usdlive/common/layer/Edit.h"

namespace usdlive::client {

/// A live session (docs/live-sessions.md).
struct SessionInfo {
    std::string name;
    std::string address;  ///< joins it: Client::connect(address)
    UserName creator;
    std::int64_t timeMs = 0;           ///< when it was created, in milliseconds since 1970
    Revision revision = 0;             ///< the revision of the main line from which it is
    bool isEnded = false;              ///< nobody can join it; restore() opens it again
    Revision merged = 0;               ///< revision of the main line that has its changes; 0: none
    std::string problem = {};          ///< the reason why it cannot be opened; empty: it can
    std::vector<UserName> users = {};  ///< were in it when the server answered; only of list()
};

/// Which line's change counts where both have changed the same.
enum class Take { Undecided, Main, Session };

/// Something that the main line and a session have both changed, and not in the same way.
struct SessionConflict {
    enum class What {
        Value,    ///< both have written the register
        Deleted,  ///< one has deleted a spec that the other has changed, or something below it
        Moved,    ///< both have renamed or moved the spec
        Refused   ///< the change is not possible in the other line, for the `reason`
    };
    What what = What::Value;
    LayerId layer;
    /// The spec's path in the line that gives its changes; if it is deleted there, the one before.
    std::string path;
    std::string field;  ///< empty: the spec itself
    FieldPart part = {};
    /// The register's contents when the lines last had the same, and now in each; nothing: absent.
    std::optional<FieldValue> before = {}, main = {}, session = {};
    bool isDeletedInMain = false, isDeletedInSession = false;
    std::string reason = {};
    UserName mainUser, sessionUser;  ///< the last users who have changed the spec in each line
    Take take = Take::Undecided;     ///< the decision
};

/// How a merge or an update is done.
struct SessionMergeOptions {
    bool isDryRun = false;  ///< only finds out what would be done
    bool isKept = false;    ///< merge(): does not end the session
    /// Is called once for each conflict, on the thread of the call. Empty: nothing is decided.
    std::function<Take(const SessionConflict&)> decide = {};
};

/// The result of a merge or an update, or of its dry run.
struct SessionMerged {
    Revision revision = 0;         ///< the one of the commit; 0: nothing was committed
    std::vector<Edit> edits;       ///< those of the commit, or what would be committed
    std::vector<LayerId> created;  ///< layers that the receiving line lacked
    std::vector<SessionConflict> conflicts;
    std::size_t undecided = 0;  ///< conflicts; nothing is committed while there is one
    /// The number of further edits that were left out, because the receiving line lacks their
    /// specs.
    std::size_t dropped = 0;
};

/// The live sessions of the project at an address. A value; copies may be used by several threads
/// at the same time. All calls block until the server has answered, and need no client, no stage
/// and no tick. Errors: NotConnected (also after 15 s without an answer: it may be done or not);
/// InvalidArgument, with what the server or this call cannot do, and what to do next.
///
///     auto sessions = *usdlive::client::ProjectSessions::at("ws://127.0.0.1:7447", "ada");
///     auto dusk = sessions.create("dusk");
///     auto found = sessions.merge("dusk", {.isDryRun = true});
///     for (const auto& one : found->conflicts) std::cout << one.path << "\n";
///     auto merged = sessions.merge("dusk", {.decide = [](const auto&) {
///         return usdlive::client::Take::Session;
///     }});
///     if (!merged) std::cerr << merged.error().message << "\n";
class ProjectSessions {
public:
    /// `address`: of the server or of a project, as for Client::connect(); it is not used over DDS.
    /// `user`: the name to act in; empty: the one with which this user's programs connect. `token`:
    /// signs in with it; empty: with the one that is known. Connects to nobody, unless the address
    /// is an invitation, which is exchanged for a token. Errors: InvalidArgument,
    /// InvalidConfiguration, NotConnected.
    [[nodiscard]] static Result<ProjectSessions> at(const std::string& address,
                                                    const std::string& user = {},
                                                    const std::string& token = {});

    /// Returns all of them, by name.
    [[nodiscard]] Result<std::vector<SessionInfo>> list() const;
    /// Creates one from a revision of the main line; 0: from the newest.
    [[nodiscard]] Result<SessionInfo> create(const std::string& name, Revision from = 0) const;
    /// Creates one from a checkpoint of the main line. Error: InvalidArgument also if there is
    /// none.
    [[nodiscard]] Result<SessionInfo> createFrom(const std::string& name,
                                                 const std::string& checkpoint) const;
    /// Disconnects everybody, and keeps the history.
    [[nodiscard]] Result<SessionInfo> end(const std::string& name) const;
    [[nodiscard]] Result<SessionInfo> restore(const std::string& name) const;
    /// Deletes an ended session with its history.
    [[nodiscard]] Result<SessionInfo> remove(const std::string& name) const;

    /// Brings what the session has changed to the main line as one commit, and ends the session.
    /// Error: InvalidArgument also if a conflict is not decided (nothing is changed then; a dry run
    /// lists all), and if somebody has edited the session meanwhile: merge it again then.
    [[nodiscard]] Result<SessionMerged> merge(const std::string& name,
                                              const SessionMergeOptions& options = {}) const;
    /// Brings what the main line has changed to the session as one commit. Errors: as merge().
    [[nodiscard]] Result<SessionMerged> update(const std::string& name,
                                               const SessionMergeOptions& options = {}) const;

private:
    struct Place;
    explicit ProjectSessions(std::shared_ptr<const Place> place) : place_(std::move(place)) {}

    std::shared_ptr<const Place> place_;
};

}  // namespace usdlive::client
