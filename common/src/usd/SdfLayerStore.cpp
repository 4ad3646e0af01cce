// Applies edits to an SdfLayer.
#include "usdlive/common/usd/SdfLayerStore.h"

#include <pxr/base/vt/dictionary.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <unordered_map>

#include "LeafCodec.h"
#include "StoreDelegate.h"
#include "usdlive/common/core/Utf8.h"
#include "usdlive/common/layer/FieldParts.h"

namespace usdlive::usd {

namespace {

using pxr::SdfPath;
using pxr::TfToken;
using pxr::VtValue;
using Elements = std::vector<PathElement>;

bool isOfPart(const EditAction& action) {
    const auto* set = std::get_if<SetField>(&action);
    const auto* erase = std::get_if<EraseField>(&action);
    return (set && !std::holds_alternative<std::monostate>(set->part)) ||
           (erase && !std::holds_alternative<std::monostate>(erase->part));
}

}  // namespace

// Applies one edit to one spec. All checks precede the first change.
class SdfLayerStore::Applier {
public:
    Applier(Delegate& delegate, std::string_view path, const Elements& elements)
        : delegate_(delegate), text_(path), elements_(elements), path_(delegate.paths(path)) {}

    Result<void> operator()(const CreateSpec& create) {
        if (elements_.empty() || !belongsIn(create.kind, list())) return misplaced();
        const SdfPath parent = parentOf(path_);
        const auto above = delegate_.kind(parent);
        if (!above) return noSpec(specpath::parent(text_));
        if (!hasList(*above, list())) return misplaced();
        if (const auto present = delegate_.kind(path_)) {
            if (*present == create.kind) return {};
            return fail(ErrorCode::SpecKindConflict,
                        "there is a spec of another kind at " + inQuotes(text_));
        }
        // Creates the spec inert, as Sdf's own functions do. Its fields define the prim, and Sdf
        // sends a notice for each of them.
        delegate_.CreateSpec(path_, pxr::SdfSpecType(create.kind), true);
        delegate_.append(parent, list(), path_.GetNameToken());
        return {};
    }

    Result<void> operator()(const DeleteSpec& erase) {
        if (elements_.empty()) return rootStays();
        if (erase.place && !delegate_.kind(path_)) return {};
        if (!delegate_.kind(path_)) return noSpec(text_);
        delegate_.placeBelow(path_);
        delegate_.deleteBelow(path_);
        delegate_.changing(parentOf(path_), list()).remove(nameOf(elements_));
        return {};
    }

    Result<void> operator()(const MoveSpec& move) {
        if (elements_.empty()) return rootStays();
        if (move.place && !delegate_.kind(path_)) return {};
        if (!delegate_.kind(path_)) return noSpec(text_);
        if (move.parent.creation)
            return fail(ErrorCode::InvalidEdit, "a move must name the new parent by its path");
        const auto parent = specpath::parse(move.parent.path);
        if (!parent) return tl::unexpected(parent.error());
        if (!hasPlaceFor(*parent)) return misplaced();
        const std::string target = specpath::child(move.parent.path, list(), move.name);
        const auto elements = specpath::parse(target);
        if (!elements) return tl::unexpected(elements.error());
        if (elements->size() != parent->size() + 1 || elements->back().list != list())
            return fail(ErrorCode::InvalidPath,
                        inQuotes(move.name) + " is not a valid name for a spec");
        auto moved = moveTo(target, TfToken(move.name));
        if (move.place) return {};  // another spec or the lack of a parent can be in its way
        return moved;
    }

    Result<void> operator()(const PlaceSpec& place) {
        if (elements_.empty()) return rootStays();
        if (!delegate_.kind(path_)) return noSpec(text_);
        const TfToken name = nameOf(elements_);
        if (place.before != name.GetString())
            delegate_.changing(parentOf(path_), list()).place(name, TfToken(place.before));
        return {};
    }

