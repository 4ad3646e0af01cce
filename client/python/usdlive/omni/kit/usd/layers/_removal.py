"""`stage.RemovePrim` while auto authoring is on.

`pxr.Usd` removes a prim from the layer of the edit target, and says False when that has no spec of it. The
delegate has specs only of what was edited since the mode began; what is seen of all other prims is in the
layers below. So the stage's own `RemovePrim` is shadowed as long as the mode is on: the delegate gets a
spec first, and its removal is distributed like that of any other."""

import typing
import weakref

from pxr import Sdf, Usd

if typing.TYPE_CHECKING:
    from ._layers import Layers


def shadow_removal(layers: "Layers", stage: Usd.Stage) -> None:
    """Until unshadow_removal(). Holds neither of them."""
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
    """Gives the delegate a spec of a prim that has none there yet."""
    target = stage.GetEditTarget().GetLayer()
    prim = stage.GetPrimAtPath(path) if path.IsAbsoluteRootOrPrimPath() else None
    if (not prim or prim.IsPseudoRoot() or prim.IsInstanceProxy() or prim.IsInPrototype()
            or not layers.get_auto_authoring().is_auto_authoring_layer(target.identifier)
            or target.GetPrimAtPath(prim.GetPath())):
        return
    # An `over` that says nothing would be nobody's removal.
    Sdf.CreatePrimInLayer(target, prim.GetPath()).specifier = Sdf.SpecifierDef
