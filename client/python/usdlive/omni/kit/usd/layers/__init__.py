"""Kit's `omni.kit.usd.layers`: states of layers, auto authoring, links and locks of specs.

    import usdlive.omni.kit.usd.layers as layers
    state = layers.get_layers().get_layers_state()

A context argument may be a name or a UsdContext: any object with `get_stage()` and `get_name()`. If its
attribute `live` is a `usdlive.Live`, the states of live layers come from there.
"""

from __future__ import annotations

import re
import typing
import urllib.parse
import weakref

from pxr import Usd

from usdlive.omni._events import EventStream, Subscription

from . import _subscriptions
from ._layers import (AutoAuthoring, Layers, LayersState, RefusedEdit, SpecsLinking, SpecsLocking,
                      authoring_context)
from ._live_syncing import LiveSession, LiveSyncing
from ._payload import LayerEventPayload, get_layer_event_payload
from ._types import LayerEditMode, LayerErrorType, LayerEventType, layer_event_name, layer_event_type
from ._utils import LayerUtils

__all__ = [
    "AutoAuthoring", "LayerEditMode", "LayerErrorType", "LayerEventPayload", "LayerEventType", "LayerUtils",
    "Layers", "LayersState", "LiveSession", "LiveSyncing", "RefusedEdit", "SpecsLinking", "SpecsLocking",
    "active_authoring_layer_context",
    "get_all_locked_specs", "get_all_spec_links", "get_auto_authoring", "get_event_stream",
    "get_last_error_string", "get_last_error_type", "get_layer_event_payload", "get_layers",
    "get_layers_state", "get_live_session_name_from_shared_link", "get_live_syncing", "get_short_user_name",
    "get_spec_layer_links", "get_spec_links_for_layers", "get_specs_linking", "get_specs_locking",
    "is_spec_linked", "is_spec_locked", "layer_event_name", "layer_event_type", "link_specs", "lock_specs",
    "subscribe_to_custom_data", "subscribe_to_prim_specs", "subscribe_to_sublayers", "unlink_all_specs",
    "unlink_specs", "unlink_specs_from_all_layers", "unlink_specs_to_layers", "unlock_all_specs",
    "unlock_specs",
]

_Texts = typing.Union[str, typing.Sequence[str]]

# Keyed by context, as in Kit.
_layers: "weakref.WeakKeyDictionary[typing.Any, Layers]" = weakref.WeakKeyDictionary()


def get_layers(context_name_or_instance: typing.Any = "") -> Layers | None:
    """Returns the layers of a context, or None if it does not exist."""
    context = context_name_or_instance
    if isinstance(context, str):
        from usdlive.omni.usd import get_context
        context = get_context(context)
    if context is None:
        return None
    if context not in _layers:
        _layers[context] = Layers(context)
    return _layers[context]


def get_layers_state(context_name_or_instance: typing.Any = "") -> LayersState | None:
    layers = get_layers(context_name_or_instance)
    return layers.get_layers_state() if layers else None


def get_auto_authoring(context_name_or_instance: typing.Any = "") -> AutoAuthoring | None:
    layers = get_layers(context_name_or_instance)
    return layers.get_auto_authoring() if layers else None


def get_specs_linking(context_name_or_instance: typing.Any = "") -> SpecsLinking | None:
    layers = get_layers(context_name_or_instance)
    return layers.get_specs_linking() if layers else None


def get_specs_locking(context_name_or_instance: typing.Any = "") -> SpecsLocking | None:
    layers = get_layers(context_name_or_instance)
    return layers.get_specs_locking() if layers else None


def get_live_syncing(context_name_or_instance: typing.Any = "") -> LiveSyncing | None:
    layers = get_layers(context_name_or_instance)
    return layers.get_live_syncing() if layers else None


def get_event_stream(context_name_or_instance: typing.Any = "") -> EventStream | None:
    layers = get_layers(context_name_or_instance)
    return layers.get_event_stream() if layers else None


def get_last_error_type(context_name_or_instance: typing.Any = "") -> LayerErrorType:
    layers = get_layers(context_name_or_instance)
    return layers.get_last_error_type() if layers else LayerErrorType.INVALID_STAGE


def get_last_error_string(context_name_or_instance: typing.Any = "") -> str:
    layers = get_layers(context_name_or_instance)
    return layers.get_last_error_string() if layers else "there is no such context"


def active_authoring_layer_context(usd_context: typing.Any) -> Usd.EditContext:
    """Edits the edit target, or in auto authoring the default layer: `with ...: ...`."""
    return authoring_context(get_layers(usd_context))


# -- several specs at once; dictionaries are {spec path: [layers]}


def _texts(texts: _Texts) -> list[str]:
    if isinstance(texts, (list, tuple, set)):
        return [str(text) for text in texts]
    return [str(texts)]


def _changed(paths: typing.Iterable[str], layer: str, into: dict[str, list[str]]) -> None:
    for path in paths:
        into.setdefault(path, []).append(layer)


def link_specs(usd_context: typing.Any, spec_paths: _Texts, layer_identifiers: _Texts,
               hierarchy: bool = False) -> dict[str, list[str]]:
    """Returns the links that were added."""
    linking, linked = get_specs_linking(usd_context), {}
    for layer in _texts(layer_identifiers):
        for path in _texts(spec_paths):
            _changed(linking.link_spec(path, layer, hierarchy), layer, linked)
    return linked


