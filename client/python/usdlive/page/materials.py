"""Reads materials as the parameters of UsdPreviewSurface. On the thread of the stage."""

from __future__ import annotations

import hashlib
import math
import typing

from pxr import Sdf, Usd, UsdShade

_SLOTS = {"diffuseColor": "color", "normal": "normal", "metallic": "metallic", "roughness": "roughness",
          "emissiveColor": "emissive", "opacity": "opacity", "occlusion": "occlusion"}
_WRAP = {"repeat": "repeat", "clamp": "clamp", "mirror": "mirror", "black": "black"}
# The names that other common shaders have for the same parameters.
_OTHER_NAMES = {"diffuseColor": ("diffuse_color_constant", "base_color", "diffuse_reflection_color"),
                "roughness": ("reflection_roughness_constant", "specular_roughness"),
                "metallic": ("metallic_constant", "metalness"), "emissiveColor": ("emissive_color", "emission_color"),
                "opacity": ("opacity_constant",)}


def name_of(path: str) -> str:
    """The name of a material for pages: it stays when the material changes."""
    return hashlib.sha256(f"material {path}".encode()).hexdigest()


def _numbers(value: typing.Any, default: list[float]) -> list[float]:
    try:
        found = [float(one) for one in value]
    except TypeError:
        return default
    return found if len(found) == len(default) and all(map(math.isfinite, found)) else default


def _number(value: typing.Any, default: float) -> float:
    return float(value) if isinstance(value, (int, float)) and math.isfinite(value) else default


class Read(typing.NamedTuple):
    """A material: its message without the hashes of its textures, and the files of these by slot."""

    message: dict
    files: dict[str, Sdf.AssetPath]


def read(material: UsdShade.Material, time: Usd.TimeCode) -> Read:
    """Never fails: what cannot be read is a problem of the material."""
    message = _unread(str(material.GetPath()))
    files: dict[str, Sdf.AssetPath] = {}
    try:
        _read_into(message, files, material, time)
    except Exception as wrong:  # values may have other types than their shader has
        message["problem"] = f"the material cannot be read: {wrong}"
    return Read(message, files)


def _unread(path: str) -> dict:
    return {"name": path, "color": [0.18, 0.18, 0.18], "opacity": 1.0, "metallic": 0.0, "roughness": 0.5,
                     "emissive": [0.0, 0.0, 0.0], "ior": 1.5, "opacityThreshold": 0.0, "textures": {}, "animated": False}


def _read_into(message: dict, files: dict[str, Sdf.AssetPath], material: UsdShade.Material, time: Usd.TimeCode) -> None:
    source = material.ComputeSurfaceSource()[0]
    if not source:
        source = next((one for context in ("mdl", "mtlx", "ri") if (one := material.ComputeSurfaceSource(context)[0])), source)
    if not source:
        message["problem"] = "the material has no surface shader"
        return
    identifier = source.GetIdAttr().Get()
    if identifier != "UsdPreviewSurface":
        message["problem"] = f"the shader {identifier or source.GetPath()} is shown by its colour only"
    for name, key in (("diffuseColor", "color"), ("emissiveColor", "emissive")):
        message[key] = _numbers(_constant(source, name, time), message[key])
    for name in ("opacity", "metallic", "roughness", "ior", "opacityThreshold"):
        message[name] = _number(_constant(source, name, time), message[name])
    message["animated"] = any(attribute.ValueMightBeTimeVarying() for one in source.GetInputs()
                              for attribute in one.GetValueProducingAttributes())
    for name, slot in _SLOTS.items():
        texture = _texture(source, name, time)
        if texture:
            message["textures"][slot], files[slot] = texture


def _constant(shader: UsdShade.Shader, name: str, time: Usd.TimeCode) -> typing.Any:
    for one in (name, *_OTHER_NAMES.get(name, ())):
        found = shader.GetInput(one)
        if found:
            for attribute in found.GetValueProducingAttributes():
                if UsdShade.Utils.GetType(attribute.GetName()) == UsdShade.AttributeType.Input:
                    value = attribute.Get(time)
                    if value is not None:
                        return value
    return None


def _texture(shader: UsdShade.Shader, name: str, time: Usd.TimeCode) -> tuple[dict, Sdf.AssetPath] | None:
    found = shader.GetInput(name)
    if not found or not found.HasConnectedSource():
        return None
    for attribute in found.GetValueProducingAttributes():
        if UsdShade.Utils.GetType(attribute.GetName()) != UsdShade.AttributeType.Output:
            continue
        reader = UsdShade.Shader(attribute.GetPrim())
        if not reader or reader.GetIdAttr().Get() != "UsdUVTexture":
            continue
        asset = _constant(reader, "file", time)
        if not asset:
            continue
        channel = UsdShade.Utils.GetBaseNameAndType(attribute.GetName())[0]
        texture = {"hash": "", "wrapS": _wrap(reader, "wrapS", time), "wrapT": _wrap(reader, "wrapT", time), "channel": str(channel),
                   "scale": _numbers(_constant(reader, "scale", time), [1.0] * 4), "bias": _numbers(_constant(reader, "bias", time), [0.0] * 4),
                   "translate": [0.0, 0.0], "rotate": 0.0, "uvScale": [1.0, 1.0],
                   "srgb": _is_srgb(reader, name, time)}
        _read_transform(reader, texture, time)
        return texture, asset
    return None


def _wrap(reader: UsdShade.Shader, name: str, time: Usd.TimeCode) -> str:
    return _WRAP.get(str(_constant(reader, name, time)), "black" if _constant(reader, name, time) else "repeat")


def _is_srgb(reader: UsdShade.Shader, slot: str, time: Usd.TimeCode) -> bool:
    space = str(_constant(reader, "sourceColorSpace", time) or "auto")
    return space == "sRGB" or (space == "auto" and slot in ("diffuseColor", "emissiveColor"))


def _read_transform(reader: UsdShade.Shader, texture: dict, time: Usd.TimeCode) -> None:
    coordinates = reader.GetInput("st")
    if not coordinates:
        return
    for attribute in coordinates.GetValueProducingAttributes():
        node = UsdShade.Shader(attribute.GetPrim())
        if node and node.GetIdAttr().Get() == "UsdTransform2d":
            texture["translate"] = _numbers(_constant(node, "translation", time), [0.0, 0.0])
            texture["uvScale"] = _numbers(_constant(node, "scale", time), [1.0, 1.0])
            texture["rotate"] = _number(_constant(node, "rotation", time), 0.0)
