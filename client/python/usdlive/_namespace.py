"""Namespace editing of a Usd.Stage, with the names of Usd.NamespaceEditor."""

from __future__ import annotations

import functools
import typing

from pxr import Sdf, Tf, Usd

from . import _usdlive
from ._errors import Error
from ._connection import opened
from ._live import Live


@functools.lru_cache(maxsize=1024)
def _built_in(type_name: str, schemas: tuple[str, ...]) -> frozenset[str]:
    """The properties that schemas define for such a prim."""
    registry = Usd.SchemaRegistry()
    if schemas:
        definition = registry.BuildComposedPrimDefinition(type_name, list(schemas))
    else:
        definition = registry.FindConcretePrimDefinition(type_name)
    return frozenset(definition.GetPropertyNames()) if definition else frozenset()


# In the order of StageView::Load.
_RULES = [Usd.StageLoadRules.AllRule, Usd.StageLoadRules.OnlyRule, Usd.StageLoadRules.NoneRule]


class _EditedStage:
    """A Usd.Stage for the extension, which composes its layers itself. Layers go by their identifiers."""

    def __init__(self, stage: Usd.Stage):
        self.stage = stage

    def root(self) -> str:
        return self.stage.GetRootLayer().identifier if self.stage else ""

    def session(self) -> str:
        layer = self.stage.GetSessionLayer() if self.stage else None
        return layer.identifier if layer else ""

    def view(self):
        rules = {str(path): _RULES.index(rule) for path, rule in self.stage.GetLoadRules().GetRules()}
        mask = [str(path) for path in self.stage.GetPopulationMask().GetPaths()]
        fallbacks = {name: list(variants) for name, variants in Usd.Stage.GetGlobalVariantFallbacks().items()}
        # Without paths, all prims are in the mask of the extension; an empty path includes no prim.
        return list(self.stage.GetMutedLayers()), rules, [] if mask == ["/"] else mask or [""], fallbacks

    def edit_target(self) -> tuple[str, bool]:
        target = self.stage.GetEditTarget()
        layer = target.GetLayer()
        return layer.identifier if layer else "", not target.GetMapFunction().isIdentityPathMapping

    def is_built_in(self, type_name: str, schemas: list[str], name: str) -> bool:
        return name in _built_in(self._known_type(type_name), tuple(schemas))

    def _known_type(self, type_name: str) -> str:
        """The type itself if it is registered, or the first of the stage's fallbacks for it that is."""
        fallbacks = self.stage.GetMetadata("fallbackPrimTypes") or {}
        return next((name for name in (type_name, *fallbacks.get(type_name, ()))
                     if Usd.SchemaRegistry().FindConcretePrimDefinition(name)), "")

    def is_in_prototype(self, path: str) -> bool:
        prim = self.stage.GetPrimAtPath(path)
        return bool(prim) and prim.IsInPrototype()


class Kept(typing.NamedTuple):
    """Content that an undo has not restored, because another user has changed it since."""

    layer: str
    path: str
    field: str | None
    part: object
    reason: str


def _path(path) -> str:
    if isinstance(path, Sdf.Path):
        return str(path)
    if not isinstance(path, str):
        raise TypeError(f"a path is a str or an Sdf.Path, not {type(path).__name__}")
    return path if Sdf.Path.IsValidPathString(path) else ""


def _renamed(parent: Sdf.Path, separator: str, name: str) -> str:
    if not isinstance(name, str):
        raise TypeError(f"a name is a str, not {type(name).__name__}")
    return _path(f"{'' if parent == Sdf.Path.absoluteRootPath and separator == '/' else parent}{separator}{name}")


