"""Subscriptions to the parts of layers that a window shows: custom data, sublayers, the prims of one layer."""

from __future__ import annotations

import typing

from pxr import Sdf

from usdlive.omni._events import EventStream, IEvent, Subscription

from ._payload import LayerEventPayload
from ._types import LayerEventType


def _value(layer: Sdf.Layer | None, key: str) -> typing.Any:
    value: typing.Any = layer.customLayerData if layer else None
    for part in key.split(":"):
        value = value.get(part) if isinstance(value, dict) else None
    return value


def custom_data(stream: EventStream, layer_identifier: str, keys: typing.Iterable[str],
                function: typing.Callable[[dict[str, typing.Any]], None]) -> Subscription:
    layer = Sdf.Layer.Find(layer_identifier) if layer_identifier else None
    known = {key: _value(layer, key) for key in keys}

    def received(event: IEvent) -> None:
        payload = LayerEventPayload(event)
        if payload.event_type != LayerEventType.INFO_CHANGED:
            return
        if "customLayerData" not in payload.layer_info_data.get(layer_identifier, ()):
            return
        now = {key: _value(Sdf.Layer.Find(layer_identifier), key) for key in known}
        changed = {key: value for key, value in now.items() if value != known[key]}
        known.update(changed)
        if changed:
            function(changed)

    return stream.create_subscription_to_pop(received, name="custom data")


def sublayers(stream: EventStream, function: typing.Callable[[], None]) -> Subscription:
    return stream.create_subscription_to_pop_by_type(
        LayerEventType.SUBLAYERS_CHANGED, lambda _: function(), name="sublayers")


def prim_specs(stream: EventStream, layer_identifier: str,
               function: typing.Callable[[list[str]], None]) -> Subscription:
    def received(event: IEvent) -> None:
        paths = LayerEventPayload(event).layer_spec_paths.get(layer_identifier)
        if paths:
            function(paths)

    return stream.create_subscription_to_pop_by_type(
        LayerEventType.PRIM_SPECS_CHANGED, received, name="prim specs")
