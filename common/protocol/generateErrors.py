"""Writes the error codes for C++, Python and TypeScript from errors.json, their one table."""

import json
import pathlib
import re
import sys

HEADER = """// Generated from common/protocol/errors.json. Do not edit.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

namespace usdlive {{

enum class ErrorCode : std::uint16_t {{
{enumerators}
}};

/// The code as it is written on the wire, in JSON, Python and TypeScript: `layerNotFound`.
[[nodiscard]] std::string_view errorName(ErrorCode code);

/// One plain sentence for people.
[[nodiscard]] std::string_view errorText(ErrorCode code);

/// The code of that name; none for a name of a newer version.
[[nodiscard]] std::optional<ErrorCode> errorFromName(std::string_view name);

}}  // namespace usdlive
"""

SOURCE = """// Generated from common/protocol/errors.json. Do not edit.
#include <array>
#include <cstddef>

#include "usdlive/common/core/ErrorPasses.h"

namespace usdlive {{

namespace {{

struct Row {{
    std::string_view name;
    std::string_view text;
    bool passes;
}};

constexpr std::array<Row, {count}> kRows{{{{
{rows}
}}}};

constexpr Row kUnknown{{"unknown", "an error of a newer version", false}};

const Row& row(ErrorCode code) {{
    const auto index = static_cast<std::size_t>(code);
    return index < kRows.size() ? kRows[index] : kUnknown;
}}

}}  // namespace

std::string_view errorName(ErrorCode code) {{ return row(code).name; }}

std::string_view errorText(ErrorCode code) {{ return row(code).text; }}

bool errorPasses(ErrorCode code) {{ return row(code).passes; }}

std::optional<ErrorCode> errorFromName(std::string_view name) {{
    for (std::size_t index = 0; index < kRows.size(); ++index)
        if (kRows[index].name == name) return static_cast<ErrorCode>(index);
    return std::nullopt;
}}

}}  // namespace usdlive
"""


PYTHON = '''"""Generated from common/protocol/errors.json. Do not edit."""

import enum


class ErrorCode(enum.StrEnum):
    """The code of an error, as it is written on the wire: `ErrorCode.LAYER_NOT_FOUND == "layerNotFound"`."""

{members}

    @property
    def passes(self):
        """Whether the reason passes by itself, such as a full disk of the server. What was refused for it is kept, and is
        sent again later."""
        return self in _PASSING


_PASSING = frozenset(({passing}))
'''

TYPESCRIPT = """// Generated from common/protocol/errors.json. Do not edit.

/** Each code as it is written on the wire, and one plain sentence for people. */
export const errorTexts = {{
{members}
}} as const;

export type ErrorCode = keyof typeof errorTexts;

/** A newer server may know codes that are not among these. */
export function isErrorCode(code: string): code is ErrorCode {{
  return Object.hasOwn(errorTexts, code);
}}

/** The errors whose reason passes by itself. What was refused for one of them is kept, and is sent again later. */
export const passingErrors: ReadonlySet<string> = new Set<ErrorCode>([
{passing}
]);
"""


def read_errors(path):
    errors = json.loads(path.read_text(encoding="utf-8"))["errors"]
    codes = [error["code"] for error in errors]
    for code in codes:
        if not re.fullmatch(r"[a-z][A-Za-z0-9]*", code):
            raise SystemExit(f"{path}: '{code}' is not a camelCase name")
    repeated = sorted({code for code in codes if codes.count(code) > 1})
    if repeated:
        raise SystemExit(f"{path}: repeated: {', '.join(repeated)}")
    return [(error["code"], error["text"], error.get("passes", False)) for error in errors]


def literal(text):
    return json.dumps(text, ensure_ascii=False)


def write(path, text):
    """Writes a file unless it has this text: a change of one output does not compile again what includes another."""
    path = pathlib.Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def main(errors_path, header_path, source_path, python_path, typescript_path):
    errors = read_errors(pathlib.Path(errors_path))
    enumerators = "\n".join(f"    {code[0].upper()}{code[1:]}," for code, *_ in errors)
    rows = "\n".join(f"    {{{literal(code)}, {literal(text)}, {literal(passes)}}}," for code, text, passes in errors)
    write(header_path, HEADER.format(enumerators=enumerators))
    write(source_path, SOURCE.format(count=len(errors), rows=rows))
    constants = [(re.sub("([A-Z])", r"_\1", code).upper(), code, text, passes) for code, text, passes in errors]
    write(python_path, PYTHON.format(
        members="\n".join(f"    {name} = {literal(code)}\n    {literal(text)}" for name, code, text, _ in constants),
        passing=", ".join(f"ErrorCode.{name}" for name, _, _, passes in constants if passes)))
    write(typescript_path, TYPESCRIPT.format(members="\n".join(
        f"  {code}: {literal(text)}," for code, text, _ in errors),
        passing="\n".join(f"  {literal(code)}," for code, _, passes in errors if passes)))


if __name__ == "__main__":
    main(*sys.argv[1:])