def unlink_specs(usd_context: typing.Any, spec_paths: _Texts, layer_identifiers: _Texts,
                 hierarchy: bool = False) -> dict[str, list[str]]:
    linking, unlinked = get_specs_linking(usd_context), {}
    for layer in _texts(layer_identifiers):
        for path in _texts(spec_paths):
            _changed(linking.unlink_spec(path, layer, hierarchy), layer, unlinked)
    return unlinked


def unlink_specs_to_layers(usd_context: typing.Any, layer_identifiers: _Texts) -> dict[str, list[str]]:
    linking, unlinked = get_specs_linking(usd_context), {}
    for layer in _texts(layer_identifiers):
        _changed(linking.unlink_specs_to_layer(layer), layer, unlinked)
    return unlinked


def unlink_specs_from_all_layers(usd_context: typing.Any, spec_paths: _Texts,
                                 hierarchy: bool = False) -> dict[str, list[str]]:
    linking, unlinked = get_specs_linking(usd_context), {}
    for path in _texts(spec_paths):
        links = linking.get_spec_layer_links(path, hierarchy)
        for spec in linking.unlink_spec_from_all_layers(path, hierarchy):
            unlinked[spec] = links.get(spec, [])
    return unlinked


def unlink_all_specs(usd_context: typing.Any) -> None:
    get_specs_linking(usd_context).unlink_all_specs()


def get_spec_layer_links(usd_context: typing.Any, spec_paths: _Texts,
                         hierarchy: bool = False) -> dict[str, list[str]]:
    links: dict[str, list[str]] = {}
    for path in _texts(spec_paths):
        links.update(get_specs_linking(usd_context).get_spec_layer_links(path, hierarchy))
    return links


def get_spec_links_for_layers(usd_context: typing.Any, layer_identifiers: _Texts) -> dict[str, list[str]]:
    """Returns {layer: [spec paths]}."""
    linking = get_specs_linking(usd_context)
    return {layer: linking.get_spec_links_for_layer(layer) for layer in _texts(layer_identifiers)}


def get_all_spec_links(usd_context: typing.Any) -> dict[str, list[str]]:
    return get_specs_linking(usd_context).get_all_spec_links()


def is_spec_linked(usd_context: typing.Any, spec_path: str, layer_identifier: str = "") -> bool:
    return get_specs_linking(usd_context).is_spec_linked(spec_path, layer_identifier)


def lock_specs(usd_context: typing.Any, spec_paths: _Texts, hierarchy: bool = False) -> list[str]:
    locking = get_specs_locking(usd_context)
    return [spec for path in _texts(spec_paths) for spec in locking.lock_spec(path, hierarchy)]


def unlock_specs(usd_context: typing.Any, spec_paths: _Texts, hierarchy: bool = False) -> list[str]:
    locking = get_specs_locking(usd_context)
    return [spec for path in _texts(spec_paths) for spec in locking.unlock_spec(path, hierarchy)]


def unlock_all_specs(usd_context: typing.Any) -> None:
    get_specs_locking(usd_context).unlock_all_specs()


def get_all_locked_specs(usd_context: typing.Any) -> list[str]:
    return get_specs_locking(usd_context).get_all_locked_specs()


def is_spec_locked(usd_context: typing.Any, spec_path: str) -> bool:
    return get_specs_locking(usd_context).is_spec_locked(spec_path)


# -- subscriptions; each ends when it is deleted


def subscribe_to_custom_data(layer_identifier: str, keys: typing.Iterable[str],
                             function: typing.Callable[[dict[str, typing.Any]], None],
                             context_name_or_instance: typing.Any = "") -> Subscription:
    """Calls `function({key: value})` when some of these keys of the layer's customLayerData change. Keys within
    dictionaries are joined by ':'. The value of a removed key is None."""
    return _subscriptions.custom_data(get_event_stream(context_name_or_instance), layer_identifier, keys,
                                      function)


def subscribe_to_sublayers(function: typing.Callable[[], None],
                           context_name_or_instance: typing.Any = "") -> Subscription:
    return _subscriptions.sublayers(get_event_stream(context_name_or_instance), function)


def subscribe_to_prim_specs(layer_identifier: str, function: typing.Callable[[list[str]], None],
                            context_name_or_instance: typing.Any = "") -> Subscription:
    """Calls `function(spec paths)` when specs of the layer change."""
    return _subscriptions.prim_specs(get_event_stream(context_name_or_instance), layer_identifier, function)


# -- texts


def get_short_user_name(user_name: str) -> str:
    """Returns initials: AL for "ada.lovelace@example.com" and "Ada Lovelace", A for "ada"."""
    words = [word for word in re.split(r"[\s._-]+", user_name.split("@")[0]) if word]
    return "".join(word[0] for word in words[:2]).upper()


def get_live_session_name_from_shared_link(shared_link: str) -> str | None:
    """Returns the last part of `?live_session_name=...`, which may be a whole URL, or None."""
    query = urllib.parse.parse_qs(urllib.parse.urlsplit(shared_link).query)
    names = query.get("live_session_name")
    return names[0].rstrip("/").rsplit("/", 1)[-1].removesuffix(".live") if names else None
