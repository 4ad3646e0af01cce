"""Makes random edits of stages from seeds, and compares after each step what ours and pxr.Usd show, and what they say has changed.

    stage_following.py FIRST LAST FOLDER [STEPS]

Prints what differs; in the last line how many steps were compared. Ends with 1 if anything differs.
"""

import itertools
import json
import os
import signal
import sys
import time

import stage_seeds
from pxr import Sdf, Tf, Usd
from stage_dump import Dump, differences, everything
from stage_edits import Editor
from stage_watch import PxrChanges, WatchedStage

BIGGEST = 250  # prims of a stage
SLOWEST = 0.8  # seconds of CPU time for one step: what arcs multiply takes longer and longer
LONGEST = 20  # seconds of CPU time for one seed


def is_below(path, prefixes):
    """Whether a path, or one above it, is among the prefixes."""
    path = Sdf.Path(path)
    while path != Sdf.Path.emptyPath:
        if str(path) in prefixes:
            return True
        path = path.GetParentPath()
    return False


def together(rounds):
    """All rounds as one."""
    return {
        "resynced": {path for one in rounds for path in one["resynced"]},
        "info": {path for one in rounds for path in one["info"]},
        "assets": {path for one in rounds for path in one["assets"]},
    }


def broader(before, after, ours, theirs):
    """Yields what ours reports as changed though pxr.Usd does not, and nothing has changed there.

    The whole stage may be resynced if pxr.Usd reports too little: other time codes of the session layer change all samples.
    """
    changed = {path for path, _ in changes_of(before, after)}
    if "/" in ours["resynced"] and any(missing(before, after, theirs)):
        return
    shown = {str(prefix) for path in changed for prefix in Sdf.Path(path).GetPrefixes()}
    for path in sorted(ours["resynced"]):
        if not is_below(path, theirs["resynced"]) and path not in shown:
            yield "%s is resynced, for pxr.Usd not" % path
    for path in sorted(ours["info"]):
        if not is_below(path, theirs["resynced"]) and path not in theirs["info"] and path not in changed:
            yield "%s is changed, for pxr.Usd not" % path
    for path in sorted(ours["assets"]):
        if not is_below(path, theirs["resynced"] | theirs["assets"]):
            yield "assets below %s are resynced, for pxr.Usd not" % path


def changes_of(before, after):
    """(path, what) of each prim and property that shows something else."""
    old, new = ({prim["path"]: prim for prim in dump["prims"]} for dump in (before, after))
    same_times = before["times"] == after["times"]  # those of "at"
    if before["rootChildren"] != after["rootChildren"] or before["metadata"] != after["metadata"]:
        yield "/", "/order"
    for path in sorted(old.keys() | new.keys()):
        if path not in old or path not in new:
            yield path, "came" if path in new else "went"
            continue
        one, other = dict(old[path]), dict(new[path])
        properties, others = one.pop("properties"), other.pop("properties")
        for name in sorted(properties.keys() | others.keys()):
            what = next(differences(properties.get(name), others.get(name)), None)
            if what and (same_times or not what.startswith("/at")):
                yield path + "." + name, what
        for record in (one, other):
            record.pop("propertyOrder")
            record["prototype"] = "prototype" in record  # without its number
            record["order"] = [name for name in record["children"] if name in set(one["children"]) & set(other["children"])]
        del one["children"], other["children"]
        for what in itertools.islice(differences(one, other), 1):
            yield path, what


def missing(before, after, ours):
    """Yields what has changed though ours does not report it. A child that is resynced may have another place."""
    resynced = ours["resynced"] | ours["assets"]
    parents = {str(Sdf.Path(path).GetParentPath()) for path in ours["resynced"]}
    for path, what in changes_of(before, after):
        said = is_below(path, resynced) or path in ours["info"] or (what.startswith("/order") and path in parents)
        if not said:
            yield "%s shows something else, and is not said to have changed: %s" % (path, what)


