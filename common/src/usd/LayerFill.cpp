#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/fileFormat.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <chrono>

#include "StoreDelegate.h"
#include "usdlive/common/usd/TfComplaints.h"

namespace usdlive::usd {

using pxr::SdfPath;
using pxr::TfToken;
using pxr::VtValue;

struct LayerFill::State {
    using FieldValues = std::vector<std::pair<TfToken, VtValue>>;

    // A spec in the order of the doc: parents before children, siblings in order.
    struct Spec {
        std::size_t parent;
        SpecKind kind;
        std::string_view name;
        const Fields* source;  // in `doc`
        SdfPath path;
        FieldValues fields;
        std::array<pxr::TfTokenVector, kChildLists.size()> children;
    };

    State(LayerDoc layerDoc, BlobSource& source) : doc(std::move(layerDoc)), blobs(source) {
        specs.reserve(doc.specCount());
        std::vector<std::pair<NodeId, std::size_t>> above;
        doc.visit([&](const LayerDoc::SpecView& view) {
            while (!above.empty() && above.back().first != view.parent) above.pop_back();
            const std::size_t parent = above.empty() ? 0 : above.back().second;
            above.emplace_back(view.node, specs.size());
            specs.push_back({parent, view.kind, view.name, view.fields, {}, {}, {}});
        });
    }

    void fillNext() {
        Spec& spec = specs[filled];
        if (filled == 0) {
            spec.path = SdfPath::AbsoluteRootPath();
        } else {
            Spec& parent = specs[spec.parent];
            const TfToken name{std::string(spec.name)};
            const ChildList list = listOf(spec.kind);
            spec.path = childOf(parent.path, list, name);
            parent.children[std::size_t(list)].push_back(name);
        }
        spec.fields.reserve(spec.source->size());
        for (const auto& [name, value] : *spec.source) fillField(spec, TfToken(name), value);
        ++filled;
    }

    static ChildList listOf(SpecKind kind) {
        for (const ChildList list : kChildLists)
            if (belongsIn(kind, list)) return list;
        return ChildList::Prims;
    }

    void fillField(Spec& spec, const TfToken& field, const FieldValue& value) {
        if (isStructural(field)) return;
        auto decoded = decodeField(spec.path, field, value, blobs);
        if (!decoded) {
            if (decoded.error().code == ErrorCode::BlobNotFound)
                waiting.emplace_back(spec.path, field, &value);
            else
                leftOut.push_back(decoded.error());
            return;
        }
        if (decoded->offsets)
            spec.fields.emplace_back(pxr::SdfFieldKeys->SubLayerOffsets,
                                     VtValue(*decoded->offsets));
        if (const auto targets = targetFields(spec.kind, field))
            fillTargets(spec, *targets, decoded->value);
        spec.fields.emplace_back(field, std::move(decoded->value));
    }

    void fillTargets(Spec& spec, const TargetFields& fields, const VtValue& value) {
        auto paths = targetsIn(value);
        if (paths.empty()) return;
        for (const SdfPath& path : paths)
            targets.emplace_back(spec.path.AppendTarget(path), fields.childType);
        spec.fields.emplace_back(fields.children, VtValue::Take(paths));
    }

    void takeChildren(Spec& spec) {
        for (const ChildList list : kChildLists) {
            auto& names = spec.children[std::size_t(list)];
            if (!names.empty()) spec.fields.emplace_back(childrenField(list), VtValue::Take(names));
        }
    }

    // All but the pseudo-root. `create` makes a spec.
    void write(pxr::SdfAbstractData& data, const auto& create) {
        for (Spec& spec : specs) {
            takeChildren(spec);
            if (spec.kind == SpecKind::PseudoRoot) continue;
            create(spec);
            for (const auto& [field, value] : spec.fields) data.Set(spec.path, field, value);
        }
        for (const auto& [path, type] : targets) data.CreateSpec(path, type);
    }

