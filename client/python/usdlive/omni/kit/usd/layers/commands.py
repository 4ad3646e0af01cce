"""Kit's commands for layers, under Kit's names. Each restores the edit target and the selection on undo."""

from __future__ import annotations

import abc
import logging
import os
import typing

from pxr import Sdf, Tf, Usd

import usdlive
from usdlive import _usdlive
from usdlive.omni import _layer_content
from usdlive.omni._layer_content import Part
from usdlive.omni._registers import Kept, Recorder, hold, remove_spec
from usdlive.omni.kit.commands import CommandFailed, RecordedCommand
from usdlive.omni.usd import UsdContext

_log = logging.getLogger("usdlive.omni.kit.usd.layers")

Context = str | UsdContext
Paths = str | Sdf.Path | typing.Sequence[str | Sdf.Path]
_ROOT = Sdf.Path.absoluteRootPath
_SHARED_METADATA = ("upAxis", "metersPerUnit", "timeCodesPerSecond", "framesPerSecond", "startTimeCode",
                    "endTimeCode")


class AbstractLayerCommand(RecordedCommand):
    """A layer command. undo() also restores the selection, and the edit target unless that layer is muted or
    missing."""

    def __init__(self, usd_context: Context = ""):
        super().__init__(usd_context)
        self._edit_target: Sdf.Layer | None = None
        self._selected: list[str] = []

    def do(self) -> typing.Any:
        self._edit_target = hold(self.stage.GetEditTarget().GetLayer())
        self._selected = self.context.get_selection().get_selected_prim_paths()
        return super().do()

    def undo(self) -> list[Kept]:
        kept = super().undo()
        self.set_edit_target(self._edit_target)
        self.context.get_selection().set_selected_prim_paths(self._selected, False)
        return kept

    # -- helpers of the commands

    @property
    def root(self) -> Sdf.Layer:
        return self.stage.GetRootLayer()

    def layer(self, identifier: str) -> Sdf.Layer:
        try:
            layer = Sdf.Layer.FindOrOpen(identifier) if identifier else None
        except Tf.ErrorException:
            layer = None
        if layer is None:
            raise CommandFailed(f"{identifier or 'a layer without a name'} cannot be found")
        return layer

    def local_layer(self, identifier: str) -> Sdf.Layer:
        layer = self.layer(identifier)
        if not self.stage.HasLocalLayer(layer):
            raise CommandFailed(f"{identifier} is not a layer of this stage")
        return layer

    def set_edit_target(self, layer: Sdf.Layer | None) -> None:
        stage = self.stage
        if layer is None or not stage.HasLocalLayer(layer) or stage.IsLayerMuted(layer.identifier):
            layer = self.root
        stage.SetEditTarget(stage.GetEditTargetForLocalLayer(layer))

    def leave_edit_target(self, layer: Sdf.Layer | None, follow: Sdf.Layer | None = None) -> None:
        """Replaces the edit target if it is `layer` or a removed layer."""
        target = self.stage.GetEditTarget().GetLayer()
        if target == layer or not self.stage.HasLocalLayer(target):
            self.set_edit_target(follow)

    def editable(self, layer: Sdf.Layer) -> Sdf.Layer:
        if not layer.permissionToEdit:
            raise CommandFailed(f"{layer.identifier} does not permit edits")
        if _layer_content.is_locked(layer, self.root):
            raise CommandFailed(f"{layer.identifier} is locked")
        return layer

    def offset_of(self, layer: Sdf.Layer) -> Sdf.LayerOffset:
        """Returns the offset from the layer's time to the stage's time."""
        return self.stage.GetEditTargetForLocalLayer(layer).GetMapFunction().timeOffset


# -- sublayers


def _sublayer_at(parent: Sdf.Layer, position: int) -> str:
    if not 0 <= position < len(parent.subLayerPaths):
        raise CommandFailed(f"{parent.identifier} has no sublayer {position}")
    return parent.subLayerPaths[position]


def _position(parent: Sdf.Layer, position: int) -> int:
    """Returns the index for inserting: -1 and positions past the end append."""
    if position < -1:
        raise CommandFailed(f"{position} is not a position of a sublayer")
    count = len(parent.subLayerPaths)
    return count if position == -1 else min(position, count)


