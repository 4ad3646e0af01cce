"""Adds a new layer on top of a shot, for all users: new_layer.py URL ROOT NEW [USER]

    ./run python client/examples/new_layer.py ws://127.0.0.1:7447 shot.usda effects/fx.usda
"""

import sys

import usdlive
from pxr import Usd


def main(url: str, root: str, new: str, user: str = "") -> None:
    with usdlive.connect(url, user=user) as live:
        stage = live.open_stage(root)
        try:
            layer = live.create_layer(new)  # creates a file in the project and opens it live
        except usdlive.Error as error:
            if error.code != "layerExists":
                raise
            layer = live.open_layer(new)
        paths = stage.GetRootLayer().subLayerPaths
        if new not in paths:
            paths.insert(0, new)  # relative to the folder of the root layer
        with Usd.EditContext(stage, layer):
            stage.DefinePrim("/Effects", "Scope")
        live.flush()
        print("layers:", *live.layers())


if __name__ == "__main__":
    main(*sys.argv[1:])
