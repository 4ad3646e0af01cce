#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>

#include <memory>
#include <string>
#include <vector>

#include "usdlive/client/usd/content/Recorder.h"
#include "usdlive/client/usd/namespace/EditedStage.h"

namespace usdlive {

struct NamespaceEditOptions {
    /// Prims with opinions over arcs are moved by relocates; without it such edits are refused.
    bool allowRelocatesAuthoring = true;
    /// Opinions within variants of the stage's own layers are moved there, in all variants, and
    /// no relocate is authored for them.
    bool editVariants = false;
};

/// What the edits of a batch come to. True: they can be applied.
struct CanApplyResult {
    std::vector<std::string> errors;
    std::vector<std::string> warnings;  ///< these prevent nothing

    explicit operator bool() const { return errors.empty(); }
    /// The errors in one line; empty when there are none.
    [[nodiscard]] std::string whyNot() const;
};

/// What ApplyEdits() has changed, and the way back. A value; keeps its layers.
class NamespaceRecord {
public:
    NamespaceRecord();
    class Content;
    explicit NamespaceRecord(std::shared_ptr<const Content> content);

    [[nodiscard]] bool isEmpty() const;
    [[nodiscard]] std::vector<pxr::SdfLayerHandle> layers() const;

    /// Moves everything back, in one change block. In a layer that `isShared`, only what still is
    /// as the edits left it goes back; the rest is returned.
    std::vector<content::Kept> undo(const content::Record::IsShared& isShared) const;

private:
    std::shared_ptr<const Content> content_;
};

/// Deletes, renames and moves prims and properties of a composed stage in all of its local layers,
/// and corrects everything that leads to them. The names are those of UsdNamespaceEditor.
///
/// Edits are queued; each one sees the stage as the ones before leave it. The batch is validated as
/// a whole, and applied as a whole or not at all, within one change block.
///
/// One thread, the one that made it; a call from another one throws Misuse. The layers are kept in
/// memory as long as the editor lives.
class NamespaceEditor {
public:
    using Options = NamespaceEditOptions;

    explicit NamespaceEditor(std::unique_ptr<EditedStage> stage, Options options = {});
    /// The same as with editedStage(stage).
    explicit NamespaceEditor(stage::Stage& stage, Options options = {});
    ~NamespaceEditor();
    NamespaceEditor(const NamespaceEditor&) = delete;
    NamespaceEditor& operator=(const NamespaceEditor&) = delete;

    // These add an edit to the batch. False: a path is none that can be edited, which invalid()
    // tells; the batch then cannot be applied.
    bool DeletePrimAtPath(const pxr::SdfPath& path);
    bool MovePrimAtPath(const pxr::SdfPath& path, const pxr::SdfPath& newPath);
    bool RenamePrim(const pxr::SdfPath& path, const pxr::TfToken& newName);
    bool ReparentPrim(const pxr::SdfPath& path, const pxr::SdfPath& newParent);
    bool ReparentPrim(const pxr::SdfPath& path, const pxr::SdfPath& newParent,
                      const pxr::TfToken& newName);
    bool DeletePropertyAtPath(const pxr::SdfPath& path);
    bool MovePropertyAtPath(const pxr::SdfPath& path, const pxr::SdfPath& newPath);
    bool RenameProperty(const pxr::SdfPath& path, const pxr::TfToken& newName);
    bool ReparentProperty(const pxr::SdfPath& path, const pxr::SdfPath& newParent);
    bool ReparentProperty(const pxr::SdfPath& path, const pxr::SdfPath& newParent,
                          const pxr::TfToken& newName);

    /// Why the last edit could not be added; empty when it could.
    [[nodiscard]] const std::string& invalid() const;
    /// The edits of the batch: from where to where; to the empty path: deleted.
    struct Edit {
        pxr::SdfPath from, to;
        bool operator==(const Edit&) const = default;
    };
    [[nodiscard]] std::vector<Edit> GetEdits() const;
    void ClearEdits();

    /// Stages that use the layers of this one, and whose own layers are corrected also. Returned is
    /// a number to remove the stage with.
    std::size_t AddDependentStage(std::unique_ptr<EditedStage> stage);
    std::size_t AddDependentStage(stage::Stage& stage);
    void RemoveDependentStage(std::size_t stage);

    [[nodiscard]] CanApplyResult CanApplyEdits();
    /// Empties the batch, also when it is refused.
    CanApplyResult ApplyEdits();
    /// All layers that ApplyEdits() would change; none when it would be refused.
    [[nodiscard]] pxr::SdfLayerHandleVector GetLayersToEdit();

    /// What the last successful ApplyEdits() has changed.
    [[nodiscard]] const NamespaceRecord& GetRecord() const;

    /// Composes the stage now, so that the next call takes less time.
    void Prepare();

private:
    class Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace usdlive
