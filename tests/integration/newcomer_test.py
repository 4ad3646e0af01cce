"""A newcomer's script with all the mistakes of a first week runs to its end."""

import os
import pathlib
import subprocess
import sys

import usdlive
from conftest import connect

SCRIPT = pathlib.Path(__file__).with_name("newcomer.py")
SET = "".join(f'    def "Group{group}"\n    {{\n'
              + "".join(f'        def Xform "Prop{prop}"\n        {{\n        }}\n' for prop in range(20))
              + "    }\n" for group in range(100))


def test_a_newcomers_script_runs_to_its_end(project, serve, tmp_path):
    (project / "shot.usda").write_text('#usda 1.0\n(\n    subLayers = [@anim.usda@, @set.usda@]\n)\n')
    (project / "anim.usda").write_text("#usda 1.0\n")
    (project / "set.usda").write_text('#usda 1.0\n\ndef "World"\n{\ndef "Set"\n{\n' + SET + "}\n}\n")
    (project / "LOOK.USDA").write_text("#usda 1.0\n")
    (project / "points.usdc").write_bytes(b"")
    subprocess.run([sys.executable, "-c", "import sys; from pxr import Sdf; "
                    "assert Sdf.Layer.CreateNew(sys.argv[1]).Save(True)", str(tmp_path / "points.usdc")], check=True)
    (tmp_path / "points.usdc").replace(project / "points.usdc")
    (project / "v2").mkdir()
    (project / "v2" / "hall.usda").write_text("#usda 1.0\n")
    (project / "latest").symlink_to("v2")
    (project / "assets.usdz").write_bytes(b"PK")
    server = serve(project)
    script = subprocess.Popen([sys.executable, str(SCRIPT), server.url, str(project)], stdin=subprocess.PIPE,
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                              env={**os.environ, "XDG_STATE_HOME": str(tmp_path / "state")})
    lines = []
    for line in script.stdout:
        lines.append(line.rstrip("\n"))
        if lines[-1] == "stop the server":
            server.stop()
            script.stdin.write("\n")
            script.stdin.flush()
    errors = script.stderr.read()
    assert script.wait(60) == 0 and lines[-1] == "end", "\n".join([*lines, errors])
    said = dict(line.split(": ", 1) for line in lines if ": " in line)
    assert "already live through another connection" in said["the same stage twice"]
    assert "another thread" in said["a tick of another thread"]
    assert said["resynced"] == "[]", "nobody's viewport rebuilds for an override"
    assert "notice handler" in said["a flush within a notice"]
    assert said["ctrl-s"] == "True"
    assert said["saved"] == "('points.usdc',) True"
    assert {"shot.usda", "LOOK.USDA", "latest/hall.usda", "v2/hall.usda"} <= set(eval(said["layers"]))
    assert "assets.usdz" in said["skipped"]
    assert "was closed" in said["a tick after close"] and "was closed" in said["an edit after close"]
    assert said["left"] == "True"
    server.start()
    with connect(server, "ada") as ada:
        assert usdlive.ErrorCode.NOT_CONNECTED == "notConnected" and "shot.usda" in ada.layers()
