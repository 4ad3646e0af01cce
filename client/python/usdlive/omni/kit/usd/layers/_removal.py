"""Replaces `stage.RemovePrim` in the edit modes with a delegate layer.

`pxr.Usd` removes a prim from the layer of the edit target and returns False if that layer has no spec of it.
The delegate has specs only for prims that were edited since the mode started. So the stage's `RemovePrim` is
shadowed during the mode: the delegate gets a spec first, and its removal is distributed like that of any other.
"""

import typing
import weakref

from pxr import Sdf, Usd


def shadow_removal(stage: Usd.Stage, is_delegate: typing.Callable[[str], bool]) -> None:
    """Shadows RemovePrim until unshadow_removal(). `is_delegate` says whether an identifier is that of the delegate
    layer. Does not keep the stage alive."""
    this = weakref.ref(stage)

    def remove_prim(path: Sdf.Path | str) -> bool:
        stage = this()
        target = stage.GetEditTarget().GetLayer()
        with Sdf.ChangeBlock():
            if is_delegate(target.identifier):
                _mirror(target, stage, Sdf.Path(path))
            return Usd.Stage.RemovePrim(stage, path)

    stage.RemovePrim = remove_prim


def unshadow_removal(stage: Usd.Stage) -> None:
    vars(stage).pop("RemovePrim", None)


def _mirror(delegate: Sdf.Layer, stage: Usd.Stage, path: Sdf.Path) -> None:
    """Creates a spec in the delegate for a prim that has none there yet."""
    prim = stage.GetPrimAtPath(path) if path.IsAbsoluteRootOrPrimPath() else None
    if (not prim or prim.IsPseudoRoot() or prim.IsInstanceProxy() or prim.IsInPrototype()
            or delegate.GetPrimAtPath(prim.GetPath())):
        return
    # The removal of an empty `over` is ignored.
    Sdf.CreatePrimInLayer(delegate, prim.GetPath()).specifier = Sdf.SpecifierDef
