// The view: predictions, addresses, and joining another history.
#include <algorithm>
#include <stdexcept>

#include "session/SessionImpl.h"
#include "usdlive/common/layer/AddressResolver.h"
#include "usdlive/common/layer/MatchedSpecs.h"
#include "usdlive/common/layer/PathsInValues.h"

namespace usdlive::client {

namespace {

std::set<LayerId> layersOf(const LayerDocs& left, const LayerDocs& right) {
    std::set<LayerId> layers;
    for (const auto& [layer, doc] : left) layers.insert(layer);
    for (const auto& [layer, doc] : right) layers.insert(layer);
    return layers;
}

// An address that no server can resolve: the creation by the edit itself. The edit keeps its place
// in the transaction, is dropped (M4), and is reported to its author as dropped.
Address unresolvable(const Creation& number) { return {{}, number}; }

}  // namespace

void Session::Impl::updateView() {
    if (frozen_) thaw();
    if (frozen_) return;
    dropClosed();
    readdressGesture();
    if (dirty_) rebuild();
    flushResets();
}

// Destroys a small prediction here: handing it over would take as long.
void Session::Impl::discard(Prediction old) {
    constexpr std::size_t kLittle = 256;
    if (old.fieldsNoted() > kLittle) host_.discard(std::make_shared<Prediction>(std::move(old)));
}

// Computes the prediction again, from the start, with the next rebuild().
void Session::Impl::restartPrediction() {
    dirty_ = true;
    if (rebuild_) discard(std::move(rebuild_->next));
    rebuild_.reset();
}

void Session::Impl::previewsChanged() {
    dirty_ = true;
    if (rebuild_) rebuild_->outdated = true;
}

// M7: the confirmed layers, previews of others, own transactions, the open gesture. Stops when the
// time is over; the view stays as it is, and the next call continues.
void Session::Impl::rebuild() {
    if (!rebuild_) predictPreviews(rebuild_.emplace(Rebuild{Prediction(confirmedSide_)}).next);
    for (std::size_t count = 0; rebuild_->done < pending_.size(); ++rebuild_->done) {
        if (outOfTime(++count)) return;
        Pending& pending = pending_[rebuild_->done];
        pending.prognosis = rebuild_->next.run(pending.transaction);
    }
    predictGesture(rebuild_->next);
    Prediction before = std::exchange(prediction_, std::move(rebuild_->next));
    dirty_ = rebuild_->outdated;
    rebuild_.reset();
    answered_ = 0;
    showDifference(before.docs());
    discard(std::move(before));
}

void Session::Impl::predictPreviews(Prediction& prediction) const {
    std::map<std::uint64_t, const PreviewFrame*> inOrder;
    for (const auto& [id, preview] : previews_)
        if (preview.frame) inOrder[preview.slot] = &*preview.frame;
    for (const auto& [slot, frame] : inOrder) prediction.preview(slot, *frame);
}

// An edit for which the executor would refuse the open gesture is removed from it, so that the rest
// stays visible. Its author learns at once. An edit that only conflicts with a preview stays.
void Session::Impl::predictGesture(Prediction& prediction) {
    if (!gesture_) return;
    Pending& pending = gesture_->pending;
    const auto run = [&] { pending.prognosis = prediction.run(pending.transaction); };
    run();
    if (!pending.prognosis.refused) return;
    Prediction confirmed(confirmedSide_);
    for (const Pending& own : pending_) confirmed.run(own.transaction);
    while (const auto refused = confirmed.land(pending.transaction).refused) {
        LostWork work{.sequence = pending.transaction.id.sequence,
                      .gesture = pending.transaction.gesture,
                      .reason = refused->error,
                      .refused = false,
                      .edits = {}};
        work.edits.push_back(gesture_->remove(refused->edit));
        events_.push_back(event::Lost{std::move(work)});
    }
    run();
}

// The prediction computed step by step has to equal one that is computed at once.
void Session::Impl::checkPrediction() const {
    if (!options_.checksPrediction || dirty_ || frozen_) return;
    Prediction anew(confirmedSide_);
    predictPreviews(anew);
    for (const Pending& pending : pending_) anew.run(pending.transaction);
    if (gesture_) anew.run(gesture_->pending.transaction);
    for (const LayerId& layer : layersOf(anew.docs(), prediction_.docs())) {
        if (*anew.find(layer) == *prediction_.find(layer)) continue;
        throw std::logic_error("the prediction of " + layer.value + " is wrong; it should be\n" +
                               anew.find(layer)->dump() + "and is\n" +
                               prediction_.find(layer)->dump());
    }
}

// ---- addresses

// Translates the addresses of an edit at revision `since` to the current revision (M3, M15). Specs
// that pending work creates keep the address by creation; committed ones get a path.
void Session::Impl::readdress(Edit& edit, Revision since, const Creation& number,
                              bool isRenewed) const {
    const AddressResolver resolver(log_, options_.client, since, [this](const Creation& creation) {
        return creations_.find(creation);
    });
    const auto isPending = [this](const Address& address) {
        return address.creation && !creations_.find(*address.creation);
    };
    // Returns false if the spec has been deleted. The server refuses other errors.
    const auto renew = [&](Address& address, bool isPlace) {
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
        renew(edit.address, ofPlace || std::holds_alternative<CreateSpec>(edit.action));
    auto* move = std::get_if<MoveSpec>(&edit.action);
    const bool isParentThere = !move || renew(move->parent, false);
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
void Session::Impl::renewNames(Edit& edit, const AddressResolver& resolver,
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
void Session::Impl::rebase(Pending& pending) {
    const auto renew = [this](Pending& one) {
        readdress(one);
        pending_.rebase(one, revision_);
    };
    if (!objectsMovedSince(pending.transaction.base)) return renew(pending);
    notePlaces();
    for (Pending& one : pending_)
        if (!one.sent) renew(one);
}

bool Session::Impl::objectsMovedSince(Revision base) const {
    return log_.lastPlace() > log_.markAfter(base);
}

void Session::Impl::readdress(Pending& pending) {
    Transaction& transaction = pending.transaction;
    const bool objectsMoved = objectsMovedSince(transaction.base);
    if (objectsMoved) notePlaces(pending);
    for (std::uint32_t index = 0; index < transaction.edits.size(); ++index) {
        const bool isRenewed = objectsMoved && followPlace(pending, index);
        readdress(transaction.edits[index], transaction.base, {transaction.id.sequence, index},
                  isRenewed);
    }
}

// M15: others may have moved the object at the place of a spec that is created below a spec of
// pending work. The address by creation says nothing about that, so the places are noted before the
// first edit gets another base.
void Session::Impl::notePlaces() {
    for (Pending& pending : pending_) notePlaces(pending);
}

void Session::Impl::notePlaces(Pending& pending) {
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

// Returns the place at which pending work creates a spec, at the base of `later`.
std::optional<std::string> Session::Impl::placeOf(const Creation& creation, const Pending& later) {
    const bool isSame = creation.sequence == later.transaction.id.sequence;
    const Pending* pending = isSame ? &later : pending_.find(creation.sequence);
    if (!pending || creation.edit >= pending->transaction.edits.size()) return std::nullopt;
    const Edit& edit = pending->transaction.edits[creation.edit];
    if (!std::holds_alternative<CreateSpec>(edit.action)) return std::nullopt;
    const auto noted = pending->places.find(creation.edit);
    if (noted == pending->places.end() && edit.address.creation) return std::nullopt;
    return log_.translatePlaceBetween(
        edit.layer, noted == pending->places.end() ? edit.address.path : noted->second,
        log_.markAfter(pending->transaction.base), log_.markAfter(later.transaction.base),
        NamespaceLog::authorOf(options_.client));
}

// Returns whether the address is a path at the current revision now.
bool Session::Impl::followPlace(Pending& pending, std::uint32_t index) const {
    Edit& edit = pending.transaction.edits[index];
    const auto noted = pending.places.find(index);
    if (noted == pending.places.end() || !edit.address.creation ||
        creations_.find(*edit.address.creation))
        return false;
    const std::uint64_t since = log_.markAfter(pending.transaction.base);
    const auto self = NamespaceLog::authorOf(options_.client);
    const std::string before = noted->second;
    auto now = log_.translatePlaceBetween(edit.layer, before, since, log_.mark(), self);
    if (now == before) return false;
    const std::string& relative = edit.address.path;
    const std::string above = before.substr(0, before.size() - relative.size());
    if (relative.starts_with('{') || !before.ends_with(relative) ||
        absolutePath(relative, above) != before)
        return false;
    const auto aboveNow = log_.translatePlaceBetween(edit.layer, above, since, log_.mark(), self);
    if (!now)
        edit.address = unresolvable({pending.transaction.id.sequence, index});
    else if (aboveNow && specpath::hasPrefix(*now, *aboveNow))
        edit.address.path = relativePath(*now, *aboveNow);
    else
        edit.address = {*now, {}};
    if (now) noted->second = *std::move(now);
    return !edit.address.creation;
}

void Session::Impl::readdressGesture() {
    if (!gesture_ || gesture_->pending.transaction.base == revision_) return;
    if (objectsMovedSince(gesture_->pending.transaction.base)) notePlaces();
    readdress(gesture_->pending);
    gesture_->pending.transaction.base = revision_;
}

void Session::Impl::addressCarried(Pending& pending,
                                   std::vector<std::optional<AuthoredEdit>> edits) {
    pending.prognosis = {};
    pending.changedSince = pending.sent;
    pending.transaction.base = revision_;
    const bool movesObjects = std::ranges::any_of(
        pending.authored, [](const AuthoredEdit& edit) { return concernsPlace(edit.action); });
    pending.transaction.seen = movesObjects ? revision_ : 0;
    pending.places.clear();
    pending.placesOf = 0;
    for (std::size_t index = 0; index < edits.size(); ++index) {
        const Creation number{pending.transaction.id.sequence, std::uint32_t(index)};
        auto addressed = edits[index] ? prediction_.author(*edits[index], number, pending.prognosis)
                                      : fail(ErrorCode::SpecDeleted, "dropped");
        if (!addressed) pending.prognosis.complete = false;
        const AuthoredEdit& edit = pending.authored[index];
        pending.transaction.edits[index] =
            addressed ? std::move(*addressed) : Edit{edit.layer, unresolvable(number), edit.action};
    }
}

void Session::Impl::showDifference(const LayerDocs& before) {
    for (const LayerId& layer : layersOf(before, prediction_.docs())) {
        const LayerDoc* now = prediction_.find(layer);
        if (!now || !isJoined(layer) || resets_.contains(layer)) continue;
        const auto old = before.find(layer);
        const LayerDoc& shown = old == before.end() ? confirmed_.at(layer) : old->second;
        for (const auto& [path, action] : difference(shown, *now))
            editor_.apply(layer, path, action);
    }
}

void Session::Impl::flushResets() {
    for (const LayerId& layer : std::exchange(resets_, {})) {
        const LayerDoc* doc = view(layer);
        if (!doc) continue;
        editor_.reset(layer, *doc);
        events_.push_back(event::Joined{layer, revision_});
    }
}

// ---- another history

// ID4: what the editor was told is committed, and the joined history lacks, becomes lost work: the
// edits that turn the present layers into those of then.
void Session::Impl::reportAbandoned() {
    if (!abandoned_) return;
    const LayerDoc none;
    LostWork work{.sequence = 0,
                  .gesture = 0,
                  .reason = std::move(abandoned_->reason),
                  .refused = false,
                  .edits = {}};
    for (const auto& [layer, then] : abandoned_->docs) {
        const auto found = confirmed_.find(layer);
        const LayerDoc& now = found == confirmed_.end() ? none : found->second;
        for (auto& [path, action] : difference(now, matchedSpecs(now, then)))
            work.edits.push_back({layer, std::move(path), std::move(action)});
    }
    abandoned_.reset();
    if (!work.edits.empty()) events_.push_back(event::Lost{std::move(work)});
}

// Called when the confirmed layers are not valid any more. The view stays until all layers have
// been joined again. Own work is carried over by its paths in the view.
void Session::Impl::freeze() {
    if (!frozen_) carryOver();
    if (sending_) {  // it gets new addresses, and is sent again from its first part
        if (Pending* pending = pending_.find(sending_->sequence)) pending_.markUnsent(*pending);
        sending_.reset();
    }
    // Also those that are being joined: the commits that follow their content are unknown.
    for (auto& [layer, opened] : layers_) opened.restart();
    restartJoins();
    restartPrediction();
    dirty_ = false;
    host_.discard(std::make_shared<LayerDocs>(std::exchange(confirmed_, {})));
    log_ = {};
    creations_ = {};
    committed_.clear();
    discard(prediction_.startAnew());
}

void Session::Impl::carryOver() {
    for (const auto& [id, preview] : std::exchange(previews_, {}))
        events_.push_back(event::PreviewChanged{id.first, id.second, true});
    Prediction before = prediction_.startAnew();
    for (Pending& pending : pending_) pending.carried = prediction_.land(pending.transaction).edits;
    if (gesture_) gesture_->pending.carried = prediction_.land(gesture_->pending.transaction).edits;
    dirty_ = false;
    showDifference(before.docs());
    discard(std::move(before));

    frozen_.emplace();
    for (auto& [layer, opened] : layers_)
        if (!opened.joining && opened.wanted)
            frozen_->views.emplace(layer, *prediction_.find(layer));
}

void Session::Impl::thaw() {
    for (const auto& [layer, opened] : layers_)
        if (opened.joining && opened.joining->again) return;
    host_.discard(std::make_shared<LayerDocs>(std::move(frozen_->views)));
    frozen_.reset();
    reportAbandoned();
    discard(prediction_.startAnew());
    const auto withoutLayer = [this](const Pending& pending) {
        return std::any_of(pending.carried.begin(), pending.carried.end(), [&](const auto& edit) {
            return edit && !confirmed_.contains(edit->layer);
        });
    };
    for (Pending& pending : pending_.takeAll()) {
        if (withoutLayer(pending)) {
            lose(std::move(pending), {ErrorCode::LayerNotFound, "its layer is gone"});
            continue;
        }
        addressCarried(pending, std::exchange(pending.carried, {}));
        pending_.add(std::move(pending));
    }
    if (gesture_) addressCarried(gesture_->pending, std::exchange(gesture_->pending.carried, {}));
    for (const auto& [layer, opened] : layers_)
        if (!opened.joining && opened.wanted) resets_.insert(layer);
    // The edits have addresses as if they were made now. The executor decides about them: a spec
    // that they create may exist already (M13).
    restartPrediction();
    presentAgain();
}

// ---- closing

bool Session::Impl::ownWorkOn(const LayerId& layer) const {
    const auto& edits = gesture_ ? gesture_->pending.authored : std::vector<AuthoredEdit>();
    return pending_.touches(layer) ||
           std::any_of(edits.begin(), edits.end(),
                       [&](const AuthoredEdit& edit) { return edit.layer == layer; });
}

void Session::Impl::dropClosed() {
    for (auto entry = closed_.begin(); entry != closed_.end();) {
        const LayerId& layer = *entry;
        if (ownWorkOn(layer)) {
            ++entry;
            continue;
        }
        const Joining* joining = joiningOf(layer);
        const bool asked = !joining || joining->snapshot.request != 0;
        if (online_ && asked) sendControl(CloseLayer{layer});
        if (joining) {
            requests_.forget(joining->snapshot.request);
            joins_.erase(joining->snapshot.request);
        }
        if (auto closed = confirmed_.extract(layer))
            host_.discard(std::make_shared<LayerDoc>(std::move(closed.mapped())));
        if (rebuild_ || prediction_.predicts(layer)) restartPrediction();
        layers_.erase(layer);
        entry = closed_.erase(entry);
    }
}

}  // namespace usdlive::client
