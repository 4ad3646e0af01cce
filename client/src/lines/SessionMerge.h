// Merges a live session and the main line, in either direction.
#pragma once

#include <chrono>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "lines/LineLink.h"
#include "session/LineMerge.h"
#include "transport/LiveSessions.h"
#include "usdlive/client/lines/ProjectSessions.h"

namespace usdlive::client {

/// How long requests about live sessions wait for the server.
inline constexpr std::chrono::milliseconds kSessionRequestTime{15'000};

/// Returns the error for conflicts that are not decided. `how`: how to decide them.
[[nodiscard]] Error undecidedConflicts(std::size_t count, const std::string& how);

/// One merge or update of a live session, over a connection to each line. One thread; the calls
/// block.
class SessionMerge {
public:
    enum class Target { Main, Session };
    struct Wanted {
        ServerAddress server;
        std::string name;
        UserName user;
        Target target = Target::Main;
        SessionMergeOptions options;
    };
    explicit SessionMerge(Wanted wanted) : wanted_(std::move(wanted)) {}

    /// Finds out what is to be done, and does it unless it is a dry run or a conflict is undecided.
    /// Call it once.
    Result<SessionMerged> run();
    /// Ends the session after a merge. Error: InvalidArgument if somebody has edited it meanwhile.
    Result<void> end();
    /// The big values of the result. Precondition: run() has succeeded.
    [[nodiscard]] LineLink& blobs() { return *into_.link; }

private:
    /// One of both lines, with the commits that concern the merge.
    struct Line {
        std::unique_ptr<LineLink> link;
        Revision start = 0;  // its own revision at which the lines parted
        Revision read = 0;   // the newest revision that was read
        std::vector<Commit> commits;
        std::size_t added = 0;  // commits that the merge has
    };
    /// A merge that was done.
    struct Done {
        NotedMerge noted;
        Revision at = 0;  // revision of its commit in the line that received
    };

    [[nodiscard]] bool isIntoMain() const { return wanted_.target == Target::Main; }
    [[nodiscard]] Line& mainLine() { return isIntoMain() ? into_ : from_; }
    [[nodiscard]] Line& sessionLine() { return isIntoMain() ? from_ : into_; }
    Result<void> find();
    Result<void> connect();
    Result<void> readLines();
    [[nodiscard]] Result<void> checkHistory() const;
    /// Reads the commits up to a revision; of the line that receives, those of `layers_`.
    Result<void> read(Line& line, Revision to);
    /// Finds the merges that were done. Returns false if one may still be under way.
    [[nodiscard]] bool findDone();
    Result<void> readCommon();
    Result<void> goTo(Side side, Revision revision);
    Result<void> followMerges();
    Result<void> joinInto();
    [[nodiscard]] bool isListed(const LayerId& layer);
    Result<void> mergeNewest();
    Result<void> commit();
    [[nodiscard]] SessionConflict shown(const MergeConflict& conflict) const;
    Result<void> checkNothingCameLate();

    const Wanted wanted_;
    ListedLiveSession session_;
    Line from_, into_;
    std::set<LayerId> layers_;  // that the line that gives has edited
    bool isIntoCut_ = false;    // the commits of the line that receives were replaced
    std::vector<Done> done_;
    std::optional<LineMerge> merge_;
    std::vector<AuthoredEdit> edits_;
    SessionMerged merged_;
};

}  // namespace usdlive::client
