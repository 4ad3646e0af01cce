#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/fileFormat.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <chrono>
#include <deque>

#include "StoreDelegate.h"
#include "usdlive/common/usd/TfComplaints.h"

namespace usdlive::usd {

using pxr::SdfPath;
using pxr::TfToken;
using pxr::VtValue;

namespace {

ChildList listOf(SpecKind kind) {
    for (const ChildList list : kChildLists)
        if (belongsIn(kind, list)) return list;
    return ChildList::Prims;
}

// The tokens of the few names that all fields of a layer have.
class FieldTokens {
public:
    const TfToken& operator()(const std::string& name) {
        for (const auto& [known, token] : tokens_)
            if (known == name) return token;
        if (tokens_.size() == kMost) tokens_.pop_back();
        return tokens_.emplace_back(name, TfToken(name)).second;
    }

private:
    static constexpr std::size_t kMost = 32;
    std::vector<std::pair<std::string, TfToken>> tokens_;
};

}  // namespace

struct LayerFill::State {
    using FieldValues = std::vector<std::pair<TfToken, VtValue>>;

    // A spec in the order of the doc: parents before children, siblings in order.
    struct Spec {
        SdfPath path;
        SpecKind kind;
        std::size_t fieldsEnd = 0;  // its fields are those from where the spec before ends
    };
    struct Children {
        std::size_t parent;  // in `specs`
        ChildList list;
        pxr::TfTokenVector names;
    };
    // A spec whose children are being filled.
    struct Level {
        NodeId node;
        std::size_t spec;
        std::optional<ChildList> list;  // of the last child
        std::size_t children = 0;       // that list's
    };

    State(LayerDoc doc, BlobSource& source)
        : total(doc.specCount()), walk(std::move(doc)), blobs(source) {
        specs.reserve(total);
    }

    /// False: that was all.
    bool fillNext() {
        const LayerDoc::SpecView* view = walk.next();
        if (!view) return false;
        while (!above.empty() && above.back().node != view->parent) above.pop_back();
        const SdfPath path =
            above.empty() ? SdfPath::AbsoluteRootPath() : addChild(view->kind, view->name);
        above.push_back({view->node, specs.size(), {}});
        Spec& spec = specs.emplace_back(Spec{path, view->kind});
        for (const auto& [name, value] : *view->fields) fillField(spec, tokens(name), value);
        spec.fieldsEnd = fields.size();
        return true;
    }

    SdfPath addChild(SpecKind kind, std::string_view name) {
        Level& level = above.back();
        const ChildList list = listOf(kind);
        if (level.list != list) {
            level.list = list;
            level.children = children.size();
            children.push_back({level.spec, list, {}});
        }
        const TfToken token{std::string(name)};
        children[level.children].names.push_back(token);
        return childOf(specs[level.spec].path, list, token);
    }

    void fillField(const Spec& spec, const TfToken& field, const FieldValue& value) {
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
            fields.emplace_back(pxr::SdfFieldKeys->SubLayerOffsets, VtValue(*decoded->offsets));
        if (const auto targets = targetFields(spec.kind, field))
            fillTargets(spec, *targets, decoded->value);
        fields.emplace_back(field, std::move(decoded->value));
    }

    void fillTargets(const Spec& spec, const TargetFields& names, const VtValue& value) {
        auto paths = targetsIn(value);
        if (paths.empty()) return;
        for (const SdfPath& path : paths)
            targets.emplace_back(spec.path.AppendTarget(path), names.childType);
        fields.emplace_back(names.children, VtValue::Take(paths));
    }

    // All but the pseudo-root's. `create` makes a spec.
    void write(pxr::SdfAbstractData& data, const auto& create) {
        std::size_t at = specs.front().fieldsEnd;
        for (std::size_t index = 1; index < specs.size(); ++index) {
            const Spec& spec = specs[index];
            create(spec);
            for (; at < spec.fieldsEnd; ++at)
                data.Set(spec.path, fields[at].first, fields[at].second);
        }
        for (Children& list : children)
            if (list.parent != 0)
                data.Set(specs[list.parent].path, childrenField(list.list),
                         VtValue::Take(list.names));
        for (const auto& [path, type] : targets) data.CreateSpec(path, type);
    }

    /// Of the pseudo-root, with its children.
    [[nodiscard]] FieldValues rootFields() {
        FieldValues all(fields.begin(), fields.begin() + std::ptrdiff_t(specs.front().fieldsEnd));
        for (Children& list : children)
            if (list.parent == 0)
                all.emplace_back(childrenField(list.list), VtValue::Take(list.names));
        return all;
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
        const SdfPath& root = SdfPath::AbsoluteRootPath();
        const FieldValues wanted = rootFields();
        for (const TfToken& present : delegate.data().List(root))
            if (present != pxr::SdfChildrenKeys->PrimChildren &&
                std::ranges::none_of(wanted,
                                     [&](const auto& field) { return field.first == present; }))
                delegate.SetField(root, present, VtValue());
        for (const auto& [field, value] : wanted) delegate.SetField(root, field, value);
    }

    // Sdf compares, and tells of what differs.
    void replace(SdfLayerStore::Delegate& delegate) {
        const auto& layer = delegate.layer();
        const auto data = layer->GetFileFormat()->InitData(layer->GetFileFormatArguments());
        write(*data,
              [&](const Spec& spec) { data->CreateSpec(spec.path, pxr::SdfSpecType(spec.kind)); });
        const SdfPath& root = SdfPath::AbsoluteRootPath();
        for (const auto& [field, value] : rootFields()) data->Set(root, field, value);
        setLayerData(layer, data);
    }

    const std::size_t total;
    LayerDoc::Walk walk;
    BlobSource& blobs;
    std::vector<Spec> specs;
    std::vector<Level> above;
    std::vector<Children> children;
    std::deque<std::pair<TfToken, VtValue>> fields;  // of all specs, one after the other
    std::vector<std::pair<SdfPath, pxr::SdfSpecType>> targets;
    std::vector<std::tuple<SdfPath, TfToken, const FieldValue*>> waiting;
    std::vector<Error> leftOut;
    FieldTokens tokens;
};

LayerFill::LayerFill(LayerDoc doc, BlobSource& blobs)
    : state_(std::make_unique<State>(std::move(doc), blobs)) {}
LayerFill::~LayerFill() = default;

bool LayerFill::fill(double budgetMs) {
    using Clock = std::chrono::steady_clock;
    constexpr int kSpecsPerLook = 64;  // at the clock
    const auto end = Clock::now() + std::chrono::duration<double, std::milli>(budgetMs);
    for (int done = 1; state_->fillNext(); ++done)
        if (done % kSpecsPerLook == 0 && Clock::now() >= end) return false;
    return true;
}

double LayerFill::progress() const { return double(state_->specs.size()) / double(state_->total); }

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
