"""Reads the blocks of code in documents, for the tests that run them."""

from __future__ import annotations

import pathlib
import re
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
