// The state delegate of a live layer.
#pragma once

#include <pxr/base/vt/dictionary.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/layerStateDelegate.h>
#include <pxr/usd/sdf/notice.h>

#include <map>
#include <optional>
#include <set>
#include <thread>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "LayerAccess.h"
#include "Tokens.h"
#include "usdlive/common/usd/ChildOrder.h"

namespace usdlive::usd {

/// The fields that could not be set because a blob was missing. Few, and only for a short time.
class WaitingFields {
public:
    using Field = std::pair<pxr::SdfPath, pxr::TfToken>;

    void add(const Field& field, const FieldValue& value, BlobSource& blobs);
    void remove(const pxr::SdfPath& path, const pxr::TfToken& field);
    [[nodiscard]] std::set<Field> take(const Hash& hash);
    [[nodiscard]] bool contains(const Hash& hash) const;
    [[nodiscard]] bool empty() const { return hashes_.empty(); }
    void clear() { hashes_.clear(); }

    void specMoved(const pxr::SdfPath& from, const pxr::SdfPath& to);
    void specDeleted(const pxr::SdfPath& path);

private:
    std::map<Field, std::set<Hash>> hashes_;
};

/// Holds blobs during one change of a field that is read, changed and written back.
class ScratchBlobs : public BlobSink, public BlobSource {
public:
    explicit ScratchBlobs(BlobSource& others) : others_(others) {}
    void keepBlob(const Hash& hash, SharedBytes bytes) override {
        kept_.emplace(hash, std::move(bytes));
    }
    SharedBytes blob(const Hash& hash) override {
        const auto found = kept_.find(hash);
        return found == kept_.end() ? others_.blob(hash) : found->second;
    }

private:
    BlobSource& others_;
    std::unordered_map<Hash, SharedBytes> kept_;
};

/// Converts text to SdfPath and caches the last results. Parsing a path costs more than a typical
/// edit, and most edits are of siblings.
class RecentPaths {
public:
    explicit RecentPaths(Tokens& tokens) : tokens_(tokens) {}
    /// Precondition: specpath::parse() accepts `path`.
    pxr::SdfPath operator()(std::string_view path);

private:
    Tokens& tokens_;
    std::string text_;
    pxr::SdfPath parent_;
};

/// The state delegate between a layer and all its writers.
class SdfLayerStore::Delegate : public pxr::SdfSimpleLayerStateDelegate {
public:
    Delegate(BlobSource& blobs, LayerWriteObserver* observer) : blobs(blobs), observer_(observer) {}

    /// While it lives, writes are ours and the observer is not notified. Must end before the
    /// enclosing change block, because the receivers of Sdf's notice may also write.
    class Applying {
    public:
        explicit Applying(Delegate& delegate) : delegate_(delegate) { ++delegate_.applying_; }
        ~Applying() { --delegate_.applying_; }
        Applying(const Applying&) = delete;
        Applying& operator=(const Applying&) = delete;

    private:
        Delegate& delegate_;
    };

    [[nodiscard]] const pxr::SdfLayerHandle& layer() const { return layer_; }
    [[nodiscard]] pxr::SdfAbstractData& data() const { return *_GetLayerData(); }
    [[nodiscard]] std::optional<SpecKind> kind(const pxr::SdfPath& path) const {
        return specKind(data().GetSpecType(path));
    }
    void markDirty() { _MarkCurrentStateAsDirty(); }

    /// Sets a field and the specs and fields that depend on it.
    void write(const pxr::SdfPath& path, const pxr::TfToken& field, const DecodedField& value);
    void erase(const pxr::SdfPath& path, const pxr::TfToken& field);
    /// Deletes a spec and everything below it. Erases the opinions of overrides first, so that a
    /// stage composes only what they affected.
    void deleteBelow(const pxr::SdfPath& path);
    /// Writes the names of children. A stage composes the parent and everything below it again only
    /// if the order of children from before the change block has changed.
    void setChildren(const pxr::SdfPath& parent, ChildList list, const pxr::TfTokenVector& names);
    /// Adds a child at the end of a list.
    void append(const pxr::SdfPath& parent, ChildList list, const pxr::TfToken& name);
    /// Returns the order of a list, which changes now. The next place() writes it.
    ChildOrder& changing(const pxr::SdfPath& parent, ChildList list);
    /// Returns the content of a dictionary, which changes now, or an empty one. The next
    /// writeParts() writes it.
    pxr::VtDictionary& changingKeys(const pxr::SdfPath& path, const pxr::TfToken& field);
    [[nodiscard]] bool hasKey(const pxr::SdfPath& path, const pxr::TfToken& field,
                              const std::vector<std::string>& keys) const;
    /// Like changingKeys(), for the content of any field in the form of the model, or nothing.
    std::optional<FieldValue>& changingParts(const pxr::SdfPath& path, const pxr::TfToken& field);
    /// Writes the field of which parts have changed. Call it before an edit of anything but a part,
    /// because the next one may be of the same field.
    void writeParts();
    /// Writes each list of children and the field that have changed, once.
    void place();
    /// Writes the changed lists of a spec and of those below it. Call it before they are deleted or
    /// moved.
    void placeBelow(const pxr::SdfPath& path);
    /// Sets the field, or remembers it if a blob is missing.
    Result<void> set(const pxr::SdfPath& path, const pxr::TfToken& field, const FieldValue& value);

