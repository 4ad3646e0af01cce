#include <algorithm>
#include <stdexcept>

#include "SessionImpl.h"

namespace usdlive::client {

namespace {

std::set<LayerId> layersOf(const LayerDocs& left, const LayerDocs& right) {
    std::set<LayerId> layers;
    for (const auto& [layer, doc] : left) layers.insert(layer);
    for (const auto& [layer, doc] : right) layers.insert(layer);
    return layers;
}

// An address that no server resolves: the edit itself does not create a spec for itself. The edit
// keeps its place in the transaction, is dropped (M4), and comes back to its author as such.
Edit gone(const Pending& pending, std::size_t index) {
    const AuthoredEdit& edit = pending.authored[index];
    return {edit.layer,
            {{}, Creation{pending.transaction.id.sequence, std::uint32_t(index)}},
            edit.action};
}

}  // namespace

void Session::Impl::settle() {
    if (frozen_) thaw();
    if (frozen_) return;
    dropClosed();
    if (dirty_) rebuild();
    flushResets();
}

// M7: the confirmed layers, previews of others, one's own transactions, the open gesture.
void Session::Impl::rebuild() {
    const LayerDocs before = prediction_.takeDocs();
    const bool anew = gesture_ || std::any_of(pending_.begin(), pending_.end(),
                                              [](const Pending& p) { return p.reseal; });
    // Addresses are told without the previews: those may never come to be.
    if (anew) predict(false, true);
    if (!anew || !previews_.empty()) predict(true, false);
    dirty_ = false;
    tellEditor(before);
}

void Session::Impl::predict(bool previews, bool anew) {
    prediction_.start(creations_, revision_);
    if (previews) {
        std::map<std::uint64_t, const PreviewFrame*> inOrder;
        for (const auto& [id, preview] : previews_)
            if (preview.frame) inOrder[preview.slot] = &*preview.frame;
        for (const auto& [slot, frame] : inOrder) prediction_.preview(slot, *frame);
    }
    for (Pending& pending : pending_) {
        if (anew && pending.reseal)
            reseal(pending);
        else
            pending.prognosis = prediction_.run(pending.transaction);
    }
    if (!gesture_) return;
    if (anew)
        resealGesture();
    else
        gesture_->pending.prognosis = prediction_.run(gesture_->pending.transaction);
}

// The whole prediction, of transactions as they stand.
void Session::Impl::replay(Prediction& prediction) const {
    prediction.start(creations_, revision_);
    std::map<std::uint64_t, const PreviewFrame*> inOrder;
    for (const auto& [id, preview] : previews_)
        if (preview.frame) inOrder[preview.slot] = &*preview.frame;
    for (const auto& [slot, frame] : inOrder) prediction.preview(slot, *frame);
    for (const Pending& pending : pending_) prediction.run(pending.transaction);
    if (gesture_) prediction.run(gesture_->pending.transaction);
}

// What was predicted step by step has to be what comes of all of it at once.
void Session::Impl::checkPrediction() const {
    if (!options_.checksPrediction || dirty_ || frozen_) return;
    NamespaceLog log = log_;
    log.truncate(prediction_.confirmedNames());
    Prediction anew(confirmed_, log);
    anew.confirmNames();
    replay(anew);
    for (const LayerId& layer : layersOf(anew.docs(), prediction_.docs())) {
        if (*anew.find(layer) == *prediction_.find(layer)) continue;
        throw std::logic_error("the prediction of " + layer.value + " is wrong; it should be\n" +
                               anew.find(layer)->dump() + "and is\n" +
                               prediction_.find(layer)->dump());
    }
}

// Tells the addresses of a transaction anew, as of the present revision: of the edits as they land
// now.
void Session::Impl::reseal(Pending& pending) {
    auto state = prediction_.save();
    Prediction::Landed landed = prediction_.land(pending.transaction);
    prediction_.restore(std::move(state));
    if (landed.refused)  // what stands against it is for the server to say
        pending.prognosis = prediction_.run(pending.transaction);
    else
        seal(pending, std::move(landed.edits));
}

// An edit that stands against an open gesture is taken out of it, rather than all of it hidden: its
// author is still at it, and learns at once.
void Session::Impl::resealGesture() {
    Pending& pending = gesture_->pending;
    for (;;) {
        auto state = prediction_.save();
        Prediction::Landed landed = prediction_.land(pending.transaction);
        prediction_.restore(std::move(state));
        if (!landed.refused) return seal(pending, std::move(landed.edits));
        LostWork work{.sequence = pending.transaction.id.sequence,
                      .gesture = pending.transaction.gesture,
                      .reason = landed.refused->error,
                      .refused = false,
                      .edits = {}};
        work.edits.push_back(gesture_->remove(landed.refused->edit));
        events_.push_back(event::Lost{std::move(work)});
    }
}

void Session::Impl::seal(Pending& pending, std::vector<std::optional<AuthoredEdit>> edits) {
    pending.reseal = false;
    pending.prognosis = {};
    pending.transaction.base = revision_;
    for (std::size_t index = 0; index < edits.size(); ++index) {
        const Creation number{pending.transaction.id.sequence, std::uint32_t(index)};
        auto told = edits[index] ? prediction_.author(*edits[index], number, pending.prognosis)
                                 : fail(ErrorCode::SpecDeleted, "dropped");
        if (!told) pending.prognosis.complete = false;
        pending.transaction.edits[index] = told ? std::move(*told) : gone(pending, index);
    }
    if (!pending.prognosis.complete) pending.prognosis.fieldsAt.clear();
}

void Session::Impl::tellEditor(const LayerDocs& before) {
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

// The confirmed layers are worth nothing any more. The editor keeps what it sees until all its
// layers have been fetched again; one's own work is carried over by where it stands now.
void Session::Impl::freeze() {
    if (!frozen_) carryOver();
    // Also what was on its way: the commits that have to follow it are not known any more.
    for (auto& [layer, opened] : layers_) opened.joinAnew();
    prediction_.start({}, 0);
    confirmed_.clear();
    log_ = {};
    prediction_.confirmNames();
    creations_ = {};
}

void Session::Impl::carryOver() {
    for (const auto& [id, preview] : std::exchange(previews_, {}))
        events_.push_back(event::PreviewChanged{id.first, id.second, true});
    const LayerDocs before = prediction_.takeDocs();
    prediction_.start(creations_, revision_);
    for (Pending& pending : pending_) pending.carried = prediction_.land(pending.transaction).edits;
    if (gesture_) gesture_->pending.carried = prediction_.land(gesture_->pending.transaction).edits;
    dirty_ = false;
    tellEditor(before);

    frozen_.emplace();
    for (auto& [layer, opened] : layers_)
        if (!opened.joining && opened.wanted)
            frozen_->views.emplace(layer, *prediction_.find(layer));
}

void Session::Impl::thaw() {
    for (const auto& [layer, opened] : layers_)
        if (opened.joining && opened.joining->again) return;
    frozen_.reset();
    prediction_.start(creations_, revision_);
    const auto homeless = [this](const Pending& pending) {
        return std::any_of(pending.carried.begin(), pending.carried.end(), [&](const auto& edit) {
            return edit && !confirmed_.contains(edit->layer);
        });
    };
    for (Pending& pending : pending_.takeAll()) {
        if (homeless(pending)) {
            lose(std::move(pending), {ErrorCode::LayerNotFound, "its layer is gone"});
            continue;
        }
        seal(pending, std::exchange(pending.carried, {}));
        pending_.add(std::move(pending));
    }
    if (gesture_) seal(gesture_->pending, std::exchange(gesture_->pending.carried, {}));
    for (const auto& [layer, opened] : layers_)
        if (!opened.joining && opened.wanted) resets_.insert(layer);
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
    for (auto entry = layers_.begin(); entry != layers_.end();) {
        const LayerId& layer = entry->first;
        const OpenedLayer& opened = entry->second;
        if (opened.wanted || ownWorkOn(layer)) {
            ++entry;
            continue;
        }
        const bool asked = !opened.joining || opened.joining->snapshot.request != 0;
        if (online_ && asked) sendControl(CloseLayer{layer});
        confirmed_.erase(layer);
        dirty_ = dirty_ || prediction_.predicts(layer);
        entry = layers_.erase(entry);
    }
}

}  // namespace usdlive::client
