"""Reads the blocks of code in documents, and runs them as a reader does."""

from __future__ import annotations

import os
import pathlib
import re
import subprocess
import sys
import textwrap
import typing

ROOT = pathlib.Path(__file__).parents[2]
BLOCK = re.compile(r"(?:^    .*\n)(?:(?:    .*)?\n)*(?=\S|\Z)", re.MULTILINE)


class Block(typing.NamedTuple):
    """A run of indented lines without their indentation, and the line of text before it."""

    code: str
    before: str


def blocks(document: str) -> list[Block]:
    text = (ROOT / document).read_text()
    found = []
    for match in BLOCK.finditer(text):
        before = text[: match.start()].rstrip().rpartition("\n")[2]
        found.append(Block(textwrap.dedent(match.group()).rstrip("\n") + "\n", before))
    return found


def matches(expected: str, printed: str) -> bool:
    """Whether the output is the expected one, without the space at the beginnings of lines; `...` stands for any text."""
    wanted, found = ("\n".join(line.strip() for line in text.strip().splitlines()) for text in (expected, printed))
    return bool(re.fullmatch(".*".join(map(re.escape, wanted.split("..."))), found, re.DOTALL))


class Reader:
    """Runs commands as a reader does, in an empty folder, with the programs and the Python of the build, for the server at a
    port that is free here."""

    def __init__(self, folder: pathlib.Path, port: int):
        self.folder, self._port = folder / "reader", str(port)
        programs = folder / "bin"
        for one in (self.folder, programs):
            one.mkdir()
        (programs / "usdlive").symlink_to(os.environ["USDLIVE_BIN"])
        path = os.pathsep.join([str(programs), str(pathlib.Path(sys.executable).parent), os.environ["PATH"]])
        self._environment = {**os.environ, "PATH": path, "HOME": str(folder), "USDLIVE_URL": f"ws://127.0.0.1:{port}"}

    def here(self, text: str) -> str:
        """A text of a document with the port."""
        return text.replace("7447", self._port)

    def start(self, code: str, **options) -> subprocess.Popen:
        return subprocess.Popen(["bash", "-c", self.here(code)], cwd=self.folder, env=self._environment, text=True, **options)

    def run(self, code: str) -> str:
        """Returns what the commands print on both outputs."""
        return self.start(code, stdout=subprocess.PIPE, stderr=subprocess.STDOUT).communicate(timeout=60)[0]
