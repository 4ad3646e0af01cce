"""The first live edit and the Python examples of the README run unchanged."""

import pathlib
import re
import textwrap

import pytest
from conftest import cat
from documents import Reader
from pxr import Sdf

import usdlive

README = pathlib.Path(__file__).parents[2] / "README.md"


def block(beginning: str) -> str:
    """Returns the indented lines that begin with `beginning`, to the end of the code."""
    text = README.read_text()
    start = text.index("    " + beginning)
    lines = re.match(r"(?:(?: {4}.*)?\n)+", text[start:]).group()
    return textwrap.dedent(lines)


class Enough(Exception):
    pass


@pytest.fixture
def names(project, serve, monkeypatch):
    """Names that the examples leave to the reader, and the server at the address that they use."""
    (project / "shot.usda").write_text('#usda 1.0\ndef "A"\n{\n    double x\n}\n')
    server = serve(project)
    connect = usdlive.connect
    monkeypatch.setattr(usdlive, "connect", lambda url, **options: connect(server.url, **options))
    frames = []

    def animate(stage):
        frames.append(stage)
        if len(frames) > 200:
            raise Enough
        stage.GetAttributeAtPath("/A.x").Set(float(len(frames)))

    return {"animate": animate, "server": server, "frames": frames, "usdlive": usdlive}


def test_the_first_live_edit(names, tmp_path):
    printed = Reader(tmp_path, names["server"].port).run(block("python -c 'import usdlive"))
    assert 'def Sphere "Hello"' in printed
    assert re.search(r"^#\d+ .* ada ", printed, re.MULTILINE) and "Traceback" not in printed


def test_the_first_example_edits_a_stage(names):
    with pytest.raises(Enough):
        exec(block("import usdlive"), names)  # noqa: S102 - our own text
    assert names["live"].flush()
    assert "200" in cat(names["server"], "shot.usda")
    names["live"].close()


def test_the_example_with_a_lock_and_a_gesture_saves(names, project, capsys):
    exec(block("def happened(event):"), names)  # noqa: S102 - our own text
    assert len(names["frames"]) == 100
    assert "written:" in capsys.readouterr().out
    saved = Sdf.Layer.OpenAsAnonymous(str(project / "shot.usda"))
    assert saved.GetAttributeAtPath("/A.x").default == 100.0
