"""Editors with several versions of OpenUSD, for the tests of the portable backend."""

import os
import pathlib
import subprocess
import sys

import pytest
from conftest import HERE, Peer, cat
from pxr import Sdf

ENVIRONMENTS = pathlib.Path(os.environ["USDLIVE_PRODUCT_ENV"]).parent
BUILT_FOR = "26.8"
# The one version that `./run soak versions` tests now; else all that CI has.
SOAKED = os.environ.get("USDLIVE_SOAK_PXR")
OLDEST, NEWEST = (SOAKED, SOAKED) if SOAKED else ("24.11", "26.11")
OTHERS = list(dict.fromkeys([OLDEST, NEWEST]))

ROOT = """#usda 1.0
(
    customLayerData = {
        float a = 1.5
        dictionary nested = {
            token t = "x"
            uchar u = 3
        }
        int64 big = 5000000000
        string "odd key" = 'it is "odd"'
    }
    defaultPrim = "World"
    subLayers = [
        @./sub.usda@ (offset = 2; scale = 0.5)
    ]
    timeCodesPerSecond = 25
    upAxis = "Z"
)

def Xform "World" (
    assetInfo = {
        asset identifier = @./a.usda@
    }
    customData = {
        bool b = 1
        float[] floats = [1, 2]
        half h = 0.5
        double3 v = (1, 2, 3)
    }
    doc = "Two\\nlines"
    kind = "assembly"
    variants = {
        string look = "red"
    }
    prepend variantSets = "look"
)
{
    rel targets = [
        </World/Ball>,
        </World/Box>,
    ]
    prepend rel more = </World/Ball>

    def Sphere "Ball" (
        delete references = </Other>
        prepend references = </Class> (
            customData = {
                float weight = 0.25
            }
            offset = 3
        )
    )
    {
        double radius = 2
        double radius.timeSamples = {
            1: 1.5,
            2: None,
            3.5: 4,
        }
        color3f[] primvars:displayColor = [(1, 0, 0.25)] (
            interpolation = "constant"
        )
        uniform token[] xformOpOrder = ["xformOp:translate"]
        double3 xformOp:translate = (1, 2, 3)
        float noise.connect = </World/Box.size>
    }

    def Cube "Box"
    {
        float size = None
    }
    variantSet "look" = {
        "blue" {
            over "Box"
            {
                bool blue = 1
            }

        }
        "red" (
            doc = "It is red"
        ) {
            string text = "red"

            def Scope "In"
            {
            }
        }
    }
}

class "Class"
{
    int number = -1
}
"""
SUB = """#usda 1.0

over "World"
{
    custom string fromBelow = "sub"
}
"""


class Editor(Peer):
    """An editor whose OpenUSD is that of an environment."""

    def __init__(self, python: str, backend: str, url: str, user: str, log: pathlib.Path):
        self.log = log
        self.process = subprocess.Popen([python, str(HERE / "portable_peer.py"), backend, url, user, "root.usda"], text=True,
                                        env=environment(), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log.open("ab"))
        self._answer()


def environment() -> dict[str, str]:
    """The environment of a process with any version: it has no module of the product's Python."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(pathlib.Path(os.environ["USDLIVE_BUILD"]) / "python"), str(HERE)])}


def python_of(version: str) -> str:
    if version == BUILT_FOR:
        return sys.executable
    python = ENVIRONMENTS / f"{'soak-' if SOAKED else ''}pxr-{version}" / "bin" / "python"
    if not python.exists():
        pytest.skip(f"there is no environment with OpenUSD {version}: ./run setup makes it")
    return str(python)


@pytest.fixture
def served(project, serve):
    """served(text) serves a project with this root layer."""

    def start(text: str = ROOT):
        (project / "root.usda").write_text(text)
        (project / "sub.usda").write_text(SUB)
        return serve(project)

    return start


@pytest.fixture
def portable(tmp_path):
    """portable(server, version, user) starts an editor that is closed after the test."""
    editors: list[Editor] = []

    def start(server, version: str, user: str, backend: str = "any") -> Editor:
        editors.append(Editor(python_of(version), backend, server.url, user, tmp_path / f"{user}.log"))
        return editors[-1]

    yield start
    for one in editors:
        one.process.kill()
        one.process.wait()


def plain(text: str) -> str:
    """The text as the pxr of this process writes it."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    assert layer.ImportFromString(text)
    return layer.ExportToString()


def all_synced(server, *editors: Editor, may_lose: bool = False) -> str:
    """Waits until all have all commits; checks that they show the same, and returns the text."""
    revision = max(one.flush() for one in editors)
    for one in editors:
        one.catch_up(revision)
        assert one.flush() == revision, "an editor has made edits of what it received"
        lost = one.run("result = [str(event) for event in happened if type(event).__name__ == 'Lost']")
        assert may_lose or lost == []
    texts = [one.text("root.usda") for one in editors]
    for text in texts[1:]:
        assert text == texts[0]
    assert plain(cat(server, "root.usda")) == texts[0]
    return texts[0]
