// Fills a layer with the content of a LayerDoc, or writes a doc as a new layer.
#include "usdlive/common/usd/LayerFill.h"

#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/abstractData.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/fileFormat.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <deque>
#include <functional>
#include <set>
#include <unordered_map>

#include "LeafCodec.h"
#include "StoreDelegate.h"
#include "Tokens.h"
#include "usdlive/common/core/Utf8.h"
#include "usdlive/common/usd/NamedAssets.h"
#include "usdlive/common/usd/TfComplaints.h"

namespace usdlive::usd {

using pxr::SdfPath;
using pxr::TfToken;
using pxr::VtValue;

namespace {

std::size_t listNumber(SpecKind kind) {
    std::size_t number = 0;
    while (number < kChildLists.size() && !belongsIn(kind, kChildLists[number])) ++number;
    return number;
}

// Overrides with at most this many specs are merged into an empty layer one by one.
constexpr std::size_t kMergedSpecs = 10'000;

// Returns empty data of the layer's own kind. The default for `.usd` is binary, but the layer may
// have been read from a text file.
pxr::SdfAbstractDataRefPtr emptyData(const pxr::SdfLayer& layer) {
    const auto data = layer.GetFileFormat()->InitData(layer.GetFileFormatArguments());
    if (!data->StreamsData() || layer.StreamsData()) return data;
    return pxr::SdfFileFormat::FindById(TfToken("usda"))->InitData({});
}

}  // namespace

struct LayerFill::State {
    using FieldValues = std::vector<std::pair<TfToken, VtValue>>;

    // Root prims are kept apart until the end, because adding them is what causes Sdf's notices.
    struct RootPrim {
        SdfPath path;
        FieldValues fields;
    };
    // A spec whose children are still being added.
    struct Level {
        NodeId node;
        SdfPath path;
        SpecKind kind;
        std::size_t list = 0;  // list of the last child, as an index into kChildLists
        std::uint64_t order = 0;
        pxr::TfTokenVector names = {};  // the names in that list
    };
    struct Waiting {
        SdfPath path;
        TfToken field;
        FieldValue value;
    };

    State(const pxr::SdfLayerHandle& layer, BlobSource& source)
        : data(emptyData(*layer)), blobs(source) {}

    Result<void> addSpec(NodeId node, NodeId parent, std::uint64_t order, SpecKind kind,
                         std::string_view name) {
        if (kind == SpecKind::PseudoRoot && !begun) {
            begun = true;
            above.push_back({node, SdfPath::AbsoluteRootPath(), kind});
            return {};
        }
        while (!above.empty() && above.back().node != parent) leave();
        if (above.empty() || !startChild(above.back(), order, kind))
            return fail(ErrorCode::InvalidEdit, "the spec " + inQuotes(name) + " is out of order");
        ++specs;
        const TfToken token = specNames(name);
        above.back().names.push_back(token);
        SdfPath path = childOf(above.back().path, kChildLists[above.back().list], token);
        if (above.size() == 1)
            rootPrims.push_back({path, {}});
        else
            data->CreateSpec(path, pxr::SdfSpecType(kind));
        above.push_back({node, std::move(path), kind});
        return {};
    }

    // Returns false if such a child cannot follow the existing ones.
    bool startChild(Level& level, std::uint64_t order, SpecKind kind) {
        const std::size_t list = listNumber(kind);
        const bool first = level.names.empty() || list != level.list;
        if (list == kChildLists.size() || !hasList(level.kind, kChildLists[list]) ||
            list < level.list || (!first && order <= level.order))
            return false;
        if (first) setNames(level);
        level.list = list;
        level.order = order;
        return true;
    }

    // Sets a field of the last spec of `above`.
    void set(const TfToken& field, VtValue value) {
        if (above.size() == 1)
            rootFields.emplace_back(field, std::move(value));
        else if (above.size() == 2)
            rootPrims.back().fields.emplace_back(field, std::move(value));
        else
            data->Set(above.back().path, field, value);
    }

    void setNames(Level& level) {
        if (level.names.empty()) return;
        const TfToken& field = childrenField(kChildLists[level.list]);
        set(field, VtValue::Take(level.names));
        level.names.clear();
    }

    void leave() {
        setNames(above.back());
        above.pop_back();
    }

    void addField(const TfToken& field, const FieldValue& value) {
        if (isStructural(field)) return;
        const Level& spec = above.back();
        auto decoded = decodeField(spec.path, field, value, blobs);
        if (!decoded) {
            if (decoded.error().code == ErrorCode::BlobNotFound)
                waiting.push_back({spec.path, field, value});
            else
                leftOut.push_back(decoded.error());
            return;
        }
        if (namesLayers(field.GetString())) addNamedAssets(decoded->value, named.arcs);
        if (namesClips(field.GetString())) addNamedAssets(decoded->value, named.clips);
        if (decoded->offsets) set(pxr::SdfFieldKeys->SubLayerOffsets, VtValue(*decoded->offsets));
        if (const auto names = targetFields(spec.kind, field))
            addTargets(spec.path, *names, decoded->value);
        set(field, std::move(decoded->value));
    }

