// Reads an SdfLayer into a LayerDoc.
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>

#include "LayerAccess.h"
#include "usdlive/common/usd/SdfLayerStore.h"

namespace usdlive::usd {

namespace {

using pxr::SdfPath;
using pxr::TfToken;

class LayerReader {
public:
    LayerReader(const pxr::SdfAbstractData& data, BlobSink& blobs) : data_(data), blobs_(blobs) {}

    Result<LayerDoc> read() {
        waiting_.push_back({SdfPath::AbsoluteRootPath(), kRootNode, SpecKind::PseudoRoot});
        while (!waiting_.empty()) {
            const Spec spec = std::move(waiting_.back());
            waiting_.pop_back();
            if (auto done = readFields(spec); !done) return tl::unexpected(done.error());
            const auto children = std::ptrdiff_t(waiting_.size());
            for (const ChildList list : kChildLists)
                if (auto done = readChildren(spec, list); !done)
                    return tl::unexpected(done.error());
            // Keeps the order of LayerDoc::visit(), so that ids mostly increase with it.
            std::reverse(waiting_.begin() + children, waiting_.end());
        }
        return builder_.finish();
    }

private:
    struct Spec {
        SdfPath path;
        NodeId node;
        SpecKind kind;
    };

    Result<void> readFields(const Spec& spec) {
        for (const TfToken& field : data_.List(spec.path)) {
            if (isStructural(field)) {
                if (auto known = checkStructure(spec, field); !known) return known;
                continue;
            }
            auto content = readField(data_, spec.path, field, blobs_);
            if (!content) return tl::unexpected(content.error());
            if (!*content) continue;
            if (auto added = builder_.addField(spec.node, field.GetString(), std::move(**content));
                !added)
                return tl::unexpected(within(added.error(), spec.path, field));
        }
        return {};
    }

    // Handles specs that the model does not have: targets are skipped if they add nothing to the
    // list op.
    Result<void> checkStructure(const Spec& spec, const TfToken& field) const {
        const auto& keys = *pxr::SdfChildrenKeys;
        if (field == keys.RelationshipTargetChildren || field == keys.ConnectionChildren) {
            for (const SdfPath& target :
                 data_.Get(spec.path, field).GetWithDefault<pxr::SdfPathVector>())
                if (!data_.List(spec.path.AppendTarget(target)).empty())
                    return unknownSpec(spec.path.AppendTarget(target));
        } else if (field == keys.MapperChildren || field == keys.MapperArgChildren ||
                   field == keys.ExpressionChildren) {
            return unknownSpec(spec.path);
        }
        return {};
    }

    static tl::unexpected<Error> unknownSpec(const SdfPath& path) {
        return fail(ErrorCode::UnsupportedValue,
                    path.GetAsString() +
                        ": mappers, expressions, markers and properties of targets "
                        "are not supported");
    }

    Result<void> readChildren(const Spec& parent, ChildList list) {
        if (!hasList(parent.kind, list)) return {};
        const auto names =
            data_.Get(parent.path, childrenField(list)).GetWithDefault<pxr::TfTokenVector>();
        std::uint64_t order = 0;
        for (const TfToken& name : names) {
            const SdfPath path = childOf(parent.path, list, name);
            const auto kind = specKind(data_.GetSpecType(path));
            if (path.IsEmpty() || !kind || !belongsIn(*kind, list))
                return fail(ErrorCode::LayerUnreadable,
                            parent.path.GetAsString() + " has no valid child " + name.GetString());
            order += ChildSequence::kOrderStep;
            const NodeId node = nextNode_++;
            auto added = builder_.addSpec(node, parent.node, order, *kind, name.GetString());
            if (!added)
                return fail(added.error().code, path.GetAsString() + ": " + added.error().message);
            waiting_.push_back({path, node, *kind});
        }
        return {};
    }

    const pxr::SdfAbstractData& data_;
    BlobSink& blobs_;
    LayerDoc::Builder builder_;
    NodeId nextNode_ = kRootNode + 1;
    std::vector<Spec> waiting_;
};

}  // namespace

Result<LayerDoc> readLayer(const pxr::SdfLayerHandle& layer, BlobSink& blobs) {
    return LayerReader(*layerData(*layer), blobs).read();
}

}  // namespace usdlive::usd