    BlobSource& blobs;
    WaitingFields waiting;
    Tokens tokens;
    RecentPaths paths{tokens};
    /// Specs that were created or moved here since the layer's last change notice.
    std::unordered_set<pxr::SdfPath, pxr::SdfPath::Hash> added;
    bool isInBlock = false;                         ///< a block will call place()
    bool filled = false;                            ///< the content is not that of the layer's file
    pxr::SdfLayerStateDelegateBaseRefPtr previous;  ///< the layer's former delegate

    void placeMoved(const pxr::SdfPath& from, const pxr::SdfPath& to) {
        if (LayerWriteObserver* observer = observerOf(from)) observer->placeMoved(from, to);
    }

protected:
    using Base = pxr::SdfSimpleLayerStateDelegate;
    using Path = pxr::SdfPath;
    using Token = pxr::TfToken;
    using ConstValue = pxr::SdfAbstractDataConstValue;

    void _OnSetLayer(const pxr::SdfLayerHandle& layer) override;
    void _OnSetField(const Path&, const Token&, const pxr::VtValue&) override;
    void _OnSetField(const Path&, const Token&, const ConstValue&) override;
    void _OnSetFieldDictValueByKey(const Path&, const Token&, const Token&,
                                   const pxr::VtValue&) override;
    void _OnSetFieldDictValueByKey(const Path&, const Token&, const Token&,
                                   const ConstValue&) override;
    void _OnSetTimeSample(const Path&, double, const pxr::VtValue&) override;
    void _OnSetTimeSample(const Path&, double, const ConstValue&) override;
    void _OnCreateSpec(const Path&, pxr::SdfSpecType, bool inert) override;
    void _OnDeleteSpec(const Path&, bool inert) override;
    void _OnMoveSpec(const Path& from, const Path& to) override;
    void _OnPushChild(const Path&, const Token&, const Token&) override;
    void _OnPushChild(const Path&, const Token&, const Path&) override;
    void _OnPopChild(const Path&, const Token&, const Token&) override;
    void _OnPopChild(const Path&, const Token&, const Path&) override;

private:
    /// Returns the observer of writes to this path, or nullptr. Specs below targets follow from
    /// list ops.
    [[nodiscard]] LayerWriteObserver* observerOf(const Path& path) const {
        if (!observer_ || path.ContainsTargetPath()) return nullptr;
        return applying_ && std::this_thread::get_id() == thread_ ? nullptr : observer_;
    }
    void notifyField(const Path& path, const Token& field);
    void notifyArray(const Path& path, const Token& field, std::optional<double> time,
                     const pxr::VtValue& value);
    void notifyArray(const Path& path, const Token& field, std::optional<double> time,
                     const ConstValue& value);
    void notifyClips(const Path& path, const Token& field, const pxr::VtValue& value);
    void notifyClips(const Path& path, const Token& field, const ConstValue& value);
    void notifyLayers(const Path& path, const Token& field, const pxr::VtValue& value);
    void notifyLayers(const Path& path, const Token& field, const ConstValue& value);
    void notifyChildren(const Path& parent, const Token& field, bool appended);
    [[nodiscard]] std::optional<TargetFields> targetsOf(const Path& path, const Token& field) const;
    void renewTargets(const Path& path, const TargetFields& fields, const pxr::VtValue& value);
    void onLayerChanged(const pxr::SdfNotice::LayersDidChangeSentPerLayer&) { added.clear(); }

    using ChildListOf = std::pair<Path, ChildList>;
    std::map<ChildListOf, ChildOrder> changing_;

    struct ChangingKeys {
        Path path;
        Token field;
        pxr::VtDictionary content;
    };
    struct ChangingParts {
        Path path;
        Token field;
        ScratchBlobs blobs;
        std::optional<FieldValue> before;
        std::optional<FieldValue> content;
    };
    static bool isOf(const auto& changing, const Path& path, const Token& field) {
        return changing && changing->path == path && changing->field == field;
    }
    // At most one is set.
    std::optional<ChangingKeys> keys_;
    std::optional<ChangingParts> parts_;
    LayerWriteObserver* observer_;
    pxr::SdfLayerHandle layer_;
    pxr::TfNotice::Key changedKey_;
    int applying_ = 0;
    // the thread whose writes `applying_` hides
    const std::thread::id thread_ = std::this_thread::get_id();
};

}  // namespace usdlive::usd
