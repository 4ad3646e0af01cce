"""Follows files that are no USD, such as chair.obj, on a stage that was opened from the project's folder."""

from __future__ import annotations

import os
import time
import weakref

from pxr import Sdf, Tf, Usd

USD_EXTENSIONS = {"usd", "usda", "usdc", "usdz"}
SECONDS = 0.5  # between two looks at the files


class ForeignFiles:
    """Reloads the layers of such files of one stage when they change on the disk. The server does not serve them:
    whoever has the folder sees its files. A layer with unsaved edits is not reloaded before they are saved."""

    def __init__(self, stage: Usd.Stage, folder: str):
        self.stage = weakref.ref(stage)
        self._folder = os.path.realpath(folder)
        self._layers: list[tuple[Sdf.Layer, str]] | None = None  # with their files; None: to be listed again
        self._stamps: dict[str, tuple[int, int] | None] = {}
        self._next = 0.0
        self._changes = Tf.Notice.Register(Usd.Notice.ObjectsChanged, self._on_changed, stage)
        self.update()

    def update(self) -> bool:
        """Returns False if the stage does not exist any more."""
        stage = self.stage()
        if stage is None:
            return False
        now = time.monotonic()
        if now >= self._next:
            self._next = now + SECONDS
            if self._layers is None:
                self._layers = [(layer, layer.realPath) for layer in stage.GetUsedLayers() if self._is_foreign(layer)]
            for layer, path in self._layers:
                if layer and not layer.dirty:
                    self._follow(layer, path)
        return True

    def _on_changed(self, notice: Usd.Notice.ObjectsChanged, _: Usd.Stage) -> None:
        if notice.GetResyncedPaths():
            self._layers = None  # a stage of thousands of layers is not looked through at each look at the files

    def _is_foreign(self, layer: Sdf.Layer) -> bool:
        path = layer.realPath
        return (bool(path) and layer.GetFileFormat().primaryFileExtension not in USD_EXTENSIONS
                and os.path.commonpath([os.path.realpath(path), self._folder]) == self._folder)

    def _follow(self, layer: Sdf.Layer, path: str) -> None:
        stamp = self._stamp(path)
        # Layers of one file with different arguments are reloaded one by one.
        before = self._stamps.setdefault(layer.identifier, stamp)
        if stamp is None or stamp == before:
            return
        self._stamps[layer.identifier] = stamp
        try:
            layer.Reload(force=True)
        except Tf.ErrorException as error:
            Tf.Warn(f"{path} has changed and cannot be read; the stage keeps its last content. {error}")

    @staticmethod
    def _stamp(path: str) -> tuple[int, int] | None:
        try:
            status = os.stat(path)
        except OSError:
            return None  # it may be about to be replaced
        return status.st_mtime_ns, status.st_size
