"""Functions that contexts and layers share: edit targets, and moving content between layers with its asset paths."""

from __future__ import annotations

import glob
import os
import re
import typing

from pxr import Ar, Sdf, Usd, UsdUtils

from usdlive import _usdlive
from usdlive.omni._registers import make_like

_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.\-]+:")
LayerLike = Sdf.Layer | str


def find_layer(layer: LayerLike) -> Sdf.Layer | None:
    if isinstance(layer, str):
        return Sdf.Layer.Find(layer) if layer else None
    return layer or None  # an expired handle is false


def is_locked(layer: Sdf.Layer, root: Sdf.Layer) -> bool:
    """Returns True if the layer is locked by its own customLayerData, or by Kit's map in the root layer. The
    root layer is never locked."""
    return _usdlive.layer_utils.is_layer_locked(layer.identifier, root.identifier)


def set_edit_target(stage: Usd.Stage, layer_identifier: str) -> bool:
    """Returns False for a layer that is not local, or is locked."""
    layer = find_layer(layer_identifier)
    if not layer or not stage.HasLocalLayer(layer) or is_locked(layer, stage.GetRootLayer()):
        return False
    stage.SetEditTarget(stage.GetEditTargetForLocalLayer(layer))
    return True


def restore_edit_target(stage: Usd.Stage) -> bool:
    """Restores the edit target of the last save, which Kit stores in the root layer."""
    layer = _usdlive.layer_utils.authoring_layer(stage.GetRootLayer().identifier)
    return bool(layer) and set_edit_target(stage, layer)


# -- asset paths


def reanchored(path: str, source: str, target: str, relative: bool = True) -> str:
    """Converts an asset path in a layer in the folder `source` for a layer in the folder `target`. Paths that
    are absolute, addresses, in memory or expressions stay unchanged. So do search paths (`X.mdl`), unless
    `source` contains the file, where it would be found first."""
    if not path or not source or path.startswith("`") or _SCHEME.match(path) or os.path.isabs(path):
        return path
    package, inside = (path.split("[", 1) + [""])[:2]
    file, separator, arguments = package.partition(":SDF_FORMAT_ARGS:")
    absolute = _joined(source, file)
    if not file.startswith(("./", "../")) and not _exists(absolute):
        return path
    rest = separator + arguments + ("[" + inside if inside else "")
    if not relative or not target:
        return absolute + rest
    return _relative(absolute, target) + rest


_ADDRESS = "usdlive://"


def _joined(folder: str, path: str) -> str:
    if not folder.startswith(_ADDRESS):
        return os.path.normpath(os.path.join(folder, path))
    # The host and what follows it are normalized as an absolute path.
    return _ADDRESS + os.path.normpath(os.path.join(folder.removeprefix(_ADDRESS[:-1]), path)).lstrip("/")


def _exists(path: str) -> bool:
    if path.startswith(_ADDRESS):
        tiles = range(1001, 1101) if "<UDIM>" in path else (0,)
        return any(Ar.GetResolver().Resolve(path.replace("<UDIM>", str(tile))) for tile in tiles)
    return bool(glob.glob(_pattern(path)))


def _pattern(path: str) -> str:
    """Returns the pattern for the files of a path; with <UDIM> there are several."""
    return glob.escape(path).replace("<UDIM>", "[0-9][0-9][0-9][0-9]")


def folder_of(layer: Sdf.Layer) -> str:
    """Returns the folder for relative paths in the layer, or "" if it is in memory."""
    return "" if layer.anonymous else os.path.dirname(_real(layer))


def _real(layer: Sdf.Layer) -> str:
    path = layer.realPath or layer.identifier
    return path if path.startswith(_ADDRESS) else os.path.realpath(path)


def reanchor(content: Sdf.Layer, source: Sdf.Layer, target: Sdf.Layer, relative: bool = True) -> None:
    """Converts the asset paths in `content`, a copy of `source` in memory, for `target`."""
    _reanchor(content, folder_of(source), folder_of(target), relative)


