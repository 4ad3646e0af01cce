"""Reading a file and the layers it uses, without a stage."""

from __future__ import annotations

import os
import typing

from pxr import Ar, Sdf, Tf

from ._enums import UsdContextInitialLoadSet
from ._errors import Failure, reason


class Loading:
    """Reads in a thread what composing would otherwise read on the loop's: Sdf lets go of the interpreter
    while it parses. `loaded` of the `total` layers known so far are here.

    Sublayers, references and payloads are followed (with LOAD_NONE sublayers alone), also in variants that
    are not selected; those that no composition holds are let go of with this object.
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
        """The root layer. Raises a Failure that names the file."""
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
                    pass  # composing reports it, with where it is used
            if found is None or found.identifier in self.layers:
                self.total -= 1
                continue
            self._keep(found)
            yield found

    def _keep(self, layer: Sdf.Layer) -> None:
        self.layers[layer.identifier] = layer
        self.loaded += 1


def open_root(url: str) -> Sdf.Layer:
    """The layer of a file; a Failure says what is wrong with it and names it."""
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
        raise Failure(f"{url} is no file that USD can read")  # a resolver's, which reports nothing
    return layer
