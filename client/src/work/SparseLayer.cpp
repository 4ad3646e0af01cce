// Builds the content of a sparse layer from lost edits.
#include "work/SparseLayer.h"

#include <array>
#include <utility>

namespace usdlive::client {

namespace {

using NameOfType = std::function<std::string(const Value&)>;

constexpr std::array<std::string_view, 3> kPropertyFields{"typeName", "custom", "variability"};
// The type of an attribute of which nobody knows it. The text format requires one.
constexpr std::string_view kAnyType = "token";

class Sparse {
public:
    Sparse(const LayerDoc* known, const NameOfType& nameOfType)
        : known_(known), nameOfType_(nameOfType) {}

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

    void describeProperty(const std::string& path, const SetField* set) {
        for (const auto field : kPropertyFields)
            if (const FieldValue* value = known_ ? known_->field(path, field) : nullptr)
                put(path, field, *value);
        if (doc_.field(path, "typeName") || doc_.kind(path) != SpecKind::Attribute || !set) return;
        const Value* value = leafOf(set->value);
        if (!value) return;
        const std::string name = nameOfType_(*value);
        put(path, "typeName", tokenValue(name.empty() ? kAnyType : name));
    }

    static const Value* leafOf(const FieldValue& value) {
        if (const auto* samples = value.as<TimeSamples>())
            return samples->samples.empty() ? nullptr : &samples->samples.begin()->second;
        return value.as<Value>();
    }

    void put(const std::string& path, std::string_view field, FieldValue value) {
        static_cast<void>(
            doc_.apply(path, SetField{std::string(field), {}, std::move(value), ValueType::None}));
    }

    inline static const Bytes kOver{1};  // SdfSpecifierOver
    const LayerDoc* known_;
    const NameOfType& nameOfType_;
    LayerDoc doc_;
};

}  // namespace

LayerDoc sparseLayer(const LostWork& work, const LayerId& layer, const LayerDoc* known,
                     const NameOfType& nameOfType) {
    Sparse sparse(known, nameOfType);
    for (const auto& edit : work.edits)
        if (edit.layer == layer) sparse.add(edit.path, edit.action);
    return sparse.take();
}

}  // namespace usdlive::client