def reanchor_to_file(content: Sdf.Layer, source: Sdf.Layer, path: str) -> None:
    """Converts the asset paths for a file that need not exist, and the layers named in its customLayerData."""
    folder = os.path.dirname(os.path.realpath(path))
    _reanchor(content, folder_of(source), folder, True)
    _usdlive.layer_utils.reanchor_states(content.identifier, folder_of(source), folder)


def _reanchor(content: Sdf.Layer, source: str, target: str, relative: bool) -> None:
    if not source or source == target and relative:
        return
    offsets = list(content.subLayerOffsets)
    UsdUtils.ModifyAssetPaths(content, lambda path: reanchored(path, source, target, relative))
    for index, offset in enumerate(offsets):
        content.subLayerOffsets[index] = offset


def relative_path(layer: Sdf.Layer, anchor: Sdf.Layer) -> str:
    """Returns the path that `anchor` uses for `layer`."""
    if layer.anonymous:
        return layer.identifier
    path, folder = _real(layer), folder_of(anchor)
    return _relative(path, folder) if folder else path


def _relative(path: str, folder: str) -> str:
    server = folder.split("/@")[0] + "/" if folder.startswith(_ADDRESS) else ""
    if server and not path.startswith(server) or not server and path.startswith(_ADDRESS):
        return path  # one is an address, or it is on another server
    moved = os.path.relpath(path, folder).replace(os.sep, "/")
    return moved if moved.startswith("../") else "./" + moved


# -- content


def copy_of(layer: Sdf.Layer) -> Sdf.Layer:
    copy = Sdf.Layer.CreateAnonymous(".usda")
    copy.TransferContent(layer)
    return copy


class Part(typing.NamedTuple):
    """A layer and the offset from its time to the time of the target layer."""

    layer: Sdf.Layer
    offset: Sdf.LayerOffset = Sdf.LayerOffset()


def composed(parts: typing.Sequence[Part], target: Sdf.Layer, prim: Sdf.Path | None = None) -> Sdf.Layer:
    """Returns the combined opinions of the layers, strongest first, as one layer in the place of `target`,
    without their sublayers. With `prim`, only that prim and everything below. USD's own rules combine them, so
    that a stage composes the same values as with the separate layers."""
    anchors: dict[str, Sdf.Layer] = {}
    whole = Sdf.Layer.CreateAnonymous(".usda")
    whole.timeCodesPerSecond = target.timeCodesPerSecond
    copies = [_copy_for(part.layer, prim) for part in parts]
    whole.subLayerPaths = [copy.identifier for copy in copies]
    for index, (part, copy) in enumerate(zip(parts, copies)):
        whole.subLayerOffsets[index] = part.offset
        anchors[copy.identifier] = part.layer
    place = folder_of(target)

    def asset_path(layer: Sdf.Layer, path: str) -> str:
        source = folder_of(anchors[layer.identifier])
        return path if source == place else reanchored(path, source, place)

    # An empty mask: no prim is composed and no reference is opened.
    stage = Usd.Stage.OpenMasked(whole, Sdf.Layer.CreateAnonymous(), Usd.StagePopulationMask())
    return UsdUtils.FlattenLayerStack(stage, asset_path, "merged.usda")


def _copy_for(layer: Sdf.Layer, prim: Sdf.Path | None) -> Sdf.Layer:
    if prim is None:
        copy = copy_of(layer)
        copy.subLayerPaths = []
        return copy
    copy = Sdf.Layer.CreateAnonymous(".usda")
    copy.timeCodesPerSecond = layer.timeCodesPerSecond
    if layer.GetPrimAtPath(prim):
        Sdf.CreatePrimInLayer(copy, prim)
        Sdf.CopySpec(layer, prim, copy, prim)
    return copy


