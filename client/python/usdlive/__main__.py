"""Runs the command line tool: `python -m usdlive VERB ...` is `usdlive VERB ...` of this installation."""

from __future__ import annotations

import os
import pathlib
import sys
import sysconfig


def program() -> pathlib.Path | None:
    """The tool that was installed, or built, with this package."""
    package = pathlib.Path(__file__).absolute().parent  # not resolved: a build links to the sources
    folders = (sysconfig.get_path("scripts"), sysconfig.get_path("scripts", scheme="posix_user"),
               package.parents[1] / "bin")
    return next((file for folder in folders if os.access(file := pathlib.Path(folder) / "usdlive", os.X_OK)), None)


def main() -> None:
    found = program()
    if found is None:
        sys.exit(f"python -m usdlive: there is no program `usdlive` beside {sys.executable}. Install the package again: "
                 "pip install --force-reinstall usdlive")
    os.execv(found, [str(found), *sys.argv[1:]])


main()
