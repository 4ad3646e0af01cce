"""Checks that two source files of one target do not define the same private name.

The sanitizer and fuzzing builds compile several files of a target as one, so a class or a constant in an unnamed
namespace must not have the name of another one in the same target. The release build does not notice.
"""

import collections
import pathlib
import re

ROOT = pathlib.Path(__file__).resolve().parents[2]

# The folders whose files are one target (see the CMakeLists.txt of common, client, server and tests). Those files
# also list the sources that CMake excludes from unity builds (SKIP_UNITY_BUILD_INCLUSION).
TARGETS = [
    ["common/src/core", "common/src/layer", "common/src/protocol"],
    ["common/src/dds"],
    ["common/src/fetch"],
    ["common/src/usd"],
    ["client/src/session"],
    ["client/src/transport"],
    ["client/src/basics", "client/src/values", "client/src/link", "client/src/work"],
    ["client/src/usd"],
    ["client/src/cli"],
    ["client/python/src"],
    ["server/src/project"],
    ["server/src/storage"],
    ["server/src/transport"],
    ["server/src/files"],
    ["server/src/app"],
    ["tests/unit/common/core", "tests/unit/common/dds", "tests/unit/common/layer", "tests/unit/common/protocol"],
    ["tests/unit/common/usd"],
    ["tests/unit/client"],
    ["tests/unit/server"],
    ["tests/unit/bombs"],
    ["tests/simulation"],
    ["tests/model"],
    ["plugins/edf/format"],
    ["plugins/edf/museum"],
    ["plugins/edf/table"],
    ["plugins/obj"],
]

NAMED = re.compile(
    r"^(?:template <.*> )?(?:class|struct|enum class|enum) (\w+)"
    r"|^thread_local [\w:<>, *&]+? (\w+)\s*(?:=|\{|;)"
    r"|^using (\w+) ="
)
CONSTANTS = re.compile(r"^(?:inline )?(?:constexpr|const) [^(]*?[ ,>*]k[A-Z]\w*\s*[={\[]")
CONSTANT = re.compile(r"[ ,>*](k[A-Z]\w*)\s*[={\[]")
FUNCTION = re.compile(r"^[\w:<>,\[\] *&]+?[ *&](\w+\([^;]*)")
ALONE = re.compile(r"([\w./]+\.cpp)[^)]*SKIP_UNITY_BUILD_INCLUSION")


def compiled_alone():
    lists = [ROOT / end / "CMakeLists.txt" for end in ("common", "client", "server", "tests")]
    return {(path.parent / name).resolve() for path in lists for name in ALONE.findall(path.read_text("utf-8"))}


def calls(signature):
    """Returns how a function is called: with types of parameters, with and without those that have a default."""
    name, _, parameters = signature.partition("(")
    every, needed = [], []
    for parameter in re.split(r",(?![^<]*>)", parameters):
        words = re.sub(r"\bconst\b|[&*]", " ", parameter.partition(" = ")[0]).split()
        every.append(" ".join(words[:-1] or words))
        if " = " not in parameter:
            needed.append(every[-1])
    return {f"{name}({', '.join(types)})" for types in (every, needed)}


def private_names(path):
    """Yields (name, its definition) for each definition in an unnamed namespace of the file.

    For a header, these are the constants that it defines for all files.
    """
    inside = path.suffix == ".h"
    lines = path.read_text(encoding="utf-8").splitlines()
    for number, line in enumerate(lines):
        if line == "namespace {":
            inside = True
        elif line.startswith("}  // namespace"):
            inside = False
        elif inside and line and not line[0].isspace():
            if CONSTANTS.match(line):
                for match in CONSTANT.finditer(line):
                    yield match.group(1), None
            elif path.suffix == ".h":
                continue
            elif (match := NAMED.match(line)) and not line.endswith(";" if line.startswith(("class", "struct")) else "\0"):
                name = next(group for group in match.groups() if group)
                yield name, line if line.startswith("using") else None
            elif match := FUNCTION.match(line):
                # Overloads are allowed, unless a call can be ambiguous.
                signature = match.group(1)
                while ")" not in signature and number + 1 < len(lines):
                    number += 1
                    signature += lines[number].strip()
                for call in calls(re.sub(r"\s+", " ", signature.partition(") {")[0].rstrip(")"))):
                    yield call, None


def test_private_names_of_a_target_differ():
    alone = compiled_alone()
    clashes = []
    for folders in TARGETS:
        places = collections.defaultdict(dict)
        for folder in folders:
            for path in sorted((ROOT / folder).rglob("*.[ch]*")):
                if path not in alone:
                    for name, text in private_names(path):
                        places[name][path.relative_to(ROOT)] = text
        for name, texts in places.items():
            same_alias = None not in texts.values() and len(set(texts.values())) == 1
            if len(texts) > 1 and not same_alias:
                clashes.append(f"{name}: {', '.join(map(str, texts))}")
    assert not clashes, "defined in several files of one target:\n" + "\n".join(clashes)