def merge_layers(dst_layer_identifier: LayerLike, src_layer_identifier: LayerLike,
                 dst_is_stronger_than_src: bool = True, src_layer_offset: float = 0.0,
                 src_layer_scale: float = 1.0) -> bool:
    """Merges the content of one layer into another, which has no sublayers afterwards. The other layer keeps
    its metadata (axis, units, its state)."""
    dst, src = find_layer(dst_layer_identifier), find_layer(src_layer_identifier)
    if dst is None or src is None or dst == src:
        return False
    parts = [Part(dst), Part(src, Sdf.LayerOffset(src_layer_offset, src_layer_scale))]
    merged = composed(parts if dst_is_stronger_than_src else parts[::-1], dst)
    keep_metadata(merged, dst)
    make_like(dst, merged)
    return True


def keep_metadata(merged: Sdf.Layer, layer: Sdf.Layer) -> None:
    """Copies the metadata of the layer, without its sublayers, to its future content."""
    _usdlive.content.take_metadata(merged.identifier, layer.identifier)


def merge_prim_spec(dst_layer_identifier: LayerLike, src_layer_identifier: LayerLike,
                    prim_spec_path: Sdf.Path | str, dst_is_stronger_than_src: bool = True,
                    target_prim_path: Sdf.Path | str = "",
                    src_layer_offset: Sdf.LayerOffset = Sdf.LayerOffset()) -> bool:
    """Merges a prim and everything below it into another layer, at `target_prim_path` if given. Missing
    ancestors are created as overs."""
    dst, src = find_layer(dst_layer_identifier), find_layer(src_layer_identifier)
    source = Sdf.Path(prim_spec_path)
    target = Sdf.Path(target_prim_path) if target_prim_path else source
    if dst is None or src is None or not src.GetPrimAtPath(source) or (dst, target) == (src, source):
        return False
    moved = composed([Part(src, src_layer_offset)], dst, source)
    if target != source:
        renamed = Sdf.Layer.CreateAnonymous(".usda")
        renamed.timeCodesPerSecond = moved.timeCodesPerSecond
        Sdf.CreatePrimInLayer(renamed, target)
        Sdf.CopySpec(moved, source, renamed, target)
        moved = renamed
    if dst.GetPrimAtPath(target):
        parts = [Part(dst), Part(moved)]
        moved = composed(parts if dst_is_stronger_than_src else parts[::-1], dst, target)
    put_prim(dst, moved, target)
    return True


def put_prim(layer: Sdf.Layer, content: Sdf.Layer, path: Sdf.Path) -> None:
    """Makes the prim at `path` equal to the one in `content`."""
    with Sdf.ChangeBlock():
        if not layer.GetPrimAtPath(path):
            Sdf.CreatePrimInLayer(layer, path)
        make_like(layer, content, path)


def resolve_paths(base_layer_identifier: LayerLike, target_layer_identifier: LayerLike,
                  store_relative_path: bool = True, relative_to_base_layer: bool = False,
                  copy_sublayer_offsets: bool = False) -> bool:
    """Converts asset paths in the target layer from the base layer's folder to its own, or in the other
    direction with `relative_to_base_layer`."""
    base, target = find_layer(base_layer_identifier), find_layer(target_layer_identifier)
    if base is None or target is None:
        return False
    content = copy_of(target)
    anchors = (target, base) if relative_to_base_layer else (base, target)
    reanchor(content, *anchors, store_relative_path)
    if copy_sublayer_offsets:
        for index, offset in list(enumerate(base.subLayerOffsets))[:len(content.subLayerPaths)]:
            content.subLayerOffsets[index] = offset
    make_like(target, content)
    return True


def resolve_prim_path_references(layer: LayerLike, old_prim_path: Sdf.Path | str,
                                 new_prim_path: Sdf.Path | str) -> None:
    resolve_prim_paths_references(layer, [old_prim_path], [new_prim_path])


def resolve_prim_paths_references(layer: LayerLike, old_prim_paths: typing.Sequence[Sdf.Path | str],
                                  new_prim_paths: typing.Sequence[Sdf.Path | str]) -> None:
    """Replaces old paths in targets, connections and internal arcs of the layer by the new ones, also for paths
    below them."""
    pairs = [(str(old), str(new)) for old, new in zip(old_prim_paths, new_prim_paths)]
    _usdlive.content.retarget(find_layer(layer).identifier, pairs)