class Follower:
    """A stage of pxr.Usd and one of ours over the same layers."""

    def __init__(self, stage, base):
        self.stage, self.base = stage, base
        self.ours = WatchedStage(stage.GetRootLayer(), stage.GetSessionLayer())
        self.theirs = PxrChanges(stage)
        self.muted = []

    def is_small(self):
        return sum(1 for _ in itertools.islice(everything(self.stage), BIGGEST + 1)) <= BIGGEST

    def anew(self):
        """Returns the dump of a stage of pxr.Usd that is opened on the layers now."""
        stage = Usd.Stage.OpenMasked(self.stage.GetRootLayer(), self.stage.GetSessionLayer(), self.stage.GetPopulationMask(), Usd.Stage.LoadNone)
        stage.MuteAndUnmuteLayers(self.muted, [])
        stage.SetLoadRules(self.stage.GetLoadRules())
        return Dump(stage, self.base).all()


class Following(Follower):
    def __init__(self, seed, folder):
        base = os.path.join(folder, "seed%d" % seed)
        root, session = stage_seeds.make(seed, base)
        layers = Sdf.Layer.FindOrOpen(root), Sdf.Layer.FindOrOpen(session) if session else Sdf.Layer.CreateAnonymous()
        super().__init__(Usd.Stage.Open(*layers), base)
        self.editor = Editor(seed, self.base, self.stage, self.ours)
        self.muted = self.editor.muted

    def step(self):
        r = self.editor.r
        choice = r.random()
        if choice < 0.06:
            self.editor.mute()
        elif choice < 0.12:
            self.editor.load()
        elif choice < 0.7:
            self.editor.edit()
        else:
            with Sdf.ChangeBlock():
                for _ in range(r.randint(2, 4)):
                    self.editor.edit()


def shown(dump):
    return {**dump, "errors": []}


def compared(following, before, after):
    """Returns the differences after a step."""
    theirs = Dump(following.stage, following.base).all()
    changes = together(following.ours.changes()), together(following.theirs.changes())
    found = list(itertools.islice(differences(shown(theirs), shown(after)), 4))
    if found and not list(itertools.islice(differences(shown(following.anew()), shown(after)), 1)):
        found = []  # pxr.Usd itself would show this if it opened the layers now
    found += ["broader: " + what for what in broader(before, after, *changes)]
    return found + ["missing: " + what for what in missing(before, after, changes[0])]


def followed(seed, follower, editor, step, steps, slowest=SLOWEST):
    """Makes steps and compares after each: (steps that were compared, what differs)."""
    if not follower.is_small():
        return 0, []
    before = follower.ours.dump(follower.base)
    for number in range(steps):
        editor.made.clear()
        begin = time.process_time()
        try:
            step()
        except Tf.ErrorException:  # Pcp's own checks fail on a few stages of the seeds
            return number, []
        if time.process_time() - begin > slowest or not follower.is_small():
            return number, []
        after = follower.ours.dump(follower.base)
        found = compared(follower, before, after)
        if found:
            made = "; ".join(editor.made)
            return number, ["seed %d, step %d (%s): %s" % (seed, number, made, what) for what in found[:5]]
        before = after
    follower.ours.close()
    return steps, []


def follow(seed, folder, steps):
    """(steps that were compared, what differs)."""
    following = Following(seed, folder)
    return followed(seed, following, following.editor, following.step, steps)


def in_a_child(work, seed, *arguments):
    """A stage whose arcs multiply, or that Pcp fails on, ends only the child: (steps that were compared, what differs)."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        signal.setitimer(signal.ITIMER_PROF, LONGEST)
        try:
            result = work(seed, *arguments)
        except Tf.ErrorException:
            result = 0, []
        with os.fdopen(writing, "w") as stream:
            json.dump(result, stream)
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading) as stream:
        text = stream.read()
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if status == -signal.SIGPROF:
        return 0, []
    return json.loads(text) if status == 0 else (0, ["seed %d: ended with %d" % (seed, status)])


def main(work, usual_steps):
    first, last, folder = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
    steps = int(sys.argv[4]) if len(sys.argv) > 4 else usual_steps
    compared, differing = 0, []
    for seed in range(first, last):
        count, found = in_a_child(work, seed, folder, steps)
        compared += count
        differing += found
    print("\n".join([*differing, "%d steps compared" % compared]))
    sys.exit(bool(differing))


if __name__ == "__main__":
    main(follow, 14)
