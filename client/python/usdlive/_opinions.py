"""Writes single opinions into live layers. On the thread of the layers."""

from __future__ import annotations

import dataclasses
import typing

from pxr import Sdf, Tf, Usd

from ._errors import Error
from ._live import Live


@dataclasses.dataclass
class Write:
    """One opinion: the value of an attribute, the selection in a variant set, whether a prim is active, the material that is
    bound, or that there is a prim of a type. `value` None removes it."""

    kind: str  # "attribute", "variant", "active", "binding", "prim"
    path: Sdf.Path
    name: str = ""
    value: typing.Any = None
    type: Sdf.ValueTypeName | None = None
    is_uniform: bool = False
    is_custom: bool = False
    time: float | None = None
    opinion: str = "property"  # the kind of opinion for access rules


def layer_for(live: Live, prim: Usd.Prim, name: str = "", wanted: str | None = None) -> str:
    """The layer that an edit goes to, if no other one is wanted: where the strongest opinion is, else where the prim is, else the
    root layer."""
    if prim.IsInstanceProxy() or prim.IsInPrototype():
        raise Error("invalidArgument", f"{prim.GetPath()} is a part of an instance: edit what is instanced")
    stack = prim.GetStage().GetLayerStack(False)
    root = live.layer_name(stack[0])
    if wanted is not None:
        if all(live.layer_name(layer) != wanted for layer in stack):
            raise Error("layerNotFound", f"{wanted} is no layer of the stage {root}")
        return wanted
    local = {layer.identifier for layer in stack}
    found = prim.GetProperty(name) if name else None
    specs = (found.GetPropertyStack(Usd.TimeCode.Default()) if found else []) + list(prim.GetPrimStack())
    for spec in specs:
        if spec.layer.identifier in local and spec.path.GetPrimPath() == prim.GetPath() and live.layer_name(spec.layer):
            return live.layer_name(spec.layer)
    return root


def check(live: Live, layer: str, writes: typing.Iterable[Write]) -> None:
    """Raises an Error if the user may not write one of these."""
    for one in writes:
        kind = "animation" if one.time is not None else one.opinion
        path = one.path.AppendProperty(one.name) if one.kind == "attribute" else one.path
        permission = live.may_edit(layer, str(path), kind)
        if not permission:
            raise Error("forbidden", f"you may not edit {one.path} in {layer}: {permission.why}")


def write(opened: Sdf.Layer, layer: str, writes: typing.Iterable[Write]) -> None:
    """Writes all of them in one change block. `layer`: the project's name of the layer."""
    try:
        with Sdf.ChangeBlock():
            for one in writes:
                _write(opened, one)
    except Tf.ErrorException as failed:
        raise Error("forbidden", f"{layer} cannot be edited: {failed}") from None


def _write(layer: Sdf.Layer, one: Write) -> None:
    if one.kind == "attribute" and one.value is None:
        _clear(layer, one)
        return
    prim = Sdf.CreatePrimInLayer(layer, one.path)
    if one.kind == "variant":
        if one.value is None:
            prim.variantSelections.pop(one.name, None)
        else:
            prim.variantSelections[one.name] = one.value
    elif one.kind == "active":
        prim.active = one.value
    elif one.kind == "binding":
        _bind(layer, prim, one)
    elif one.kind == "prim":
        prim.specifier, prim.typeName = Sdf.SpecifierDef, one.value
    else:
        path = one.path.AppendProperty(one.name)
        spec = layer.GetAttributeAtPath(path)
        if not spec:
            spec = Sdf.AttributeSpec(prim, one.name, one.type, Sdf.VariabilityUniform if one.is_uniform else Sdf.VariabilityVarying,
                                     one.is_custom)
        if one.time is None:
            spec.default = one.value
        else:
            layer.SetTimeSample(path, one.time, one.value)


def _clear(layer: Sdf.Layer, one: Write) -> None:
    path = one.path.AppendProperty(one.name)
    spec = layer.GetAttributeAtPath(path)
    if not spec:
        return
    if one.time is None:
        spec.ClearDefaultValue()
    else:
        layer.EraseTimeSample(path, one.time)


def _bind(layer: Sdf.Layer, prim: Sdf.PrimSpec, one: Write) -> None:
    spec = layer.GetRelationshipAtPath(one.path.AppendProperty(one.name))
    if one.value is None:
        if spec:
            spec.targetPathList.ClearEdits()
        return
    applied = prim.GetInfo("apiSchemas")
    if "MaterialBindingAPI" not in applied.GetAppliedItems():
        applied = Sdf.TokenListOp() if not applied else applied
        if applied.isExplicit:
            applied.explicitItems = [*applied.explicitItems, "MaterialBindingAPI"]
        else:
            applied.prependedItems = [*applied.prependedItems, "MaterialBindingAPI"]
        prim.SetInfo("apiSchemas", applied)
    spec = spec or Sdf.RelationshipSpec(prim, one.name, False)
    spec.targetPathList.ClearEditsAndMakeExplicit()
    spec.targetPathList.explicitItems = [one.value]