def _find_sublayer(parent: Sdf.Layer, path: str) -> Sdf.Layer | None:
    try:
        return Sdf.Layer.FindOrOpenRelativeToLayer(parent, path)
    except Tf.ErrorException:
        return None


def _position_of(parent: Sdf.Layer, layer: Sdf.Layer) -> int:
    """Returns -1 if it is not a sublayer of the parent."""
    found = [Sdf.Layer.FindRelativeToLayer(parent, path) for path in parent.subLayerPaths]
    return found.index(layer) if layer in found else -1


def _is_below(layer: Sdf.Layer, top: Sdf.Layer, seen: set[str] | None = None) -> bool:
    """Returns True if `layer` is the top or a sublayer at any depth."""
    seen = seen if seen is not None else set()
    if layer == top:
        return True
    if top.identifier in seen:
        return False
    seen.add(top.identifier)
    below = filter(None, (_find_sublayer(top, path) for path in top.subLayerPaths))
    return any(_is_below(layer, sublayer, seen) for sublayer in below)


def _insert(parent: Sdf.Layer, position: int, layer: Sdf.Layer,
            offset: Sdf.LayerOffset = Sdf.LayerOffset()) -> None:
    if _position_of(parent, layer) >= 0:
        raise CommandFailed(f"{layer.identifier} is a sublayer of {parent.identifier} already")
    if _is_below(parent, layer):
        raise CommandFailed(f"{layer.identifier} has {parent.identifier} as a sublayer, or is it")
    parent.subLayerPaths.insert(position, _layer_content.relative_path(layer, parent))
    parent.subLayerOffsets[position] = offset


class _SublayerCommand(AbstractLayerCommand):
    """A command that changes sublayers. Removes the mutes and the stored states of layers that are removed from
    the stack."""

    def __init__(self, usd_context: Context = ""):
        super().__init__(usd_context)
        self._muted: list[str] = []  # layers that do() has unmuted
        self._held: list[Sdf.Layer] = []  # keeps layers in memory alive for undo

    def do(self) -> typing.Any:
        self._muted, self._held = [], []
        result = super().do()
        self.stage.MuteAndUnmuteLayers([], self._muted)
        return result

    def undo(self) -> list[Kept]:
        kept = super().undo()
        if self._muted:
            self.stage.MuteAndUnmuteLayers(self._muted, [])
            self.leave_edit_target(None)
        return kept

    def sublayer_for(self, parent: Sdf.Layer, path: str) -> Sdf.Layer:
        """Returns the layer for a path. A live parent accepts only layers of its project, also by their names
        there."""
        if not self.context.is_live_layer(parent):
            return self.layer(path)
        live = self.context.live
        if path in live.layers():
            return live.open_layer(path)
        layer = self.layer(path)
        if not self.context.is_live_layer(layer):
            raise CommandFailed(f"{path} is not a layer of the project")
        return layer

    def take_out(self, recorder: Recorder, parent: Sdf.Layer, position: int) -> Sdf.Layer | None:
        """Removes a sublayer and returns it if it can be opened."""
        path = _sublayer_at(self.editable(parent), position)
        recorder.touch(parent)
        layer = _find_sublayer(parent, path)
        del parent.subLayerPaths[position]
        identifier = layer.identifier if layer else Sdf.ComputeAssetPathRelativeToLayer(parent, path)
        if layer:
            self._held.append(layer)
        if not self._is_used(identifier):
            self._forget(recorder, identifier)
        return layer

    def _is_used(self, identifier: str) -> bool:
        layer = Sdf.Layer.Find(identifier)
        return layer is not None and _is_below(layer, self.root)

    def _forget(self, recorder: Recorder, identifier: str) -> None:
        if self.stage.IsLayerMuted(identifier):
            self._muted.append(identifier)
        root, utils = self.root.identifier, _usdlive.layer_utils
        for flag in ("muteness", "locked"):
            if identifier in utils.layer_flags(root, flag):
                recorder.touch(self.root)
                utils.remove_layer_flag(root, flag, identifier)


