"""Starts the programs of this installation, for the commands `usdlive` and `usdlive-server`.

A module beside the package, because importing the package loads OpenUSD, which these programs do themselves.
"""

from __future__ import annotations

import importlib
import os
import pathlib
import sys
import types

_HERE = pathlib.Path(__file__).absolute().parent  # not resolved: a build links to the sources


def usdlive() -> None:
    _run("usdlive")


def usdlive_server() -> None:
    _run("usdlive-server")


def _run(name: str) -> None:
    """Replaces this process by the program."""
    installed = _HERE / "usdlive" / "bin" / name
    built = _HERE.parent / "bin" / name
    program = next((file for file in (installed, built) if os.access(file, os.X_OK)), None)
    if program is None:
        sys.exit(f"{name}: there is no program {installed}. Install the package again: "
                 f"{sys.executable} -m pip install --force-reinstall usdlive")
    if program == installed:
        _find_openusd(name)
    os.environ["USDLIVE_PYTHON"] = sys.executable  # runs the gateway of `usdlive page`
    os.execv(program, [str(program), *sys.argv[1:]])


def _find_openusd(name: str) -> None:
    """The programs search OpenUSD beside the package. Names another place of this Python, where it was installed."""
    openusd = _module("_openusd")
    folder = openusd.library_folder()
    if folder is None:
        sys.exit(f"{name}: {openusd.missing()}")
    if pathlib.Path(folder).parent != _HERE:
        before = os.environ.get("LD_LIBRARY_PATH")
        os.environ["LD_LIBRARY_PATH"] = os.pathsep.join([folder, *([before] if before else [])])


def _module(name: str) -> types.ModuleType:
    """A module of the package, without the package."""
    package = types.ModuleType("usdlive_unloaded")
    package.__path__ = [str(_HERE / "usdlive")]
    sys.modules[package.__name__] = package
    return importlib.import_module(f"{package.__name__}.{name}")
