"""Compares a stage of ours with one of pxr.Usd, both over the live layers of one client, while another client edits them at random.

    live_stage_following.py SEED URL

The server at URL serves the stage of the seed from stage_seeds. Prints the differences, and in the last line the number of steps that were
compared. Returns 1 if there are differences.
"""

import sys

import usdlive
from pxr import Sdf
from stage_edits import Editor
from stage_following import SLOWEST, Follower, followed, in_a_child

STEPS = 16


class LiveEditor(Editor):
    def layers(self):
        return [layer for layer in super().layers() if not layer.anonymous]


def follow_live(seed, url):
    """(steps that were compared, what differs)."""
    author, bo = (usdlive.connect(url, user=user, application="test") for user in ("Ada", "Bo"))
    editor = LiveEditor(seed, "", author.open_stage("root.usda"), None)

    def step():
        with Sdf.ChangeBlock():
            for _ in range(editor.r.randint(1, 3)):
                editor.edit()
        assert author.flush(8), "not committed"
        assert bo.wait(lambda: bo.revision >= author.revision, 8), "did not arrive"
        bo.tick()

    return followed(seed, Follower(bo.open_stage("root.usda"), bo.cache_folder), editor, step, STEPS, 2 * SLOWEST)


def main():
    seed, url = int(sys.argv[1]), sys.argv[2]
    count, found = in_a_child(follow_live, seed, url)
    print("\n".join([*found, "%d steps compared" % count]))
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
