"""Replaces functions of pxr that remove or clear opinions, for the edit modes with a delegate layer.

They look only into the layer of the edit target, and the delegate mirrors only what was edited since the mode
started. So the delegate gets the opinions first that such a function may remove, and what was removed is distributed
at once: what is read or defined next is as in the normal mode. Functions that edit a list find the layer's items in
the same way, so that a new item gets the same place as in the normal mode.
"""

from __future__ import annotations

import contextlib
import functools
import typing
import weakref

from pxr import Sdf, Usd, UsdGeom, UsdShade


class Delegating(typing.Protocol):
    """The part of Layers that is used here."""

    def clearing(self, specs: typing.Iterable[Sdf.Path | str],
                 time: float | None = None) -> contextlib.AbstractContextManager[None]: ...
    def distribute_now(self) -> None: ...


#: The layers of the stages in such a mode, by the identifier of the delegate.
_delegates: weakref.WeakValueDictionary[str, Delegating] = weakref.WeakValueDictionary()


def shadow_removal(stage: Usd.Stage, layers: Delegating) -> None:
    """Begins for the stage, whose edit target is the delegate. Does not keep the stage or `layers` alive. Keep the
    stage's Python object: RemovePrim is replaced in it."""
    _delegates[stage.GetEditTarget().GetLayer().identifier] = layers
    _shadow_classes()
    this = weakref.ref(stage)

    def remove_prim(path: Sdf.Path | str) -> bool:
        stage = this()
        delegating = _delegating(stage)
        with Sdf.ChangeBlock():
            if delegating:
                _mirror(stage.GetEditTarget().GetLayer(), stage, Sdf.Path(path))
            removed = Usd.Stage.RemovePrim(stage, path)
        if delegating:
            delegating.distribute_now()
        return removed

    stage.RemovePrim = remove_prim


def unshadow_removal(stage: Usd.Stage) -> None:
    vars(stage).pop("RemovePrim", None)


def _delegating(stage: Usd.Stage | None) -> Delegating | None:
    layer = stage.GetEditTarget().GetLayer() if stage and _delegates else None
    return _delegates.get(layer.identifier) if layer else None


def _mirror(delegate: Sdf.Layer, stage: Usd.Stage, path: Sdf.Path) -> None:
    """Gives the delegate a spec of the prim whose removal is an edit. That of an empty `over` is ignored."""
    prim = stage.GetPrimAtPath(path) if path.IsAbsoluteRootOrPrimPath() else None
    if not prim or prim.IsPseudoRoot() or prim.IsInstanceProxy() or prim.IsInPrototype():
        return
    Sdf.CreatePrimInLayer(delegate, prim.GetPath()).specifier = Sdf.SpecifierDef


@functools.cache
def _shadow_classes() -> None:
    """Replaces the functions once for the process. They cost little more where no delegate is the edit target."""
    for module in (Usd, UsdGeom, UsdShade):
        for kind in vars(module).values():
            if isinstance(kind, type) and (hasattr(kind, "GetPrim") or kind is Usd.AttributeLimits):
                for name in [name for name in vars(kind) if _looks_into_target(name)]:
                    _shadow(kind, name)


#: Edit lists with paths of prims and names. As everywhere, the next frame distributes them.
_LISTS = ("AddInherit", "RemoveInherit", "AddSpecialize", "RemoveSpecialize", "AddTarget", "RemoveTarget",
          "AddConnection", "RemoveConnection", "AddAppliedSchema", "RemoveAppliedSchema", "ApplyAPI", "AddAPI",
          "RemoveAPI")
#: Edit lists with relative paths of files, which have another meaning in the delegate.
_ARCS = ("AddReference", "AddInternalReference", "RemoveReference", "AddPayload", "AddInternalPayload", "RemovePayload")


def _looks_into_target(name: str) -> bool:
    return name.startswith("Clear") or name in ("RemoveProperty", "RemovePrimvar", "ResetCollection", *_ARCS, *_LISTS)


def _shadow(kind: type, name: str) -> None:
    shadowed = vars(kind)[name]
    is_static = isinstance(shadowed, staticmethod)
    original = shadowed.__func__ if is_static else shadowed

    @functools.wraps(original)
    def remove(*arguments: typing.Any, **named: typing.Any) -> typing.Any:
        part = arguments[0].GetAttribute() if kind is Usd.AttributeLimits else arguments[0]
        stage = part.GetPrim().GetStage() if part and hasattr(part, "GetPrim") and part.GetPrim() else None
        if not (delegating := _delegating(stage)):
            return original(*arguments, **named)
        argument = next(iter((*arguments[1:], *named.values())), None)
        time = Usd.TimeCode(argument) if name == "ClearAtTime" and argument is not None else Usd.TimeCode.Default()
        specs = map(stage.GetEditTarget().MapToSpecPath, _paths(part, name, argument))
        with Sdf.ChangeBlock():  # relative paths of arcs must not be composed in the delegate
            with delegating.clearing(filter(None, specs), None if time.IsDefault() else time.GetValue()):
                result = original(*arguments, **named)
            if name not in _LISTS:
                delegating.distribute_now()
        return result

    setattr(kind, name, staticmethod(remove) if is_static else remove)


def _paths(part: typing.Any, name: str, argument: typing.Any) -> list[Sdf.Path]:
    """Returns the paths of the prims and properties that the function may change."""
    if isinstance(part, Usd.Property):
        return [part.GetPath()]
    if name == "RemoveProperty":
        return [part.GetPath().AppendProperty(argument)] if argument else []
    if hasattr(part, "GetAttr"):  # UsdShade.Input and the like
        return [part.GetAttr().GetPath()]
    prim = part.GetPrim()
    schema = isinstance(part, Usd.SchemaBase)
    return [prim.GetPath(), *(one.GetPath() for one in prim.GetAuthoredProperties() if schema)]
