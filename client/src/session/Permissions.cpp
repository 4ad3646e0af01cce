// Decides what this user may do now, by role, access rules and locks.
#include "session/Permissions.h"

#include <array>

#include "session/OwnRights.h"
#include "usdlive/common/core/FilePath.h"
#include "usdlive/common/core/LayerPath.h"
#include "usdlive/common/core/Utf8.h"
#include "usdlive/common/layer/SpecPath.h"
#include "usdlive/common/protocol/Role.h"

namespace usdlive::client {

namespace {

template <std::size_t N>
std::string listOf(const std::array<std::string_view, N>& names) {
    std::string list;
    for (const std::string_view name : names)
        list += (list.empty() ? "" : ", ") + std::string(name);
    return list;
}

Permission permissionBy(const OwnRights& rights, const AccessRules::Decision& decision) {
    if (decision.isAllowed) return {true, {}};
    return {false, decision.rule ? rights.rules().describe(*decision.rule)
                                 : "a " + std::string(nameOf(rights.role())) +
                                       " may not, and no rule allows it"};
}

Permission lockedBy(const UserName& holder, const LayerId& layer) {
    return {false, layer.value + " is locked by " + holder.value};
}

Error projectIsUnknown() {
    return {ErrorCode::NotConnected, "what the user may do is not known before the project is"};
}

Error noSuchLayer(const LayerId& layer) {
    return {ErrorCode::LayerNotFound, "the project has no layer " + layer.value};
}

}  // namespace

std::optional<UserName> foreignLock(const Session& session, const LayerId& layer) {
    const auto& welcome = session.welcome();
    if (!welcome || welcome->administrator.value_or(false)) return std::nullopt;
    const auto state = session.layerStates().find(layer);
    if (state == session.layerStates().end() || !state->second.locked ||
        state->second.holder == session.rights().user())
        return std::nullopt;
    return state->second.holder;
}

bool mayWriteIn(const Session& session, const LayerId& layer) {
    return !foreignLock(session, layer) && session.rights().mayWriteIn(layer);
}

Result<Permission> mayEdit(const Session& session, const LayerId& layer, const std::string& path,
                           std::string_view kind) {
    if (!session.welcome()) return tl::unexpected(projectIsUnknown());
    if (const auto parsed = specpath::parse(path); !parsed) return tl::unexpected(parsed.error());
    const auto asked = opinionKindNamed(kind);
    if (!kind.empty() && !asked)
        return fail(
            ErrorCode::InvalidArgument,
            inQuotes(kind) + " is not a kind of opinion; they are " + listOf(kOpinionKindNames));
    if (!session.projectLayers().contains(layer)) return tl::unexpected(noSuchLayer(layer));
    if (const auto holder = foreignLock(session, layer)) return lockedBy(*holder, layer);
    const OwnRights& rights = session.rights();
    Permission permission;
    for (std::size_t index = 0; index < kOpinionKindNames.size(); ++index) {
        const auto one = OpinionKind(index);
        if (asked && *asked != one) continue;
        permission = permissionBy(rights, rights.decide(layer, path, one));
        if (permission.isAllowed) break;
    }
    return permission;
}

Result<Permission> mayDo(const Session& session, std::string_view action, const LayerId& place) {
    if (!session.welcome()) return tl::unexpected(projectIsUnknown());
    const auto asked = projectActionNamed(action);
    if (!asked)
        return fail(ErrorCode::InvalidArgument, inQuotes(action) + " is not an action; they are " +
                                                    listOf(kProjectActionNames));
    if (place.empty() != concernsProject(*asked))
        return fail(ErrorCode::InvalidArgument,
                    place.empty() ? "name the layer or the file of the action " + inQuotes(action)
                                  : "the action " + inQuotes(action) +
                                        " concerns the project; name no layer");
    if (*asked == ProjectAction::Upload) {
        if (auto valid = checkFilePath(place.value); !valid) return tl::unexpected(valid.error());
    } else if (!place.empty()) {
        if (auto valid = parseLayerId(place.value); !valid) return tl::unexpected(valid.error());
    }
    const bool isNew = *asked == ProjectAction::Upload || *asked == ProjectAction::CreateLayer;
    const OwnRights& rights = session.rights();
    const auto permission = permissionBy(rights, rights.decide(*asked, place));
    if (place.empty() || isNew) return permission;
    if (!session.projectLayers().contains(place)) return tl::unexpected(noSuchLayer(place));
    const auto holder = foreignLock(session, place);
    if (!permission.isAllowed || !holder || *asked == ProjectAction::TakeOver) return permission;
    return lockedBy(*holder, place);
}

}  // namespace usdlive::client
