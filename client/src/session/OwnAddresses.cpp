// Keeps the addresses of own unsent edits up to date.
#include "session/OwnAddresses.h"

#include <algorithm>

#include "usdlive/common/layer/PathsInValues.h"

namespace usdlive::client {

// Translates the addresses of an edit at revision `since` to the current revision (M3, M15). Specs
// that pending work creates keep the address by creation; committed ones get a path.
void OwnAddresses::renew(Edit& edit, Revision since, const Creation& number, bool isRenewed) const {
    const AddressResolver resolver(
        log_, self_, since, [this](const Creation& creation) { return creations_.find(creation); });
    const auto isPending = [this](const Address& address) {
        return address.creation && !creations_.find(*address.creation);
    };
    // Returns false if the spec has been deleted. The server refuses other errors.
    const auto translate = [&](Address& address, bool isPlace) {
        if (isPending(address)) return true;
        auto path =
            isPlace ? resolver.place(edit.layer, address) : resolver.spec(edit.layer, address);
        if (path) address = {*std::move(path), {}};
        return path || path.error().code != ErrorCode::SpecDeleted;
    };
    const bool ofPlace = concernsPlace(edit.action);
    renewNames(edit, resolver, number);
    const bool isThere =
        isRenewed ||
        translate(edit.address, ofPlace || std::holds_alternative<CreateSpec>(edit.action));
    auto* move = std::get_if<MoveSpec>(&edit.action);
    const bool isParentThere = !move || translate(move->parent, false);
    if (isThere && isParentThere) return;
    if (!ofPlace) {
        edit.address = unresolvable(number);
    } else if (isThere) {
        move->parent = unresolvable(number);
    } else {
        edit.address = {resolver.vacated(edit.layer, edit.address), {}};
        edit.action = stayingAt(edit.address.path);
    }
}

// The names of the paths in the values follow, too.
void OwnAddresses::renewNames(Edit& edit, const AddressResolver& resolver,
                              const Creation& number) const {
    if (!mayHavePaths(edit.action)) return;
    std::vector<Address> names;
    bool differ = false;
    forEachPath(edit.action, [&](std::string_view path, PathRole role) {
        Address name{std::string(path), {}};
        if (!edit.names.empty())
            name = names.size() < edit.names.size() ? edit.names[names.size()] : Address{};
        const bool isKnown = !name.creation || creations_.find(*name.creation);
        if (isKnown && (name.creation || !name.path.empty())) {
            auto now = resolver.named(edit.layer, name, path, role);
            name = now ? Address{*std::move(now), {}} : unresolvable(number);
        }
        differ = differ || name != Address{std::string(path), {}};
        names.push_back(std::move(name));
    });
    edit.names = differ ? std::move(names) : std::vector<Address>();
}

// Gives the edits of an unsent transaction addresses at the current revision. If objects have
// moved, all unsent transactions get them, so that none has an older base than those before it.
void OwnAddresses::rebase(Pending& pending) {
    const auto rebaseOne = [this](Pending& one) {
        renew(one);
        pending_.rebase(one, revision_);
    };
    if (!objectsMovedSince(pending.transaction.base)) return rebaseOne(pending);
    notePlaces();
    for (Pending& one : pending_)
        if (!one.sent) rebaseOne(one);
}

void OwnAddresses::renewWithPlaces(Pending& pending) {
    if (objectsMovedSince(pending.transaction.base)) notePlaces();
    renew(pending);
}

bool OwnAddresses::objectsMovedSince(Revision base) const {
    return log_.lastPlace() > log_.markAfter(base);
}

void OwnAddresses::renew(Pending& pending) {
    Transaction& transaction = pending.transaction;
    const bool objectsMoved = objectsMovedSince(transaction.base);
    if (objectsMoved) notePlaces(pending);
    for (std::uint32_t index = 0; index < transaction.edits.size(); ++index) {
        const bool isRenewed = objectsMoved && followPlace(pending, index);
        renew(transaction.edits[index], transaction.base, {transaction.id.sequence, index},
              isRenewed);
    }
}

// M15: others may have moved the object at the place of a spec that is created below a spec of
// pending work. The address by creation says nothing about that, so the places are noted before the
// first edit gets another base.
void OwnAddresses::notePlaces() {
    for (Pending& pending : pending_) notePlaces(pending);
}

void OwnAddresses::notePlaces(Pending& pending) {
    const auto& edits = pending.transaction.edits;
    for (; pending.placesOf < edits.size(); ++pending.placesOf) {
        const auto index = std::uint32_t(pending.placesOf);
        const Edit& edit = edits[index];
        const bool namesPlace =
            std::holds_alternative<CreateSpec>(edit.action) || concernsPlace(edit.action);
        if (!namesPlace || !edit.address.creation) continue;
        const auto above = placeOf(*edit.address.creation, pending);
        auto place = above ? absolutePath(edit.address.path, *above) : std::nullopt;
        if (place) pending.places.emplace(index, *std::move(place));
    }
}

// Returns the pending work with an edit that `later` may name; nullptr if there is none.
const Pending* OwnAddresses::pendingWith(const Creation& creation, const Pending& later) const {
    const bool isSame = creation.sequence == later.transaction.id.sequence;
    const Pending* pending = isSame ? &later : pending_.find(creation.sequence);
    return pending && creation.edit < pending->transaction.edits.size() ? pending : nullptr;
}

// Returns the place at which pending work creates a spec, at the base of `later`.
std::optional<std::string> OwnAddresses::placeOf(const Creation& creation,
                                                 const Pending& later) const {
    const Pending* pending = pendingWith(creation, later);
    if (!pending) return std::nullopt;
    const Edit& edit = pending->transaction.edits[creation.edit];
    if (!std::holds_alternative<CreateSpec>(edit.action)) return std::nullopt;
    const auto noted = pending->places.find(creation.edit);
    if (noted == pending->places.end() && edit.address.creation) return std::nullopt;
    return log_.translatePlaceBetween(
        edit.layer, noted == pending->places.end() ? edit.address.path : noted->second,
        log_.markAfter(pending->transaction.base), log_.markAfter(later.transaction.base),
        NamespaceLog::authorOf(self_));
}

// Returns whether the address is a path at the current revision now.
bool OwnAddresses::followPlace(Pending& pending, std::uint32_t index) const {
    Edit& edit = pending.transaction.edits[index];
    const auto noted = pending.places.find(index);
    if (noted == pending.places.end() || !edit.address.creation ||
        creations_.find(*edit.address.creation))
        return false;
    // With a spec that is not created all below it is dropped (M4).
    const Creation below = *edit.address.creation;
    if (const Pending* creating = pendingWith(below, pending);
        !creating || creating->transaction.edits[below.edit].address == unresolvable(below))
        return false;
    const std::uint64_t since = log_.markAfter(pending.transaction.base);
    const auto self = NamespaceLog::authorOf(self_);
    const std::string before = noted->second;
    const std::string& relative = edit.address.path;
    if (relative.starts_with('{') || !before.ends_with(relative)) return false;
    const std::string above = before.substr(0, before.size() - relative.size());
    if (absolutePath(relative, above) != before) return false;
    auto [now, aboveNow, left] =
        log_.followPlace(edit.layer, before, above, since, log_.mark(), self);
    if (left) now = log_.translatePlace(edit.layer, *std::move(now), *left);
    if (now == before) return false;
    if (!now)
        edit.address = unresolvable({pending.transaction.id.sequence, index});
    else if (!left)
        edit.address.path = relativePath(*now, *aboveNow);
    else
        edit.address = {*now, {}};
    if (now) noted->second = *std::move(now);
    return !edit.address.creation;
}

}  // namespace usdlive::client
