"""Installs the modules of usdlive-omni from the source tree (`./run python`) instead of with pip."""

import importlib
import os
import sys


def become(name: str) -> None:
    """Replaces the importing module `name` of this folder by the module that usdlive-omni provides."""
    here = os.path.dirname(os.path.abspath(__file__))
    source = os.path.join(os.path.dirname(here), "src")
    sys.path[:] = [source if os.path.abspath(entry) == here else entry for entry in sys.path]
    importlib.import_module("usdlive_omni").install()
    del sys.modules[name]
    importlib.import_module(name)
