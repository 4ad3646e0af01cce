// Lets stages compose files and layers that were not there when a layer named them.
#include "usd/assets/LateAssets.h"

#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/fileFormat.h>
#include <pxr/usd/sdf/layerUtils.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <iterator>
#include <utility>

#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/core/PercentEncoding.h"
#include "usdlive/common/layer/NoBlobs.h"
#include "usdlive/common/usd/NamedAssets.h"
#include "usdlive/common/usd/ValueCodec.h"

namespace usdlive::client {

namespace {

// Returns the name of the file that an asset path names, without the path in a package and without
// arguments for a file format.
std::string nameOfFile(std::string_view asset) {
    asset = asset.substr(0, std::min(asset.find('['), asset.find(":SDF_FORMAT_ARGS:")));
    return std::string(asset.substr(asset.rfind('/') + 1));
}

// The files that such a path names depend on variables.
bool isExpression(std::string_view asset) { return asset.starts_with('`'); }

}  // namespace

/// A part of a field that may name a wanted file or layer.
struct LateAssets::Named {
    LayerId layer;
    std::string path, field;
    FieldPart part;
    std::vector<std::string> assets;  // that may be wanted; empty: not known
};

/// Used by the worker until isDone, afterwards by the owner.
struct LateAssets::Search {
    void run() {
        for (const auto& [layer, doc] : docs)
            doc.visit([&](const LayerDoc::SpecView& spec) {
                for (const auto& [field, value] : *spec.fields)
                    if (const auto* list = value.as<ListOp>(); list && usd::namesLayers(field))
                        lookInList(layer, spec, field, *list);
                    else if (usd::namesClips(field))
                        lookInClips(layer, spec, field, value);
            });
        docs.clear();
        isDone = true;
    }

    void lookInList(const LayerId& layer, const LayerDoc::SpecView& spec, const std::string& field,
                    const ListOp& list) {
        for (const ListName name :
             {ListName::Explicit, ListName::Added, ListName::Prepended, ListName::Appended})
            for (const Value& item : list[name]) {
                // The items of these lists begin with the asset path.
                std::string asset(ByteReader(item.bytes()).text());
                if (mayName(asset))
                    found.push_back({layer,
                                     std::string(spec.path),
                                     field,
                                     ListItem{name, item, {}},
                                     {std::move(asset)}});
            }
    }

    void lookInClips(const LayerId& layer, const LayerDoc::SpecView& spec, const std::string& field,
                     const FieldValue& value) {
        NoBlobs none;  // does not wait for big values
        Named named{layer, std::string(spec.path), field, {}, {}};
        if (const auto clips = usd::decodeValue(pxr::TfToken(field), value, none)) {
            std::set<std::string> assets;
            usd::addNamedAssets(*clips, assets);
            std::ranges::copy_if(assets, std::back_inserter(named.assets),
                                 [this](const auto& asset) { return mayName(asset); });
            if (named.assets.empty()) return;
        }
        found.push_back(std::move(named));
    }

    [[nodiscard]] bool mayName(const std::string& asset) const {
        const std::string name = nameOfFile(asset);
        if (usd::isTemplate(name))
            return std::ranges::any_of(
                fileNames, [&](const auto& file) { return usd::matchesTemplate(name, file); });
        return isExpression(asset) || fileNames.contains(name) ||
               fileNames.contains(percentDecoded(name).value_or(name));
    }

    Wanted wanted;
    std::set<std::string> fileNames;  // the file names of these
    std::vector<std::pair<LayerId, LayerDoc>> docs;
    std::vector<Named> found;
    std::atomic<bool> isDone = false;
};

LateAssets::LateAssets(LiveSet& live, LayerPlaces& places, const PlainFiles& files, Worker& worker)
    : live_(live), places_(places), files_(files), worker_(worker) {}
LateAssets::~LateAssets() = default;

void LateAssets::add(const std::vector<LayerId>& layers) {
    for (const LayerId& layer : layers) next_.layers.insert(layer.value);
}

void LateAssets::add(const std::vector<std::string>& files) {
    for (const std::string& file : files)
        if (pxr::SdfFileFormat::FindByExtension(file)) next_.files.insert(file);
}

void LateAssets::compose() {
    takeFound([this](LiveLayer& live, const Named& named) {
        const auto* item = std::get_if<ListItem>(&named.part);
        if (item && isWanted(live, named)) live.notify(named.path, named.field, *item);
        return item != nullptr;
    });
    if (!search_ && !next_.isEmpty()) start();
}

void LateAssets::composeClips() {
    std::set<LayerId> changed;
    {
        const pxr::SdfChangeBlock block;
        takeFound([&](LiveLayer& live, const Named& named) {
            if (std::holds_alternative<ListItem>(named.part)) return false;
            if (isWanted(live, named)) {
                live.takeOut(named.path, named.field);
                changed.insert(live.id());
            }
            return true;
        });
    }
    const pxr::SdfChangeBlock block;
    for (const LayerId& id : changed)
        if (LiveLayer* live = live_.find(id)) live->restore();
}

/// Calls `take` for all that was found in live layers, and forgets those for which it returns true.
template <class Take>
void LateAssets::takeFound(Take take) {
    if (!search_ || !search_->isDone) return;
    std::erase_if(search_->found, [&](const Named& named) {
        LiveLayer* const live = live_.find(named.layer);
        if (!live) return true;
        // A field that the editor has just written stays until that is part of a transaction.
        return !live->hasWrites() && take(*live, named);
    });
    if (search_->found.empty()) search_.reset();
}

bool LateAssets::isWanted(const LiveLayer& live, const Named& named) const {
    return named.assets.empty() || std::ranges::any_of(named.assets, [&](const auto& asset) {
               return isWanted(live, asset);
           });
}

/// Returns whether the asset path, as the layer means it, is one of those that are wanted.
bool LateAssets::isWanted(const LiveLayer& live, const std::string& asset) const {
    if (isExpression(asset)) return true;
    const auto identifier = pxr::SdfComputeAssetPathRelativeToLayer(live.layer(), asset);
    const Wanted& wanted = search_->wanted;
    const auto id = places_.layerAt(identifier);
    if (id && usd::isTemplate(asset))
        return std::ranges::any_of(std::array{&wanted.layers, &wanted.files}, [&](auto* paths) {
            return std::ranges::any_of(
                *paths, [&](const auto& path) { return usd::matchesTemplate(id->value, path); });
        });
    if (id && wanted.layers.contains(id->value)) return places_.makeFindable(*id).has_value();
    const auto file = files_.fileAt(identifier);
    return file && wanted.files.contains(*file);
}

void LateAssets::start() {
    auto search = std::make_shared<Search>();
    search->wanted = std::exchange(next_, {});
    for (const auto* paths : {&search->wanted.files, &search->wanted.layers})
        for (const std::string& path : *paths) search->fileNames.insert(nameOfFile(path));
    for (const auto& [id, live] : live_.all())
        if (const LayerDoc* doc =
                live->uses().namesLayers() || live->uses().namesClips() ? live->content() : nullptr)
            search->docs.emplace_back(id, *doc);
    if (search->docs.empty()) return;
    search_ = search;
    worker_.post([search] { search->run(); });
}

}  // namespace usdlive::client