class SetEditTargetCommand(AbstractLayerCommand):
    def __init__(self, layer_identifier: str, usd_context: Context = ""):
        super().__init__(usd_context)
        self._identifier = layer_identifier

    def edit(self, recorder: Recorder) -> None:
        layer = Sdf.Layer.Find(self._identifier)
        if layer is None or not self.stage.HasLocalLayer(layer):
            _log.warning("%s is not a layer of this stage; the edit target is not changed", self._identifier)
            return
        if _layer_content.is_locked(layer, self.root):
            raise CommandFailed(f"{self._identifier} is locked and cannot be the edit target. Unlock it first")
        self.set_edit_target(layer)


class CreateSublayerCommand(_SublayerCommand):
    """With `create_or_insert` True, creates a layer; an existing one is emptied in memory (its file when it is
    saved). With False, inserts an existing layer. Without a path the layer is anonymous. Returns its
    identifier. undo removes it from the stack and keeps its file; it does nothing if somebody else has worked in
    the created layer since."""

    def __init__(self, layer_identifier: str, sublayer_position: int, new_layer_path: str,
                 transfer_root_content: bool, create_or_insert: bool, layer_name: str = "",
                 usd_context: Context = ""):
        super().__init__(usd_context)
        self._identifier, self._at = layer_identifier, sublayer_position
        self._path, self._name = new_layer_path, layer_name
        self._transfer, self._create = transfer_root_content, create_or_insert
        self._new: Sdf.Layer | None = None  # redo uses the same layer
        self._stays = False

    def undo(self) -> list[Kept]:
        self._stays = (self._new is not None and self.context.is_live_layer(self._new)
                       and self._record.is_followed(self._new))
        if self._stays:
            return [Kept(self._new.identifier, "/", None, None, "another user has worked in it")]
        return super().undo()

    def redo(self) -> list[Kept]:
        return [] if self._stays else super().redo()

    def edit(self, recorder: Recorder) -> str:
        parent = self.editable(self.local_layer(self._identifier))
        position = _position(parent, self._at)
        recorder.touch(parent)
        if self._create or not self._path:
            layer = self._made(recorder, parent)
        else:
            layer = self.sublayer_for(parent, self._path)
        self._held.append(layer)
        _insert(parent, position, layer)
        if self._name:
            recorder.touch(layer)
            _usdlive.layer_utils.set_custom_layer_name(layer.identifier, self._name)
        if self._transfer:
            self._transfer_root(recorder, layer)
        return layer.identifier

    def _made(self, recorder: Recorder, parent: Sdf.Layer) -> Sdf.Layer:
        if self._new is None and self.context.is_live_layer(parent):
            self._new = self._made_in_project(parent)
        existing = self._new or (Sdf.Layer.FindOrOpen(self._path) if self._path else None)
        if existing is not None and self._new is None:
            if _is_below(parent, existing):
                raise CommandFailed(f"{existing.identifier} has {parent.identifier} as a sublayer, or is it")
            recorder.touch(self.editable(existing), deep=True)
            _layer_content.make_like(existing, Sdf.Layer.CreateAnonymous())
            layer = existing
        elif existing is not None:
            layer = existing
        else:
            layer = Sdf.Layer.CreateNew(self._path) if self._path else Sdf.Layer.CreateAnonymous()
            if layer is None:
                raise CommandFailed(f"{self._path} cannot be created")
            self._new = layer
        recorder.touch(layer)
        for field in _SHARED_METADATA:
            if self.root.pseudoRoot.HasInfo(field):
                layer.pseudoRoot.SetInfo(field, self.root.pseudoRoot.GetInfo(field))
        return layer

    def _made_in_project(self, parent: Sdf.Layer) -> Sdf.Layer:
        """Creates a layer of the project. An existing one is refused instead of emptied, because others may be
        editing it."""
        if not self._path:
            raise CommandFailed("a new layer of a live project needs a path: others cannot use a layer in memory")
        live = self.context.live
        name = live.layer_name(parent)
        project = parent.realPath.removesuffix(name)
        named = self._path if self._path.startswith(project) else os.path.join(os.path.dirname(parent.realPath),
                                                                               self._path)
        path = os.path.relpath(named, project)
        try:
            return live.create_layer(path)
        except usdlive.Error as error:
            raise CommandFailed(f"{path} cannot be created: {error.message}") from error

    def _transfer_root(self, recorder: Recorder, layer: Sdf.Layer) -> None:
        for prim in list(self.editable(self.root).rootPrims):
            recorder.touch_with_ancestors(layer, prim.path)
            recorder.touch(self.root, prim.path, deep=True)
            _layer_content.merge_prim_spec(layer, self.root, prim.path,
                                           src_layer_offset=self.offset_of(layer).GetInverse())
            remove_spec(self.root, prim.path)


