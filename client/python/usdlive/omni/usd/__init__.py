"""Kit's `omni.usd`: contexts, each with one stage.

    ctx = omni.usd.get_context()
    success, error = await ctx.open_stage_async("usdlive://127.0.0.1:7447/shot.usda")

An address opens live; so does a file in a folder given to attach_project().
"""

from __future__ import annotations

import typing

from pxr import Sdf, Usd

from usdlive.omni._layer_content import (merge_layers, merge_prim_spec, resolve_paths,
                                         resolve_prim_path_references, resolve_prim_paths_references)

from ._context import ContextSettings, UsdContext
from ._enums import StageEventType, StageState, UsdContextInitialLoadSet
from ._projects import attach_project, detach_project
from ._selection import Selection

__all__ = [
    "ContextSettings", "Selection", "StageEventType", "StageState", "UsdContext",
    "UsdContextInitialLoadSet", "attach_project", "create_context", "destroy_context", "detach_project",
    "get_context", "get_context_from_live_layer", "get_context_from_stage", "merge_layers",
    "merge_prim_spec", "resolve_paths", "resolve_prim_path_references", "resolve_prim_paths_references",
]

# Kit's API knows contexts by name, so there is a registry here. The default one is there from the start.
_contexts: dict[str, UsdContext] = {}


def get_context(name: str = "") -> UsdContext | None:
    """The default context, or one that create_context() made."""
    if name == "" and name not in _contexts:
        _contexts[name] = UsdContext(name)
    return _contexts.get(name)


def create_context(name: str = "", **settings: typing.Any) -> UsdContext:
    """The context of that name; a new one takes the fields of ContextSettings as keywords."""
    if name not in _contexts:
        _contexts[name] = UsdContext(name, **settings)
    return _contexts[name]


def destroy_context(name: str = "") -> bool:
    """Closes its stage. False when there is no such context, it is in the middle of an operation, or the stage
    cannot be closed because its server has not confirmed what was authored (see close_stage)."""
    context = _contexts.get(name)
    if context is None or not context._destroy():
        return False
    del _contexts[name]
    return True


def get_context_from_stage(stage: Usd.Stage) -> UsdContext | None:
    if not stage:
        return None
    return next((context for context in _contexts.values() if context.get_stage() == stage), None)


def get_context_from_live_layer(layer: Sdf.Layer) -> UsdContext | None:
    """The context whose project the layer is live in."""
    return next((context for context in _contexts.values() if context.is_live_layer(layer)), None)
