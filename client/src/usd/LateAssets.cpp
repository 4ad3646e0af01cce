// Lets stages compose files and layers that were not there when a layer named them.
#include "usd/LateAssets.h"

#include <pxr/usd/sdf/fileFormat.h>
#include <pxr/usd/sdf/layerUtils.h>

#include <algorithm>
#include <atomic>
#include <utility>

#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/core/PercentEncoding.h"
#include "usdlive/common/usd/LayerFill.h"

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

/// An item of a field that names a file or layer.
struct LateAssets::Named {
    LayerId layer;
    std::string path, field;
    ListItem item;
    std::string asset;
};

/// Used by the worker until isDone, afterwards by the owner.
struct LateAssets::Search {
    void run() {
        for (const auto& [layer, doc] : docs)
            doc.visit([&](const LayerDoc::SpecView& spec) {
                for (const auto& [field, value] : *spec.fields)
                    if (const auto* list = value.as<ListOp>(); list && usd::namesLayers(field))
                        look(layer, spec, field, *list);
            });
        docs.clear();
        isDone = true;
    }

    void look(const LayerId& layer, const LayerDoc::SpecView& spec, const std::string& field,
              const ListOp& list) {
        for (const ListName name :
             {ListName::Explicit, ListName::Added, ListName::Prepended, ListName::Appended})
            for (const Value& item : list[name]) {
                // The items of these lists begin with the asset path.
                std::string asset(ByteReader(item.bytes()).text());
                if (mayName(asset))
                    found.push_back(
                        {layer, std::string(spec.path), field, {name, item, {}}, std::move(asset)});
            }
    }

    [[nodiscard]] bool mayName(const std::string& asset) const {
        const std::string name = nameOfFile(asset);
        return isExpression(asset) || fileNames.contains(name) ||
               fileNames.contains(percentDecoded(name).value_or(name));
    }

    Wanted wanted;
    std::set<std::string> fileNames;  // the file names of these
    std::vector<std::pair<LayerId, LayerDoc>> docs;
    std::vector<Named> found;
    std::atomic<bool> isDone = false;
};

LateAssets::LateAssets(LiveSet& live, LayerPlaces& places, const ProjectFiles& files,
                       Worker& worker)
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
    if (search_ && search_->isDone) {
        // A field that the editor has just written stays until that is part of a transaction.
        std::erase_if(search_->found, [&](const Named& named) {
            LiveLayer* const live = live_.find(named.layer);
            if (live && live->hasWrites()) return false;
            if (live && names(*live, named)) live->notify(named.path, named.field, named.item);
            return true;
        });
        if (search_->found.empty()) search_.reset();
    }
    if (!search_ && !next_.isEmpty()) start();
}

/// Returns whether the asset path, as the layer means it, is one of those that are wanted.
bool LateAssets::names(const LiveLayer& live, const Named& named) const {
    if (isExpression(named.asset)) return true;
    const auto identifier = pxr::SdfComputeAssetPathRelativeToLayer(live.layer(), named.asset);
    const Wanted& wanted = search_->wanted;
    if (const auto id = places_.layerAt(identifier); id && wanted.layers.contains(id->value))
        return places_.makeFindable(*id).has_value();
    const auto file = files_.fileAt(identifier);
    return file && wanted.files.contains(*file);
}

void LateAssets::start() {
    auto search = std::make_shared<Search>();
    search->wanted = std::exchange(next_, {});
    for (const auto* paths : {&search->wanted.files, &search->wanted.layers})
        for (const std::string& path : *paths) search->fileNames.insert(nameOfFile(path));
    for (const auto& [id, live] : live_.all())
        if (const LayerDoc* doc = live->namesLayers() ? live->content() : nullptr)
            search->docs.emplace_back(id, *doc);
    if (search->docs.empty()) return;
    search_ = search;
    worker_.post([search] { search->run(); });
}

}  // namespace usdlive::client
