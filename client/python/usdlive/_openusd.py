"""Checks that this process has the OpenUSD for which usdlive was built: a call into another one would crash.

Imports nothing of the package but what the build wrote, so that it also works where the package cannot be imported.
"""

from __future__ import annotations

import os
import pathlib
import re
import sys

from ._built_for import PYTHON, USD_CORE, USD_LIBRARY

_WANTED = f"usdlive needs usd-core=={USD_CORE} for Python {PYTHON}"
_PORTABLE_FROM = (0, 24, 11)
# Libraries that contain Sdf: of usd-core and bpy, of a stock OpenUSD, of Houdini.
_SDF = re.compile(r"/lib(usd|pxr)_(ms|sdf)[-.][^/]*$")


class OtherOpenUsd(ImportError):
    """The process has an OpenUSD that is not the one for which usdlive was built. The portable backend may fit."""


def check() -> None:
    """Loads OpenUSD. Raises an ImportError that says what was found, what is needed and what to do."""
    python = f"{sys.version_info[0]}.{sys.version_info[1]}"
    if python != PYTHON:
        raise ImportError(f"{_WANTED}; this is Python {python} ({sys.executable}). Install usdlive with this Python: "
                          f"{sys.executable} -m pip install usdlive")
    before = "pxr" in sys.modules
    version, found = _loaded()
    if version != USD_CORE:
        raise (ImportError if version is None else OtherOpenUsd)(f"{_WANTED}; found {found}. {_advice(before)}")
    libraries = _loaded_libraries()
    if libraries is None or not USD_LIBRARY:
        return
    ours = [path for path in libraries if os.path.basename(path) == USD_LIBRARY]
    if not ours:
        raise OtherOpenUsd(f"{_WANTED}; found {found}, which is another build of it. {_advice(before)}")
    if len(libraries) > 1:
        others = ", ".join(path for path in libraries if path != ours[0])
        raise ImportError(f"{_WANTED}, and no other OpenUSD in the process; found {others} beside {ours[0]}. Start "
                          "usdlive in a process that loads one OpenUSD only.")


def is_portable_here() -> bool:
    """Whether the portable backend can use the OpenUSD of this process."""
    try:
        from pxr import Gf, Sdf, Usd, Vt  # noqa: F401

        from . import _session  # noqa: F401
    except ImportError:
        return False
    return Usd.GetVersion() >= _PORTABLE_FROM


def library_folder() -> str | None:
    """The folder with the library of usd-core that the programs need, if this Python has it."""
    beside = os.fspath(pathlib.Path(__file__).absolute().parents[1])
    folders = (os.path.join(entry or os.curdir, "usd_core.libs") for entry in (beside, *sys.path))
    return next((folder for folder in folders if os.path.isfile(os.path.join(folder, USD_LIBRARY))), None)


def missing() -> str:
    """Why the programs cannot start without library_folder()."""
    return f"{_WANTED}; found {_loaded()[1]}. {_advice(before=False)}"


def _loaded() -> tuple[str | None, str]:
    """Imports pxr. Returns the version of OpenUSD, and in words what was found."""
    try:
        import pxr
    except ModuleNotFoundError:
        return None, f"no OpenUSD, because {sys.executable} has no module pxr"
    place = next(iter(pxr.__path__), "a place that is unknown")
    try:
        from pxr import Usd
    except ImportError as error:
        return None, f"pxr in {place}, which cannot be loaded ({error})"
    version = ".".join(str(part) for part in Usd.GetVersion()[1:])
    return version, f"OpenUSD {version} in {place}"


def _loaded_libraries() -> list[str] | None:
    """The libraries of OpenUSD in this process; None where they cannot be listed."""
    try:
        with open("/proc/self/maps", encoding="utf-8", errors="surrogateescape") as maps:
            paths = {line.rstrip("\n").removesuffix(" (deleted)").split(maxsplit=5)[-1] for line in maps}
    except OSError:
        return None
    return sorted(path for path in paths if _SDF.search(path))


def _advice(before: bool) -> str:
    install = f"{sys.executable} -m pip install usd-core=={USD_CORE}"
    if "pxr" not in sys.modules and "bpy" in sys.modules:
        return "Blender has its own: call bpy.utils.expose_bundled_modules() before the import of usdlive."
    if "pxr" not in sys.modules:
        return f"Install it: {install}"
    folder = library_folder()
    if folder is not None:
        first = f"{os.path.dirname(folder)} has it, but the module pxr comes from elsewhere"
        if before:
            return f"{first}: it was imported before usdlive. Import usdlive first, and check PYTHONPATH."
        return f"{first}. Remove that place from PYTHONPATH and sys.path."
    return ("Install usdlive in an environment of its own (python -m venv), or replace the OpenUSD of this one: "
            f"{install}")
