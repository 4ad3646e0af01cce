// The content that one call of a provider makes: checked, and kept apart until the call has
// succeeded.
#pragma once

#include <pxr/usd/sdf/data.h>

#include <atomic>
#include <memory>
#include <set>
#include <string>
#include <unordered_map>
#include <unordered_set>

#include "usdlive/edf/DataProvider.h"

namespace usdlive::edf {

class SourceData final : public IEdfSourceData {
public:
    enum class Adds { Everything, ChildrenOnly };
    /// Writes the content of `root` to `into`. With ChildrenOnly, `root` gets no properties and
    /// metadata. `label` names payload and provider in warnings.
    SourceData(pxr::SdfPath root, Adds adds, pxr::SdfDataRefPtr into, std::string label,
               std::shared_ptr<std::atomic<bool>> isCancelled);

    bool CreatePrim(const pxr::SdfPath& parent, const std::string& name,
                    pxr::SdfSpecifier specifier, const pxr::TfToken& typeName) override;
    bool CreateAttribute(const pxr::SdfPath& prim, const pxr::TfToken& name,
                         const pxr::SdfValueTypeName& typeName, pxr::SdfVariability variability,
                         const pxr::VtValue& value) override;
    bool CreateRelationship(const pxr::SdfPath& prim, const pxr::TfToken& name,
                            const pxr::SdfPathVector& targets) override;
    bool SetField(const pxr::SdfPath& path, const pxr::TfToken& field,
                  const pxr::VtValue& value) override;
    bool HasField(const pxr::SdfPath& path, const pxr::TfToken& field) const override;
    bool HasAttribute(const pxr::SdfPath& attribute) const override;
    bool DeferChildren(const pxr::SdfPath& prim) override;
    void SetMayChange() override { mayChange_ = true; }
    void AddDependency(const std::string& resolvedPath) override {
        dependencies_.insert(resolvedPath);
    }
    void Warn(const std::string& text) override;
    [[nodiscard]] bool IsCancelled() const override { return *isCancelled_; }

    /// The reason of the first refusal; empty if there was none.
    [[nodiscard]] const std::string& refusal() const { return refusal_; }
    /// Completes the content: adds the lists of children. Called once, at the end.
    void finish();
    [[nodiscard]] const pxr::SdfPathSet& deferred() const { return deferred_; }
    [[nodiscard]] const std::set<std::string>& dependencies() const { return dependencies_; }
    [[nodiscard]] bool mayChange() const { return mayChange_; }

private:
    struct Children {
        std::vector<pxr::TfToken> prims, properties;
    };
    bool refuse(const std::string& reason);
    [[nodiscard]] bool isPrim(const pxr::SdfPath& path) const;
    bool createProperty(const pxr::SdfPath& prim, const pxr::TfToken& name, pxr::SdfSpecType type);
    bool setDefault(const pxr::SdfPath& attribute, const pxr::TfType& type,
                    const pxr::VtValue& value);

    const pxr::SdfPath root_;
    const Adds adds_;
    const std::string label_;
    const std::shared_ptr<std::atomic<bool>> isCancelled_;
    const pxr::SdfDataRefPtr data_;
    std::unordered_map<pxr::SdfPath, Children, pxr::SdfPath::Hash> children_;
    std::size_t specs_ = 0;
    pxr::SdfPathSet deferred_;
    std::set<std::string> dependencies_;
    std::string refusal_;
    int warnings_ = 0;
    bool mayChange_ = false;
};

}  // namespace usdlive::edf
