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

# Kit's API finds contexts by name, so there is a registry here. The default context is created on
# first use.
_contexts: dict[str, UsdContext] = {}


def get_context(name: str = "") -> UsdContext | None:
    """Returns the default context, or one that was created with create_context()."""
    if name == "" and name not in _contexts:
        _contexts[name] = UsdContext(name)
    return _contexts.get(name)


def create_context(name: str = "", **settings: typing.Any) -> UsdContext:
    """Returns the context of that name. A new one takes the fields of ContextSettings as keywords."""
    if name not in _contexts:
        _contexts[name] = UsdContext(name, **settings)
    return _contexts[name]


def destroy_context(name: str = "") -> bool:
    """Closes the context's stage and removes the context. Returns False if there is no such context, if an
    operation is running, or if the stage cannot be closed because its server has not confirmed one's own edits
    (see close_stage)."""
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
    """Returns the context whose project contains the live layer."""
    return next((context for context in _contexts.values() if context.is_live_layer(layer)), None)
