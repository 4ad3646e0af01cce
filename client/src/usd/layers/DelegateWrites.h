// Records writes to the delegate layer of auto authoring.
#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/usd/sdf/layerStateDelegate.h>
#include <pxr/usd/sdf/path.h>

#include <unordered_map>
#include <vector>

namespace usdlive::layers {

/// Records what was written into the delegate layer since take(). Works as the layer's state
/// delegate, which is called before each change, so that it also sees removals and moves. Of a
/// field only the place is recorded, because its final content counts.
class DelegateWrites final : public pxr::SdfSimpleLayerStateDelegate {
public:
    struct Field {
        pxr::TfToken name;
        bool existed = false;  ///< the layer had an opinion before
        bool whole = false;    ///< the whole field, not only parts of it
        std::vector<pxr::TfToken> keyPaths;
        std::vector<double> times;
    };
    struct Spec {
        pxr::SdfPath path;
        bool created = false;
        std::vector<Field> fields;
    };
    /// A move, or a removal if `to` is empty.
    struct NamespaceEdit {
        pxr::SdfPath from, to;
    };
    struct Taken {
        std::vector<NamespaceEdit> namespaceEdits;  ///< in order; to be applied before all others
        std::vector<Spec> specs;                    ///< parents before children
    };

    [[nodiscard]] bool empty() const { return specs_.empty() && namespaceEdits_.empty(); }
    [[nodiscard]] Taken take();
    [[nodiscard]] bool has(const pxr::SdfPath& path) const { return index_.contains(path); }
    [[nodiscard]] bool has(const pxr::SdfPath& path, const pxr::TfToken& field) const;
    /// Call when the whole content was replaced without single writes: all of it is new.
    void contentReplaced();

    /// While it lives, writes are ours and are not recorded.
    class Ignoring {
    public:
        explicit Ignoring(DelegateWrites& writes) : writes_(writes) { ++writes_.ignoring_; }
        ~Ignoring() { --writes_.ignoring_; }
        Ignoring(const Ignoring&) = delete;
        Ignoring& operator=(const Ignoring&) = delete;

    private:
        DelegateWrites& writes_;
    };

private:
    using Base = pxr::SdfSimpleLayerStateDelegate;
    using Path = pxr::SdfPath;
    using Token = pxr::TfToken;
    using Const = pxr::SdfAbstractDataConstValue;

    void _OnSetField(const Path& path, const Token& field, const pxr::VtValue& value) override;
    void _OnSetField(const Path& path, const Token& field, const Const& value) override;
    void _OnSetFieldDictValueByKey(const Path& path, const Token& field, const Token& keyPath,
                                   const pxr::VtValue& value) override;
    void _OnSetFieldDictValueByKey(const Path& path, const Token& field, const Token& keyPath,
                                   const Const& value) override;
    void _OnSetTimeSample(const Path& path, double time, const pxr::VtValue& value) override;
    void _OnSetTimeSample(const Path& path, double time, const Const& value) override;
    void _OnCreateSpec(const Path& path, pxr::SdfSpecType type, bool inert) override;
    void _OnDeleteSpec(const Path& path, bool inert) override;
    void _OnMoveSpec(const Path& from, const Path& to) override;

    [[nodiscard]] bool isNoted(const Path& path, const Token& field) const;
    Spec& spec(const Path& path);
    Field& field(const Path& path, const Token& name);
    void noteField(const Path& path, const Token& name, const pxr::VtValue& value);
    void noteKey(const Path& path, const Token& name, const Token& keyPath);
    void noteTime(const Path& path, double time);
    void forgetBelow(const Path& path);

    std::vector<NamespaceEdit> namespaceEdits_;
    std::vector<Spec> specs_;  // dropped ones have an empty path
    std::unordered_map<Path, std::size_t, Path::Hash> index_;
    int ignoring_ = 0;
};

}  // namespace usdlive::layers