    void addTargets(const SdfPath& property, const TargetFields& names, const VtValue& value) {
        auto paths = targetsIn(value);
        if (paths.empty()) return;
        for (const SdfPath& path : paths)
            data->CreateSpec(property.AppendTarget(path), names.childType);
        set(names.children, VtValue::Take(paths));
    }

    void setRootPrims(const auto& create) {
        for (const RootPrim& prim : rootPrims) {
            create(prim.path);
            for (const auto& [field, value] : prim.fields) data->Set(prim.path, field, value);
        }
    }

    // Returns true if all root prims are defined, because a stage then composes them with
    // everything below anyway.
    [[nodiscard]] bool definesRootPrims() const {
        return !rootPrims.empty() && std::ranges::all_of(rootPrims, [](const RootPrim& prim) {
            return std::ranges::any_of(prim.fields, [](const auto& field) {
                return field.first == pxr::SdfFieldKeys->Specifier &&
                       field.second != pxr::SdfSpecifierOver;
            });
        });
    }

    // Fills a layer that has no prims. The notice for each root prim covers everything below it, so
    // the rest is written without notices.
    void writeQuietly(SdfLayerStore::Delegate& delegate) {
        const SdfPath& root = SdfPath::AbsoluteRootPath();
        for (const TfToken& field : delegate.data().List(root))
            data->Set(root, field, delegate.data().Get(root, field));
        auto before = data;
        swapLayerData(delegate.layer(), before);
        setRootPrims(
            [&](const SdfPath& path) { delegate.CreateSpec(path, pxr::SdfSpecTypePrim, false); });
        for (const TfToken& present : data->List(root))
            if (present != pxr::SdfChildrenKeys->PrimChildren &&
                std::ranges::none_of(rootFields,
                                     [&](const auto& field) { return field.first == present; }))
                delegate.SetField(root, present, VtValue());
        for (const auto& [field, value] : rootFields)
            if (!areIdentical(delegate.data().Get(root, field), value))
                delegate.SetField(root, field, value);
    }

    // Writes the differences spec by spec and field by field, like edits.
    void merge(SdfLayerStore::Delegate& delegate) {
        complete();
        const auto present = specsOf(delegate.data());
        const auto wanted = specsOf(*data);
        const auto kept = [&](const SdfPath& path) {
            return data->GetSpecType(path) == delegate.data().GetSpecType(path);
        };
        for (const SdfPath& path : present)
            if (delegate.data().HasSpec(path) && !kept(path)) remove(delegate, path);
        for (const SdfPath& path : wanted)
            if (!delegate.data().HasSpec(path)) {
                delegate.CreateSpec(path, data->GetSpecType(path), true);
                delegate.added.insert(path);
            }
        for (const SdfPath& path : wanted) mergeFields(delegate, path);
    }

    static void remove(SdfLayerStore::Delegate& delegate, const SdfPath& path) {
        if (path.IsTargetPath()) return delegate.DeleteSpec(path, true);
        delegate.deleteBelow(path);
    }

    void mergeFields(SdfLayerStore::Delegate& delegate, const SdfPath& path) {
        const TfToken& offsets = pxr::SdfFieldKeys->SubLayerOffsets;
        const auto mergeField = [&](const TfToken& field) {
            VtValue value = data->Get(path, field);
            if (areIdentical(delegate.data().Get(path, field), value)) return;
            const auto list = std::ranges::find(kChildLists, field, childrenField);
            if (list != kChildLists.end())
                delegate.setChildren(path, *list, value.GetWithDefault<pxr::TfTokenVector>());
            else
                delegate.SetField(path, field, value);
        };
        auto fields = data->List(path);
        for (const TfToken& field : delegate.data().List(path))
            if (!data->Has(path, field)) fields.push_back(field);
        // Sdf compares the offsets with the sublayers, which have to be set first.
        std::partition(fields.begin(), fields.end(),
                       [&](const TfToken& field) { return field != offsets; });
        std::ranges::for_each(fields, mergeField);
    }

    // Returns all specs, each after its parent.
    static std::set<SdfPath> specsOf(const pxr::SdfAbstractData& data) {
        struct Visitor final : pxr::SdfAbstractDataSpecVisitor {
            bool VisitSpec(const pxr::SdfAbstractData&, const SdfPath& path) override {
                paths.insert(path);
                return true;
            }
            void Done(const pxr::SdfAbstractData&) override {}
            std::set<SdfPath> paths;
        } visitor;
        data.VisitSpecs(&visitor);
        return std::move(visitor.paths);
    }

    void swap(SdfLayerStore::Delegate& delegate) {
        complete();
        auto before = data;
        swapLayerData(delegate.layer(), before);
        delegate.markDirty();
    }

    // Replaces everything. Comparing would read the whole file first.
    void replace(SdfLayerStore::Delegate& delegate) {
        complete();
        setLayerData(delegate.layer(), data);
    }

    void complete() {
        setRootPrims([&](const SdfPath& path) { data->CreateSpec(path, pxr::SdfSpecTypePrim); });
        for (const auto& [field, value] : rootFields)
            data->Set(SdfPath::AbsoluteRootPath(), field, value);
    }

