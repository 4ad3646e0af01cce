"""Writes the example of a README into a folder: each code block is the file that the line before it names.

    extract.py README.md FOLDER

A file is named on a line of its own, such as `HelloProvider.cpp`:
"""

import pathlib
import re
import sys

BLOCK = re.compile(r"^`([\w.]+)`:\n+```\w*\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def main(readme: pathlib.Path, folder: pathlib.Path) -> None:
    found = BLOCK.findall(readme.read_text())
    if len(found) < 3:
        sys.exit(f"{readme}: expected three files of the example, found {[name for name, _ in found]}")
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in found:
        file = folder / name
        if not file.exists() or file.read_text() != text:
            file.write_text(text)


main(pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]))
