// Edits whole layers of a line of history.
#include "lines/LineEdits.h"

#include <algorithm>
#include <functional>
#include <optional>
#include <string>
#include <utility>

#include "usdlive/common/core/ErrorPasses.h"

namespace usdlive::client {

namespace {

std::string namesOf(const std::set<LayerId>& layers) {
    std::string names;
    for (const LayerId& layer : layers) names += (names.empty() ? "" : ", ") + layer.value;
    return names;
}

// Works until `done` returns true, or something fails. Returns the revision of the last own commit.
Result<Revision> linkUntil(LineLink& link, const std::set<LayerId>& layers,
                           const std::function<bool()>& done) {
    std::optional<Error> failed;
    Revision own = 0;
    const auto ran = link.run([&](const std::vector<Event>& events) {
        for (const auto& one : events) {
            if (const auto* lost = std::get_if<event::Lost>(&one)) failed = lost->work.reason;
            if (const auto* join = std::get_if<event::JoinFailed>(&one)) failed = join->reason;
            if (const auto* committed = std::get_if<event::Committed>(&one);
                committed && committed->commit.id.client == link.session().id())
                own = committed->commit.revision;
            // SE21: an editor waits; a person wants to know.
            const auto* error = std::get_if<event::ServerError>(&one);
            const ErrorCode code = error ? toError(error->message).code : ErrorCode::Internal;
            if (errorPasses(code))
                failed = {code, namesOf(layers) + (layers.size() == 1 ? " was" : " were") +
                                    " not changed: " + std::string(errorText(code)) +
                                    " Try again later"};
        }
        return failed || done();
    });
    if (!ran) return tl::unexpected(ran.error());
    if (failed) return tl::unexpected(*failed);
    return own;
}

}  // namespace

Result<void> joinLayers(LineLink& link, const std::set<LayerId>& layers) {
    for (const LayerId& layer : layers) link.session().openLayer(layer);
    const auto areJoined = [&] {
        return std::ranges::all_of(
            layers, [&](const LayerId& layer) { return link.session().isJoined(layer); });
    };
    return linkUntil(link, layers, areJoined).map([](Revision) {});
}

Result<Revision> submitEdits(LineLink& link, std::vector<AuthoredEdit> edits,
                             const std::string& label) {
    std::set<LayerId> layers;
    for (const AuthoredEdit& edit : edits) layers.insert(edit.layer);
    link.session().beginUndoGroup(label);
    link.session().author(std::move(edits));
    link.session().endUndoGroup();
    return linkUntil(link, layers, [&] { return link.session().pendingTransactions() == 0; });
}

}  // namespace usdlive::client
