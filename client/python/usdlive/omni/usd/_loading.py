"""Reads a file and the layers that it uses, without a stage."""

from __future__ import annotations

import os
import typing

from pxr import Ar, Sdf, Tf

from ._enums import UsdContextInitialLoadSet
from ._errors import Failure, reason


class Loading:
    """Reads layers in a thread, which composing would otherwise read on the event loop's thread. Sdf releases
    the interpreter while it parses. `loaded` of the `total` layers known so far have been read.

    Follows sublayers, references and payloads (with LOAD_NONE only sublayers), also in variants that are not
    selected. Layers that no composition uses are released with this object.
    """

    def __init__(self, url: str, load_set: UsdContextInitialLoadSet):
        self.url = url
        self.loaded, self.total = 0, 1
        self.layers: dict[str, Sdf.Layer] = {}
        self._everything = load_set == UsdContextInitialLoadSet.LOAD_ALL

    @property
    def message(self) -> str:
        return f"Opening {self.url}"

    def read(self) -> Sdf.Layer:
        """Returns the root layer. Raises a Failure that names the file."""
        resolver = Ar.GetResolver()
        with Ar.ResolverContextBinder(resolver.CreateDefaultContextForAsset(self.url)):
            root = open_root(self.url)
            self._keep(root)
            waiting = [root]
            while waiting:
                waiting.extend(self._read_used(waiting.pop()))
        return root

    def _read_used(self, layer: Sdf.Layer) -> typing.Iterator[Sdf.Layer]:
        used = layer.GetCompositionAssetDependencies() if self._everything else list(layer.subLayerPaths)
        self.total += len(used)
        for path in used:
            found = None
            if path:
                try:
                    found = Sdf.Layer.FindOrOpenRelativeToLayer(layer, path)
                except Tf.ErrorException:
                    pass  # composing reports the error, with the place where it is used
            if found is None or found.identifier in self.layers:
                self.total -= 1
                continue
            self._keep(found)
            yield found

    def _keep(self, layer: Sdf.Layer) -> None:
        self.layers[layer.identifier] = layer
        self.loaded += 1


def open_root(url: str) -> Sdf.Layer:
    """Returns the layer of a file. Raises a Failure with the file's name and the problem."""
    if not url:
        raise Failure("no file was named")
    asset = Sdf.Layer.SplitIdentifier(url)[0]
    path = str(Ar.GetResolver().Resolve(asset)) or asset
    if Sdf.Layer.Find(url) is None:
        if os.path.isdir(path):
            raise Failure(f"{url} is a folder")
        if not os.path.exists(path) and not Ar.IsPackageRelativePath(path):
            raise Failure(f"{url}: no such file")
        if os.path.exists(path) and not os.access(path, os.R_OK):
            raise Failure(f"{url}: no permission to read it")
    try:
        layer = Sdf.Layer.FindOrOpen(url)
    except Tf.ErrorException as error:
        text = reason(error)
        raise Failure(text if url in text else f"{url}: {text}") from error
    if layer is None:
        raise Failure(f"{url} cannot be read by USD")  # a resolver's, which reports nothing
    return layer
