"""Notes what the notices of a stage tell, until somebody takes it."""

from __future__ import annotations

from pxr import Sdf, Tf, Usd


class StageChanges:
    """Prims of a stage that have changed since the last `take()`. Notices come within a tick or an edit; they are only noted then.
    On the thread of the stage."""

    def __init__(self, stage: Usd.Stage):
        self._resynced: set[Sdf.Path] = set()
        self._changed: dict[str, set[str]] = {}
        self._listener = Tf.Notice.Register(Usd.Notice.ObjectsChanged, self._objects_changed, stage)

    def close(self) -> None:
        self._listener.Revoke()

    def __bool__(self) -> bool:
        return bool(self._changed or self._resynced)

    def take(self) -> tuple[set[Sdf.Path], dict[str, set[str]]]:
        """The prims that were composed again, with everything below them; and, by the path of the prim, the names of properties
        that have changed, the empty name for metadata of the prim."""
        taken = self._resynced, self._changed
        self._resynced, self._changed = set(), {}
        return taken

    def _objects_changed(self, notice: Usd.Notice.ObjectsChanged, _: Usd.Stage) -> None:
        for path in notice.GetChangedInfoOnlyPaths():
            self._note(path)
        for path in notice.GetResyncedPaths():
            if path.IsPropertyPath():
                self._note(path)
            else:
                self._resynced.add(path)
        for path in notice.GetResolvedAssetPathsResyncedPaths():
            self._note(path)

    def _note(self, path: Sdf.Path) -> None:
        prim, _, name = str(path).partition(".")
        names = self._changed.get(prim)
        if names is None:
            self._changed[prim] = {name}
        else:
            names.add(name)
