"""The selection of a context."""

from __future__ import annotations

import typing

from pxr import Sdf, Usd


class Selection:
    """Paths of prims in the order of their selection. Belongs to one UsdContext, which sends SELECTION_CHANGED
    at most once per frame."""

    def __init__(self, stage: typing.Callable[[], Usd.Stage | None], changed: typing.Callable[[], None]):
        self._stage = stage
        self._changed = changed
        self._paths: dict[str, None] = {}

    def get_selected_prim_paths(self) -> list[str]:
        return list(self._paths)

    def is_prim_path_selected(self, path: str) -> bool:
        return str(path) in self._paths

    def set_selected_prim_paths(self, paths: typing.Iterable[str], expand_in_stage: bool = True) -> bool:
        """Selects exactly these paths. `expand_in_stage` is for a tree view, which usdlive does not have."""
        return self._set(dict.fromkeys(str(path) for path in paths if Sdf.Path.IsValidPathString(str(path))))

    def set_prim_path_selected(self, path: str, selected: bool, force_prim: bool = False,
                               clear_selected: bool = False, expand_in_stage: bool = True) -> bool:
        """Adds or removes one path. With `force_prim` the stage need not have the prim."""
        stage = self._stage()
        if selected and not force_prim and not (stage and stage.GetPrimAtPath(str(path))):
            return False
        paths = {} if clear_selected else dict(self._paths)
        if selected:
            paths[str(path)] = None
        else:
            paths.pop(str(path), None)
        return self._set(paths)

    def clear_selected_prim_paths(self) -> bool:
        return self._set({})

    def select_all_prims(self, type_names: typing.Iterable[str] | None = None) -> None:
        wanted = None if type_names is None else set(type_names)
        self._set(dict.fromkeys(str(prim.GetPath()) for prim in self._prims()
                                if wanted is None or prim.GetTypeName() in wanted))

    def select_inverted_prims(self) -> None:
        self._set(dict.fromkeys(path for prim in self._prims()
                                if (path := str(prim.GetPath())) not in self._paths))

    def _prims(self) -> typing.Iterable[Usd.Prim]:
        stage = self._stage()
        return stage.Traverse() if stage else ()

    def _set(self, paths: dict[str, None]) -> bool:
        """Sets the selection. Returns True and notifies if it has changed."""
        if list(paths) == list(self._paths):
            return False
        self._paths = paths
        self._changed()
        return True
