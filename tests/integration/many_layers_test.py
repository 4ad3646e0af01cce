"""A project whose list of layers has more than 16 MiB can be used."""

import os
import subprocess

from conftest import connect

LAYERS = 16_800
FOLDER = "/".join(["d" * 200] * 4)


def test_a_list_of_layers_above_16_mib_reaches_everybody(project, serve):
    (project / FOLDER).mkdir(parents=True)
    first = project / "root.usda"
    first.write_text("#usda 1.0\n\ndef \"World\"\n{\n}\n")
    names = [f"{FOLDER}/{number:0>190}.usda" for number in range(LAYERS)]
    for name in names:
        os.link(first, project / name)
    server = serve(project)
    with connect(server, "ada") as ada:
        assert len(ada.layers()) == LAYERS + 1
        layer = ada.open_layer(names[7])
        layer.comment = "changed"
        assert ada.flush(20)
        ada.create_layer("later.usda")
        assert "later.usda" in ada.layers()
    listed = subprocess.run([os.environ["USDLIVE_BIN"], "ls", server.url], capture_output=True, text=True, timeout=120)
    assert listed.returncode == 0, listed.stderr
    assert len(listed.stdout.splitlines()) >= LAYERS + 2