    // Into a layer without prims: a change notice for each root prim says all, so the rest goes
    // into the data behind the layer's back.
    void writeQuietly(SdfLayerStore::Delegate& delegate) {
        write(delegate.data(), [&](const Spec& spec) {
            if (spec.path.IsRootPrimPath())
                delegate.CreateSpec(spec.path, pxr::SdfSpecType(spec.kind), false);
            else
                delegate.data().CreateSpec(spec.path, pxr::SdfSpecType(spec.kind));
        });
        const auto& root = specs.front().path;
        const auto& fields = specs.front().fields;
        for (const TfToken& present : delegate.data().List(root))
            if (present != pxr::SdfChildrenKeys->PrimChildren &&
                std::ranges::none_of(fields, [&](const auto& f) { return f.first == present; }))
                delegate.SetField(root, present, VtValue());
        for (const auto& [field, value] : fields) delegate.SetField(root, field, value);
    }

    // Sdf compares, and tells of what differs.
    void replace(SdfLayerStore::Delegate& delegate) {
        const auto& layer = delegate.layer();
        const auto data = layer->GetFileFormat()->InitData(layer->GetFileFormatArguments());
        write(*data,
              [&](const Spec& spec) { data->CreateSpec(spec.path, pxr::SdfSpecType(spec.kind)); });
        for (const auto& [field, value] : specs.front().fields)
            data->Set(specs.front().path, field, value);
        setLayerData(layer, data);
    }

    LayerDoc doc;
    BlobSource& blobs;
    std::vector<Spec> specs;
    std::size_t filled = 0;
    std::vector<std::pair<SdfPath, pxr::SdfSpecType>> targets;
    std::vector<std::tuple<SdfPath, TfToken, const FieldValue*>> waiting;
    std::vector<Error> leftOut;
};

LayerFill::LayerFill(LayerDoc doc, BlobSource& blobs)
    : state_(std::make_unique<State>(std::move(doc), blobs)) {}
LayerFill::~LayerFill() = default;

bool LayerFill::fill(double budgetMs) {
    using Clock = std::chrono::steady_clock;
    constexpr int kSpecsPerLook = 64;  // at the clock
    const auto end = Clock::now() + std::chrono::duration<double, std::milli>(budgetMs);
    int done = 0;
    while (state_->filled < state_->specs.size()) {
        if (done > 0 && done % kSpecsPerLook == 0 && Clock::now() >= end) return false;
        state_->fillNext();
        ++done;
    }
    return true;
}

double LayerFill::progress() const { return double(state_->filled) / double(state_->specs.size()); }

Result<void> LayerFill::into(SdfLayerStore& store) {
    auto& delegate = *store.delegate_;
    {
        const pxr::SdfChangeBlock block;
        const SdfLayerStore::Delegate::Applying applying(delegate);
        delegate.waiting.clear();
        // A layer that was read from a file without prims has an empty list of them.
        const auto prims = delegate.data().GetAs<pxr::TfTokenVector>(
            SdfPath::AbsoluteRootPath(), pxr::SdfChildrenKeys->PrimChildren);
        if (prims.empty())
            state_->writeQuietly(delegate);
        else
            state_->replace(delegate);
        for (const auto& [path, field, value] : state_->waiting)
            delegate.waiting.add({path, field}, *value, state_->blobs);
    }
    if (!state_->leftOut.empty()) return tl::unexpected(state_->leftOut.front());
    return {};
}

Result<pxr::SdfLayerRefPtr> makeLayer(const LayerDoc& doc, BlobSource& blobs,
                                      const std::string& formatId) {
    const auto format = pxr::SdfFileFormat::FindById(TfToken(formatId));
    if (!format) return fail(ErrorCode::InvalidArgument, "there is no file format " + formatId);
    auto layer = pxr::SdfLayer::CreateAnonymous("usdlive." + formatId, format);
    LayerFill fill(doc, blobs);
    while (!fill.fill(1e9)) {
    }
    SdfLayerStore store(layer, blobs, nullptr);
    if (auto filled = fill.into(store); !filled) return tl::unexpected(filled.error());
    if (store.waitsForBlobs())
        return fail(ErrorCode::BlobNotFound, "big values of the layer are not here");
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
                    "what the layer is written as cannot be read: " + complaints.text("no reason"));
    return text;
}

}  // namespace usdlive::usd
