"""Answers about one prim: its properties, their opinions, variants and metadata. On the thread of the stage."""

from __future__ import annotations

import typing

import usdlive
from pxr import Sdf, Usd

from . import tree, values

MOST_PROPERTIES = 2000
MOST_OPINIONS = 64
_Name = typing.Callable[[Sdf.Layer], str]
# Metadata that the answer has elsewhere.
_ELSEWHERE = {"specifier", "typeName", "documentation", "variantSetNames", "variantSelection", "primOrder", "propertyOrder"}


def properties(stage: Usd.Stage, name: _Name, path: str, time: Usd.TimeCode) -> dict:
    prim = tree.prim_at(stage, path)
    sets = prim.GetVariantSets()
    return {"path": str(prim.GetPath()), "type": str(prim.GetTypeName()),
            "documentation": prim.GetDocumentation()[:values.MOST_TEXT], "metadata": _metadata(prim),
            "schemas": [str(one) for one in prim.GetAppliedSchemas()], "editable": not prim.IsInstanceProxy(),
            "variants": [{"set": one, "selection": sets.GetVariantSelection(one), "choices": list(sets.GetVariantSet(one).GetVariantNames())}
                         for one in sets.GetNames()],
            "arcs": _arcs(prim, name),
            "properties": [_property(prim.GetProperty(one), name, time) for one in prim.GetPropertyNames()[:MOST_PROPERTIES]]}


def _metadata(prim: Usd.Prim) -> dict:
    found: dict[str, object] = {}
    for key, value in prim.GetAllAuthoredMetadata().items():
        if key not in _ELSEWHERE:
            found[key] = values.to_text(value)
    return found


def _arcs(prim: Usd.Prim, name: _Name) -> list[dict]:
    """The layers and prims that this prim is composed of, the strongest first."""
    found = []
    for spec in prim.GetPrimStack()[:MOST_OPINIONS]:
        found.append({"layer": name(spec.layer), "path": str(spec.path), "specifier": str(spec.specifier).rsplit(".", 1)[-1]})
    return found


def _property(found: Usd.Property, name: _Name, time: Usd.TimeCode) -> dict:
    entry: dict[str, typing.Any] = {"name": found.GetName(), "documentation": found.GetDocumentation()[:values.MOST_TEXT],
                                    "authored": found.IsAuthored(), "custom": found.IsCustom(), "targets": [], "connections": [],
                                    "allowed": [], "animated": False, "samples": 0, "opinions": _opinions(found, name, time)}
    if isinstance(found, Usd.Relationship):
        targets = [str(one) for one in found.GetTargets()[:values.MOST_ITEMS]]
        return entry | {"type": "rel", "relationship": True, "value": None, "valueText": ", ".join(targets)[:values.MOST_TEXT], "targets": targets}
    value = found.Get(time)
    return entry | {"type": str(found.GetTypeName()), "relationship": False, "value": values.to_json(value),
                    "valueText": values.to_text(value), "animated": found.ValueMightBeTimeVarying(),
                    "samples": found.GetNumTimeSamples(), "connections": [str(one) for one in found.GetConnections()[:values.MOST_ITEMS]],
                    "allowed": [str(one) for one in found.GetMetadata("allowedTokens") or ()]}


def _opinions(found: Usd.Property, name: _Name, time: Usd.TimeCode) -> list[dict]:
    if not found.IsAuthored():
        return []
    return [{"layer": name(spec.layer), "path": str(spec.path), "valueText": _value_of(spec)}
            for spec in found.GetPropertyStack(time)[:MOST_OPINIONS]]


def _value_of(spec: Sdf.PropertySpec) -> str:
    if isinstance(spec, Sdf.RelationshipSpec):
        return ", ".join(str(one) for one in spec.targetPathList.GetAppliedItems())[:values.MOST_TEXT]
    samples = spec.layer.GetNumTimeSamplesForPath(spec.path)
    if samples:
        return f"{samples} samples"
    return values.to_text(spec.default) if spec.HasDefaultValue() else ""


def specs_of(stage: Usd.Stage, name: _Name, path: str, property: str) -> list[tuple[str, str, str]]:
    """The opinions of a property, the strongest first: layer, path, value. Of the prim itself if there is no property."""
    prim = tree.prim_at(stage, path)
    if not property:
        return [(name(one.layer), str(one.path), "") for one in prim.GetPrimStack()[:MOST_OPINIONS]]
    found = prim.GetProperty(property)
    if not found:
        raise usdlive.Error("NotFound", f"{path} has no property {property}")
    return [(name(one.layer), str(one.path), _value_of(one)) for one in found.GetPropertyStack(Usd.TimeCode.Default())[:MOST_OPINIONS]]