    // Everything except the pseudo-root's fields and the root prims.
    const pxr::SdfAbstractDataRefPtr data;
    BlobSource& blobs;
    bool begun = false;
    std::vector<Level> above;  // from the pseudo-root to the last spec
    FieldValues rootFields;    // the fields of the pseudo-root
    std::deque<RootPrim> rootPrims;
    std::vector<Waiting> waiting;
    std::vector<Error> leftOut;
    Named named;
    std::size_t specs = 0;
    Tokens fieldNames, specNames;
};

LayerFill::LayerFill(const pxr::SdfLayerHandle& layer, BlobSource& blobs)
    : state_(std::make_unique<State>(layer, blobs)) {}
LayerFill::~LayerFill() = default;

Result<void> LayerFill::addSpec(NodeId node, NodeId parent, std::uint64_t order, SpecKind kind,
                                std::string_view name) {
    return state_->addSpec(node, parent, order, kind, name);
}

void LayerFill::addField(std::string_view name, const FieldValue& value) {
    state_->addField(state_->fieldNames(name), value);
}

const LayerFill::Named& LayerFill::named() const { return state_->named; }

void LayerFill::add(const LayerDoc& doc) {
    doc.visit([this](const LayerDoc::SpecView& spec) {
        // Cannot fail, because a doc is in the right order.
        (void)addSpec(spec.node, spec.parent, spec.order, spec.kind, spec.name);
        for (const auto& [name, value] : *spec.fields) addField(name, value);
    });
}

Result<void> LayerFill::into(SdfLayerStore& store, Notices notices) {
    while (!state_->above.empty()) state_->leave();
    auto& delegate = *store.delegate_;
    {
        const pxr::SdfChangeBlock block;
        const SdfLayerStore::Delegate::Applying applying(delegate);
        delegate.place();
        delegate.waiting.clear();
        // A layer from a file without prims has an empty list of them.
        const auto prims = delegate.data().GetAs<pxr::TfTokenVector>(
            SdfPath::AbsoluteRootPath(), pxr::SdfChildrenKeys->PrimChildren);
        const bool isFile =
            !std::exchange(delegate.filled, true) && delegate.layer()->StreamsData();
        const bool asWhole = state_->definesRootPrims() || state_->specs > kMergedSpecs;
        if (notices == Notices::None)
            state_->swap(delegate);
        else if (prims.empty() && asWhole)
            state_->writeQuietly(delegate);
        else if (!prims.empty() && isFile)
            state_->replace(delegate);
        else
            state_->merge(delegate);
        // Missing blobs may have arrived since.
        for (const auto& [path, field, value] : state_->waiting)
            if (auto set = delegate.set(path, field, value); !set)
                state_->leftOut.push_back(set.error());
            else if (namesClips(field.GetString()))
                addNamedAssets(delegate.data().Get(path, field), state_->named.clips);
    }
    if (!state_->leftOut.empty()) return tl::unexpected(state_->leftOut.front());
    return {};
}

// Nothing can use the new layer yet, so that nothing misses a notice.
pxr::SdfLayerRefPtr copyOfLayer(const pxr::SdfLayer& layer) {
    const auto copy = pxr::SdfLayer::CreateAnonymous(".usda");
    // Pcp reads no relocates of a new layer until it has unsaved changes (SdfLayer::GetHints()).
    copy->SetComment("copy");
    auto data = emptyData(*copy);
    data->CopyFrom(layerData(layer));
    swapLayerData(copy, data);
    return copy;
}

Result<pxr::SdfLayerRefPtr> makeLayer(const LayerDoc& doc, BlobSource& blobs,
                                      const std::string& formatId) {
    const auto format = pxr::SdfFileFormat::FindById(TfToken(formatId));
    if (!format) return fail(ErrorCode::InvalidArgument, "unknown file format " + formatId);
    auto layer = pxr::SdfLayer::CreateAnonymous("usdlive." + formatId, format);
    LayerFill fill(layer, blobs);
    fill.add(doc);
    SdfLayerStore store(layer, blobs, nullptr);
    if (auto filled = fill.into(store); !filled) return tl::unexpected(filled.error());
    if (store.waitsForBlobs())
        return fail(ErrorCode::BlobNotFound, "big values of the layer are missing");
    return layer;
}

Result<std::string> exportText(const LayerDoc& doc, BlobSource& blobs) {
    const auto layer = makeLayer(doc, blobs, "usda");
    if (!layer) return tl::unexpected(layer.error());
    const TfComplaints complaints;
    std::string text;
    if (!(*layer)->ExportToString(&text) || complaints.hasErrors())
        return fail(ErrorCode::SaveFailed, complaints.text("the layer cannot be written as text"));
    if (!pxr::SdfLayer::CreateAnonymous(".usda")->ImportFromString(text))
        return fail(ErrorCode::SaveFailed,
                    "the layer's text cannot be read back: " + complaints.text("no reason"));
    return text;
}

}  // namespace usdlive::usd
