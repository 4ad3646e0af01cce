"""Stages of the past."""

from __future__ import annotations

import re
import weakref

from pxr import Sdf, Tf, Usd

from ._errors import Error
from ._forked import keep_if_forked


def open_at(address: str, load: "Usd.Stage.InitialLoadSet", follow_muteness: bool) -> Usd.Stage:
    """Opens a stage at the address of a revision. `follow_muteness`: mutes the layers that were muted for everybody."""
    try:
        stage = Usd.Stage.Open(address, load)
    except Tf.ErrorException as failed:
        reasons = re.findall(r": '(.*)'$", str(failed), re.MULTILINE)  # without places in the sources of OpenUSD
        why = reasons[0].removeprefix(f"usdlive: cannot open {address}: ") if reasons else failed
        raise Error("layerUnreadable", f"cannot open {address}: {why}") from None
    keep_if_forked(stage)
    if follow_muteness:
        stage.MuteAndUnmuteLayers(_muted_on(stage.GetRootLayer()), [])
    return stage


def _muted_on(root: Sdf.Layer) -> list[str]:
    """The layers that the root layer says are muted for everybody (MU1)."""
    muteness = root.customLayerData.get("omni_layer", {}).get("muteness", {})
    return [root.ComputeAbsolutePath(path) for path, muted in muteness.items() if muted is True]


class ReadOnly:
    """Makes the layers of a stage refuse edits, also those that it loads later. Its session layer permits them."""

    def __init__(self, stage: Usd.Stage):
        self.stage = weakref.ref(stage)
        self._listener = Tf.Notice.Register(Usd.Notice.ObjectsChanged, self._changed, stage)
        self._close(stage)

    def _changed(self, notice: Usd.Notice.ObjectsChanged, stage: Usd.Stage) -> None:
        if notice.GetResyncedPaths():
            self._close(stage)

    @staticmethod
    def _close(stage: Usd.Stage) -> None:
        own = set(stage.GetLayerStack()[:1])  # the session layer
        for layer in stage.GetUsedLayers():
            if layer not in own and not layer.anonymous:
                layer.SetPermissionToEdit(False)
