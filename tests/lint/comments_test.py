"""Checks how comments begin.

A comment is a plain sentence or an imperative: "Returns ...", "The newest commit". It does not begin with a clause that
hides the subject or the verb ("What a store holds.", "Of the newest commit."). The first comment of a source file says
what the file is for.
"""

import ast
import io
import pathlib
import re
import tokenize

ROOT = pathlib.Path(__file__).resolve().parents[2]
FOLDERS = ["bench", "client", "common", "docker", "plugins", "server", "tests"]
CODE = {".h", ".cpp", ".idl"}
TYPESCRIPT = {".ts", ".tsx"}

OPENING = re.compile(r"(?:who|what|of|where|as|whoever|whatever)\b", re.IGNORECASE)
WHOLE_LINE = re.compile(r"^(\s*)//[/!]?<?\s?(.*)$")
BLOCK = re.compile(r"^\s*/\*\*?\s+(.*)$")
TRAILING = re.compile(
    r"""^((?:[^"'/]|(?<=\d)'(?=\d)|"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*'|/(?!/))+)//[/!]?<?\s?(.*)$""")

# Folders and files whose comments still begin in another way. An entry without a finding fails.
EXCEPTED_OPENINGS = []
# Folders that have source files without a first comment. An entry without a finding fails.
EXCEPTED_FIRST = []


def source_files(suffixes):
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in suffixes and path.is_file():
                yield path


def openings(text):
    """Yields (line number, text) for each comment of C++ or IDL, and for each paragraph of a longer one."""
    column = None  # the column of a comment that the next line may continue
    for number, line in enumerate(text.splitlines(), 1):
        if whole := WHOLE_LINE.match(line):
            here = len(whole[1])
            if here != column and whole[2]:
                yield number, whole[2]
            column = here if whole[2] else None
        elif trailing := TRAILING.match(line):
            yield number, trailing[2]
            column = len(trailing[1])
        else:
            column = None


def typescript_openings(text):
    """Yields (line number, text) for each comment of TypeScript."""
    yield from openings(text)
    lines = text.splitlines()
    for number, line in enumerate(lines, 1):
        if block := BLOCK.match(line):
            yield number, block[1]
        elif line.strip() == "/**" and number < len(lines):
            yield number + 1, lines[number].strip().lstrip("* ")


def python_openings(text):
    """Yields (line number, text) for each comment and each docstring of a Python file."""
    column = None
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            if token.start != column:
                yield token.start[0], token.string.lstrip("#! ")
            column = (token.start[0] + 1, token.start[1])
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            if docstring := ast.get_docstring(node):
                yield node.body[0].lineno, docstring


def excepted(path, entries):
    return next((entry for entry in entries if path == entry or path.startswith(entry + "/")), None)


def check(findings, entries):
    """`findings`: (path, text). Fails for findings that no entry excepts, and for entries without a finding."""
    used = {excepted(path, entries) for path, _ in findings}
    assert not (left := [text for path, text in findings if not excepted(path, entries)]), "\n".join(left)
    assert not (unused := set(entries) - used), f"remove these exceptions: {sorted(unused)}"


def test_comments_begin_with_their_subject_or_verb():
    findings = []
    for path in source_files(CODE | TYPESCRIPT | {".py"}):
        text = path.read_text(encoding="utf-8")
        name = path.relative_to(ROOT).as_posix()
        found = python_openings if path.suffix == ".py" else typescript_openings if path.suffix in TYPESCRIPT else openings
        for number, comment in found(text):
            if OPENING.match(comment):
                findings.append((name, f"{name}:{number}: {comment.splitlines()[0]}"))
    check(findings, EXCEPTED_OPENINGS)


def test_source_files_begin_with_a_comment():
    findings = []
    for path in source_files(CODE | TYPESCRIPT):
        name = path.relative_to(ROOT).as_posix()
        if not path.read_text(encoding="utf-8").startswith("//"):
            findings.append((name, f"{name} begins without a comment that says what it is for"))
    check(findings, EXCEPTED_FIRST)


def test_the_openings_are_found():
    text = """\
// What it holds.
int a;  ///< of all sessions
        ///< of one
/// A value.
///
/// Of the newest commit.
const char* url = "http://what";  // where it is
int b = 1'000;  // as long as that
"""
    found = [number for number, comment in openings(text) if OPENING.match(comment)]
    assert found == [1, 2, 6, 7, 8]
    python = '"""As it is."""\nx = "# what"  # of y\n# A sentence,\n# of two lines.\ndef f():\n    """Whatever."""\n'
    assert [number for number, comment in python_openings(python) if OPENING.match(comment)] == [2, 1, 6]
    typescript = "/** What it is. */\n/**\n * As it was.\n */\nlet a = 1;  // of b\n// A sentence.\n"
    assert {number for number, comment in typescript_openings(typescript) if OPENING.match(comment)} == {1, 3, 5}
