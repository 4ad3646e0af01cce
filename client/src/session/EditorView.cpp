// Follows commits, previews and own work with the view.
#include "session/EditorView.h"

#include <algorithm>
#include <memory>
#include <stdexcept>
#include <utility>

namespace usdlive::client {

namespace {

// Number of own structural edits that are committed before the prediction is computed again, which
// drops its notes about them.
constexpr std::size_t kAnsweredKept = 4'096;

std::set<LayerId> layersOf(const LayerDocs& left, const LayerDocs& right) {
    std::set<LayerId> layers;
    for (const auto& [layer, doc] : left) layers.insert(layer);
    for (const auto& [layer, doc] : right) layers.insert(layer);
    return layers;
}

// Returns whether each edit was committed at the predicted path and unchanged. The executor may
// change it (M13, ED9).
bool asPredicted(const Pending& own, const Commit& commit) {
    if (!own.expectation.complete || !commit.dropped.empty()) return false;
    const auto& submitted = own.transaction.edits;
    if (commit.edits.size() != submitted.size()) return false;
    auto touched = own.expectation.touched.begin();
    const auto end = own.expectation.touched.end();
    for (std::size_t index = 0; index < submitted.size(); ++index) {
        const Edit& edit = commit.edits[index];
        if (touched == end || touched->path != edit.address.path) return false;
        if (fieldOf(edit.action) && edit.action != submitted[index].action) return false;
        ++touched;
        const auto* move = std::get_if<MoveSpec>(&edit.action);
        if (move && touched != end && touched->path == destination(edit.address.path, *move))
            ++touched;
    }
    return touched == end;
}

}  // namespace

EditorView::EditorView(const Parts& parts) : parts_(parts) {}

bool EditorView::isJoined(const LayerId& layer) const {
    if (frozen_) return parts_.opened.isWanted(layer) && frozen_->contains(layer);
    return parts_.opened.isJoined(layer);
}

const LayerDoc* EditorView::find(const LayerId& layer) const {
    if (!isJoined(layer)) return nullptr;
    return frozen_ ? &frozen_->at(layer) : prediction_.find(layer);
}

// While the prediction is outdated, it lacks some commits.
Revision EditorView::seenUntil(const LayerId& layer) const {
    return outdated_ ? prediction_.openedAt(layer) : parts_.confirmed.revision;
}

Revision EditorView::oldestNeeded(Revision otherwise) const {
    Revision oldest = prediction_.oldest(otherwise);
    if (next_) oldest = next_->prediction.oldest(oldest);
    if (parts_.gesture) oldest = std::min(oldest, neededSince(parts_.gesture->pending.transaction));
    return oldest;
}

// ---- edits of the editor

Result<Edit> EditorView::author(Pending& pending, const AuthoredEdit& edit) {
    if (!isJoined(edit.layer))
        return fail(ErrorCode::LayerNotOpen, "the layer " + edit.layer.value + " is not open");
    if (frozen_) {  // addressed when it is carried over
        const auto applied = frozen_->at(edit.layer).apply(edit.path, edit.action);
        if (!applied) return tl::unexpected(applied.error());
        return Edit{edit.layer, {}, edit.action};
    }
    const Creation number{pending.transaction.id.sequence,
                          std::uint32_t(pending.transaction.edits.size())};
    const LayerDoc* doc = prediction_.find(edit.layer);
    const bool exists =
        std::holds_alternative<CreateSpec>(edit.action) && doc && doc->has(edit.path);
    auto addressed = prediction_.author(edit, number, pending.expectation);
    if (addressed && exists) createdExisting_ = true;
    if (addressed) parts_.addresses.renew(*addressed, prediction_.openedAt(edit.layer), number);
    return addressed;
}

// The executor decides about the fields of a spec that exists already (M13).
void EditorView::authored() {
    if (std::exchange(createdExisting_, false) && !frozen_) recompute();
    check();
}

Result<Edit> EditorView::addressed(const AuthoredEdit& edit, const Creation& number) const {
    auto addressed = prediction_.addressed(edit);
    if (addressed) parts_.addresses.renew(*addressed, prediction_.openedAt(edit.layer), number);
    return addressed;
}

Result<void> EditorView::writeAgain(const AuthoredEdit& edit, const Creation& number) {
    Expectation unchanged;
    const auto addressed = prediction_.author(edit, number, unchanged);
    if (!addressed) return tl::unexpected(addressed.error());
    return {};
}

Inverse EditorView::inverseOf(const AuthoredEdit& edit) const {
    const LayerDoc* doc = frozen_ ? nullptr : find(edit.layer);
    return doc ? inverseBefore(*doc, edit.path, edit.action) : Inverse();
}

void EditorView::Repairs::add(const EditorView& view, const AuthoredEdit& edit) {
    const LayerDoc* doc = view.find(edit.layer);
    if (!doc) return;
    if (fieldOf(edit.action) && doc->has(edit.path))
        fields_.push_back(edit);
    else
        resets_.insert(edit.layer);
}

void EditorView::Repairs::follow(const AuthoredEdit& accepted) {
    const auto below = [&](const AuthoredEdit& other) {
        return other.layer == accepted.layer && specpath::hasPrefix(other.path, accepted.path);
    };
    if (std::holds_alternative<DeleteSpec>(accepted.action)) std::erase_if(fields_, below);
    const auto* move = std::get_if<MoveSpec>(&accepted.action);
    if (!move) return;
    const std::string to = destination(accepted.path, *move);
    for (AuthoredEdit& other : fields_)
        if (below(other)) other.path = specpath::replacePrefix(other.path, accepted.path, to);
}

void EditorView::repair(const Repairs& repairs) {
    for (const LayerId& layer : repairs.resets_)
        if (const LayerDoc* doc = find(layer)) parts_.editor.reset(layer, *doc);
    for (const AuthoredEdit& edit : repairs.fields_) {
        const LayerDoc* doc = find(edit.layer);
        if (!doc || repairs.resets_.contains(edit.layer) || !doc->has(edit.path)) continue;
        const std::string& name = *fieldOf(edit.action);
        if (const FieldValue* value = doc->field(edit.path, name))
            parts_.editor.apply(edit.layer, edit.path, SetField{name, {}, *value});
        else
            parts_.editor.apply(edit.layer, edit.path, EraseField{name, {}});
    }
}

// ---- commits

bool EditorView::isPending(std::uint64_t sequence) const {
    return parts_.pending.contains(sequence) ||
           (parts_.gesture && parts_.gesture->pending.transaction.id.sequence == sequence);
}

Prediction* EditorView::valid() {
    if (valid_ == Valid::Next && next_) return &next_->prediction;
    return valid_ == Valid::Shown ? &prediction_ : nullptr;
}

// Finds the prediction that is valid after this commit: the shown one, or else the one that is
// being computed. A computation is stopped only if its result would be wrong. Otherwise another one
// follows it, so that a stream of commits cannot keep it from ever being shown.
void EditorView::commitComes(const Commit& commit, const Pending* own) {
    valid_ = Valid::None;
    if (frozen_ || (outdated_ && !next_)) return;
    const Prediction& current = next_ ? next_->prediction : prediction_;
    bool holds = true, canGoOn = next_.has_value();
    if (own) {
        const bool isNext =
            parts_.pending.isFirst(commit.id.sequence) && (!next_ || next_->done > 0);
        canGoOn = canGoOn && isNext && !current.previewsChangeNames() && asPredicted(*own, commit);
        holds = isNext && parts_.previews.isEmpty() && asPredicted(*own, commit);
    } else {
        const auto pending = [this](std::uint64_t number) { return isPending(number); };
        for (const Edit& edit : commit.edits) {
            if (!parts_.confirmed.layers.contains(edit.layer)) continue;
            if (current.effect(edit, pending) != Prediction::Effect::Invalidates) continue;
            holds = false;
            canGoOn = canGoOn && !changesNamespace(edit);
        }
    }
    if (!holds && !canGoOn) return restart();
    if (!holds) next_->outdated = true;
    valid_ = next_ ? Valid::Next : Valid::Shown;
}

// Layers without predictions show the confirmed doc, so every commit applies. Layers with
// predictions show it when the prediction is valid or has been computed again.
void EditorView::commitShown(const Commit& commit, const Pending* own) {
    using Effect = Prediction::Effect;
    if (frozen_) return;
    Prediction* current = valid();
    const LayerId* layer = nullptr;  // layer of the edit before: most commits edit one layer
    bool known = false, predicted = false, shown = false;
    const auto pending = [this](std::uint64_t number) { return isPending(number); };
    for (const Edit& edit : commit.edits) {
        if (!layer || *layer != edit.layer) {
            layer = &edit.layer;
            known = parts_.confirmed.layers.contains(*layer);
            predicted = prediction_.predicts(*layer);
            shown = isJoined(*layer) && !resets_.contains(*layer);
        }
        if (!known) continue;
        const bool applies = current && !own && current->effect(edit, pending) == Effect::Applies;
        if (applies) current->apply(edit);
        if (predicted && (outdated_ || !applies)) continue;
        if (shown) show(edit.layer, edit.address.path, edit.action);
    }
}

void EditorView::acknowledged(const Pending& own) {
    if (Prediction* current = valid())
        current->acknowledge(own.transaction.id.sequence, own.expectation);
    if (next_) --next_->done;
    const auto& edits = own.transaction.edits;
    answered_ += std::size_t(std::ranges::count_if(
        edits, [](const Edit& edit) { return fieldOf(edit.action) == nullptr; }));
    if (!parts_.pending.empty()) {
        // Drops the notes about their specs from time to time.
        if (!outdated_ && answered_ > std::max(kAnsweredKept, 2 * parts_.pending.size())) restart();
        return;
    }
    if (outdated_ || frozen_ || parts_.gesture || !parts_.previews.isEmpty()) return restart();
    check();  // the views are the confirmed docs again
    discard(prediction_.startAnew());
    answered_ = 0;
}

void EditorView::followUndo() {
    if (outdated_ || frozen_) return;
    parts_.undo.follow([this](const LayerId& layer, const std::string& path, std::uint64_t mark) {
        return prediction_.pathInView(layer, path, mark);
    });
}

// The prediction computed step by step has to equal one that is computed at once.
void EditorView::check() const {
    if (!parts_.options.checksPrediction || outdated_ || frozen_) return;
    Prediction anew(parts_.confirmed);
    predictPreviews(anew);
    for (const Pending& pending : parts_.pending) anew.run(pending.transaction);
    if (parts_.gesture) anew.run(parts_.gesture->pending.transaction);
    for (const LayerId& layer : layersOf(anew.docs(), prediction_.docs())) {
        if (*anew.find(layer) == *prediction_.find(layer)) continue;
        throw std::logic_error("the prediction of " + layer.value + " is wrong; it should be\n" +
                               anew.find(layer)->dump() + "and is\n" +
                               prediction_.find(layer)->dump());
    }
}

// ---- layers

void EditorView::joined(const LayerId& layer, bool again) {
    if (!again || !frozen_) resets_.insert(layer);
}

void EditorView::allJoined() {
    if (next_) restart();
}

void EditorView::joinFailed(const LayerId& layer) {
    if (frozen_) frozen_->erase(layer);
}

void EditorView::dropped(const LayerId& layer) {
    if (next_ || prediction_.predicts(layer)) restart();
}

// ---- predictions

// Destroys a small prediction here: handing it over would take as long.
void EditorView::discard(Prediction old) {
    constexpr std::size_t kLittle = 256;
    if (old.fieldsNoted() > kLittle)
        parts_.host.discard(std::make_shared<Prediction>(std::move(old)));
}

void EditorView::restart() {
    outdated_ = true;
    if (next_) discard(std::move(next_->prediction));
    next_.reset();
}

void EditorView::previewsChanged() {
    outdated_ = true;
    if (next_) next_->outdated = true;
}

void EditorView::recompute() {
    restart();
    compute();
}

void EditorView::complete() {
    constexpr double kNoBound = 1e12;
    parts_.deadline.set(kNoBound);
    while (outdated_ && !frozen_) compute();
}

void EditorView::update() {
    readdressGesture();
    if (outdated_) compute();
    showResets();
}

void EditorView::readdressGesture() {
    if (!parts_.gesture) return;
    Pending& pending = parts_.gesture->pending;
    if (pending.transaction.base == parts_.confirmed.revision) return;
    parts_.addresses.renewWithPlaces(pending);
    pending.transaction.base = parts_.confirmed.revision;
}

// M7: the confirmed layers, previews of others, own transactions, the open gesture. Stops when the
// time is over; the view stays as it is, and the next call continues.
void EditorView::compute() {
    if (!next_) predictPreviews(next_.emplace(Next{Prediction(parts_.confirmed)}).prediction);
    for (std::size_t count = 0; next_->done < parts_.pending.size(); ++next_->done) {
        if (parts_.deadline.isOver(++count)) return;
        Pending& pending = parts_.pending[next_->done];
        pending.expectation = next_->prediction.run(pending.transaction);
    }
    predictGesture(next_->prediction);
    Prediction before = std::exchange(prediction_, std::move(next_->prediction));
    outdated_ = next_->outdated;
    next_.reset();
    answered_ = 0;
    showDifference(before.docs());
    discard(std::move(before));
}

void EditorView::predictPreviews(Prediction& prediction) const {
    for (const auto& [slot, frame] : parts_.previews.shown()) prediction.preview(slot, *frame);
}

// An edit for which the executor would refuse the open gesture is removed from it, so that the rest
// stays visible. Its author learns at once. An edit that only conflicts with a preview stays.
void EditorView::predictGesture(Prediction& prediction) {
    if (!parts_.gesture) return;
    Pending& pending = parts_.gesture->pending;
    const auto run = [&] { pending.expectation = prediction.run(pending.transaction); };
    run();
    if (!pending.expectation.refused) return;
    Prediction confirmed(parts_.confirmed);
    for (const Pending& own : parts_.pending) confirmed.run(own.transaction);
    while (const auto refused = confirmed.land(pending.transaction).refused) {
        LostWork work{.sequence = pending.transaction.id.sequence,
                      .gesture = pending.transaction.gesture,
                      .reason = refused->error,
                      .refused = false,
                      .edits = {}};
        work.edits.push_back(parts_.gesture->remove(refused->edit));
        parts_.undo.removed(pending.transaction.id.sequence, refused->edit);
        parts_.events.push(event::Lost{std::move(work)});
    }
    run();
}

void EditorView::showDifference(const LayerDocs& before) {
    for (const LayerId& layer : layersOf(before, prediction_.docs())) {
        const LayerDoc* now = prediction_.find(layer);
        if (!now || !isJoined(layer) || resets_.contains(layer)) continue;
        const auto old = before.find(layer);
        const LayerDoc& shown =
            old == before.end() ? parts_.confirmed.layers.at(layer) : old->second;
        for (const auto& [path, action] : difference(shown, *now)) show(layer, path, action);
    }
}

void EditorView::show(const LayerId& layer, const std::string& path, const EditAction& action) {
    parts_.undo.shown(layer, path, action);
    parts_.editor.apply(layer, path, action);
}

void EditorView::showResets() {
    for (const LayerId& layer : std::exchange(resets_, {})) {
        const LayerDoc* doc = find(layer);
        if (!doc) continue;
        parts_.editor.reset(layer, *doc);
        parts_.events.push(event::Joined{layer, parts_.confirmed.revision});
    }
}

// ---- another history

void EditorView::freeze() {
    if (!frozen_) carryOver();
    restart();
    outdated_ = false;
    discard(prediction_.startAnew());
}

void EditorView::carryOver() {
    Prediction before = prediction_.startAnew();
    const auto land = [this](Pending& pending) {
        pending.carried = prediction_.land(pending.transaction).edits;
    };
    for (Pending& pending : parts_.pending) land(pending);
    if (parts_.gesture) land(parts_.gesture->pending);
    outdated_ = false;
    showDifference(before.docs());
    discard(std::move(before));

    LayerDocs docs;
    parts_.opened.forEachJoined(
        [&](const LayerId& layer) { docs.emplace(layer, *prediction_.find(layer)); });
    frozen_ = std::move(docs);
}

void EditorView::thaw() {
    parts_.host.discard(std::make_shared<LayerDocs>(*std::exchange(frozen_, {})));
    discard(prediction_.startAnew());
}

void EditorView::carried(Pending& pending) {
    const auto edits = std::exchange(pending.carried, {});
    const Revision revision = parts_.confirmed.revision;
    pending.expectation = {};
    pending.changedSince = pending.sent;
    pending.transaction.base = revision;
    const bool movesObjects = std::ranges::any_of(
        pending.authored, [](const AuthoredEdit& edit) { return concernsPlace(edit.action); });
    pending.transaction.seen = movesObjects ? revision : 0;
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
                      : Edit{edit.layer, OwnAddresses::unresolvable(number), edit.action};
    }
}

// The edits have addresses as if they were made now. The executor decides about them: a spec that
// they create may exist already (M13).
void EditorView::showAll() {
    parts_.opened.forEachJoined([this](const LayerId& layer) { resets_.insert(layer); });
    restart();
}

}  // namespace usdlive::client
