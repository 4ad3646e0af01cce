"""Checks that each claim of docs/security.md has tests, and that they exist."""

import pathlib
import re

ROOT = pathlib.Path(__file__).resolve().parents[2]
ROW = re.compile(r"^\| (.+?) \| (.+) \|$", re.MULTILINE)
NAME = re.compile(r"`([^`]+)`")


def rows(title):
    """The cells of the table in a section, without its head."""
    text = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
    section = text.split(f"\n## {title}\n")[1].split("\n## ")[0]
    return [row for row in ROW.findall(section) if row[0] not in ("from whom", "---")]


def exists(name, suites):
    """`name` is a test of pytest, or of a suite; `...` at the end stands for all that begin so."""
    if "::" in name:
        file, _, test = name.partition("::")
        return f"\ndef {test}(" in (ROOT / "tests" / "integration" / file).read_text(encoding="utf-8")
    if name.endswith("..."):
        return any(suite.startswith(name[:-3]) for suite in suites)
    return name in suites


def test_each_claim_has_tests_that_exist():
    files = [path for kind in ("unit", "contract") for path in (ROOT / "tests" / kind).rglob("*Test.cpp")]
    sources = "\n".join(path.read_text(encoding="utf-8") for path in files)
    suites = {f"{suite}.{test}" for suite, test in re.findall(r"^TEST(?:_[FP])?\((\w+),\s*(\w+)\)", sources, re.MULTILINE)}
    claims, tests = rows("What is protected"), dict(rows("The test of each claim"))
    assert [claim for claim, _ in claims] == list(tests)
    missing = [name for cell in tests.values() for name in NAME.findall(cell) if not exists(name, suites)]
    assert not missing and all(NAME.findall(cell) for cell in tests.values())
