"""An editor driven by its stdin: `peer.py URL USER LAYER`. Each line is a JSON string of Python
statements; the answer is a JSON line with the value of `result`, or the error."""

import json
import os
import sys
import traceback

import usdlive
from pxr import Gf, Sdf, Ts, Usd, UsdGeom, UsdShade, Vt  # noqa: F401 - for the statements

live = usdlive.connect(sys.argv[1], user=sys.argv[2])
stage = live.open_stage(sys.argv[3])
happened = []
live.add_handler(happened.append)


def layer(name):
    return Sdf.Layer.Find(os.path.join(live.cache_folder, name))


names = dict(globals())
print("{}", flush=True)
for line in sys.stdin:
    names.pop("result", None)
    try:
        exec(json.loads(line), names)
        answer = {"value": names.get("result")}
    except BaseException:
        answer = {"error": traceback.format_exc()}
    print(json.dumps(answer), flush=True)
