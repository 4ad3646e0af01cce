"""Provides a Usd.Stage for the extension (`usdlive::layers::StageHost`)."""

from __future__ import annotations

from pxr import Sdf, Usd


class StageHost:
    def __init__(self, stage: Usd.Stage):
        self._stage = stage

    def root(self) -> str:
        return self._stage.GetRootLayer().identifier

    def session(self) -> str:
        layer = self._stage.GetSessionLayer()
        return layer.identifier if layer else ""

    def muted_layers(self) -> list[str]:
        return list(self._stage.GetMutedLayers())

    def mute_and_unmute(self, mute: list[str], unmute: list[str]) -> bool:
        fixed = {self.root()}
        self._stage.MuteAndUnmuteLayers([layer for layer in mute if layer not in fixed], unmute)
        return True

    def edit_target(self) -> str:
        layer = self._stage.GetEditTarget().GetLayer()
        return layer.identifier if layer else ""

    def set_edit_target(self, identifier: str) -> bool:
        layer = Sdf.Layer.Find(identifier)
        if not layer or not self._stage.HasLocalLayer(layer):
            return False
        self._stage.SetEditTarget(self._stage.GetEditTargetForLocalLayer(layer))
        return True

    def used_layers(self) -> list[str]:
        return [layer.identifier for layer in self._stage.GetUsedLayers()]

    def child_names(self, path: str) -> list[str]:
        prim = self._stage.GetPrimAtPath(path)
        return list(prim.GetAllChildrenNames()) if prim else []

    def property_names(self, path: str) -> list[str]:
        prim = self._stage.GetPrimAtPath(path)
        return list(prim.GetPropertyNames()) if prim else []