    Result<void> operator()(const SetField& set) {
        if (auto checked = checkSet(elements_.empty(), set); !checked) return checked;
        if (!delegate_.kind(path_)) return noSpec(text_);
        const TfToken field = delegate_.tokens(set.field);
        if (isStructural(field)) return {};  // `subLayers` includes `subLayerOffsets`
        if (const auto* key = std::get_if<DictionaryKey>(&set.part))
            return setKey(field, key->path, set);
        if (const auto* sample = std::get_if<SampleTime>(&set.part))
            if (field == pxr::SdfFieldKeys->TimeSamples) return setSample(sample->time, set);
        if (std::holds_alternative<std::monostate>(set.part))
            return delegate_.set(path_, field, set.value);
        return setPart(field, set);
    }

    Result<void> operator()(const EraseField& erase) {
        if (auto checked = checkErase(erase); !checked) return checked;
        if (!delegate_.kind(path_)) return noSpec(text_);
        const TfToken field = delegate_.tokens(erase.field);
        if (isStructural(field)) return {};
        if (const auto* key = std::get_if<DictionaryKey>(&erase.part))
            return eraseKey(field, key->path);
        if (const auto* sample = std::get_if<SampleTime>(&erase.part))
            if (field == pxr::SdfFieldKeys->TimeSamples) return eraseSample(sample->time);
        if (!std::holds_alternative<std::monostate>(erase.part)) return erasePart(field, erase);
        delegate_.erase(path_, field);
        return {};
    }

private:
    [[nodiscard]] ChildList list() const { return elements_.back().list; }
    static TfToken nameOf(const Elements& elements) {
        return TfToken(std::string(elements.back().name));
    }

    // ---- children

    [[nodiscard]] pxr::TfTokenVector children(const SdfPath& parent, ChildList list) const {
        return delegate_.data()
            .Get(parent, childrenField(list))
            .GetWithDefault<pxr::TfTokenVector>();
    }

    void setChildren(const SdfPath& parent, ChildList list, pxr::TfTokenVector names) {
        delegate_.SetField(parent, childrenField(list),
                           names.empty() ? VtValue() : VtValue::Take(names));
    }

    // ---- moving

    // Returns true if the path grammar allows a child of this list below `parent`.
    [[nodiscard]] bool hasPlaceFor(const Elements& parent) const {
        if (parent.empty()) return list() == ChildList::Prims;
        const ChildList last = parent.back().list;
        if (last == ChildList::Properties) return false;
        return (last == ChildList::VariantSets) == (list() == ChildList::Variants);
    }

    Result<void> moveTo(const std::string& target, const TfToken& name) {
        if (target != text_ && specpath::hasPrefix(target, text_))
            return fail(ErrorCode::MoveIntoItself,
                        inQuotes(text_) + " cannot be moved below itself");
        const SdfPath to = delegate_.paths(target);
        const SdfPath parent = parentOf(to);
        const auto above = delegate_.kind(parent);
        if (!above) return noSpec(specpath::parent(target));
        const bool sameParent = parent == parentOf(path_);
        if (!hasList(*above, list()) || (list() == ChildList::Variants && !sameParent))
            return misplaced();
        if (to == path_) return {};
        if (delegate_.kind(to))
            return fail(ErrorCode::SpecExists, "there is a spec at " + inQuotes(target));
        delegate_.placeBelow(path_);
        if (sameParent)
            rename(to, parent, name);
        else
            reparent(to, parent, name);
        return {};
    }

    void rename(const SdfPath& to, const SdfPath& parent, const TfToken& name) {
        // If another prim left that name in the same change block, Pcp (26.8) mistakes this rename
        // for that prim's. The stage then keeps a prim without a prim index, and using it crashes.
        // Creating and deleting a prim there makes Sdf report it, and the stage composes the name
        // again.
        if (list() == ChildList::Prims) {
            delegate_.CreateSpec(to, pxr::SdfSpecTypePrim, false);
            delegate_.DeleteSpec(to, false);
        }
        moveSpecs(to);
        delegate_.added.insert(to);
        delegate_.changing(parent, list()).rename(nameOf(elements_), name);
    }

