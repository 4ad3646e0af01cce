"""An editor with the OpenUSD of its environment: `portable_peer.py BACKEND URL USER LAYER`, driven as peer.py."""

import difflib
import sys

import bundled_pxr  # noqa: F401
import usdlive
from pxr import Gf, Sdf, Usd, UsdGeom, Vt  # used by the statements
from statements import answer_all

backend, url, user, root = sys.argv[1:]
live = usdlive.connect(url, user=user, backend=None if backend == "any" else backend)
happened = []
live.add_handler(happened.append)
stage = live.open_stage(root)


def layer(name=root):
    return Sdf.Layer.Find(live.identifier(name))


def check():
    """Checks that the layer, which was changed step by step, has the content that the session says."""
    if live.backend != "portable" or any(one.sweep is not None for one in live._layers.values()):
        return  # later ticks compare the rest of the layer
    from usdlive.portable import _content

    afresh = Sdf.Layer.CreateAnonymous(".usda")
    writer = _content.Writer(afresh, _content.Memory())
    for path, kind, fields in live._client.content(root):
        if path != "/":
            writer.create(path, kind)
        for field, data in fields.items():
            writer.field(path, field, data)
    here, there = layer().ExportToString().splitlines(), afresh.ExportToString().splitlines()
    assert here == there, "\n".join(difflib.unified_diff(here, there, "the layer", "the session", lineterm=""))


answer_all(dict(globals()))
live.close()