class NamespaceEditor:
    """Deletes, renames and moves prims and properties of a composed stage, in all layers of its own that have
    opinions, and corrects the targets, connections and arcs that lead to them.

    The methods are those of Usd.NamespaceEditor. Edits are queued; each sees the stage as the ones before
    leave it; `ApplyEdits` applies all of them or none. docs/namespace-editing.md lists where this does more than
    Usd.NamespaceEditor."""

    class EditOptions:
        """`allowRelocatesAuthoring`: prims with opinions over arcs are moved by relocates. `editVariants`:
        opinions within variants of the stage's own layers are moved there, in all variants."""

        def __init__(self, allowRelocatesAuthoring: bool = True, editVariants: bool = False):
            self.allowRelocatesAuthoring = allowRelocatesAuthoring
            self.editVariants = editVariants

    class CanApplyResult:
        """True when the edits can be applied. `warnings` prevent nothing; `whyNot` joins `errors`."""

        def __init__(self, errors: list[str], warnings: list[str]):
            self.errors = errors
            self.warnings = warnings

        @property
        def whyNot(self) -> str:
            return "; ".join(self.errors)

        def __bool__(self) -> bool:
            return not self.errors

        def __repr__(self) -> str:
            return f"CanApplyResult(errors={self.errors!r}, warnings={self.warnings!r})"

    def __init__(self, stage: Usd.Stage, editOptions=None):
        self._stage = self._checked(stage)
        options = editOptions or self.EditOptions()
        self._editor = _usdlive.namespace.Editor(_EditedStage(stage), bool(options.allowRelocatesAuthoring),
                                                 bool(getattr(options, "editVariants", False)))
        self._dependents: dict[Usd.Stage, int] = {}
        self._result = self.CanApplyResult([], [])

    @staticmethod
    def _checked(stage: Usd.Stage) -> Usd.Stage:
        if not isinstance(stage, Usd.Stage):
            raise TypeError(f"a namespace editor edits a Usd.Stage, not {type(stage).__name__}")
        if not stage:
            raise Error("invalidArgument", "the stage is no longer open")
        return stage

    def _object(self, thing, kind: type) -> Sdf.Path:
        if not isinstance(thing, kind):
            raise TypeError(f"expected a Usd.{kind.__name__}, not {type(thing).__name__}")
        if not thing:
            raise Error("invalidArgument", f"the {kind.__name__.lower()} is not valid: {thing}")
        if thing.GetStage() != self._stage:
            raise Error("invalidArgument", f"<{thing.GetPath()}> belongs to another stage than the editor's")
        return thing.GetPath()

    @staticmethod
    def _added(problem: str) -> bool:
        if problem:
            Tf.RaiseCodingError(problem)
        return True

    def _property_path(self, path) -> str:
        """OpenUSD's documentation writes `/testSphere/customProp` for the property of a prim."""
        text = _path(path)
        if text:
            path = Sdf.Path(text)
            if path.IsRootPrimPath() or not path.IsPrimPath() or not path.IsAbsolutePath():
                return text
            meant = path.GetParentPath().AppendProperty(path.name)
            if not self._stage.GetPrimAtPath(path) and self._stage.GetPropertyAtPath(meant):
                return str(meant)
        return text

    # --- edits: Tf.ErrorException for a path that no edit can have, as of Usd.NamespaceEditor ---

    def DeletePrimAtPath(self, path) -> bool:
        return self._added(self._editor.delete_prim(_path(path)))

    def MovePrimAtPath(self, path, newPath) -> bool:
        return self._added(self._editor.move_prim(_path(path), _path(newPath)))

    def DeletePrim(self, prim: Usd.Prim) -> bool:
        return self.DeletePrimAtPath(self._object(prim, Usd.Prim))

    def RenamePrim(self, prim: Usd.Prim, newName: str) -> bool:
        path = self._object(prim, Usd.Prim)
        return self.MovePrimAtPath(path, _renamed(path.GetParentPath(), "/", newName))

    def ReparentPrim(self, prim: Usd.Prim, newParent: Usd.Prim, newName: str | None = None) -> bool:
        path, parent = self._object(prim, Usd.Prim), self._object(newParent, Usd.Prim)
        return self.MovePrimAtPath(path, _renamed(parent, "/", path.name if newName is None else newName))

    def DeletePropertyAtPath(self, path) -> bool:
        return self._added(self._editor.delete_property(self._property_path(path)))

    def MovePropertyAtPath(self, path, newPath) -> bool:
        return self._added(self._editor.move_property(self._property_path(path), _path(newPath)))

    def DeleteProperty(self, property: Usd.Property) -> bool:
        return self.DeletePropertyAtPath(self._object(property, Usd.Property))

    def RenameProperty(self, property: Usd.Property, newName: str) -> bool:
        path = self._object(property, Usd.Property)
        return self.MovePropertyAtPath(path, _renamed(path.GetPrimPath(), ".", newName))

    def ReparentProperty(self, property: Usd.Property, newParent: Usd.Prim, newName: str | None = None) -> bool:
        path, parent = self._object(property, Usd.Property), self._object(newParent, Usd.Prim)
        return self.MovePropertyAtPath(path, _renamed(parent, ".", path.name if newName is None else newName))

    def GetEdits(self) -> list[tuple[Sdf.Path, Sdf.Path]]:
        """From where to where; to the empty path: deleted."""
        return [(Sdf.Path(old), Sdf.Path(new) if new else Sdf.Path()) for old, new in self._editor.edits()]

    def ClearEdits(self) -> None:
        self._editor.clear()

    # --- stages that depend on this one ---

    def AddDependentStage(self, stage: Usd.Stage) -> None:
        if self._checked(stage) != self._stage and stage not in self._dependents:
            self._dependents[stage] = self._editor.add_dependent(_EditedStage(stage))

    def RemoveDependentStage(self, stage: Usd.Stage) -> None:
        number = self._dependents.pop(stage, None)
        if number is not None:
            self._editor.remove_dependent(number)

    def SetDependentStages(self, stages: typing.Iterable[Usd.Stage]) -> None:
        """These and no others."""
        wanted = [self._checked(stage) for stage in stages]
        for stage in list(self._dependents):
            if stage not in wanted:
                self.RemoveDependentStage(stage)
        for stage in wanted:
            self.AddDependentStage(stage)

    # --- the batch ---

    def CanApplyEdits(self) -> "NamespaceEditor.CanApplyResult":
        return self.CanApplyResult(*self._editor.can_apply())

    def ApplyEdits(self) -> bool:
        """Empties the batch. False: nothing is changed, and `GetResult` says why."""
        self._result = self.CanApplyResult(*self._editor.apply())
        return bool(self._result)

    def GetResult(self) -> "NamespaceEditor.CanApplyResult":
        """Returns the result of the last ApplyEdits."""
        return self._result

    def GetLayersToEdit(self) -> list[Sdf.Layer]:
        """All layers that ApplyEdits would change; none when it would be refused."""
        found = (Sdf.Layer.Find(identifier) for identifier in self._editor.layers_to_edit())
        return [layer for layer in found if layer]

    def Undo(self) -> list[Kept]:
        """Takes back what the last successful ApplyEdits has changed; a second call does nothing. In live layers what
        others have written since stays, and is returned. A prim that cannot go back keeps the targets that lead to
        it."""
        record = self._editor.record()
        clients = [live._client for live in opened if isinstance(live, Live) and not live.closed]
        shared = [layer for layer in record.layers()
                  if any(client.layer_name(layer) is not None for client in clients)]
        return [Kept(*kept) for kept in record.undo(shared)]

    def Prepare(self) -> None:
        """Composes the stage and reads its layers now, so that the next call takes less time."""
        self._editor.prepare()