class RemoveSublayerCommand(_SublayerCommand):
    def __init__(self, layer_identifier: str, sublayer_position: int, usd_context: Context = ""):
        super().__init__(usd_context)
        self._identifier, self._at = layer_identifier, sublayer_position

    def edit(self, recorder: Recorder) -> None:
        self.take_out(recorder, self.layer(self._identifier), self._at)
        self.leave_edit_target(None)


class ReplaceSublayerCommand(_SublayerCommand):
    def __init__(self, layer_identifier: str, sublayer_position: int, new_layer_path: str,
                 usd_context: Context = ""):
        super().__init__(usd_context)
        self._identifier, self._at, self._path = layer_identifier, sublayer_position, new_layer_path

    def edit(self, recorder: Recorder) -> None:
        parent = self.layer(self._identifier)
        layer = self.sublayer_for(parent, self._path)
        _sublayer_at(parent, self._at)
        offset = parent.subLayerOffsets[self._at]
        was_target = self.stage.GetEditTarget().GetLayer()
        with Sdf.ChangeBlock():
            replaced = self.take_out(recorder, parent, self._at)
            _insert(parent, self._at, layer, offset)
        self.leave_edit_target(replaced, layer if was_target == replaced else None)


class MoveSublayerCommand(_SublayerCommand):
    """Moves a sublayer. Afterwards it is at `to_sublayer_position` of its new parent."""

    def __init__(self, from_parent_layer_identifier: str, from_sublayer_position: int,
                 to_parent_layer_identifier: str, to_sublayer_position: int, remove_source: bool = False,
                 usd_context: Context = ""):
        super().__init__(usd_context)
        self._from, self._from_at = from_parent_layer_identifier, from_sublayer_position
        self._to, self._to_at = to_parent_layer_identifier, to_sublayer_position
        self._remove_source = remove_source

    def edit(self, recorder: Recorder) -> None:
        source, target = self.layer(self._from), self.editable(self.layer(self._to))
        path = _sublayer_at(source, self._from_at)
        offset, layer = source.subLayerOffsets[self._from_at], _find_sublayer(source, path)
        if layer is None:
            raise CommandFailed(f"{path} cannot be opened")
        was_target = self.stage.GetEditTarget().GetLayer() == layer
        recorder.touch(source)
        recorder.touch(target)
        _position(target, self._to_at)
        with Sdf.ChangeBlock():
            if self._remove_source or source == target:
                del self.editable(source).subLayerPaths[self._from_at]
            _insert(target, _position(target, self._to_at), layer, offset)
        self.leave_edit_target(None, layer if was_target else None)


# -- content


