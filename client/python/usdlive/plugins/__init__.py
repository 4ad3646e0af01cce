"""The OpenUSD plug-ins of usdlive: schemas and file formats.

`import usdlive` registers them, so that pxr.Usd of this process knows them. OpenUSD reads all schemas when a process
opens its first stage, and all file formats when it opens its first layer: import usdlive before. Another program
finds them with the environment variable PXR_PLUGINPATH_NAME:

    PXR_PLUGINPATH_NAME=$(python -m usdlive.plugins) usdview shot.usda
"""

from __future__ import annotations

import json
import pathlib
import warnings

from pxr import Plug, Tf


def folder() -> pathlib.Path:
    """The folder for PXR_PLUGINPATH_NAME."""
    return pathlib.Path(__file__).parents[1] / "_plugins"


def register() -> list[str]:
    """Makes the plug-ins known to this process, and returns the names of those that were not known before. A name
    that is known already, for example from PXR_PLUGINPATH_NAME, stays what it is."""
    known = {plugin.name for plugin in _registered()}
    added = []
    for path in sorted(folder().glob("*/plugInfo.json")):
        name = json.loads(path.read_text(encoding="utf-8"))["Plugins"][0]["Name"]
        if name not in known:
            Plug.Registry().RegisterPlugins(str(path))
            added.append(name)
    return added


def _registered() -> list:
    try:
        return Plug.Registry().GetAllPlugins()
    except Tf.ErrorException as error:
        # A plugInfo.json of somebody else is malformed. The first call reports it; the others are usable.
        warnings.warn(f"a plug-in of OpenUSD is not used: {error}", stacklevel=3)
        return Plug.Registry().GetAllPlugins()