    void reparent(const SdfPath& to, const SdfPath& parent, const TfToken& name) {
        delegate_.changing(parentOf(path_), list()).remove(nameOf(elements_));
        moveSpecs(to);
        delegate_.append(parent, list(), name);
    }

    // Sdf moves the specs below by path prefix, but the path of a variant set is no prefix of its
    // variants' paths.
    void moveSpecs(const SdfPath& to) {
        if (list() == ChildList::Variants) return moveVariant(path_, to);
        if (list() != ChildList::VariantSets) return delegate_.MoveSpec(path_, to);
        auto variants = children(path_, ChildList::Variants);
        setChildren(path_, ChildList::Variants, {});
        delegate_.MoveSpec(path_, to);
        for (const TfToken& variant : variants)
            moveVariant(childOf(path_, ChildList::Variants, variant),
                        childOf(to, ChildList::Variants, variant));
        setChildren(to, ChildList::Variants, std::move(variants));
    }

    // Composition follows variants that are added and removed, but not renamed ones, because Sdf
    // itself never renames them. So this adds and removes one at both places.
    void moveVariant(const SdfPath& from, const SdfPath& to) {
        addAndRemove(to);
        delegate_.MoveSpec(from, to);
        addAndRemove(from);
    }
    void addAndRemove(const SdfPath& variant) {
        delegate_.CreateSpec(variant, pxr::SdfSpecTypeVariant, false);
        delegate_.DeleteSpec(variant, false);
    }

    // ---- parts of fields

    Result<void> setKey(const TfToken& field, const std::vector<std::string>& keys,
                        const SetField& set) {
        if (auto proper = checkType(path_, field, typeid(pxr::VtDictionary)); !proper)
            return proper;
        auto value = decodeValue(TfToken(), set.value, delegate_.blobs);
        if (!value) return orWait(field, set.value, value.error());
        delegate_.changingKeys(path_, field).SetValueAtPath(keys, *value);
        return {};
    }

    Result<void> eraseKey(const TfToken& field, const std::vector<std::string>& keys) {
        if (delegate_.hasKey(path_, field, keys))
            delegate_.changingKeys(path_, field).EraseValueAtPath(keys);
        return {};
    }

    Result<void> setSample(double time, const SetField& set) {
        const auto value = decodeLeaf(*set.value.as<Value>(), delegate_.blobs);
        if (!value) return orWait(pxr::SdfFieldKeys->TimeSamples, set.value, value.error());
        delegate_.SetTimeSample(path_, time, *value);
        return {};
    }

    Result<void> eraseSample(double time) {
        if (delegate_.data().QueryTimeSample(path_, time, static_cast<VtValue*>(nullptr)))
            delegate_.SetTimeSample(path_, time, VtValue());
        return {};
    }

    // The general case: changes the field's content like the model. A part that can be decoded
    // alone can be decoded with the others.
    Result<void> setPart(const TfToken& field, const SetField& set) {
        FieldValue alone;
        usdlive::setPart(alone, set);
        const auto decoded = decodeField(path_, field, alone, delegate_.blobs);
        if (!decoded && decoded.error().code != ErrorCode::BlobNotFound)
            return tl::unexpected(within(decoded.error(), path_, field));
        auto& content = delegate_.changingParts(path_, field);
        if (!content) content.emplace();
        usdlive::setPart(*content, set);
        return {};
    }

    Result<void> erasePart(const TfToken& field, const EraseField& erase) {
        auto& content = delegate_.changingParts(path_, field);
        if (content && holdsPart(*content, erase.part) && !usdlive::erasePart(*content, erase.part))
            content.reset();
        return {};
    }

    Result<void> orWait(const TfToken& field, const FieldValue& value, const Error& error) {
        if (error.code != ErrorCode::BlobNotFound)
            return tl::unexpected(within(error, path_, field));
        delegate_.waiting.add({path_, field}, value, delegate_.blobs);
        return {};
    }