class MergeLayersCommand(_SublayerCommand):
    """Merges the source into the destination and removes it from its parent. `src_layer_offset` is applied in
    addition to the offsets of both. The sublayers of both become the destination's."""

    def __init__(self, dst_parent_layer_identifier: str, dst_layer_identifier: str,
                 src_parent_layer_identifier: str, src_layer_identifier: str, dst_stronger_than_src: bool,
                 src_layer_offset: Sdf.LayerOffset = Sdf.LayerOffset(), usd_context: Context = ""):
        super().__init__(usd_context)
        self._dst_parent, self._dst = dst_parent_layer_identifier, dst_layer_identifier
        self._src_parent, self._src = src_parent_layer_identifier, src_layer_identifier
        self._dst_stronger, self._offset = dst_stronger_than_src, src_layer_offset

    def edit(self, recorder: Recorder) -> None:
        src_parent = self.layer(self._src_parent)
        if self._is_out(self._dst):
            dst_parent = self.layer(self._dst_parent)
            self.take_out(recorder, dst_parent, self._find(dst_parent, self._dst))
        elif self._is_out(self._src):
            self.take_out(recorder, src_parent, self._find(src_parent, self._src))
        else:
            self._merge(recorder, src_parent)
        self.leave_edit_target(None, Sdf.Layer.Find(self._dst))

    def _is_out(self, identifier: str) -> bool:
        """Returns True if the layer is muted or missing."""
        if self.stage.IsLayerMuted(identifier):
            return True
        try:
            return Sdf.Layer.FindOrOpen(identifier) is None
        except Tf.ErrorException:
            return True

    @staticmethod
    def _find(parent: Sdf.Layer, identifier: str) -> int:
        for index, path in enumerate(parent.subLayerPaths):
            found = Sdf.Layer.FindRelativeToLayer(parent, path)
            if Sdf.ComputeAssetPathRelativeToLayer(parent, path) == identifier or (
                    found is not None and found.identifier == identifier):
                return index
        raise CommandFailed(f"{identifier} is not a sublayer of {parent.identifier}")

    def _merge(self, recorder: Recorder, src_parent: Sdf.Layer) -> None:
        dst, src = self.editable(self.local_layer(self._dst)), self.local_layer(self._src)
        if dst == src:
            raise CommandFailed("a layer cannot be merged with itself")
        at = self._find(src_parent, self._src)
        offset = self._offset * self.offset_of(dst).GetInverse() * self.offset_of(src)
        recorder.touch(dst, deep=True)
        parts = [Part(dst), Part(src, offset)]
        merged = _layer_content.composed(parts if self._dst_stronger else parts[::-1], dst)
        _layer_content.keep_metadata(merged, dst)
        with Sdf.ChangeBlock():
            subs = _layers_below(src, dst, offset)
            self.take_out(recorder, src_parent, at)
            own = list(zip(dst.subLayerPaths, dst.subLayerOffsets))
            subs = [entry for entry in subs if entry[0] not in dict(own)]
            _set_sublayers(merged, own + subs if self._dst_stronger else subs + own)
            _layer_content.make_like(dst, merged)


def _set_sublayers(layer: Sdf.Layer, entries: list[tuple[str, Sdf.LayerOffset]]) -> None:
    layer.subLayerPaths = [path for path, _ in entries]
    for index, (_, offset) in enumerate(entries):
        layer.subLayerOffsets[index] = offset


def _layers_below(src: Sdf.Layer, dst: Sdf.Layer,
                  offset: Sdf.LayerOffset) -> list[tuple[str, Sdf.LayerOffset]]:
    """Returns the sublayers of `src` as entries of `dst`."""
    folders = _layer_content.folder_of(src), _layer_content.folder_of(dst)
    return [(_layer_content.reanchored(path, *folders) if folders[0] != folders[1] else path, offset * own)
            for path, own in zip(src.subLayerPaths, src.subLayerOffsets)]


class FlattenLayersCommand(_SublayerCommand):
    """Merges all layers below the root layer into it. Muted layers are removed without merging."""

    def __init__(self, usd_context: Context = ""):
        super().__init__(usd_context)

    def edit(self, recorder: Recorder) -> None:
        root, stage = self.editable(self.root), self.stage
        session = set(_session_layers(stage))
        layers = [layer for layer in stage.GetLayerStack() if layer.identifier not in session]
        recorder.touch(root, deep=True)
        merged = _layer_content.composed([Part(layer, self.offset_of(layer)) for layer in layers], root)
        self._held.extend(map(hold, layers))
        with Sdf.ChangeBlock():
            while len(root.subLayerPaths):
                self.take_out(recorder, root, 0)
            _layer_content.keep_metadata(merged, root)
            _layer_content.make_like(root, merged)
        self.leave_edit_target(None)


def _session_layers(stage: Usd.Stage) -> list[str]:
    """Returns the session layer and its sublayers."""
    found, waiting = [], [stage.GetSessionLayer()]
    while waiting:
        layer = waiting.pop()
        if layer and layer.identifier not in found:
            found.append(layer.identifier)
            waiting.extend(_find_sublayer(layer, path) for path in layer.subLayerPaths)
    return found


