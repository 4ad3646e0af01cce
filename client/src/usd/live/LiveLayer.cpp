// Makes an SdfLayer live: fills it, applies edits to it and captures those of the editor.
#include "usd/live/LiveLayer.h"

#include <pxr/base/tf/weakPtr.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/schema.h>

#include <string_view>
#include <utility>
#include <variant>

#include "usdlive/common/usd/NamedAssets.h"

namespace usdlive::client {

namespace {

// The most edits after a snapshot that are applied one by one. If there are more, building the
// content again is faster.
constexpr std::size_t kMostSince = 5'000;

}  // namespace

LiveLayer::LiveLayer(LayerId id, pxr::SdfLayerRefPtr layer, Dependencies dependencies)
    : id_(std::move(id)),
      layer_(std::move(layer)),
      dependencies_(std::move(dependencies)),
      capture_(id_, dependencies_.view, dependencies_.wake, dependencies_.clipsWritten,
               dependencies_.layersNamed),
      permission_(layer_) {
    const auto self = pxr::TfCreateWeakPtr(this);
    replacedKey_ =
        pxr::TfNotice::Register(self, &LiveLayer::onReplaced, pxr::SdfLayerHandle(layer_));
    mutenessKey_ = pxr::TfNotice::Register(self, &LiveLayer::onMuteness);
    savedKey_ = pxr::TfNotice::Register(self, &LiveLayer::onSaved, pxr::SdfLayerHandle(layer_));
    changedKey_ = pxr::TfNotice::Register(self, &LiveLayer::onChanged, pxr::SdfLayerHandle(layer_));
}

LiveLayer::~LiveLayer() {
    restore();
    while (hasApart()) {
        const pxr::SdfChangeBlock block;
        applyApart();
    }
    pxr::TfNotice::Revoke(replacedKey_);
    pxr::TfNotice::Revoke(mutenessKey_);
    pxr::TfNotice::Revoke(savedKey_);
    pxr::TfNotice::Revoke(changedKey_);
    store_.reset();
    permission_.release();
}

bool LiveLayer::isIdle() const {
    return !fill_ && !capture_.hasWrites() && !expectsReplacement_ && !startOver_ &&
           !writtenBeforeMuted_ && !reloadedWritten_ && !usesChanged_ && !saved_ && !hasApart();
}

void LiveLayer::noteUses() {
    usesChanged_ = true;
    dependencies_.wake();
}

void LiveLayer::noteNames(const std::string& path, const EditAction& action) {
    if (uses_.note(path, action)) noteUses();
}

std::unique_ptr<BackgroundFill> LiveLayer::newFill() {
    return std::make_unique<BackgroundFill>(layer_, dependencies_.workerSource,
                                            dependencies_.worker);
}

void LiveLayer::arriving(std::shared_ptr<const SnapshotPart> part) {
    if (part->first) {
        arriving_ = newFill();
        snapshot_.reset();
    }
    if (arriving_) arriving_->add(std::move(part));
}

void LiveLayer::arrived(const LayerDoc& snapshot) {
    if (arriving_) snapshot_ = snapshot;
}

void LiveLayer::reset(const LayerDoc& doc) {
    dependencies_.wake();
    capture_.discard();
    permission_.setClosed(true);
    waiting_.clear();
    apart_ = {};
    auto arriving = std::move(arriving_);
    const auto snapshot = std::exchange(snapshot_, std::nullopt);
    if (snapshot && doc.specCount() > BackgroundFill::kMadeAtOnce) {
        auto since = difference(*snapshot, doc);
        if (since.size() <= kMostSince) {
            for (auto& [path, action] : since)
                waiting_.push_back({std::move(path), std::move(action)});
            fill_ = std::move(arriving);
            return;
        }
    }
    fill_ = newFill();
    fill_->add(doc);
}

void LiveLayer::fill() {
    if (!fill_ || !fill_->isDone()) return;
    if (fill_->hasFailed()) {
        // The session has made a doc from the same parts. Shows that one.
        if (const LayerDoc* view = dependencies_.view()) reset(*view);
        return;
    }
    const bool wasFilled = bool(store_);
    Result<void> filled;
    {
        const EditPermission::OwnWrites permitted(permission_);
        if (!wasFilled)
            store_ = std::make_unique<usd::SdfLayerStore>(layer_, dependencies_.source, &capture_);
        // Sdf does not compare a streaming layer with its new content, and notifies that all was
        // replaced.
        expectsReplacement_ =
            !wasFilled && layer_->StreamsData() && !layer_->GetRootPrims().empty();
        filled = fill_->into(*store_);
        auto named = fill_->named();
        fill_.reset();
        uses_.replace(std::move(named));
    }
    if (!filled) dependencies_.report(filled.error());
    Block block;
    for (const auto& [path, action] : std::exchange(waiting_, {})) applyNow(path, action, block);
    noteUses();
}

void LiveLayer::apply(const std::string& path, const EditAction& action, Block& block) {
    if (fill_)
        waiting_.push_back({path, action});
    else if (store_)
        applyNow(path, action, block);
}

void LiveLayer::applyNow(const std::string& path, const EditAction& action, Block& block) {
    if (apart_.take(path, action))
        dependencies_.wake();
    else
        write(path, action, block);
}

void LiveLayer::applyApart() {
    Block block;
    for (const EditAction& edit : apart_.next()) write("/", edit, block);
}

void LiveLayer::write(const std::string& path, const EditAction& action, Block& block) {
    const auto applied = store_->apply(path, action, block);
    noteNames(path, action);
    if (!applied && !layer_->IsMuted())
        dependencies_.report(
            {applied.error().code, id_.value + " <" + path + ">: " + applied.error().message});
}

void LiveLayer::notify(const std::string& path, const std::string& field, const ListItem& item) {
    const LayerDoc* view = content();
    const FieldValue* value = view ? view->field(path, field) : nullptr;
    if (!value || layer_->IsMuted()) return;
    const pxr::SdfChangeBlock block;
    const SetField whole{field, {}, *value};
    static_cast<void>(store_->apply(path, EraseField{field, item}));
    static_cast<void>(store_->apply(path, whole));
}

void LiveLayer::takeOut(const std::string& path, const std::string& field) {
    const LayerDoc* view = content();
    if (!view || !view->field(path, field) || layer_->IsMuted()) return;
    takenOut_.emplace_back(path, field);
    static_cast<void>(store_->apply(path, EraseField{field, {}}));
}

void LiveLayer::restore() {
    for (const auto& [path, field] : std::exchange(takenOut_, {})) {
        const LayerDoc* view = content();
        const FieldValue* value = view ? view->field(path, field) : nullptr;
        // A notice handler may have written another value.
        if (!value || layer_->IsMuted() ||
            layer_->HasField(pxr::SdfPath(path), pxr::TfToken(field)))
            continue;
        const SetField whole{field, {}, *value};
        static_cast<void>(store_->apply(path, whole));
    }
}

bool LiveLayer::hasWrites() const { return isFilled() && capture_.hasWrites(); }

Capture::Sealed LiveLayer::seal() {
    if (!isFilled()) return {};
    expectsReplacement_ = false;
    written_ = false;
    if (writtenBeforeMuted_ && layer_->IsMuted()) return sealMuted();
    if (startOver_) startOver();
    Capture::Sealed sealed;
    if (hasWrites()) sealed = capture_.seal(*store_, dependencies_.sink);
    for (const auto& edit : sealed.edits) noteNames(edit.path, edit.action);
    if (std::exchange(reloadedWritten_, false))
        sealed.lost.push_back(
            {"/",
             {},
             {ErrorCode::InvalidArgument,
              id_.value + " was reloaded, which discards what was written since the last "
                          "tick(); call it before you reload"},
             {}});
    return sealed;
}

// A mute or a reload has replaced the content, which is not an edit. Sdf keeps the content of a
// muted layer, so writes of the same frame before the mute are read there.
Capture::Sealed LiveLayer::sealMuted() {
    const std::string path = layer_->GetIdentifier();
    pxr::SdfLayer::RemoveFromMutedLayers(path);
    capture_.discard();
    capture_.contentReplaced();
    auto sealed = capture_.seal(*store_, dependencies_.sink);
    pxr::SdfLayer::AddToMutedLayers(path);
    writtenBeforeMuted_ = false;
    startOver_ = true;
    return sealed;
}

// Replaces the content by that of the project.
void LiveLayer::startOver() {
    capture_.discard();
    if (layer_->IsMuted()) return;
    startOver_ = false;
    if (const LayerDoc* view = dependencies_.view()) reset(*view);
}

void LiveLayer::blobArrived(const Hash& hash) {
    if (!isFilled() || !store_->waitsForBlobs()) return;
    std::vector<std::string> named;
    store_->blobArrived(hash, [&](const std::string& path, const std::string& field) {
        if (usd::namesClips(field)) named.push_back(path);
        const LayerDoc* view = dependencies_.view();
        return view ? view->field(path, field) : nullptr;
    });
    for (const std::string& path : named)
        if (uses_.note(path, pxr::SdfFieldKeys->Clips.GetString())) noteUses();
}

void LiveLayer::onReplaced(const pxr::SdfNotice::LayerDidReplaceContent& notice) {
    if (std::exchange(expectsReplacement_, false) || !isFilled()) return;
    if (dynamic_cast<const pxr::SdfNotice::LayerDidReloadContent*>(&notice))
        reloaded();
    else
        capture_.contentReplaced();
    dependencies_.wake();
}

// Sdf has read the layer's file, which has no content or that of the last save. It notifies stages
// afterwards that everything may have changed; they find the content of the project.
void LiveLayer::reloaded() {
    reloadedWritten_ |= std::exchange(written_, false);
    const LayerDoc* view = dependencies_.view();
    if (fill_ || !view || layer_->IsMuted()) {
        startOver_ = true;
        permission_.setClosed(true);  // edits would be lost until it is filled again
        return;
    }
    capture_.discard();
    apart_ = {};
    usd::LayerFill fill(layer_, dependencies_.source);
    fill.add(*view);
    if (const auto filled = fill.into(*store_, usd::LayerFill::Notices::None); !filled)
        dependencies_.report(filled.error());
}

void LiveLayer::onChanged(const pxr::SdfNotice::LayersDidChangeSentPerLayer& notice) {
    const auto list = notice.find(layer_);
    const auto& root = pxr::SdfPath::AbsoluteRootPath();
    if (list != notice.end() && !list->second.GetEntry(root).flags.didReloadContent)
        written_ = hasWrites();
}

void LiveLayer::onSaved(const pxr::SdfNotice::LayerDidSaveLayerToFile&) {
    saved_ = true;
    dependencies_.wake();
}

void LiveLayer::onMuteness(const pxr::SdfNotice::LayerMutenessChanged& notice) {
    if (notice.GetLayerPath() != layer_->GetIdentifier()) return;
    writtenBeforeMuted_ = notice.WasMuted() && isFilled() && !startOver_ && capture_.hasWrites();
    startOver_ = true;
    dependencies_.wake();
}

}  // namespace usdlive::client
