// Moves layers through the history of a project.
#include "usd/editor/PastLayers.h"

#include <pxr/base/tf/token.h>
#include <pxr/usd/sdf/layerUtils.h>

#include <algorithm>
#include <filesystem>
#include <string_view>
#include <utility>

#include "usd/editor/ClientImpl.h"
#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/layer/MatchedSpecs.h"
#include "usdlive/common/usd/NamedAssets.h"
#include "usdlive/common/usd/ValueCodec.h"

namespace usdlive::client {

namespace {

// The server closes a session that asks for more than 16 layers of old revisions at once.
constexpr std::size_t kLayersAtOnce = 4;
// The commits that are read at once.
constexpr Revision kCommitsAtOnce = 512;
// A jump over more commits reads the layers at its end instead of the commits.
constexpr Revision kFar = 2'000;
// Commits that are known ahead while playing.
constexpr Revision kAhead = 256;
constexpr std::string_view kSubLayersField = "subLayers";

// Its items are no values of OpenUSD by themselves: each has an asset path and an offset.
void addSubLayers(const FieldValue& field, std::set<std::string>& assets) {
    const auto* list = field.as<ListOp>();
    if (!list) return;
    for (const Value& item : (*list)[ListName::Explicit])
        assets.insert(std::string(ByteReader(item.bytes()).text()));
}

}  // namespace

Result<std::unique_ptr<PastLayers>> PastLayers::create(Dependencies dependencies, LayerId root,
                                                       const std::optional<ServerAddress>& web) {
    auto folders = ClientFolders::create({});
    if (!folders) return tl::unexpected(folders.error());
    std::unique_ptr<PastLayers> past(
        new PastLayers(dependencies, std::move(root), std::move(folders->background),
                       std::move(folders->own), std::move(folders->cache)));
    if (web)
        if (auto base = past->files_.start(past->places_->folder(), web))
            past->places_->useAddresses(std::move(*base));
    return past;
}

PastLayers::PastLayers(Dependencies dependencies, LayerId root, std::unique_ptr<Worker> worker,
                       ProcessFolder folder, std::unique_ptr<CacheFolderPlaces> places)
    : with_(dependencies),
      root_(std::move(root)),
      folder_(std::move(folder)),
      worker_(std::move(worker)),
      places_(std::move(places)) {}

PastLayers::~PastLayers() = default;

Revision PastLayers::first() const {
    return std::max<Revision>(with_.session.welcome()->base.value_or(0), 1);
}
Revision PastLayers::last() const { return with_.session.revision(); }

pxr::SdfLayerRefPtr PastLayers::root() const {
    const auto found = layers_.find(root_);
    return shown_ > 0 && found != layers_.end() ? found->second.layer : pxr::SdfLayerRefPtr();
}

std::optional<std::int64_t> PastLayers::timeOf(Revision revision) const {
    if (!timeline_.contains(revision) || revision == timeline_.first()) return std::nullopt;
    return timeline_.timeOf(revision);
}

void PastLayers::aim(Revision revision) {
    if (std::exchange(target_, revision) != revision) dropNext();
}

Result<void> PastLayers::advance() {
    const auto done = step();
    if (!done) dropNext();
    return done;
}

Result<void> PastLayers::step() {
    for (;;) {
        if (failed_) return tl::unexpected(*std::exchange(failed_, std::nullopt));
        if (asked_ && asked_->isDone()) {
            Asked asked = std::move(*std::exchange(asked_, nullptr));
            if (auto taken = take(std::move(asked)); !taken) return taken;
            continue;
        }
        if (asked_) askMore();
        if (next_) {
            if (asked_ && asked_->purpose == Asked::For::Layers) return {};
            const auto prepared = isPrepared();
            if (!prepared) return tl::unexpected(prepared.error());
            if (!*prepared) return {};
            show();
            continue;
        }
        if (isThere()) return {};
        // A known content can be shown while more is read.
        if (asked_ && (shown_ == 0 || !timeline_.contains(target_))) return {};
        if (auto begun = begin(); !begun) return begun;
    }
}

// Layers that it has made, and that show nothing yet, are made again when they are needed.
void PastLayers::dropNext() {
    next_.reset();
    std::erase_if(layers_, [](const auto& entry) { return !entry.second.store; });
}

// --- reading

std::vector<LayerId> PastLayers::known() const {
    std::vector<LayerId> all{root_};
    for (const auto& [id, layer] : layers_)
        if (id != root_) all.push_back(id);
    return all;
}

void PastLayers::ask(Asked::For purpose, Revision revision, std::vector<LayerId> layers) {
    asked_ = std::make_shared<Asked>();
    asked_->purpose = purpose;
    asked_->revision = revision;
    asked_->waiting = std::move(layers);
    askMore();
}

void PastLayers::askMore() {
    while (!asked_->error && !asked_->waiting.empty() && asked_->open < kLayersAtOnce) {
        const LayerId layer = asked_->waiting.back();
        asked_->waiting.pop_back();
        ++asked_->open;
        with_.session.peek(
            layer, asked_->revision,
            [asked = asked_, layer, isRoot = layer == root_](Result<LayerDoc> doc, Revision) {
                --asked->open;
                // A layer that the project lacks by now has no content.
                if (!doc && !isRoot && doc.error().code == ErrorCode::LayerNotFound)
                    doc = LayerDoc();
                if (doc)
                    asked->docs.emplace(layer, *std::move(doc));
                else
                    asked->error = doc.error();
            });
    }
}

void PastLayers::askLog(Revision from, Revision to) {
    ++asked_->open;
    with_.session.requestLog(
        from, to, [asked = asked_](const Commit& commit) { asked->commits.push_back(commit); },
        [asked = asked_](Result<void> end) {
            --asked->open;
            if (!end) asked->error = end.error();
        });
}

// Asks for what the target needs, or begins with its content.
Result<void> PastLayers::begin() {
    const bool isFar =
        shown_ == 0 || target_ > timeline_.last() + kFar || target_ + kFar < timeline_.first();
    if (isFar) {
        ask(Asked::For::Restart, target_, known());
    } else if (target_ > timeline_.last()) {
        prefetch(Direction::Forward);
    } else if (target_ < timeline_.first()) {
        prefetch(Direction::Backward);
    } else {
        auto docs = timeline_.at(target_);
        if (!docs) return tl::unexpected(docs.error());
        next_ = Next{};
        next_->revision = target_;
        next_->docs = *std::move(docs);
    }
    if (asked_ || next_) return {};
    return fail(ErrorCode::FutureRevision,
                "the project has no revision " + std::to_string(target_) +
                    " any more: the client has joined another history. Open another player");
}

void PastLayers::prefetch(Direction direction) {
    if (asked_ || shown_ == 0) return;
    const Revision first = timeline_.first(), known = timeline_.last();
    if (direction == Direction::Forward) {
        if (known >= last() || known >= std::max(target_, shown_ + kAhead)) return;
        ask(Asked::For::Later, 0, {});
        askLog(known + 1, std::min(known + kCommitsAtOnce, last()));
    } else {
        const Revision oldest = std::max(this->first(), oldest_);
        const bool isNeeded = target_ < first;
        if (!isNeeded && (first <= oldest || first + kAhead <= shown_)) return;
        const Revision begin = std::min(target_, first);
        const Revision from =
            begin > oldest + kCommitsAtOnce ? begin - kCommitsAtOnce : std::min(oldest, begin);
        ask(Asked::For::Earlier, from, this->known());
        askLog(from + 1, first);
    }
}

Result<void> PastLayers::take(Asked asked) {
    const Revision newest = std::min(target_, timeline_.first());
    if (asked.error && asked.error->code == ErrorCode::HistoryReplaced &&
        asked.purpose == Asked::For::Earlier && asked.revision < newest) {
        oldest_ = newest;  // a base was made since the connection
        return {};
    }
    const bool isAhead = asked.purpose == Asked::For::Later || asked.purpose == Asked::For::Earlier;
    if (asked.error && isAhead && timeline_.contains(target_)) return {};  // nothing needs it yet
    if (asked.error) return tl::unexpected(*asked.error);
    switch (asked.purpose) {
        case Asked::For::Restart:
            next_ = Next{};
            next_->revision = asked.revision;
            next_->restarts = true;
            for (auto& [id, doc] : asked.docs) {
                const auto shown = docs_.find(id);
                next_->docs.emplace(
                    id, shown == docs_.end() ? std::move(doc) : matchedSpecs(shown->second, doc));
            }
            break;
        case Asked::For::Later:
            // The timeline may have been restarted meanwhile.
            if (!asked.commits.empty() && asked.commits.front().revision == timeline_.last() + 1)
                timeline_.add(std::move(asked.commits));
            break;
        case Asked::For::Earlier: {
            if (asked.commits.empty() || asked.commits.back().revision != timeline_.first()) break;
            auto later = timeline_.commits();
            timeline_.start(std::move(asked.docs), asked.revision);
            timeline_.add(std::move(asked.commits));
            timeline_.add(std::move(later));
            // The same content, with the ids of the specs that the earlier ones have, too.
            auto same = timeline_.at(shown_);
            if (!same) return tl::unexpected(same.error());
            docs_ = *std::move(same);
            dropNext();
            break;
        }
        case Asked::For::Layers:
            if (!next_ || next_->revision != asked.revision) break;
            next_->docs.merge(asked.docs);
            next_->restarts = true;  // the contents that are kept lack them
            break;
    }
    return {};
}

// --- preparing

Result<bool> PastLayers::isPrepared() {
    for (const auto& [id, doc] : next_->docs)
        if (next_->examined.insert(id).second) examine(id, doc);
    std::erase_if(next_->blobs, [this](const Hash& hash) { return with_.blobs.holds(hash); });
    if (!next_->blobs.empty()) return false;
    for (const auto& [id, doc] : next_->docs)
        if (auto started = startFill(id, doc); !started) return tl::unexpected(started.error());
    if (std::ranges::any_of(layers_, [](const auto& entry) {
            return entry.second.fill && !entry.second.fill->isDone();
        }))
        return false;
    std::set<LayerId> used;
    for (const auto& [id, doc] : next_->docs)
        if (next_->named.insert(id).second) addNamed(id, namedBy(id, doc), used);
    std::erase_if(used, [this](const LayerId& id) { return next_->docs.contains(id); });
    if (used.empty()) return true;
    ask(Asked::For::Layers, next_->revision, {used.begin(), used.end()});
    return false;
}

// Finds what changes in a layer, and asks for its big values.
void PastLayers::examine(const LayerId& id, const LayerDoc& doc) {
    const auto need = [this](const Value& blob) {
        if (!with_.blobs.holds(blob.hash()) && next_->blobs.insert(blob.hash()).second)
            with_.session.requestBlob(blob.hash());
    };
    const auto shown = docs_.find(id);
    if (shown == docs_.end()) return forEachBlob(doc, need);
    Edits edits = difference(shown->second, doc);
    for (const auto& [path, action] : edits) forEachBlob(action, need);
    next_->edits.emplace(id, std::move(edits));
}

Result<void> PastLayers::startFill(const LayerId& id, const LayerDoc& doc) {
    Layer& layer = layers_[id];
    if (layer.store || layer.fill) return {};
    if (auto made = places_->makeFindable(id); !made) return tl::unexpected(made.error());
    const std::string identifier = places_->identifierOf(id);
    layer.layer = pxr::SdfLayer::FindOrOpen(identifier);
    if (!layer.layer) return fail(ErrorCode::LayerUnreadable, "cannot open " + identifier);
    layer.layer->SetPermissionToEdit(false);
    layer.fill = std::make_unique<BackgroundFill>(layer.layer, with_.blobs, with_.filler);
    layer.fill->add(doc);
    return {};
}

usd::LayerFill::Named PastLayers::namedBy(const LayerId& id, const LayerDoc& doc) const {
    const Layer& layer = layers_.at(id);
    if (layer.fill) return layer.fill->named();
    usd::LayerFill::Named named;
    for (const auto& [path, action] : next_->edits.at(id)) {
        const auto* set = std::get_if<SetField>(&action);
        const bool clips = set && usd::namesClips(set->field);
        if (!set || (!clips && !usd::namesLayers(set->field))) continue;
        const FieldValue* field = doc.has(path) ? doc.field(path, set->field) : nullptr;
        if (!field) continue;
        if (set->field == kSubLayersField) {
            addSubLayers(*field, named.arcs);
            continue;
        }
        const auto value = usd::decodeValue(pxr::TfToken(set->field), *field, with_.blobs);
        if (value) usd::addNamedAssets(*value, clips ? named.clips : named.arcs);
    }
    return named;
}

void PastLayers::addNamed(const LayerId& id, const usd::LayerFill::Named& named,
                          std::set<LayerId>& used) {
    const auto& project = with_.session.projectLayers();
    const pxr::SdfLayerRefPtr& layer = layers_.at(id).layer;
    const auto folder = std::filesystem::path(id.value).parent_path();
    const auto add = [&](const std::string& asset) {
        if (asset.empty()) return;
        // OpenUSD looks beside the layer first, for a file that is there.
        const LayerId beside{(folder / asset).lexically_normal().string()};
        if (project.contains(beside)) static_cast<void>(places_->makeFindable(beside));
        const auto found = places_->layerAt(pxr::SdfComputeAssetPathRelativeToLayer(layer, asset));
        if (found && project.contains(*found)) used.insert(*found);
    };
    for (const std::string& asset : named.arcs) add(asset);
    for (const std::string& asset : named.clips) {
        if (!usd::isTemplate(asset)) {
            add(asset);
            continue;
        }
        const std::string pattern = (folder / asset).lexically_normal().string();
        for (const LayerId& one : project)
            if (usd::matchesTemplate(pattern, one.value)) used.insert(one);
    }
}

// --- showing

void PastLayers::show() {
    Next next = std::move(*std::exchange(next_, std::nullopt));
    {
        usd::SdfLayerStore::Block block;
        for (auto& [id, layer] : layers_) {
            if (!layer.fill) continue;
            layer.layer->SetPermissionToEdit(true);
            layer.store = std::make_unique<usd::SdfLayerStore>(layer.layer, with_.blobs, nullptr);
            // Leaves out content that this OpenUSD does not know, as in a live layer.
            static_cast<void>(layer.fill->into(*layer.store));
            layer.fill.reset();
            layer.layer->SetPermissionToEdit(false);
        }
        for (const auto& [id, edits] : next.edits) {
            Layer& layer = layers_.at(id);
            for (const auto& [path, action] : edits)
                if (!layer.apart.take(path, action))
                    static_cast<void>(layer.store->apply(path, action, block));
        }
    }
    for (auto& [id, layer] : layers_)
        while (!layer.apart.isEmpty()) {
            usd::SdfLayerStore::Block block;
            for (const EditAction& edit : layer.apart.next())
                static_cast<void>(layer.store->apply("/", edit, block));
        }
    docs_ = std::move(next.docs);
    shown_ = next.revision;
    if (next.restarts) timeline_.start(docs_, shown_);
}

bool PastLayers::needs(const Hash& hash) const { return next_ && next_->blobs.contains(hash); }

void PastLayers::blobFailed(const Hash& hash, const Error& reason) {
    if (!needs(hash)) return;
    failed_ = reason;
}

}  // namespace usdlive::client