    // ---- errors

    static tl::unexpected<Error> noSpec(std::string_view path) {
        return fail(ErrorCode::SpecNotFound, "there is no spec at " + inQuotes(path));
    }
    [[nodiscard]] tl::unexpected<Error> misplaced() const {
        return fail(ErrorCode::InvalidEdit, "the edit of " + inQuotes(text_) +
                                                " puts a spec where its kind is not allowed");
    }
    static tl::unexpected<Error> rootStays() {
        return fail(ErrorCode::InvalidEdit, "the pseudo-root cannot be deleted or moved");
    }

    Delegate& delegate_;
    std::string_view text_;
    const Elements& elements_;
    SdfPath path_;
};

SdfLayerStore::SdfLayerStore(pxr::SdfLayerHandle layer, BlobSource& blobs,
                             LayerWriteObserver* observer)
    : delegate_(pxr::TfCreateRefPtr(new Delegate(blobs, observer))) {
    const bool wasDirty = layer->IsDirty();
    delegate_->previous = layer->GetStateDelegate();
    layer->SetStateDelegate(delegate_);
    if (wasDirty) delegate_->markDirty();
}

SdfLayerStore::~SdfLayerStore() {
    delegate_->place();
    const auto layer = delegate_->layer();
    // Compares addresses, because under C++20 Tf's comparison of a weak pointer with a strong one
    // recurses endlessly.
    if (layer && get_pointer(layer->GetStateDelegate()) == get_pointer(delegate_))
        layer->SetStateDelegate(delegate_->previous);
}

void SdfLayerStore::placeMoved(const pxr::SdfLayerHandle& layer, const SdfPath& from,
                               const SdfPath& to) {
    const auto delegate = layer->GetStateDelegate();
    if (auto* own = dynamic_cast<Delegate*>(pxr::get_pointer(delegate))) own->placeMoved(from, to);
}

const pxr::SdfLayerHandle& SdfLayerStore::layer() const { return delegate_->layer(); }

SdfLayerStore::Block::Block() = default;
SdfLayerStore::Block::~Block() {
    for (const auto& delegate : delegates_) delegate->place();
}

Result<void> SdfLayerStore::apply(std::string_view path, const EditAction& action) {
    Block block;
    return apply(path, action, block);
}

Result<void> SdfLayerStore::apply(std::string_view path, const EditAction& action, Block& block) {
    const auto elements = specpath::parse(path);
    if (!elements) return tl::unexpected(elements.error());
    if (!std::exchange(delegate_->isInBlock, true)) block.delegates_.push_back(delegate_);
    const Delegate::Applying applying(*delegate_);
    if (!isOfPart(action)) delegate_->writeParts();
    return std::visit(Applier(*delegate_, path, *elements), action);
}

void SdfLayerStore::blobArrived(
    const Hash& hash,
    const std::function<const FieldValue*(const std::string& path, const std::string& field)>&
        current) {
    const auto fields = delegate_->waiting.take(hash);
    if (fields.empty()) return;
    const pxr::SdfChangeBlock block;
    const Delegate::Applying applying(*delegate_);
    for (const auto& [path, field] : fields) {
        const FieldValue* value = current(path.GetAsString(), field.GetString());
        // Skips content that this OpenUSD does not support, like apply().
        if (value && delegate_->kind(path)) (void)delegate_->set(path, field, *value);
    }
}

bool SdfLayerStore::waitsForBlobs() const { return !delegate_->waiting.empty(); }
bool SdfLayerStore::waitsFor(const Hash& hash) const { return delegate_->waiting.contains(hash); }

Result<std::optional<FieldValue>> SdfLayerStore::read(const pxr::SdfPath& path,
                                                      const pxr::TfToken& field,
                                                      BlobSink& blobs) const {
    return readField(delegate_->data(), path, field, blobs);
}

}  // namespace usdlive::usd
