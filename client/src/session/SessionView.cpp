// The view: predictions, addresses, and joining another history.
#include <algorithm>
#include <stdexcept>

#include "session/SessionImpl.h"
#include "usdlive/common/layer/MatchedSpecs.h"

namespace usdlive::client {

namespace {

std::set<LayerId> layersOf(const LayerDocs& left, const LayerDocs& right) {
    std::set<LayerId> layers;
    for (const auto& [layer, doc] : left) layers.insert(layer);
    for (const auto& [layer, doc] : right) layers.insert(layer);
    return layers;
}

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
        if (deadline_.isOver(++count)) return;
        Pending& pending = pending_[rebuild_->done];
        pending.expectation = rebuild_->next.run(pending.transaction);
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
    for (const auto& [slot, frame] : previews_.shown()) prediction.preview(slot, *frame);
}

// An edit for which the executor would refuse the open gesture is removed from it, so that the rest
// stays visible. Its author learns at once. An edit that only conflicts with a preview stays.
void Session::Impl::predictGesture(Prediction& prediction) {
    if (!gesture_) return;
    Pending& pending = gesture_->pending;
    const auto run = [&] { pending.expectation = prediction.run(pending.transaction); };
    run();
    if (!pending.expectation.refused) return;
    Prediction confirmed(confirmedSide_);
    for (const Pending& own : pending_) confirmed.run(own.transaction);
    while (const auto refused = confirmed.land(pending.transaction).refused) {
        LostWork work{.sequence = pending.transaction.id.sequence,
                      .gesture = pending.transaction.gesture,
                      .reason = refused->error,
                      .refused = false,
                      .edits = {}};
        work.edits.push_back(gesture_->remove(refused->edit));
        undo_.removed(pending.transaction.id.sequence, refused->edit);
        events_.push(event::Lost{std::move(work)});
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

void Session::Impl::readdressGesture() {
    if (!gesture_ || gesture_->pending.transaction.base == revision_) return;
    addresses_.renewWithPlaces(gesture_->pending);
    gesture_->pending.transaction.base = revision_;
}

void Session::Impl::addressCarried(Pending& pending,
                                   std::vector<std::optional<AuthoredEdit>> edits) {
    pending.expectation = {};
    pending.changedSince = pending.sent;
    pending.transaction.base = revision_;
    const bool movesObjects = std::ranges::any_of(
        pending.authored, [](const AuthoredEdit& edit) { return concernsPlace(edit.action); });
    pending.transaction.seen = movesObjects ? revision_ : 0;
    pending.places.clear();
    pending.placesOf = 0;
    for (std::size_t index = 0; index < edits.size(); ++index) {
        const Creation number{pending.transaction.id.sequence, std::uint32_t(index)};
        auto addressed = edits[index]
                             ? prediction_.author(*edits[index], number, pending.expectation)
                             : fail(ErrorCode::SpecDeleted, "dropped");
        if (!addressed) pending.expectation.complete = false;
        const AuthoredEdit& edit = pending.authored[index];
        pending.transaction.edits[index] =
            addressed ? std::move(*addressed)
                      : Edit{edit.layer, addresses_.unresolvable(number), edit.action};
    }
}

void Session::Impl::showDifference(const LayerDocs& before) {
    for (const LayerId& layer : layersOf(before, prediction_.docs())) {
        const LayerDoc* now = prediction_.find(layer);
        if (!now || !isJoined(layer) || resets_.contains(layer)) continue;
        const auto old = before.find(layer);
        const LayerDoc& shown = old == before.end() ? confirmed_.at(layer) : old->second;
        for (const auto& [path, action] : difference(shown, *now)) show(layer, path, action);
    }
}

void Session::Impl::show(const LayerId& layer, const std::string& path, const EditAction& action) {
    undo_.shown(layer, path, action);
    editor_.apply(layer, path, action);
}

// The undo follows commits when the view shows them.
void Session::Impl::followUndo() {
    if (dirty_ || frozen_) return;
    undo_.follow([this](const LayerId& layer, const std::string& path, std::uint64_t mark) {
        return prediction_.pathInView(layer, path, mark);
    });
}

void Session::Impl::flushResets() {
    for (const LayerId& layer : std::exchange(resets_, {})) {
        const LayerDoc* doc = view(layer);
        if (!doc) continue;
        editor_.reset(layer, *doc);
        events_.push(event::Joined{layer, revision_});
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
    if (!work.edits.empty()) events_.push(event::Lost{std::move(work)});
}

// Called when the confirmed layers are not valid any more. The view stays until all layers have
// been joined again. Own work is carried over by its paths in the view.
void Session::Impl::freeze() {
    if (!frozen_) carryOver();
    undo_.clear();
    submissions_.restart();
    // Also those that are being joined: the commits that follow their content are unknown.
    opened_.restartAll();
    restartPrediction();
    dirty_ = false;
    host_.discard(std::make_shared<LayerDocs>(std::exchange(confirmed_, {})));
    log_ = {};
    creations_ = {};
    committed_.clear();
    discard(prediction_.startAnew());
}

void Session::Impl::carryOver() {
    previews_.endAll();
    Prediction before = prediction_.startAnew();
    for (Pending& pending : pending_) pending.carried = prediction_.land(pending.transaction).edits;
    if (gesture_) gesture_->pending.carried = prediction_.land(gesture_->pending.transaction).edits;
    dirty_ = false;
    showDifference(before.docs());
    discard(std::move(before));

    frozen_.emplace();
    opened_.forEachJoined(
        [this](const LayerId& layer) { frozen_->views.emplace(layer, *prediction_.find(layer)); });
}

void Session::Impl::thaw() {
    if (opened_.areJoiningAgain()) return;
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
    opened_.forEachJoined([this](const LayerId& layer) { resets_.insert(layer); });
    // The edits have addresses as if they were made now. The executor decides about them: a spec
    // that they create may exist already (M13).
    restartPrediction();
    previews_.presentAgain();
}

// ---- closing

bool Session::Impl::ownWorkOn(const LayerId& layer) const {
    const auto& edits = gesture_ ? gesture_->pending.authored : std::vector<AuthoredEdit>();
    return pending_.touches(layer) ||
           std::any_of(edits.begin(), edits.end(),
                       [&](const AuthoredEdit& edit) { return edit.layer == layer; });
}

void Session::Impl::dropClosed() {
    const auto hasOwnWork = [this](const LayerId& layer) { return ownWorkOn(layer); };
    opened_.dropClosed(hasOwnWork, [this](const LayerId& layer) {
        if (auto closed = confirmed_.extract(layer))
            host_.discard(std::make_shared<LayerDoc>(std::move(closed.mapped())));
        if (rebuild_ || prediction_.predicts(layer)) restartPrediction();
    });
}

}  // namespace usdlive::client
