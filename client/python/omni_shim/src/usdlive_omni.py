"""`import omni` without Kit: provides usdlive's modules under Kit's names.

`omni.x` is the module `usdlive.omni.x` itself, and `carb.events` has the event type. If the real `carb` exists,
this is Kit, and the modules are left to it with a warning. Nothing of usdlive is loaded before somebody imports
`omni`.
"""

from __future__ import annotations

import functools
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import sys
import types
import typing
import warnings

# The modules that exist after `import omni` alone, as in Kit.
_READY = ["usd", "kit.app", "kit.commands", "kit.undo", "kit.usd.layers"]


class _Alias(importlib.abc.Loader):
    """Returns an existing module for another name."""

    def __init__(self, module: types.ModuleType):
        self._module = module
        self._spec = module.__spec__

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> types.ModuleType:
        return self._module

    def exec_module(self, module: types.ModuleType) -> None:
        module.__spec__ = self._spec  # the import system has just replaced it


class _Finder(importlib.abc.MetaPathFinder):
    """The first finder, because our packages would otherwise be loaded again under the other name. Ignores
    modules that exist."""

    _kit_is_here: bool | None = None

    def find_spec(self, name: str, path: typing.Any = None,
                  target: typing.Any = None) -> importlib.machinery.ModuleSpec | None:
        top, _, _ = name.partition(".")
        if top not in ("omni", "carb") or self._leaves_to_kit():
            return None
        parent = sys.modules.get(name.rpartition(".")[0])
        ours = parent is not None and parent.__name__.startswith(("usdlive.", "carb"))
        if not ours and importlib.machinery.PathFinder.find_spec(name, path):
            return None  # part of `omni` from another distribution
        module = _carb(name) if top == "carb" else _omni(name)
        return importlib.util.spec_from_loader(name, _Alias(module)) if module else None

    def _leaves_to_kit(self) -> bool:
        if self._kit_is_here is None:
            real = importlib.machinery.PathFinder.find_spec("carb")
            self._kit_is_here = real is not None or "carb" in sys.modules
            if self._kit_is_here:
                where = real.origin if real else getattr(sys.modules["carb"], "__file__", "it is loaded")
                warnings.warn(f"Kit is in this Python ({where}): usdlive-omni leaves `omni` and `carb` to it. "
                              "usdlive's own are in `usdlive.omni`.", stacklevel=2)
        return self._kit_is_here


def _omni(name: str) -> types.ModuleType | None:
    """Returns None for modules that usdlive does not have. Errors inside a module are raised."""
    ours = "usdlive." + name
    try:
        module = importlib.import_module(ours)
    except ModuleNotFoundError as error:
        if error.name and (ours == error.name or ours.startswith(error.name + ".")):
            return None
        raise
    if name == "omni":
        for ready in _READY:
            _omni("omni." + ready)
    return module


@functools.cache
def _carb(name: str) -> types.ModuleType | None:
    module = types.ModuleType(name, "The part of carb that scripts for Kit's layers and contexts use.")
    module.__spec__ = importlib.machinery.ModuleSpec(name, None)
    if name == "carb":
        module.__path__ = []
        module.events = _carb("carb.events")
    elif name == "carb.events":
        module.IEvent = importlib.import_module("usdlive.omni._events").IEvent
    else:
        return None
    return module


def install() -> None:
    """Called by usdlive_omni.pth when Python starts."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())
