"""An editor that is driven by its stdin (statements.py): `peer.py URL USER LAYER [BACKEND]`."""

import sys

import usdlive
from pxr import Gf, Sdf, Ts, Usd, UsdGeom, UsdShade, Vt  # used by the statements
from statements import answer_all

live = usdlive.connect(sys.argv[1], user=sys.argv[2], backend=(sys.argv[4:] or [None])[0])
stage = live.open_stage(sys.argv[3])
happened = []
live.add_handler(happened.append)


def layer(name):
    return Sdf.Layer.Find(live.identifier(name))


def composed(of):
    """The composed content of each prim; None for a prim that the stage has lost, which would crash at the
    next query."""
    return {prim.GetPath(): prim.GetPrimIndex() and (
                prim.GetTypeName(), [(a.GetName(), a.Get(), a.GetTimeSamples()) for a in prim.GetAttributes()])
            for prim in Usd.PrimRange.Stage(of, Usd.PrimAllPrimsPredicate)}


def check_stage(of=stage):
    """Checks that the content that arrived step by step equals that of a newly opened stage."""
    here, afresh = composed(of), composed(Usd.Stage.Open(of.GetRootLayer()))
    assert here == afresh, [(str(path), here.get(path), afresh.get(path))
                            for path in {*here, *afresh} if here.get(path) != afresh.get(path)]


answer_all(dict(globals()))
