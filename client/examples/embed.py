"""An editor in 20 lines: embed.py ws://127.0.0.1:7447 shot.usda ada"""

import sys
import time

import usdlive
from pxr import UsdGeom

url, layer, user = sys.argv[1:]
with usdlive.connect(url, user=user, application="embed") as live:
    live.add_handler(lambda event: print(event) if isinstance(event, usdlive.events.Lost) else None)
    stage = live.open_stage(layer)  # an ordinary Usd.Stage
    ball = UsdGeom.Sphere.Define(stage, f"/{user}")
    with live.undo_group("Move the ball"):  # one step of undo
        for frame in range(120):
            UsdGeom.XformCommonAPI(ball).SetTranslate((frame, 0, 0))
            live.show_presence(selection=[ball.GetPath()])
            live.tick()  # sends own edits, and applies those of others
            time.sleep(1 / 60)