class CreateLayerReferenceCommand(AbstractLayerCommand):
    """Creates a prim in that layer only, at `path_to` or the next free path. Returns the path."""

    def __init__(self, layer_identifier: str, path_to: str | Sdf.Path, asset_path: str | None = None,
                 prim_path: str | Sdf.Path | None = None, usd_context: Context = ""):
        super().__init__(usd_context)
        self._identifier, self._path = layer_identifier, path_to
        self._asset, self._prim = asset_path, prim_path

    def edit(self, recorder: Recorder) -> str:
        layer = self.editable(self.local_layer(self._identifier))
        path = self._free_path(layer, Sdf.Path(self._path))
        asset = self._asset or ""
        if asset and (found := Sdf.Layer.Find(asset)) and not found.anonymous:
            asset = _layer_content.relative_path(found, layer)
        recorder.touch_with_ancestors(layer, path)
        with Sdf.ChangeBlock():
            spec = Sdf.CreatePrimInLayer(layer, path)
            spec.specifier = Sdf.SpecifierDef
            spec.referenceList.prependedItems = [Sdf.Reference(asset, Sdf.Path(self._prim or ""))]
        return str(path)

    def _free_path(self, layer: Sdf.Layer, path: Sdf.Path) -> Sdf.Path:
        if not path.IsAbsoluteRootOrPrimPath() or path == _ROOT:
            raise CommandFailed(f"{self._path} is not the path of a prim")
        free, number = path, 0
        while self.stage.GetPrimAtPath(free) or layer.GetPrimAtPath(free):
            number += 1
            free = path.ReplaceName(f"{path.name}_{number:02}")
        return free


def _prim_paths(paths: Paths) -> list[Sdf.Path]:
    paths = [paths] if isinstance(paths, (str, Sdf.Path)) else list(paths)
    for path in paths:
        if not Sdf.Path.IsValidPathString(str(path)) or not Sdf.Path(path).IsPrimPath():
            raise CommandFailed(f"{path} is not the path of a prim")
    return list(Sdf.Path.RemoveDescendentPaths([Sdf.Path(path) for path in paths]))


class RemovePrimSpecCommand(AbstractLayerCommand):
    """Removes one or several prim specs."""

    def __init__(self, layer_identifier: str, prim_spec_path: Paths, usd_context: Context = ""):
        super().__init__(usd_context)
        self._identifier, self._paths = layer_identifier, prim_spec_path

    def edit(self, recorder: Recorder) -> None:
        layer, paths = self.editable(self.layer(self._identifier)), _prim_paths(self._paths)
        for path in paths:
            if not layer.GetPrimAtPath(path):
                raise CommandFailed(f"{layer.identifier} has no prim {path}")
            recorder.touch(layer, path, deep=True)
        with Sdf.ChangeBlock():
            for path in paths:
                remove_spec(layer, path)


class StitchPrimSpecsToLayer(AbstractLayerCommand):
    """Moves all opinions of the local layers about these prims to the target layer."""

    def __init__(self, prim_paths: Paths, target_layer_identifier: str, usd_context: Context = ""):
        super().__init__(usd_context)
        self._paths, self._identifier = prim_paths, target_layer_identifier

    def edit(self, recorder: Recorder) -> None:
        target = self.editable(self.local_layer(self._identifier))
        to_target = self.offset_of(target).GetInverse()
        for path in _prim_paths(self._paths):
            layers = [layer for layer in self.stage.GetLayerStack() if layer.GetPrimAtPath(path)]
            if not layers:
                raise CommandFailed(f"no layer of this stage has a prim {path}")
            parts = [Part(layer, to_target * self.offset_of(layer)) for layer in layers]
            whole = _layer_content.composed(parts, target, path)
            recorder.touch_with_ancestors(target, path)
            for layer in layers:
                recorder.touch(self.editable(layer), path, deep=True)
            with Sdf.ChangeBlock():
                for layer in layers:
                    if layer != target:
                        remove_spec(layer, path)
                _layer_content.put_prim(target, whole, path)


