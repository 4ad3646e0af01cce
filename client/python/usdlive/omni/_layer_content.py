"""Moving content between layers, with asset paths that lead to where they led."""

from __future__ import annotations

import glob
import os
import re
import typing

from pxr import Sdf, Usd, UsdUtils

from usdlive import _usdlive
from usdlive.omni._registers import make_like

_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.\-]+:")
LayerLike = Sdf.Layer | str


def find_layer(layer: LayerLike) -> Sdf.Layer | None:
    if isinstance(layer, str):
        return Sdf.Layer.Find(layer) if layer else None
    return layer or None  # one that has expired is none


def is_locked(layer: Sdf.Layer, root: Sdf.Layer) -> bool:
    """By its own customLayerData, or by Kit's map in the root layer; the root layer itself never is."""
    return _usdlive.layer_utils.is_layer_locked(layer.identifier, root.identifier)


# -- asset paths


def reanchored(path: str, source: str, target: str, relative: bool = True) -> str:
    """`path` as a layer in the folder `target` writes what one in `source` meant by it. Stays as it is: what
    is absolute, an address, in memory, an expression, and what is looked for by a search path (`X.mdl`),
    unless there is such a file in `source`, where it is found first."""
    if not path or not source or path.startswith("`") or _SCHEME.match(path) or os.path.isabs(path):
        return path
    package, inside = (path.split("[", 1) + [""])[:2]
    file, separator, arguments = package.partition(":SDF_FORMAT_ARGS:")
    absolute = os.path.normpath(os.path.join(source, file))
    if not file.startswith(("./", "../")) and not glob.glob(_pattern(absolute)):
        return path
    rest = separator + arguments + ("[" + inside if inside else "")
    if not relative or not target:
        return absolute + rest
    return _relative(absolute, target) + rest


def _pattern(path: str) -> str:
    """Of the files a path means: with <UDIM> it is several."""
    return glob.escape(path).replace("<UDIM>", "[0-9][0-9][0-9][0-9]")


def folder_of(layer: Sdf.Layer) -> str:
    """What relative paths in the layer are relative to; "" for one in memory."""
    return "" if layer.anonymous else os.path.dirname(os.path.realpath(layer.realPath or layer.identifier))


def reanchor(content: Sdf.Layer, source: Sdf.Layer, target: Sdf.Layer, relative: bool = True) -> None:
    """Changes the asset paths in `content`, a copy in memory of what `source` has, for `target`."""
    _reanchor(content, folder_of(source), folder_of(target), relative)


def reanchor_to_file(content: Sdf.Layer, source: Sdf.Layer, path: str) -> None:
    """The same for a file that is not yet there; also for the layers that its customLayerData names."""
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
    """How `anchor` names `layer`."""
    if layer.anonymous:
        return layer.identifier
    path, folder = os.path.realpath(layer.realPath or layer.identifier), folder_of(anchor)
    return _relative(path, folder) if folder else path


def _relative(path: str, folder: str) -> str:
    moved = os.path.relpath(path, folder).replace(os.sep, "/")
    return moved if moved.startswith("../") else "./" + moved


# -- content


def copy_of(layer: Sdf.Layer) -> Sdf.Layer:
    copy = Sdf.Layer.CreateAnonymous(".usda")
    copy.TransferContent(layer)
    return copy


class Part(typing.NamedTuple):
    """A layer, and how its time is that of the layer it is brought into."""

    layer: Sdf.Layer
    offset: Sdf.LayerOffset = Sdf.LayerOffset()


def composed(parts: typing.Sequence[Part], target: Sdf.Layer, prim: Sdf.Path | None = None) -> Sdf.Layer:
    """What the layers say together, strongest first, as one layer in the place of `target`; their sublayers
    left out. With `prim`, only that one and below. USD's own rules decide, so that a stage composes the same
    values as with the layers next to each other."""
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

    # Masked to nothing: no prim of it needs to be composed, and nothing that is referenced opened.
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
    """Brings the content of one layer into another, which has no sublayers then. What it says of itself
    (axis, units, its state) it says still."""
    dst, src = find_layer(dst_layer_identifier), find_layer(src_layer_identifier)
    if dst is None or src is None or dst == src:
        return False
    parts = [Part(dst), Part(src, Sdf.LayerOffset(src_layer_offset, src_layer_scale))]
    merged = composed(parts if dst_is_stronger_than_src else parts[::-1], dst)
    keep_metadata(merged, dst)
    make_like(dst, merged)
    return True


def keep_metadata(merged: Sdf.Layer, layer: Sdf.Layer) -> None:
    """What the layer says of itself, but its sublayers, in what is to become its content."""
    _usdlive.content.take_metadata(merged.identifier, layer.identifier)


def merge_prim_spec(dst_layer_identifier: LayerLike, src_layer_identifier: LayerLike,
                    prim_spec_path: Sdf.Path | str, dst_is_stronger_than_src: bool = True,
                    target_prim_path: Sdf.Path | str = "",
                    src_layer_offset: Sdf.LayerOffset = Sdf.LayerOffset()) -> bool:
    """Brings a prim with all below it into another layer, at `target_prim_path` if given. Ancestors that are
    missing there are made as overs."""
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
    """The prim at `path` becomes as in `content`."""
    with Sdf.ChangeBlock():
        if not layer.GetPrimAtPath(path):
            Sdf.CreatePrimInLayer(layer, path)
        make_like(layer, content, path)


def resolve_paths(base_layer_identifier: LayerLike, target_layer_identifier: LayerLike,
                  store_relative_path: bool = True, relative_to_base_layer: bool = False,
                  copy_sublayer_offsets: bool = False) -> bool:
    """Asset paths in the target layer, written for the base layer's place, are written for its own; or, with
    `relative_to_base_layer`, the other way round."""
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
    """Targets, connections and arcs within the layer that lead to (below) an old path lead to the new one."""
    pairs = [(str(old), str(new)) for old, new in zip(old_prim_paths, new_prim_paths)]
    _usdlive.content.retarget(find_layer(layer).identifier, pairs)
