"""Compares a stage of ours with one of pxr.Usd, both over the live layers of one client, while another client edits them at random.

    live_stage_following.py SEED URL

The server at URL serves the stage of the seed from stage_seeds. Prints the differences, and in the last line the number of steps that were
compared. Returns 1 if there are differences.
"""

import itertools
import sys
import time

import stage_seeds
import usdlive
from pxr import Sdf, Usd
from stage_dump import Dump, everything
from stage_edits import Editor
from stage_following import BIGGEST, SLOWEST, compared, in_a_child
from stage_watch import PxrChanges, WatchedStage

STEPS = 16


class LiveEditor(Editor):
    def layers(self):
        return [layer for layer in super().layers() if not layer.anonymous]

    def edit_stage(self, layer, spec):
        """Leaves expression variables alone: pxr.Usd 26.8 crashes when they change (PcpLayerStack::Apply), depending on the arcs."""
        choice = self.r.randrange(3)
        if choice == 0:
            layer.defaultPrim = self.r.choice(stage_seeds.NAMES)
        elif choice == 1:
            layer.startTimeCode, layer.endTimeCode = 1, self.r.choice((11, 20))
        else:
            layer.customLayerData = {"k": {"x": self.r.randrange(3)}}


class Follower:
    def __init__(self, live):
        self.live, self.base = live, live.cache_folder
        self.stage = live.open_stage("root.usda")
        self.ours = WatchedStage(self.stage.GetRootLayer(), self.stage.GetSessionLayer())
        self.theirs = PxrChanges(self.stage)

    def is_small(self):
        return sum(1 for _ in itertools.islice(everything(self.stage), BIGGEST + 1)) <= BIGGEST

    def anew(self):
        return Dump(Usd.Stage.Open(self.stage.GetRootLayer(), self.stage.GetSessionLayer()), self.base).all()


def follow_live(seed, url):
    """(steps that were compared, what differs)."""
    author, follower = (usdlive.connect(url, user=user, application="test") for user in ("Ada", "Bo"))
    editor = LiveEditor(seed, "", author.open_stage("root.usda"), None)
    following = Follower(follower)
    before = following.ours.dump(following.base)
    for number in range(STEPS):
        editor.made.clear()
        begin = time.process_time()
        with Sdf.ChangeBlock():
            for _ in range(editor.r.randint(1, 3)):
                editor.edit()
        # Together less than LONGEST, after which a seed ends without a failure.
        assert author.flush(8), "not committed"
        assert follower.wait(lambda: follower.revision >= author.revision, 8), "did not arrive"
        follower.tick()
        if time.process_time() - begin > 2 * SLOWEST or not following.is_small():
            return number, []
        after = following.ours.dump(following.base)
        found = compared(following, before, after)
        if found:
            return number, ["seed %d, step %d (%s): %s" % (seed, number, "; ".join(editor.made), what) for what in found[:5]]
        before = after
    return STEPS, []


def main():
    seed, url = int(sys.argv[1]), sys.argv[2]
    count, found = in_a_child(follow_live, seed, url)
    print("\n".join([*found, "%d steps compared" % count]))
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
