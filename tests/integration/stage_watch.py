"""Stages of ours in this process, over layers that pxr.Usd has open too (tests/watch)."""

import ctypes
import json
import os
import pathlib

from pxr import Usd


class Library:
    """The functions of tests/watch/watch.cpp."""

    def __init__(self):
        self.loaded = ctypes.PyDLL(str(pathlib.Path(os.environ["USDLIVE_BUILD"]) / "bin" / "stage_watch.so"))
        for name in ("watch_open", "watch_dump", "watch_changes"):
            getattr(self.loaded, name).restype = ctypes.c_void_p if name == "watch_open" else ctypes.c_char_p

    def __getattr__(self, name):
        return getattr(self.loaded, "watch_" + name)


class WatchedStage:
    """A usdlive::stage::Stage."""

    library = None

    def __init__(self, root, session=None):
        WatchedStage.library = WatchedStage.library or Library()
        self.stage = ctypes.c_void_p(self.library.open(root.identifier.encode(), (session.identifier if session else "").encode()))

    def close(self):
        self.library.close(self.stage)

    def dump(self, base):
        return json.loads(self.library.dump(self.stage, str(base).encode()))

    def changes(self):
        """Since the last call: one entry for each notice."""
        return json.loads(self.library.changes(self.stage))

    def load(self, path, loads):
        self.library.load(self.stage, str(path).encode(), int(loads))

    def mute(self, identifiers):
        self.library.mute(self.stage, "\n".join(identifiers).encode())


class PxrChanges:
    """What Usd.Notice.ObjectsChanged says of a stage, in the form of WatchedStage.changes()."""

    def __init__(self, stage: Usd.Stage):
        from pxr import Tf

        self.stage, self.rounds = stage, []
        self.key = Tf.Notice.Register(Usd.Notice.ObjectsChanged, self.record, stage)

    def seen(self, path):
        """Paths inside prototypes as they are seen from the instances: other programs number prototypes differently."""
        for prototype in self.stage.GetPrototypes():
            if path.HasPrefix(prototype.GetPath()):
                return [one for instance in prototype.GetInstances()
                        for one in self.seen(path.ReplacePrefix(prototype.GetPath(), instance.GetPath()))]
        return [] if str(path).startswith("/__Prototype_") else [str(path)]

    def record(self, notice, _):
        self.rounds.append({
            "resynced": [at for path in notice.GetResyncedPaths() for at in self.seen(path)],
            "info": {at: list(notice.GetChangedFields(path)) for path in notice.GetChangedInfoOnlyPaths() for at in self.seen(path)},
            "assets": [at for path in notice.GetResolvedAssetPathsResyncedPaths() for at in self.seen(path)],
        })

    def changes(self):
        rounds, self.rounds = self.rounds, []
        return rounds
