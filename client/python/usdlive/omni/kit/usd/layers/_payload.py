"""The payload of a layers event."""

from __future__ import annotations

import typing

from usdlive.omni._events import IEvent

from ._types import LayerEventType

_BY_LAYER = {LayerEventType.INFO_CHANGED, LayerEventType.PRIM_SPECS_CHANGED}


class LayerEventPayload:
    """`event_type` is None for an event of another kind."""

    def __init__(self, event: IEvent):
        payload = event.payload
        self.event_type: LayerEventType | None = None
        if event.type in LayerEventType._value2member_map_:
            self.event_type = LayerEventType(event.type)
        self._layer: str = payload.get("layer_identifier", "")
        val = payload.get("val", [])
        values: list[str] = [val] if isinstance(val, str) else list(val)
        self.layer_info_data: dict[str, list[str]] = {}
        self.layer_spec_paths: dict[str, list[str]] = {}
        self.identifiers_or_spec_paths: list[str] = []
        if self.event_type == LayerEventType.INFO_CHANGED:
            self.layer_info_data[self._layer] = values
        elif self.event_type == LayerEventType.PRIM_SPECS_CHANGED:
            self.layer_spec_paths[self._layer] = values
        elif self.event_type == LayerEventType.SPECS_LINKING_CHANGED:
            self.layer_spec_paths = {entry["key"]: list(entry["value"]) for entry in val}
        else:
            self.identifiers_or_spec_paths = values
        if self._layer and not self.identifiers_or_spec_paths:
            self.identifiers_or_spec_paths = [self._layer]
        self.user_name: str = payload.get("user_name", "")
        self.user_id: str = payload.get("user_id", "")
        self.success: bool = payload.get("success", True)

    @property
    def layer_identifier(self) -> str:
        """Returns the first identifier."""
        return self.identifiers_or_spec_paths[0] if self.identifiers_or_spec_paths else ""

    def is_layer_influenced(self, layer: typing.Any) -> bool:
        """Returns True if the event concerns the layer (an identifier or an Sdf.Layer)."""
        identifier = layer if isinstance(layer, str) else layer.identifier
        return (identifier in self.identifiers_or_spec_paths or identifier in self.layer_info_data
                or identifier in self.layer_spec_paths)


def get_layer_event_payload(event: IEvent) -> LayerEventPayload:
    return LayerEventPayload(event)
