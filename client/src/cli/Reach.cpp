// First steps of several verbs: reach the server, find the layer, read the log.
#include "cli/Reach.h"

#include <algorithm>
#include <iostream>
#include <optional>
#include <utility>

#include "cli/Json.h"
#include "cli/Text.h"
#include "link/Destination.h"

namespace usdlive::cli {

namespace {

constexpr double kTimeoutMs = 10'000;

}  // namespace

Result<UserName> userOf(const Common& options) {
    return client::nameAt(options.target.server, options.user);
}

Result<std::unique_ptr<Link>> reach(const Common& options) {
    const auto user = userOf(options);
    if (!user) return tl::unexpected(user.error());
    auto link = Link::connect(options.target.server, *user, kTimeoutMs);
    if (link && !options.json && isForPeople()) (*link)->showProgress();
    return link;
}

bool hasLayer(const Link& link, const LayerId& layer) {
    return link.session().projectLayers().contains(layer);
}

Error noSuchLayer(const LayerId& layer) {
    return {ErrorCode::LayerNotFound,
            "the project has no layer " + layer.value + "; `usdlive ls` lists its layers"};
}

Result<LayerId> chosenLayer(const Link& link, const Common& options) {
    if (options.target.layers.empty()) return LayerId{};
    const LayerId& layer = options.target.layers.front();
    if (!hasLayer(link, layer)) return tl::unexpected(noSuchLayer(layer));
    return layer;
}

Result<Revision> revisionOf(Link& link, const std::string& checkpoint) {
    const auto all = link.ask(ListCheckpoints{});
    if (!all) return tl::unexpected(all.error());
    const auto found = std::ranges::find(all->checkpoints, checkpoint, &Checkpoint::name);
    if (found == all->checkpoints.end())
        return fail(ErrorCode::InvalidArgument, "the project has no checkpoint '" + checkpoint +
                                                    "'; `usdlive checkpoints` lists them");
    return found->revision;
}

void warnOfBase(Revision base) {
    if (base > 0)
        std::cerr
            << "usdlive: the history begins at revision " << base
            << ": older commits were replaced by the content of the layers at that revision\n";
}

std::string CommitView::text(const Commit& commit, Link& link) const {
    return json ? line(toJson(commit, layer, link)) : describe(commit, maxEdits, layer, palette);
}

}  // namespace usdlive::cli