class MovePrimSpecsToLayerCommand(AbstractLayerCommand):
    def __init__(self, dst_layer_identifier: str, src_layer_identifier: str, prim_spec_path: Paths,
                 dst_stronger_than_src: bool, usd_context: Context = ""):
        super().__init__(usd_context)
        self._dst, self._src = dst_layer_identifier, src_layer_identifier
        self._paths, self._dst_stronger = prim_spec_path, dst_stronger_than_src

    def edit(self, recorder: Recorder) -> None:
        dst = self.editable(self.local_layer(self._dst))
        src = self.editable(self.local_layer(self._src))
        if dst == src:
            raise CommandFailed("both are the same layer")
        offset = self.offset_of(dst).GetInverse() * self.offset_of(src)
        for path in _prim_paths(self._paths):
            if not src.GetPrimAtPath(path):
                raise CommandFailed(f"{src.identifier} has no prim {path}")
            recorder.touch_with_ancestors(dst, path)
            recorder.touch(src, path, deep=True)
            with Sdf.ChangeBlock():
                _layer_content.merge_prim_spec(dst, src, path, self._dst_stronger, src_layer_offset=offset)
                remove_spec(src, path)


# -- states


class _StateCommand(AbstractLayerCommand):
    """A command that changes states through the context's `Layers`."""

    def layers(self) -> typing.Any:
        from usdlive.omni.kit.usd.layers import get_layers

        return get_layers(self.context)


class SetLayerMutenessCommand(_StateCommand):
    """Sets the muteness in the present scope. The other scope stays unchanged."""

    def __init__(self, layer_identifier: str, muted: bool, usd_context: Context = ""):
        super().__init__(usd_context)
        self._identifier, self._muted = layer_identifier, muted
        self._was = muted

    def edit(self, recorder: Recorder) -> None:
        layer = Sdf.Layer.Find(self._identifier)
        if layer is not None and layer in (self.root, self.stage.GetSessionLayer()):
            raise CommandFailed("the root and the session layer cannot be muted")
        self._was = self.stage.IsLayerMuted(self._identifier)
        self._set(recorder, self._muted)
        if self._muted:
            self.leave_edit_target(layer)

    def undo(self) -> list[Kept]:
        changes = ([self._identifier], []) if self._was else ([], [self._identifier])
        self.stage.MuteAndUnmuteLayers(*changes)
        return super().undo()

    def _set(self, recorder: Recorder, muted: bool) -> None:
        if self.layers().get_layers_state().is_muteness_global():
            from usdlive.omni.kit.usd.layers import LayerUtils

            recorder.touch(self.root)
            LayerUtils.set_layer_global_muteness(self.root, self._identifier, muted)
        self.stage.MuteAndUnmuteLayers(*(([self._identifier], []) if muted else ([], [self._identifier])))


class LockLayerCommand(_StateCommand):
    def __init__(self, layer_identifier: str, locked: bool, usd_context: Context = ""):
        super().__init__(usd_context)
        self._identifier, self._locked = layer_identifier, locked
        self._was = locked

    def edit(self, recorder: Recorder) -> None:
        layer = self.layer(self._identifier)
        if layer == self.root:
            raise CommandFailed("the root layer cannot be locked")
        # A muted layer is not local.
        if not self.stage.HasLocalLayer(layer) and not _is_below(layer, self.root):
            raise CommandFailed(f"{self._identifier} is not a layer of this stage")
        state = self.layers().get_layers_state()
        self._was = state.is_layer_locked(self._identifier)
        if not state.set_layer_lock_state(self._identifier, self._locked):
            raise CommandFailed(self.layers().get_last_error_string())
        if self._locked:
            self.leave_edit_target(layer)

    def undo(self) -> list[Kept]:
        state = self.layers().get_layers_state()
        if (state.is_layer_locked(self._identifier) != self._locked
                or not state.set_layer_lock_state(self._identifier, self._was)):
            kept = [Kept(self._identifier, str(_ROOT), None, None, "another user has changed its lock since")]
            return kept + super().undo()
        return super().undo()


def _names(given: Paths) -> list[str]:
    return [str(given)] if isinstance(given, (str, Sdf.Path)) else [str(item) for item in given]


