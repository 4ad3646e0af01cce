"""Checks that a name stands for one thing, and that what has a name is used."""

import ast
import collections
import pathlib
import re

ROOT = pathlib.Path(__file__).resolve().parents[2]
PRODUCT = ["common", "server", "client", "plugins"]

CLASS = re.compile(r"^(?:template ?<.*> )?(?:class|struct|enum class) (\w+)(?: final)?(?: : .*)? \{", re.MULTILINE)
# Class names that exist twice, and why.
SAME_CLASSES = {
    "Session": "the two ends of one session, on a server and in a client",
    "LayerOpened": "the answer of the server, and the event of a client",
    "Address": "`museum` is a service of its own, which links nothing of usdlive",
}

DECLARED = re.compile(
    r"^ {0,4}(?:\[\[nodiscard\]\] |virtual |static |inline |explicit |friend |constexpr )*"
    r"(?!return|else|throw|co_|case|delete|new|using)[A-Za-z][\w:<>,&* \[\]]+?[ &*]([a-z]\w*)\(", re.MULTILINE)
# Functions of headers that no product code calls by name, and why.
UNCALLED = {
    "applyToPrim": "called by generated classes of schemas",
    "definePrim": "called by generated classes of schemas",
    "removeFromPrim": "called by generated classes of schemas",
    "setTargets": "called by generated classes of schemas",
    "overflow": "called by std::ostream",
    "async_teardown": "called by Beast",
    "beast_close_socket": "called by Beast",
    "teardown": "called by Beast",
    "createMemoryBlobStore": "the second implementation of a port, for tests and benchmarks",
    "createMemoryCommitStore": "the second implementation of a port, for tests and benchmarks",
}


def sources(*suffixes):
    """Yields (path, text without comments) of the product."""
    for folder in PRODUCT:
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in suffixes:
                yield path, re.sub(r"//.*", "", path.read_text(encoding="utf-8"))


def test_a_class_name_belongs_to_one_place():
    places = collections.defaultdict(set)
    for path, text in sources(".h"):
        for name in CLASS.findall(text):
            places[name].add(str(path.relative_to(ROOT)))
    twice = {name: sorted(paths) for name, paths in places.items() if len(paths) > 1}
    assert twice.keys() == SAME_CLASSES.keys(), {
        name: twice.get(name, "no longer there twice") for name in twice.keys() ^ SAME_CLASSES.keys()}


def test_functions_of_headers_are_called():
    """A function that only tests call is no part of the product. Functions of installed headers are for others."""
    texts = dict(sources(".h", ".cpp"))
    words = collections.Counter(word for text in texts.values() for word in re.findall(r"\w+", text))
    declared = collections.Counter(
        name for path, text in texts.items() if path.suffix == ".h" and "client/include" not in path.as_posix()
        for name in DECLARED.findall(text))
    defined = collections.Counter(
        name for path, text in texts.items() if path.suffix == ".cpp"
        for name in re.findall(r"^(?:[A-Za-z\[][\w:<>,&*\[\] ]*[ &*])?(?:\w+::)*([a-z]\w*)\(", text, re.MULTILINE))
    uncalled = {name for name, count in declared.items() if words[name] <= count + defined[name]}
    assert uncalled == UNCALLED.keys(), f"remove it, or from UNCALLED: {sorted(uncalled ^ UNCALLED.keys())}"


def test_a_test_stands_in_one_file():
    names, bodies = collections.defaultdict(set), collections.defaultdict(set)
    for path in sorted((ROOT / "tests").rglob("*_test.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                names[node.name].add(path.name)
    for path in sorted((ROOT / "tests").rglob("*.cpp")):
        for suite, name, body in re.findall(r"^TEST(?:_F|_P)?\((\w+), (\w+)\) \{\n(.*?)^\}", path.read_text("utf-8"),
                                            re.MULTILINE | re.DOTALL):
            names[f"{suite}.{name}"].add(path.name)
            if body.count("\n") > 2:
                bodies[body].add(f"{path.name} {suite}.{name}")
    found = [f"{name}: {sorted(files)}" for name, files in names.items() if len(files) > 1]
    found += [str(sorted(tests)) for tests in bodies.values() if len(tests) > 1]
    assert not found, "\n".join(found)
