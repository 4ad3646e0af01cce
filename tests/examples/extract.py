"""Writes the C++ examples of public headers and of the README into one file, each as a function, so that the build
compiles them.

    extract.py OUTPUT README.md HEADER...

An example in a header is a run of comment lines `///     code`; in the README, a block of indented lines that names
`usdlive::`. `live` is a connected client. `#line` makes the compiler name the place of the example.
"""

import pathlib
import re
import sys

# The parts that the examples leave to their reader.
PREAMBLE = """\
#include <pxr/usd/sdf/layer.h>

#include <iostream>

#include "usdlive/client/usd/Client.h"

void edit(const pxr::SdfLayerRefPtr& layer);
void editAndDraw();
"""

HEADER_CODE = re.compile(r"\s*///     (.*)")
README_CODE = re.compile(r"    (.*)")


def blocks(path: pathlib.Path, code: re.Pattern[str]) -> list[tuple[int, list[str]]]:
    """The runs of code in a file, each with the number of its first line."""
    found: list[tuple[int, list[str]]] = []
    isInside = False
    for number, line in enumerate(path.read_text().splitlines(), 1):
        match = code.fullmatch(line)
        if match and not isInside:
            found.append((number, []))
        if match:
            found[-1][1].append(match.group(1))
        isInside = bool(match)
    return found


def main(output: pathlib.Path, readme: pathlib.Path, headers: list[pathlib.Path]) -> None:
    examples = []
    includes = []
    for header in sorted(headers):
        inHeader = [(header, *block) for block in blocks(header, HEADER_CODE)]
        if inHeader:
            includes.append(f'#include "{header.as_posix().rpartition("/include/")[2]}"\n')
        examples += inHeader
    inReadme = [(readme, *block) for block in blocks(readme, README_CODE)
                if any("usdlive::" in line and not line.startswith("target_") for line in block[1])]
    if not examples or not inReadme:
        sys.exit("extract.py: no examples found: have headers or the README another form?")
    text = PREAMBLE + "".join(includes)
    for index, (path, number, lines) in enumerate(examples + inReadme):
        text += f'\nvoid example{index}(usdlive::Client& live);\nvoid example{index}(usdlive::Client& live) {{\n#line {number} "{path}"\n' + "\n".join(lines) + "\n}\n"
    if not output.exists() or output.read_text() != text:
        output.write_text(text)


main(pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]), [pathlib.Path(name) for name in sys.argv[3:]])
