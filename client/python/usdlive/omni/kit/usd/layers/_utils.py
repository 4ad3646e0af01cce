"""Operations on layers and sublayers: Kit's `LayerUtils`."""

from __future__ import annotations

import asyncio
import logging
import os
import typing

from pxr import Sdf, Usd

from usdlive import _usdlive
from usdlive.omni._layer_content import restore_edit_target, set_edit_target
from usdlive.omni.usd import UsdContext, get_context_from_live_layer

from ._layers import distribute_all

_log = logging.getLogger("usdlive.omni.kit.usd.layers")
_utils = _usdlive.layer_utils
# Tasks of create_checkpoint(). The loop alone does not keep them alive.
_tasks: set[asyncio.Future] = set()

_Layer = typing.Union[str, Sdf.Layer]


def _id(layer: _Layer) -> str:
    if isinstance(layer, str):
        return layer
    return layer.identifier if layer else ""


def _layer(kept: tuple[str, object] | None) -> Sdf.Layer | None:
    return Sdf.Layer.Find(kept[0]) if kept else None


def _is_file_writable(path: str) -> bool:
    # A file without write permission is not written, even by root.
    return not os.path.exists(path) or bool(os.stat(path).st_mode & 0o222 and os.access(path, os.W_OK))


def _context_of(identifier: str) -> UsdContext | None:
    """Returns the context whose project contains the live layer."""
    layer = Sdf.Layer.Find(identifier) if identifier else None
    return get_context_from_live_layer(layer) if layer else None


