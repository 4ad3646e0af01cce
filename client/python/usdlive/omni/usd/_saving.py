"""Saves the layers and locks of a UsdContext."""

from __future__ import annotations

import typing

from pxr import Sdf, Tf, Usd

from usdlive import _usdlive
from usdlive.omni import _layer_content

from ._errors import OUTSIDE, Failure, reason
from ._files import Replacement, check_writable, extension, is_read_only
from ._live_stage import LiveStage
from ._steps import Steps


def unsaved(stage: Usd.Stage, live: LiveStage | None) -> list[Sdf.Layer]:
    """Returns the layers of the local stack that a save may write. Includes all live layers, because only their
    server knows whether they have changed."""
    layers, root = [], stage.GetRootLayer()
    for layer in stage.GetLayerStack():
        if live and live.name_of(layer):
            layers.append(layer)
        elif live and not layer.permissionToEdit:
            continue  # not joined yet: the server would not have it
        elif layer.dirty and not layer.anonymous and not _layer_content.is_locked(layer, root):
            layers.append(layer)
    return layers


def store_edit_target(stage: Usd.Stage, live: LiveStage | None) -> None:
    """Stores the edit target in the root layer like Kit, so that it is restored when the stage is opened. A root
    layer that has none, or cannot be saved, is not changed for its own sake."""
    root, target = stage.GetRootLayer(), stage.GetEditTarget().GetLayer()
    stored = _usdlive.layer_utils.authoring_layer(root.identifier)
    if (not target or target.anonymous or not stage.HasLocalLayer(target) or target.identifier == (stored or root.identifier)
            or not root.permissionToEdit or not live and is_read_only(root.realPath)):
        return
    _usdlive.layer_utils.set_authoring_layer(root.identifier, target.identifier)


def newly_locked(stage: Usd.Stage, live: LiveStage | None) -> list[Sdf.Layer]:
    """Returns the layers of the local stack whose own lock is not saved yet."""
    return [layer for layer in stage.GetLayerStack()
            if layer.dirty and not layer.anonymous and not (live and live.name_of(layer))
            and layer != stage.GetRootLayer() and _has_own_lock(layer) and _lacks_lock(layer.realPath)]


def _has_own_lock(layer: Sdf.Layer) -> bool:
    return _usdlive.layer_utils.has_own_lock(layer.identifier)


def _lacks_lock(path: str) -> bool:
    """Returns True for a writable file without a lock."""
    try:
        return not is_read_only(path) and not _has_own_lock(Sdf.Layer.OpenAsAnonymous(path, metadataOnly=True))
    except OUTSIDE:
        return False


def save_locks(stage: Usd.Stage, live: LiveStage | None, only: list[Sdf.Layer] | None) -> Steps[list[str]]:
    """Saves the unsaved locks of the stage's layers; `only`: of these layers. Returns the problems."""
    problems = []
    for layer in newly_locked(stage, live):
        if only is not None and layer not in only:
            continue
        try:
            yield from save_lock(layer)
        except OUTSIDE as error:
            problems.append(f"the lock of {layer.identifier} is not saved: {reason(error)}")
    return problems


def save_lock(layer: Sdf.Layer) -> Steps[None]:
    """Writes the lock to the layer's file, so that it exists when the layer is opened next. Does not save other
    edits of a locked layer."""
    content = Sdf.Layer.OpenAsAnonymous(layer.realPath)
    _usdlive.layer_utils.set_own_lock(content.identifier)
    yield from _replace(Replacement(content, layer.realPath, like=layer))
    if content.ExportToString() == layer.ExportToString():
        layer.Reload(True)
    else:
        _usdlive.layer_utils.file_was_written(layer.identifier)


def find_local(stage: Usd.Stage, live: LiveStage | None,
               identifiers: typing.Iterable[str]) -> list[Sdf.Layer]:
    """Finds layers of the local stack that may be saved. For a live layer the server decides who may save it
    while it is locked."""
    layers = []
    for identifier in identifiers:
        layer = Sdf.Layer.Find(identifier)
        if layer is None or not stage.HasLocalLayer(layer):
            raise Failure(f"{identifier} is not a layer of the local layer stack")
        is_live = live and live.name_of(layer)
        if not is_live and _layer_content.is_locked(layer, stage.GetRootLayer()):
            raise Failure(f"{identifier} is locked")
        if live and not is_live and not layer.anonymous and not layer.permissionToEdit:
            raise Failure(f"{identifier} is not joined and refuses edits: its server cannot read it yet")
        layers.append(layer)
    return layers


def save(layers: list[Sdf.Layer], live: LiveStage | None,
         unsaved_only: bool = False) -> Steps[tuple[list[Sdf.Layer], list[str], list[str]]]:
    """Returns the saved layers, the problems of the others, and sentences about those that were skipped.
    `unsaved_only` applies to live layers."""
    saved: list[Sdf.Layer] = []
    problems: list[str] = []
    skipped: list[str] = []
    if live:
        saved, problems, skipped = yield from live.save(layers, unsaved_only)
    for layer in layers:
        if live and live.name_of(layer):
            continue
        try:
            yield from _save_file(layer)
            saved.append(layer)
        except OUTSIDE as error:
            problems.append(reason(error))
    return saved, problems, skipped


def _save_file(layer: Sdf.Layer) -> Steps[None]:
    if layer.anonymous:
        raise Failure(f"{layer.identifier} is in memory only and has no file")
    if not layer.permissionToSave:
        raise Failure(f"{layer.identifier} does not permit saving")
    changed: list[bool] = []
    notice = Tf.Notice.Register(Sdf.Notice.LayersDidChangeSentPerLayer,
                                lambda *_: changed.append(True), layer)
    try:
        yield from _replace(Replacement(layer, layer.realPath or layer.identifier))
    finally:
        notice.Revoke()
    # Only this tells pxr that the layer equals its file again, and a .usdc layer has to read its
    # values from the new file. A layer that was edited meanwhile stays dirty.
    if not changed:
        layer.Reload(True)
    else:
        _usdlive.layer_utils.file_was_written(layer.identifier)


def _replace(replacement: Replacement) -> Steps[None]:
    try:
        yield replacement.sync_and_verify
        replacement.put_in_place()
    finally:
        replacement.discard()


def check_new_root(url: str, stage: Usd.Stage, anything_used: bool = False) -> None:
    """Checks whether the stage can be written to this file."""
    check_writable(url)
    existing = Sdf.Layer.Find(url)
    if existing is None or existing == stage.GetRootLayer() and not anything_used:
        return
    if anything_used and existing in stage.GetUsedLayers():
        raise Failure(f"{url} is used by the stage itself")
    if stage.HasLocalLayer(existing):
        raise Failure(f"{url} is a layer of the stage itself")


def write_root(root: Sdf.Layer, url: str) -> Steps[Sdf.Layer]:
    """Writes the root layer to a new file. Returns its layer."""
    copy = Sdf.Layer.CreateAnonymous("root." + extension(url))
    copy.TransferContent(root)
    _layer_content.reanchor_to_file(copy, root, url)
    yield from _replace(Replacement(copy, url, like=root))
    if existing := Sdf.Layer.Find(url):
        existing.Reload(True)
    return Sdf.Layer.FindOrOpen(url)


def export(stage: Usd.Stage, url: str) -> Steps[None]:
    flat = stage.Flatten(addSourceFileComment=False)
    yield from _replace(Replacement(flat, url, like=stage.GetRootLayer()))
