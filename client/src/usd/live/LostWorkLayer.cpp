// Builds a sparse layer from lost edits.
#include "usd/live/LostWorkLayer.h"

#include <pxr/usd/sdf/schema.h>
#include <pxr/usd/sdf/valueTypeName.h>

#include "usdlive/common/usd/LayerFill.h"
#include "usdlive/common/usd/ValueCodec.h"

namespace usdlive::client {

namespace {

constexpr std::array<std::string_view, 3> kPropertyFields{"typeName", "custom", "variability"};

class Sparse {
public:
    Sparse(const LayerDoc* known, BlobSource& blobs) : known_(known), blobs_(blobs) {}

    void add(const std::string& path, const EditAction& action) {
        if (doc_.apply(path, action)) return;
        const bool creates = std::holds_alternative<CreateSpec>(action);
        if (!creates && !std::holds_alternative<SetField>(action)) return;
        need(creates ? specpath::parent(path) : path, std::get_if<SetField>(&action));
        static_cast<void>(doc_.apply(path, action));
    }
    LayerDoc take() { return std::move(doc_); }

private:
    // Creates the spec at `path` and its ancestors like those of the project, or as overs.
    void need(const std::string& path, const SetField* set) {
        if (path.empty() || doc_.has(path)) return;
        need(specpath::parent(path), nullptr);
        const ChildList list = specpath::last(path).list;
        if (!doc_.apply(path, CreateSpec{kindOf(path, list, set)})) return;
        if (list == ChildList::Prims) put(path, "specifier", Value(ValueType::Specifier, kOver));
        if (list == ChildList::Properties) describeProperty(path, set);
    }

    SpecKind kindOf(const std::string& path, ChildList list, const SetField* set) const {
        if (known_)
            if (const auto kind = known_->kind(path)) return *kind;
        switch (list) {
            case ChildList::Prims:
                return SpecKind::Prim;
            case ChildList::VariantSets:
                return SpecKind::VariantSet;
            case ChildList::Variants:
                return SpecKind::Variant;
            case ChildList::Properties:
                break;
        }
        return set && set->field == "targetPaths" ? SpecKind::Relationship : SpecKind::Attribute;
    }

    // The text format requires a type for an attribute.
    void describeProperty(const std::string& path, const SetField* set) {
        for (const auto field : kPropertyFields)
            if (const FieldValue* value = known_ ? known_->field(path, field) : nullptr)
                put(path, field, *value);
        if (doc_.field(path, "typeName") || doc_.kind(path) != SpecKind::Attribute || !set) return;
        if (const Value* value = leafOf(set->value)) put(path, "typeName", typeNameOf(*value));
    }

    static const Value* leafOf(const FieldValue& value) {
        if (const auto* samples = value.as<TimeSamples>())
            return samples->samples.empty() ? nullptr : &samples->samples.begin()->second;
        return value.as<Value>();
    }

    Value typeNameOf(const Value& value) {
        const auto decoded = usd::decodeLeaf(value, blobs_);
        const auto type =
            decoded ? pxr::SdfSchema::GetInstance().FindType(*decoded) : pxr::SdfValueTypeName();
        return tokenValue(type ? type.GetAsToken().GetString() : "token");
    }

    void put(const std::string& path, std::string_view field, FieldValue value) {
        static_cast<void>(
            doc_.apply(path, SetField{std::string(field), {}, std::move(value), ValueType::None}));
    }

    inline static const Bytes kOver{std::uint8_t(pxr::SdfSpecifierOver)};
    const LayerDoc* known_;
    BlobSource& blobs_;
    LayerDoc doc_;
};

}  // namespace

Result<pxr::SdfLayerRefPtr> lostWorkLayer(const LostWork& work, const LayerId& layer,
                                          const LayerDoc* known, BlobSource& blobs) {
    Sparse sparse(known, blobs);
    for (const auto& edit : work.edits)
        if (edit.layer == layer) sparse.add(edit.path, edit.action);
    return usd::makeLayer(sparse.take(), blobs, "usda");
}

}  // namespace usdlive::client
