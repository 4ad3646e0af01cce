"""Writes IdentifierRanges.h: which code points OpenUSD takes in identifiers, asked of usd-core itself.

Run it with a new usd-core: python generateIdentifierRanges.py > IdentifierRanges.h
"""

from pxr import Sdf, Usd


def ranges(accepts):
    found = []
    for point in range(0x80, 0x110000):
        if 0xD800 <= point <= 0xDFFF or not accepts(chr(point)):
            continue
        if found and found[-1][1] == point - 1:
            found[-1][1] = point
        else:
            found.append([point, point])
    return found


def table(name, found):
    cells = [f"{{0x{first:X}, 0x{last:X}}}," for first, last in found]
    lines, line = [], "   "
    for cell in cells:
        if len(line) + 1 + len(cell) > 100:
            lines.append(line)
            line = "   "
        line += " " + cell
    lines.append(line)
    return f"inline constexpr CodePointRange {name}[] = {{\n" + "\n".join(lines) + "\n};\n"


version = ".".join(str(part) for part in Usd.GetVersion())
print(f"""// Written by generateIdentifierRanges.py from OpenUSD {version}. Do not edit.
#pragma once

namespace usdlive {{

struct CodePointRange {{
    char32_t first;
    char32_t last;
}};

// Above U+007F, sorted: XID_Start and XID_Continue of Unicode, as OpenUSD has them.
// clang-format off
{table("kIdentifierStart", ranges(Sdf.Path.IsValidIdentifier))}
{table("kIdentifierContinue", ranges(lambda text: Sdf.Path.IsValidIdentifier("a" + text)))}// clang-format on

}}  // namespace usdlive""")
