// Compares a layer with a LayerDoc, spec by spec. Holds only one more field in memory at a time.
#include <pxr/usd/sdf/layer.h>

#include <algorithm>

#include "LayerAccess.h"
#include "usdlive/common/usd/SdfLayerStore.h"

namespace usdlive::usd {

namespace {

// Compares big values by their hash.
class HashOnly final : public BlobSink {
public:
    [[nodiscard]] bool wantsBlob(const Hash&) override { return false; }
    void keepBlob(const Hash&, SharedBytes) override {}
};

bool hasFields(const pxr::SdfAbstractData& data, const pxr::SdfPath& path,
               const LayerDoc::SpecView& spec) {
    HashOnly blobs;
    std::size_t found = 0;
    for (const pxr::TfToken& field : data.List(path)) {
        if (isStructural(field)) continue;
        const auto content = readField(data, path, field, blobs);
        if (!content) return false;
        if (!*content) continue;
        const auto ought = std::ranges::lower_bound(*spec.fields, field.GetString(), {},
                                                    [](const auto& entry) { return entry.first; });
        if (ought == spec.fields->end() || ought->first != field.GetString() ||
            !(ought->second == **content))
            return false;
        ++found;
    }
    return found == spec.fields->size();
}

bool hasChildren(const pxr::SdfAbstractData& data, const pxr::SdfPath& path, SpecKind kind,
                 const LayerDoc& doc, std::string_view docPath) {
    return std::ranges::all_of(kChildLists, [&](ChildList list) {
        if (!hasList(kind, list)) return true;
        const auto names = data.Get(path, childrenField(list)).GetWithDefault<pxr::TfTokenVector>();
        return std::ranges::equal(names, doc.children(docPath, list), {},
                                  [](const pxr::TfToken& name) { return name.GetString(); });
    });
}

}  // namespace

bool holds(const pxr::SdfLayerHandle& layer, const LayerDoc& doc) {
    const auto data = layerData(*layer);
    bool same = true;
    // This visits every spec of the layer, too, because each is a child of one whose lists of
    // children are equal.
    doc.visit([&](const LayerDoc::SpecView& spec) {
        if (!same) return;
        const bool isRoot = spec.kind == SpecKind::PseudoRoot;
        const auto path =
            isRoot ? pxr::SdfPath::AbsoluteRootPath() : pxr::SdfPath(std::string(spec.path));
        same = specKind(data->GetSpecType(path)) == spec.kind && hasFields(*data, path, spec) &&
               hasChildren(*data, path, spec.kind, doc, spec.path);
    });
    return same;
}

}  // namespace usdlive::usd
