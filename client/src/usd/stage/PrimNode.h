// Declares PrimNode, one prim in the tree of a stage.
#pragma once

#include <pxr/base/tf/delegatedCountPtr.h>
#include <pxr/usd/pcp/primIndex.h>
#include <pxr/usd/sdf/path.h>

#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

#include "usdlive/client/usd/stage/AttributeQuery.h"
#include "usdlive/client/usd/stage/Prim.h"

namespace usdlive::stage {

class StageState;
struct Prototype;

using PrimNodePtr = pxr::TfDelegatedCountPtr<PrimNode>;

/// Owned by its parent, by the stage (for the root and prototypes) and by its handles. A node that
/// was removed from the tree never returns; a prim that is created later gets a new node.
class PrimNode {
public:
    PrimNode(StageState* owner, pxr::SdfPath where, PrimNode* above)
        : stage(owner), path(std::move(where)), parent(above) {}

    [[nodiscard]] bool has(PrimFlag flag) const { return flags & std::uint16_t(flag); }
    [[nodiscard]] PrimNode* child(const pxr::TfToken& name) const {
        for (const auto& one : children)
            if (one->path.GetNameToken() == name) return one.get();
        return nullptr;
    }

    StageState* stage;                         // null after removal; then only the path is valid
    const pxr::SdfPath path;                   // in a prototype: "/__Prototype_1/child"
    PrimNode* parent;                          // null for roots
    const pxr::PcpPrimIndex* index = nullptr;  // in a prototype: of its source
    std::vector<PrimNodePtr> children;
    pxr::TfToken typeName;
    pxr::TfTokenVector apiSchemas;  // the authored list
    const schema::PrimDefinition* definition = nullptr;
    const Prototype* prototype = nullptr;   // set for an instance
    std::shared_ptr<const ClipSets> clips;  // also of its ancestors; null if there are none
    std::uint16_t flags = 0;

private:
    friend void TfDelegatedCountIncrement(PrimNode* node) noexcept;
    friend void TfDelegatedCountDecrement(PrimNode* node) noexcept;
    std::atomic<std::uint32_t> count_ = 0;
};

}  // namespace usdlive::stage
