// Declares NamespaceEditor, which deletes, renames and moves prims and properties of a composed
// stage.
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

/// The options of a NamespaceEditor.
struct NamespaceEditOptions {
    /// If true, prims with opinions over arcs are moved with relocates. If false, such edits are
    /// refused.
    bool allowRelocatesAuthoring = true;
    /// If true, opinions inside variants of the stage's local layers are moved in these layers, in
    /// all variants, without a relocate.
    bool editVariants = false;
};

/// The result of validating a batch. It converts to true if the batch can be applied.
struct CanApplyResult {
    std::vector<std::string> errors;
    std::vector<std::string> warnings;  ///< warnings do not prevent the edits

    explicit operator bool() const { return errors.empty(); }
    /// Returns the errors in one line, or an empty string if there are none.
    [[nodiscard]] std::string whyNot() const;
};

/// The changes of one ApplyEdits(), for undoing them once. Copies share them. It keeps the changed
/// layers in memory.
class NamespaceRecord {
public:
    NamespaceRecord();
    class Content;
    explicit NamespaceRecord(std::shared_ptr<Content> content);

    /// Returns true if there is nothing to undo.
    [[nodiscard]] bool isEmpty() const;
    /// Returns the changed layers.
    [[nodiscard]] std::vector<pxr::SdfLayerHandle> layers() const;

    /// Undoes the edits, in as many change blocks as they were made in, and empties the record.
    /// An edit whose specs cannot go back stays as a whole, with the paths that lead to them. In a
    /// layer for which `isShared` returns true, only values that were not changed since the edits
    /// are restored. Returns the parts that were not restored. Throws Misuse on another thread than
    /// that of ApplyEdits().
    std::vector<content::Kept> undo(const content::Record::IsShared& isShared) const;

private:
    std::shared_ptr<Content> content_;
};

/// Deletes, renames and moves prims and properties of a composed stage in all of its local layers,
/// and updates all targets, connections and arcs that lead to them. The function names are those of
/// UsdNamespaceEditor.
///
/// Edits are added to a batch. Each edit is validated against the stage that the edits before it
/// produce. The batch is applied as a whole or not at all: within one change block, or, if paths of
/// its edits meet ("/A" to "/B", then "/C" to "/A"), within several, because a UsdStage does not
/// survive such moves in one.
///
/// Threads: use the editor only on the thread that created it. A call from another thread throws
/// Misuse. The editor keeps the stage's layers in memory.
class NamespaceEditor {
public:
    using Options = NamespaceEditOptions;

    explicit NamespaceEditor(std::unique_ptr<EditedStage> stage, Options options = {});
    /// Edits a composed stage. The stage may be destroyed before the editor.
    explicit NamespaceEditor(stage::Stage& stage, Options options = {});
    ~NamespaceEditor();
    NamespaceEditor(const NamespaceEditor&) = delete;
    NamespaceEditor& operator=(const NamespaceEditor&) = delete;

    // Each function adds one edit to the batch. It returns false if a path cannot be edited;
    // invalid() then returns the reason, and the batch cannot be applied until it is cleared.
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

    /// Returns the reason for which the last edit was not added, or an empty string if it was
    /// added.
    [[nodiscard]] const std::string& invalid() const;
    /// One edit of the batch. If `to` is empty, the object at `from` is deleted.
    struct Edit {
        pxr::SdfPath from, to;
        bool operator==(const Edit&) const = default;
    };
    /// Returns the edits of the batch in the order in which they were added.
    [[nodiscard]] std::vector<Edit> GetEdits() const;
    /// Removes all edits from the batch, also the invalid ones.
    void ClearEdits();

    /// Adds a stage that uses layers of the edited stage. Its own local layers are updated too.
    /// Returns a number for RemoveDependentStage().
    std::size_t AddDependentStage(std::unique_ptr<EditedStage> stage);
    std::size_t AddDependentStage(stage::Stage& stage);
    void RemoveDependentStage(std::size_t stage);

    /// Validates the batch without changing a layer.
    [[nodiscard]] CanApplyResult CanApplyEdits();
    /// Applies the batch if it is valid. Clears the batch in any case.
    CanApplyResult ApplyEdits();
    /// Returns all layers that ApplyEdits() would change, or none if it would be refused.
    [[nodiscard]] pxr::SdfLayerHandleVector GetLayersToEdit();

    /// Returns the record of the last successful ApplyEdits(). It is empty if there was none.
    [[nodiscard]] const NamespaceRecord& GetRecord() const;

    /// Composes the stage and reads its local layers now, so that the next call is faster.
    void Prepare();

private:
    class Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace usdlive