class _SpecsCommand(_StateCommand):
    """A command that changes a stored set. undo restores only the changes of do()."""

    def __init__(self, usd_context: Context = ""):
        super().__init__(usd_context)
        self._added: set = set()
        self._removed: set = set()

    @abc.abstractmethod
    def state(self) -> set: ...

    @abc.abstractmethod
    def add(self, item: typing.Any) -> None: ...

    @abc.abstractmethod
    def remove(self, item: typing.Any) -> None: ...

    @abc.abstractmethod
    def change(self) -> None: ...

    def edit(self, recorder: Recorder) -> list[str]:
        before = self.state()
        self.change()
        after = self.state()
        self._added, self._removed = after - before, before - after
        changed = self._added | self._removed
        return sorted({item[0] if isinstance(item, tuple) else item for item in changed})

    def undo(self) -> list[Kept]:
        before = self.state()
        wanted = (before - self._added) | self._removed
        # One call may change several specs: a prim includes its properties.
        for item in sorted(self._added):
            if item in self.state():
                self.remove(item)
        for item in sorted(wanted - self.state()):
            self.add(item)
        for item in sorted(self.state() - wanted):
            self.remove(item)
        return super().undo()


class _LinkCommand(_SpecsCommand):
    def __init__(self, spec_paths: Paths, layer_identifiers: str | typing.Sequence[str],
                 usd_context: Context = ""):
        super().__init__(usd_context)
        self._specs, self._layers = _names(spec_paths), _names(layer_identifiers)

    @property
    def linking(self) -> typing.Any:
        return self.layers().get_specs_linking()

    def state(self) -> set:
        return {(str(spec), layer) for spec, layers in self.linking.get_all_spec_links().items()
                for layer in layers}

    def add(self, item: tuple[str, str]) -> None:
        self.linking.link_spec(*item)

    def remove(self, item: tuple[str, str]) -> None:
        self.linking.unlink_spec(*item)


class LinkSpecsCommand(_LinkCommand):
    """Links specs to layers. Without `additive`, removes their other links."""

    def __init__(self, spec_paths: Paths, layer_identifiers: str | typing.Sequence[str],
                 additive: bool = True, hierarchy: bool = False, usd_context: Context = ""):
        super().__init__(spec_paths, layer_identifiers, usd_context)
        self._additive, self._hierarchy = additive, hierarchy

    def change(self) -> None:
        for spec in self._specs:
            if not self._additive:
                self.linking.unlink_spec_from_all_layers(spec, self._hierarchy)
            for layer in self._layers:
                self.linking.link_spec(spec, layer, self._hierarchy)


class UnlinkSpecsCommand(_LinkCommand):
    def __init__(self, spec_paths: Paths, layer_identifiers: str | typing.Sequence[str],
                 hierarchy: bool = False, usd_context: Context = ""):
        super().__init__(spec_paths, layer_identifiers, usd_context)
        self._hierarchy = hierarchy

    def change(self) -> None:
        for spec in self._specs:
            for layer in self._layers:
                self.linking.unlink_spec(spec, layer, self._hierarchy)


class _LockSpecs(_SpecsCommand):
    def __init__(self, spec_paths: Paths, hierarchy: bool = False, usd_context: Context = ""):
        super().__init__(usd_context)
        self._specs, self._hierarchy = _names(spec_paths), hierarchy

    @property
    def locking(self) -> typing.Any:
        return self.layers().get_specs_locking()

    def state(self) -> set:
        return {str(path) for path in self.locking.get_all_locked_specs()}

    def add(self, item: str) -> None:
        self.locking.lock_spec(item)

    def remove(self, item: str) -> None:
        self.locking.unlock_spec(item)


class LockSpecsCommand(_LockSpecs):
    def change(self) -> None:
        for spec in self._specs:
            self.locking.lock_spec(spec, self._hierarchy)


class UnlockSpecsCommand(_LockSpecs):
    def change(self) -> None:
        unlocked = [path for spec in self._specs for path in self.locking.unlock_spec(spec, self._hierarchy)]
        kept = [spec for spec in self._specs if self.locking.is_spec_locked(spec)]
        if kept and not unlocked:
            raise CommandFailed(f"{', '.join(kept)} is locked by somebody else")
