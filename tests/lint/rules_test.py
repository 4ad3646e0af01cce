"""Checks that each number of a rule in docs/PROTOCOL.md stands for one rule, and that every cited rule
exists."""

import collections
import pathlib
import re

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROTOCOL = ROOT / "docs" / "PROTOCOL.md"
SUFFIXES = {".h", ".cpp", ".py", ".fbs", ".idl", ".md"}
FOLDERS = ["common", "server", "client", "plugins", "tests", "bench", "docs"]
DEFINITION = re.compile(r"\*\*([A-Z]{1,2})(\d+)\*\*")
# The places that cite rules: comments, documents, and the names of tests, which begin with a number.
CPP_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/|(?<=, )[A-Z]{1,2}\d+(?=[A-Z]\w*\)\s*\{)", re.DOTALL)
PYTHON_COMMENT = re.compile(r"#[^\n]*|\"\"\".*?\"\"\"", re.DOTALL)


def defined():
    return DEFINITION.findall(PROTOCOL.read_text(encoding="utf-8"))


def texts():
    """Yields (file, the part of its text that may cite rules)."""
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix not in SUFFIXES or not path.is_file():
                continue
            text = path.read_text(encoding="utf-8")
            part = {".md": None, ".py": PYTHON_COMMENT}.get(path.suffix, CPP_COMMENT)
            yield path.relative_to(ROOT), text if part is None else "\n".join(part.findall(text))


def test_a_number_stands_for_one_rule():
    twice = [f"{family}{number}" for (family, number), count in collections.Counter(defined()).items() if count > 1]
    assert not twice, f"docs/PROTOCOL.md has two rules of the number {', '.join(twice)}"


def test_rules_that_are_named_exist():
    rules = {f"{family}{number}" for family, number in defined()}
    families = "|".join(sorted({family for family, _ in defined()}, key=len, reverse=True))
    reference = re.compile(rf"\b((?:{families})\d{{1,2}})\b")
    missing = [f"{path}: {name}" for path, text in texts() for name in reference.findall(text) if name not in rules]
    assert not missing, "not in docs/PROTOCOL.md:\n" + "\n".join(missing)
