"""A client belongs to one thread: the unit test that calls every function of Client on another thread knows them all."""

import pathlib
import re

ROOT = pathlib.Path(__file__).resolve().parents[2]
# They work on any thread, or have no client yet.
EXEMPT = {"Client", "connect", "misuse", "filesProblem"}


def public_functions(header: str) -> set[str]:
    body = header[header.index("class Client {"):]
    body = re.sub(r"struct \w+ \{.*?\n    \};", "", body[:body.index("\nprivate:")], flags=re.DOTALL)
    body = re.sub(r"//.*", "", body)
    return set(re.findall(r"(?<![\w:])(\w+)\((?=[^;]*;)", body)) - {"void", "nodiscard", "function"}


def test_every_function_of_client_is_called_on_another_thread():
    header = (ROOT / "client/include/usdlive/client/usd/Client.h").read_text()
    test = (ROOT / "tests/unit/client/usd/editor/ClientThreadTest.cpp").read_text()
    listed = set(re.findall(r"(?:THROWS|RETURNS)\((\w+)", test)) - {"name"}
    functions = {name for name in public_functions(header) if name[0].islower()} - EXEMPT
    assert len(functions) > 35, functions
    assert functions - listed == set(), "add to kFunctions of ClientThreadTest.cpp"
    assert listed - functions == set(), "not in Client.h"
