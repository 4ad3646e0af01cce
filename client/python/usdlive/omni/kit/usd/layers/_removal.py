"""Replaces `stage.RemovePrim` during auto authoring.

`pxr.Usd` removes a prim from the layer of the edit target and returns False if that layer has no spec of it.
The delegate has specs only for prims that were edited since the mode started. So the stage's `RemovePrim` is
shadowed during the mode: the delegate gets a spec first, and its removal is distributed like that of any other.
"""

import typing
import weakref

from pxr import Sdf, Usd

if typing.TYPE_CHECKING:
    from ._layers import Layers


def shadow_removal(layers: "Layers", stage: Usd.Stage) -> None:
    """Shadows RemovePrim until unshadow_removal(). Keeps neither object alive."""
    this = weakref.ref(layers)

    def remove_prim(path: Sdf.Path | str) -> bool:
        layers = this()
        stage = layers._stage
        with Sdf.ChangeBlock():
            _mirror(layers, stage, Sdf.Path(path))
            return Usd.Stage.RemovePrim(stage, path)

    stage.RemovePrim = remove_prim


def unshadow_removal(stage: Usd.Stage) -> None:
    vars(stage).pop("RemovePrim", None)


def _mirror(layers: "Layers", stage: Usd.Stage, path: Sdf.Path) -> None:
    """Creates a spec in the delegate for a prim that has none there yet."""
    target = stage.GetEditTarget().GetLayer()
    prim = stage.GetPrimAtPath(path) if path.IsAbsoluteRootOrPrimPath() else None
    if (not prim or prim.IsPseudoRoot() or prim.IsInstanceProxy() or prim.IsInPrototype()
            or not layers.get_auto_authoring().is_auto_authoring_layer(target.identifier)
            or target.GetPrimAtPath(prim.GetPath())):
        return
    # The removal of an empty `over` is ignored.
    Sdf.CreatePrimInLayer(target, prim.GetPath()).specifier = Sdf.SpecifierDef
