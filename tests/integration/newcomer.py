"""A script as a user writes it who has read only the README: `newcomer.py URL FOLDER`. It makes all common
mistakes; each of them results in an error that it prints, and none ends the process. newcomer_test.py runs
it."""

import array
import os
import pathlib
import sys
import threading

from pxr import Sdf, Tf, Usd, UsdGeom, Vt

import usdlive

URL, FOLDER = sys.argv[1], pathlib.Path(sys.argv[2])


def mistake(what, call):
    try:
        call()
    except usdlive.Error as error:
        print(f"{what}: {error}")
    else:
        sys.exit(f"{what}: nothing was said")


def collected(live, kind):
    happened = []
    live.add_handler(lambda event: happened.append(event) if isinstance(event, kind) else None)
    return happened


ada = usdlive.connect(URL, user="ada")
stage = ada.open_stage("shot.usda")

# Two connections of one process.
bob = usdlive.connect(URL, user="bob")
mistake("the same stage twice", lambda: bob.attach(stage))
theirs = bob.open_stage("shot.usda")

# A call from another thread.
in_thread = threading.Thread(target=lambda: mistake("a tick of another thread", ada.tick))
in_thread.start()
in_thread.join()

# A viewport's notice handler, and a colleague's first override of a deep prim.
resynced = []


class Viewport:
    def changed(self, notice, sender):
        resynced.extend(map(str, notice.GetResyncedPaths()))
        bob.tick()  # runs already
        mistake("a flush within a notice", bob.flush)


viewport = Viewport()
listener = Tf.Notice.Register(Usd.Notice.ObjectsChanged, viewport.changed, theirs)
deep = stage.GetPrimAtPath("/World/Set/Group1/Prop1")
UsdGeom.XformCommonAPI(deep).SetTranslate((1, 2, 3))
assert ada.flush(20)
x = theirs.GetPrimAtPath(deep.GetPath()).GetAttribute("xformOp:translate")
assert bob.wait(lambda: x.Get() == (1, 2, 3), 20)
print("resynced:", sorted(set(resynced) & {"/", "/World", "/World/Set", "/World/Set/Group1"}))
listener.Revoke()

# Ctrl-S, and 200 MB.
stage.Save()
done = ada.save()
assert not done.failed, done
print("ctrl-s:", "(1, 2, 3)" in (FOLDER / "shot.usda").read_text())
floats = array.array("f")
floats.frombytes(os.urandom(200 << 20))
points = ada.open_layer("points.usdc")
Sdf.JustCreatePrimAttributeInLayer(points, "/Points.values", Sdf.ValueTypeNames.FloatArray)
points.GetAttributeAtPath("/Points.values").default = Vt.FloatArray.FromBuffer(floats)
assert ada.flush(120)
print("saved:", ada.save("points.usdc").saved, (FOLDER / "points.usdc").stat().st_size > 200 << 20)

# Files in the folder that are not layers.
print("layers:", sorted(ada.layers()))
print("skipped:", sorted(path for path, why in ada.skipped_files()))

# Closing at unexpected places.
closing = collected(bob, usdlive.events.Committed)
bob.add_handler(lambda event: bob.close() if isinstance(event, usdlive.events.Committed) else None)
stage.DefinePrim("/World/After")
assert ada.flush(20)
try:
    bob.wait(lambda: closing, 20)
except usdlive.Error:
    pass
mistake("a tick after close", bob.tick)
bob.close()

# The server stops; edits made then are reported, not lost silently.
print("stop the server", flush=True)
sys.stdin.readline()
stage.DefinePrim("/World/Offline")
left = ada.close(timeout=1)
print("left:", left.edits > 0)
mistake("an edit after close", lambda: ada.open_layer("shot.usda"))
print("end")
