// First steps of several verbs: reach the server, find the layer, read the log.
#pragma once

#include <unistd.h>

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "cli/Commands.h"
#include "cli/Link.h"
#include "cli/Terminal.h"

namespace usdlive::cli {

/// The number of edits that are printed for one commit.
inline constexpr std::size_t kEditsShown = 8;

[[nodiscard]] Result<UserName> userOf(const Common& options);
[[nodiscard]] Result<std::unique_ptr<Link>> reach(const Common& options);

[[nodiscard]] bool hasLayer(const Link& link, const LayerId& layer);
[[nodiscard]] Error noSuchLayer(const LayerId& layer);
/// Returns the layer for the verb; empty if none was named.
[[nodiscard]] Result<LayerId> chosenLayer(const Link& link, const Common& options);
/// Returns the revision of a checkpoint.
[[nodiscard]] Result<Revision> revisionOf(Link& link, const std::string& checkpoint);

/// Prints to standard error where the history begins, if that is not its first commit.
void warnOfBase(Revision base);

/// Options for printing a commit.
struct CommitView {
    LayerId layer;  ///< only edits of this layer; empty: all
    std::size_t maxEdits = kEditsShown;
    bool json = false;
    Palette palette = Palette::of(STDOUT_FILENO);

    /// Precondition: for JSON, the big values are here.
    [[nodiscard]] std::string text(const Commit& commit, Link& link) const;
};

}  // namespace usdlive::cli