class LayerUtils:
    """Operations on layers, given as Sdf.Layer or by identifier. None of them raises: a failure returns None,
    "", -1 or False."""

    # -- sublayers

    @staticmethod
    def create_sublayer(layer: _Layer, sublayer_position: int, layer_identifier: str) -> Sdf.Layer | None:
        """Creates a sublayer. An existing file is emptied; without an identifier the layer is anonymous.
        Position -1, or past the end, means last."""
        return _layer(_utils.create_sublayer(_id(layer), sublayer_position, layer_identifier or ""))

    @staticmethod
    def insert_sublayer(layer: _Layer, sublayer_position: int, layer_identifier: str,
                        check_empty_layer: bool = True) -> Sdf.Layer | None:
        """Returns None also if the layer would contain itself."""
        return _layer(_utils.insert_sublayer(_id(layer), sublayer_position, layer_identifier or "",
                                             check_empty_layer))

    @staticmethod
    def replace_sublayer(layer: _Layer, sublayer_position: int, layer_identifier: str) -> Sdf.Layer | None:
        return _layer(_utils.replace_sublayer(_id(layer), sublayer_position, layer_identifier or ""))

    @staticmethod
    def remove_sublayer(layer: _Layer, sublayer_position: int) -> str | None:
        """Returns the identifier of the removed sublayer."""
        return _utils.remove_sublayer(_id(layer), sublayer_position) or None

    @staticmethod
    def move_layer(from_parent_layer_identifier: _Layer, from_sublayer_position: int,
                   to_parent_layer_identifier: _Layer, to_sublayer_position: int,
                   remove_source: bool = False) -> bool:
        return _utils.move_layer(_id(from_parent_layer_identifier), from_sublayer_position,
                                 _id(to_parent_layer_identifier), to_sublayer_position, remove_source)

    @staticmethod
    def get_sublayer_identifier(layer: _Layer, sublayer_position: int) -> str | None:
        return _utils.sublayer_identifier(_id(layer), sublayer_position) or None

    @staticmethod
    def get_sublayer_position_in_parent(parent_layer: _Layer, layer_identifier: _Layer) -> int:
        """Returns -1 if it is not a sublayer of the parent."""
        return _utils.sublayer_position(_id(parent_layer), _id(layer_identifier))

    @staticmethod
    def get_all_sublayers(stage: Usd.Stage, include_session_layers: bool = False,
                          include_only_omni_layers: bool = False,
                          include_anonymous_layers: bool = True) -> list[str]:
        """Returns the local layers, including muted ones: the root layer first, session layers last."""
        tops = [stage.GetRootLayer()]
        if include_session_layers and stage.GetSessionLayer():
            tops.append(stage.GetSessionLayer())
        all_layers: list[str] = []
        for top in tops:
            all_layers += [top.identifier, *_utils.all_sublayers(top.identifier)]
        kept = []
        for identifier in dict.fromkeys(all_layers):
            anonymous = Sdf.Layer.IsAnonymousLayerIdentifier(identifier)
            omni = identifier.startswith(("omniverse://", "usdlive://"))
            if (include_anonymous_layers or not anonymous) and (omni or not include_only_omni_layers):
                kept.append(identifier)
        return kept

    @staticmethod
    def get_dirty_layers(stage: Usd.Stage, include_root_layer: bool = True) -> list[str]:
        """Returns used layers with unsaved edits, without anonymous ones."""
        root = stage.GetRootLayer()
        return [layer.identifier for layer in stage.GetUsedLayers()
                if layer.dirty and not layer.anonymous and (include_root_layer or layer != root)
                and not layer.identifier.endswith(".live") and not layer.identifier.startswith("metrics:")]

    # -- content

    @staticmethod
    def has_prim_spec(layer: _Layer, prim_spec_path: str | Sdf.Path) -> bool:
        found = Sdf.Layer.Find(_id(layer)) if _id(layer) else None
        valid = Sdf.Path.IsValidPathString(str(prim_spec_path))
        return bool(found and valid and found.GetPrimAtPath(prim_spec_path))

    @staticmethod
    def remove_prim_spec(layer: _Layer, prim_spec_path: str | Sdf.Path) -> bool:
        return _utils.remove_prim_spec(_id(layer), str(prim_spec_path))

    @staticmethod
    def transfer_layer_content(source_layer: _Layer, target_layer: _Layer, copy_custom_data: bool = True,
                               skip_sublayers: bool = True) -> bool:
        """Copies the source's content to the target and adjusts relative asset paths."""
        return _utils.transfer_content(_id(source_layer), _id(target_layer), copy_custom_data, skip_sublayers)

    @staticmethod
    def resolve_paths(base_layer: _Layer, target_layer: _Layer, store_relative_path: bool = True,
                      relative_to_base_layer: bool = False, copy_sublayer_offsets: bool = False) -> None:
        """Makes asset paths of the target that are relative to the base layer relative to the target, relative
        to the base, or absolute."""
        _utils.resolve_paths(_id(base_layer), _id(target_layer), store_relative_path, relative_to_base_layer,
                             copy_sublayer_offsets)

    # -- the edit target

    @staticmethod
    def get_edit_target(stage: Usd.Stage) -> str:
        layer = stage.GetEditTarget().GetLayer()
        return layer.identifier if layer else ""

    @staticmethod
    def set_edit_target(stage: Usd.Stage, layer_identifier: str) -> bool:
        """Returns False for a layer that is not local, or is locked."""
        return set_edit_target(stage, layer_identifier)

    @staticmethod
    def save_authoring_layer_to_custom_data(stage: Usd.Stage) -> bool:
        """Stores the edit target in the root layer, unless it is anonymous."""
        root, layer = stage.GetRootLayer(), stage.GetEditTarget().GetLayer()
        if not layer or layer.anonymous or not root.permissionToEdit:
            return False
        return _utils.set_authoring_layer(root.identifier, layer.identifier)

    @staticmethod
    def restore_authoring_layer_from_custom_data(stage: Usd.Stage) -> bool:
        return restore_edit_target(stage)

    # -- flags in the root layer

    @staticmethod
    def get_layer_global_muteness(root_layer: _Layer, layer_identifier: str) -> bool:
        return _utils.layer_flags(_id(root_layer), "muteness").get(layer_identifier, False)

    @staticmethod
    def set_layer_global_muteness(root_layer: _Layer, layer_identifier: str, muted: bool) -> bool:
        return _utils.set_layer_flag(_id(root_layer), "muteness", layer_identifier, muted)

    @staticmethod
    def remove_layer_global_muteness(root_layer: _Layer, layer_identifier: str) -> bool:
        return _utils.remove_layer_flag(_id(root_layer), "muteness", layer_identifier)

    @staticmethod
    def get_layer_lock_status(root_layer: _Layer, layer_identifier: str) -> bool:
        return _utils.layer_flags(_id(root_layer), "locked").get(layer_identifier, False)

    @staticmethod
    def set_layer_lock_status(root_layer: _Layer, layer_identifier: str, locked: bool) -> bool:
        """Writes the root layer's flag only. Returns False for unlocking a layer that has a lock of its own:
        LayersState.set_layer_lock_state() ends both."""
        if not locked and _utils.has_own_lock(layer_identifier):
            return False
        return _utils.set_layer_flag(_id(root_layer), "locked", layer_identifier, locked)

    @staticmethod
    def remove_layer_lock_status(root_layer: _Layer, layer_identifier: str) -> bool:
        if _utils.has_own_lock(layer_identifier):
            return False
        return _utils.remove_layer_flag(_id(root_layer), "locked", layer_identifier)

    @staticmethod
    def restore_muteness_from_custom_data(stage: Usd.Stage) -> None:
        """Mutes and unmutes with one change of the stage."""
        root = stage.GetRootLayer().identifier
        flags = _utils.layer_flags(root, "muteness")
        flags.pop(root, None)
        stage.MuteAndUnmuteLayers([layer for layer, muted in flags.items() if muted],
                                  [layer for layer, muted in flags.items() if not muted])

    # -- names and files

    @staticmethod
    def get_custom_layer_name(layer: _Layer) -> str:
        """Returns the custom name, otherwise the name of the layer's file, or an anonymous layer's identifier."""
        identifier = _id(layer)
        custom = _utils.custom_layer_name(identifier)
        if custom or Sdf.Layer.IsAnonymousLayerIdentifier(identifier):
            return custom or identifier
        return Sdf.Layer.GetDisplayNameFromIdentifier(identifier)

    @staticmethod
    def set_custom_layer_name(layer: _Layer, name: str) -> bool:
        return _utils.set_custom_layer_name(_id(layer), name)

    @staticmethod
    def is_layer_writable(layer_identifier: str) -> bool:
        """Returns True if the layer and its file permit edits."""
        layer = Sdf.Layer.Find(layer_identifier) if layer_identifier else None
        if not layer or not layer.permissionToEdit:
            return False
        return layer.anonymous or _is_file_writable(layer.realPath)

    @staticmethod
    def reload_all_layers(layer_identifiers: list[str]) -> bool:
        """Reloads with one change of the stages that use the layers."""
        return _utils.reload_layers(list(layer_identifiers))

    # -- checkpoints

    @staticmethod
    async def create_checkpoint_async(layer_identifier: str | typing.Sequence[str], comment: str,
                                      force: bool = False) -> tuple[list[str], list[str]]:
        """Returns (done, failed). A checkpoint names a revision of a whole project, so layers that are not live
        fail. An existing checkpoint of the same revision is enough unless `force`."""
        identifiers = [layer_identifier] if isinstance(layer_identifier, str) else list(layer_identifier)
        projects = {identifier: _context_of(identifier) for identifier in identifiers}
        done: dict[object, bool] = {None: False}
        for context in dict.fromkeys(projects.values()):
            if context is not None:
                done[context], error = await context.create_checkpoint_async(comment, force)
                if error:
                    _log.error("no checkpoint: %s", error)
        return ([one for one, context in projects.items() if done[context]],
                [one for one, context in projects.items() if not done[context]])

    @staticmethod
    def create_checkpoint(layer_identifier: str | typing.Sequence[str], comment: str,
                          force: bool = False) -> None:
        """Starts creating checkpoints without waiting. Needs a running event loop."""
        task = asyncio.ensure_future(LayerUtils.create_checkpoint_async(layer_identifier, comment, force))
        _tasks.add(task)
        task.add_done_callback(_tasks.discard)

    @staticmethod
    async def create_checkpoint_for_stage_async(stage: Usd.Stage, comment: str, only_dirty_layers: bool = False,
                                                force: bool = False) -> tuple[list[str], list[str]]:
        """Creates checkpoints for the stage's live local layers; with `only_dirty_layers`, for the unsaved
        ones."""
        chosen = []
        distribute_all()
        for identifier in LayerUtils.get_all_sublayers(stage, include_anonymous_layers=False):
            context = _context_of(identifier)
            if context and only_dirty_layers:
                context.live.tick()  # includes the edits of this frame
            if context and (not only_dirty_layers or context.is_live_layer_unsaved(Sdf.Layer.Find(identifier))):
                chosen.append(identifier)
        return await LayerUtils.create_checkpoint_async(chosen, comment, force)

    @staticmethod
    def save_layers(layer_identifiers: list[str]) -> list[str]:
        """Returns the layers that could not be saved."""
        distribute_all()
        return _utils.save_layers(list(layer_identifiers))
