"""Kit's commands for prims that change layers."""

from __future__ import annotations

import typing

from pxr import Gf, Sdf, Usd, UsdGeom

from usdlive import NamespaceEditor
from usdlive.omni import _layer_content
from usdlive.omni._registers import Kept, Recorder, arrange, children_of, hold
from usdlive.omni.kit.commands import CommandFailed, RecordedCommand
from usdlive.omni.kit.usd.layers import active_authoring_layer_context

from ._context import UsdContext

_OnMove = typing.Callable[[Sdf.Path, Sdf.Path], typing.Any]


class MovePrimCommand(RecordedCommand):
    """`destructive` moves the prim in all local layers and adjusts all paths to it. Undo moves it back and
    keeps later edits of others. Otherwise the opinions of the local layers are copied to the edit target (in auto
    authoring to the default layer) under the new path, and the old prim is deactivated."""

    def __init__(self, path_from: str | Sdf.Path, path_to: str | Sdf.Path,
                 time_code: Usd.TimeCode | None = None, keep_world_transform: bool = True,
                 on_move_fn: _OnMove | None = None, destructive: bool = True,
                 stage_or_context: str | UsdContext | Usd.Stage = "", resolve_reference: bool = True):
        super().__init__(stage_or_context)
        self._from, self._to = Sdf.Path(path_from), Sdf.Path(path_to)
        self._time = Usd.TimeCode.Default() if time_code is None else time_code
        self._keep_world, self._destructive = keep_world_transform, destructive
        self._resolve = resolve_reference
        self._on_move = on_move_fn or (lambda *_: None)
        self._orders: list[tuple[Sdf.Layer, list[str]]] = []

    def edit(self, recorder: Recorder) -> None:
        stage = self.stage
        prim = stage.GetPrimAtPath(self._from)
        if not prim:
            raise CommandFailed(f"there is no prim {self._from}")
        world = self._world(prim) if self._keep_world else None
        if self._destructive:
            self._orders = [(hold(layer), children_of(layer, self._from.GetParentPath()))
                            for layer in stage.GetLayerStack() if layer.GetPrimAtPath(self._from)]
            self._move(self._from, self._to)
        else:
            self._copy(recorder)
        try:
            if world is not None:
                self._restore(recorder, stage.GetPrimAtPath(self._to), world)
        except BaseException:
            if self._destructive:
                self._move(self._to, self._from)
            raise
        self._on_move(self._from, self._to)

    def undo(self) -> list[Kept]:
        kept = super().undo()
        if self._destructive:
            try:
                self._move(self._to, self._from)
            # Another user has moved it again, or created a prim in its place.
            except CommandFailed as error:
                layer = self.stage.GetRootLayer().identifier
                return [*kept, Kept(layer, str(self._to), None, None, str(error))]
            with Sdf.ChangeBlock():
                for layer, order in self._orders:
                    arrange(layer, self._from.GetParentPath(), order, [self._from.name])
        self._on_move(self._to, self._from)
        return kept

    def _move(self, source: Sdf.Path, target: Sdf.Path) -> None:
        editor = NamespaceEditor(self.stage)
        if not editor.MovePrimAtPath(source, target):
            raise CommandFailed(f"{source} cannot be moved to {target}")
        for layer in editor.GetLayersToEdit():
            if _layer_content.is_locked(layer, self.stage.GetRootLayer()):
                raise CommandFailed(f"{source} cannot be moved: {layer.identifier} is locked")
        if not editor.ApplyEdits():
            raise CommandFailed(f"{source} cannot be moved to {target}: {editor.GetResult().whyNot}")

    def _copy(self, recorder: Recorder) -> None:
        stage = self.stage
        with active_authoring_layer_context(self.context):
            target = stage.GetEditTarget().GetLayer()  # a delegate has no folder for relative paths
        if stage.GetPrimAtPath(self._to):
            raise CommandFailed(f"there is a prim {self._to} already")
        to_target = stage.GetEditTargetForLocalLayer(target).GetMapFunction().timeOffset.GetInverse()
        parts = [_layer_content.Part(layer, to_target * stage.GetEditTargetForLocalLayer(
            layer).GetMapFunction().timeOffset) for layer in stage.GetLayerStack()
            if layer.GetPrimAtPath(self._from)]
        content = _layer_content.composed(parts, target, self._from)
        if self._resolve:  # any prim may refer to it
            recorder.touch(target, deep=True)
        for path in (self._to, self._from):
            recorder.touch_with_ancestors(target, path)
        _layer_content.merge_prim_spec(target, content, self._from, target_prim_path=self._to)
        stage.GetPrimAtPath(self._from).SetActive(False)
        if self._resolve:
            _layer_content.resolve_prim_path_references(target, self._from, self._to)

    # -- transforms

    def _world(self, prim: Usd.Prim) -> Gf.Matrix4d | None:
        if not UsdGeom.Xformable(prim):
            return None
        return UsdGeom.XformCache(self._time).GetLocalToWorldTransform(prim)

    def _restore(self, recorder: Recorder, prim: Usd.Prim, world: Gf.Matrix4d) -> None:
        cache = UsdGeom.XformCache(self._time)
        if Gf.IsClose(cache.GetLocalToWorldTransform(prim), world, 1e-9):
            return
        target = self.stage.GetEditTarget().GetLayer()
        recorder.touch_with_ancestors(target, prim.GetPath())
        local = world * cache.GetParentToWorldTransform(prim).GetInverse()
        UsdGeom.Xformable(prim).MakeMatrixXform().Set(local, self._time)


class ReorderPrimCommand(RecordedCommand):
    """Moves a prim to `position` among its siblings; -1 is the last. Always written to the root layer."""

    def __init__(self, prim_path: str | Sdf.Path, position: int,
                 stage_or_context: str | UsdContext | Usd.Stage = ""):
        super().__init__(stage_or_context)
        self._path, self._position = Sdf.Path(prim_path), position

    def edit(self, recorder: Recorder) -> None:
        prim, root = self.stage.GetPrimAtPath(self._path), self.stage.GetRootLayer()
        if not prim:
            raise CommandFailed(f"there is no prim {self._path}")
        parent = self._path.GetParentPath()
        names = [name for name in prim.GetParent().GetAllChildrenNames() if name != prim.GetName()]
        names.insert(len(names) if self._position < 0 else self._position, prim.GetName())
        touch = recorder.touch if root.GetPrimAtPath(parent) else recorder.touch_with_ancestors
        touch(root, parent)
        with Sdf.ChangeBlock():
            if parent == Sdf.Path.absoluteRootPath:
                root.pseudoRoot.nameChildrenOrder = names
            else:
                Sdf.CreatePrimInLayer(root, parent).nameChildrenOrder = names
