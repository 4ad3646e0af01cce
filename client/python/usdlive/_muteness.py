"""The layers that are muted for everybody, on the stages of this process."""

from __future__ import annotations

import typing
import weakref

from pxr import Usd


class MutenessOfStage:
    """Mutes on one stage the layers that are muted for everybody. Layers that the user mutes or unmutes on this
    stage keep their state until the shared state changes."""

    def __init__(self, stage: Usd.Stage, root: str):
        self.stage = weakref.ref(stage)
        self._root = root
        self._muted: frozenset[str] = frozenset()

    def update(self, client: typing.Any, identifier: typing.Callable[[str, str], str],
               compose: typing.Callable[[typing.Callable[[], object]], None]) -> bool:
        """Returns False if the stage does not exist any more. `identifier(layer, root)`: of a layer of the project on a stage
        with this root layer. `compose` calls what lets the stage compose."""
        stage = self.stage()
        if stage is None:
            return False
        muted = frozenset(client.globally_muted(self._root))
        if muted != self._muted:
            before, self._muted = self._muted, muted
            root = stage.GetRootLayer().identifier
            changes = [[identifier(layer, root) for layer in sorted(one)] for one in (muted - before, before - muted)]
            compose(lambda: stage.MuteAndUnmuteLayers(*changes))
        return True
