"""Checks that includes point one way and that third-party headers stay in their folders
(docs/architecture.md).

Every rule is checked over all sources of the tree at once, so that a failure lists each offending line.
"""

import pathlib
import re

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
INCLUDE = re.compile(r'^\s*#\s*include\s*[<"]([^">]+)[">]', re.MULTILINE)
SOURCE_SUFFIXES = {".h", ".cpp"}
FOLDERS = ["common", "server", "client", "plugins", "tests", "bench"]

# The area of a file, and the areas whose headers it may include. An area is a folder of common, server or
# client ("server/project"); a prefix ("common/") means all areas below it.
COMMON_PLAIN = ["common/core", "common/layer", "common/protocol"]
# The client without OpenUSD. None of these includes one after it.
CLIENT_PLAIN = ["client/session", "client/transport", "client/basics", "client/values", "client/link", "client/work",
                "client/history", "client/lines"]
SERVER_EDGES = ["server/transport", "server/storage", "server/files"]
ALLOWED = {
    **{area: COMMON_PLAIN for area in COMMON_PLAIN},
    "common/access": [*COMMON_PLAIN, "common/access"],
    "common/history": [*COMMON_PLAIN, "common/access", "common/history"],
    "common/transport": COMMON_PLAIN,
    "common/dds": COMMON_PLAIN,
    "common/net": ["common/core"],
    "common/fetch": ["common/core", "common/net"],
    "common/usd": ["common/"],
    "server/project": [*COMMON_PLAIN, "common/access"],
    "server/storage": [*COMMON_PLAIN, "server/project"],
    "server/transport": [*COMMON_PLAIN, "common/transport", "common/dds", "common/net", "server/project"],
    "server/files": ["common/", "server/project"],
    "server/auth": [*COMMON_PLAIN, "common/access", "common/net", "server/project"],
    "server/app": ["common/", "server/project", "server/auth", *SERVER_EDGES],
    "client/session": [*COMMON_PLAIN, "common/access"],
    "client/transport": [*COMMON_PLAIN, "common/transport", "common/dds", "common/net", "common/fetch", "client/session"],
    "client/basics": COMMON_PLAIN,
    "client/values": [*COMMON_PLAIN, "client/session", "client/basics"],
    "client/link": [*COMMON_PLAIN, "common/fetch", "common/net", *CLIENT_PLAIN[:3]],
    "client/work": [*COMMON_PLAIN, *CLIENT_PLAIN[:5]],
    "client/history": [*COMMON_PLAIN, "common/access", "common/history", "client/session", "client/basics"],
    "client/lines": [*COMMON_PLAIN, *CLIENT_PLAIN[:5], "client/history"],
    # Layers and stages of any editor, without a connection.
    "client/usd/content": ["common/", "client/session", "client/usd"],
    "client/usd/schema": ["common/"],
    "client/usd/stage": ["common/", "client/usd/content", "client/usd/schema"],
    "client/usd/namespace": ["common/", "client/usd", "client/usd/content", "client/usd/schema", "client/usd/stage"],
    # Live layers.
    "client/usd/places": ["common/", "client/session", "client/transport", "client/basics", "client/usd"],
    "client/usd/live": ["common/", "client/session", "client/basics", "client/values", "client/work",
                        "client/usd/places"],
    "client/usd/assets": ["common/", "client/basics", "client/usd/places", "client/usd/live"],
    "client/usd/editor": ["common/", *CLIENT_PLAIN, "client/usd", "client/usd/places", "client/usd/live",
                          "client/usd/assets", "client/usd/content"],
    # Kit's layers, of any stage; live ones by way of the client.
    "client/usd/layers": ["common/", "client/basics", "client/usd", "client/usd/content", "client/usd/stage",
                          "client/usd/editor"],
    "client/usd": ["common/core"],  # two headers beside the folders
    "client/cli": ["common/", "client/"],
    "client/python": ["common/", "client/"],
    "client/examples": ["common/", "client/"],
    # Loaded into programs that have nothing of usdlive.
    "plugins/obj": [],
    "plugins/edf/museum": ["common/core", "common/fetch"],
    "plugins/edf": [],
    "plugins/resolver": ["common/core", "common/fetch"],
    "plugins/schemaTools": ["common/", "client/", "plugins/"],
}

# A third-party header, and the folders that may include it: prefixes of the path in the tree.
EDGES = {
    r"pxr/": [
        "common/usd",
        "client/usd",
        "client/cli",
        "client/python",
        "client/examples",
        "server/files",
        "plugins",
        "tests/unit/common/usd",
        "tests/unit/client/usd",
        "tests/unit/server/files",
        "tests/contract",
        "tests/examples/openusd",
        "tests/simulation",
        "tests/demo",
        "tests/edf",
        "tests/probe",
        "tests/watch",
        "tests/schemas",
        "tests/schemaKinds",
        "tests/fuzz",
        "bench",
    ],
    r"rocksdb/": ["server/storage", "tests/unit/server/storage", "tests/fuzz"],
    r"boost/(asio|beast)": [
        "common/net",
        "server/transport",
        "server/app",
        "client/transport",
        "client/cli",
        "common/fetch",
        "tests/conformance",
        "tests/unit/common/net",
        "tests/unit/server/transport",
        "tests/unit/client/transport",
        "tests/contract",
        "tests/integration",
        "tests/fuzz",
        "bench",
    ],
    r"(dds|ddsc)/|usdlive/common/dds/(Topics|StateSamples|usdlive)\.h": [
        "common/dds",
        "tests/unit/common/dds",
        "tests/stranger",
        "server/transport",
        "client/transport",
    ],
    r"openssl/": ["common/core", "common/dds", "common/net", "server/auth", "server/transport",
                 "tests/unit/common/net", "tests/unit/server/auth", "bench"],
    r"prometheus/": ["server/transport", "server/app", "tests/unit/server"],
    r"spdlog/": ["server/transport", "server/app", "server/files", "tests/unit/server"],
    r"CLI/": ["server/app", "client/cli"],
    r"nanobind/": ["client/python"],
}


def source_files():
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in SOURCE_SUFFIXES:
                yield path


def room(parts):
    """Returns usd/live for usd/live/Capture.h, and session for session/Session.h."""
    if parts[0] != "usd":
        return parts[0]
    if parts[-1] == "Client.h" and len(parts) == 2:
        return "usd/editor"
    return "/".join(parts[:2]) if len(parts) > 2 and (ROOT / "client/src/usd" / parts[1]).is_dir() else "usd"


def area_of(path):
    """Returns the area: client/include/usdlive/client/usd/Client.h and client/src/usd/editor/Client.cpp both belong
    to client/usd/editor."""
    parts = path.relative_to(ROOT).parts
    if len(parts) > 4 and parts[1] == "include":
        return f"{parts[0]}/{room(parts[4:])}"
    if len(parts) > 3 and parts[1] == "src":
        return f"{parts[0]}/{room(parts[2:])}"
    if parts[0] in ("tests", "bench", "plugins"):
        return "/".join(parts[:-1])
    return "/".join(parts[:2])


def area_of_include(include):
    """Returns the area of one of our headers; None for all others. usdlive/client/usd/stage/Stage.h is
    installed, and usd/stage/Clips.h is a private header of the client, in client/src: both are of client/usd/stage.
    No header of the server is installed."""
    parts = include.split("/")
    if parts[0] == "usdlive":
        return f"{parts[1]}/{room(parts[2:])}" if len(parts) > 3 else None
    if len(parts) > 1:
        for program in ("client", "server"):
            if (ROOT / program / "src" / include).is_file():
                return f"{program}/{room(parts)}"
    return None


def all_includes():
    """Yields (file, line, area of the file, header) for every include of the tree."""
    for path in source_files():
        text = path.read_text(encoding="utf-8")
        for match in INCLUDE.finditer(text):
            line = text.count("\n", 0, match.start(1)) + 1
            yield path.relative_to(ROOT), line, area_of(path), match.group(1)


def listed(offences):
    return "\n" + "\n".join(f"{path}:{line}: {area} includes {header}" for path, line, area, header in offences)


def test_parts_include_in_one_direction():
    def allowed(area, header):
        target = area_of_include(header)
        own = next((known for known in ALLOWED if area == known or area.startswith(known + "/")), None)
        if target is None or own is None or target == own:
            return True
        return any(target == ok or ok.endswith("/") and target.startswith(ok) for ok in ALLOWED[own])

    offences = [found for found in all_includes() if not allowed(found[2], found[3])]
    assert not offences, listed(offences)


# The inside of server/project, each folder with those before it.
PROJECT = ["ports", "lines", "sessions", "layers", "access", "stream", "clients", "files", "upkeep"]


def test_parts_of_a_project_include_in_one_direction():
    """A part refers to the parts below it, and to none of those above or to the whole."""
    inside = ROOT / "server" / "src" / "project"
    assert sorted(path.name for path in inside.iterdir() if path.is_dir()) == sorted(PROJECT)
    offences = []
    for path in sorted(inside.glob("*/*")):
        below = PROJECT[: PROJECT.index(path.parent.name) + 1]
        for include in re.findall(r'#include "([^"]+)"', path.read_text(encoding="utf-8")):
            top, folder, *rest = include.split("/")
            is_above = folder not in below if rest else folder == "ProjectImpl.h"
            if top == "project" and is_above:
                offences.append(f"{path.relative_to(ROOT)} includes {include}")
    assert not offences, "\n".join(offences)


def test_every_part_has_a_rule():
    known = tuple(ALLOWED)
    unknown = {
        area
        for area in map(area_of, source_files())
        if area.split("/")[0] not in ("tests", "bench") and not area.startswith(known)
    }
    assert not unknown, f"add to ALLOWED: {sorted(unknown)}"


def test_every_rule_has_a_part():
    areas = set(map(area_of, source_files()))
    gone = [rule for rule in ALLOWED if not any(area == rule or area.startswith(rule + "/") for area in areas)]
    assert not gone, f"remove from ALLOWED: {gone}"


@pytest.mark.parametrize("header", EDGES)
def test_third_party_headers_stay_at_their_edge(header):
    offences = [
        (path, line, area, include)
        for path, line, area, include in all_includes()
        if re.match(header, include) and not area.startswith(tuple(EDGES[header]))
    ]
    assert not offences, listed(offences)


def test_json_headers_are_included_by_sources_only():
    """json_fwd.hpp only declares the type, which a header may do."""
    offences = [
        found for found in all_includes()
        if found[3].startswith("nlohmann/") and found[3] != "nlohmann/json_fwd.hpp" and found[0].suffix == ".h"
    ]
    assert not offences, listed(offences)


def test_headers_are_included_by_their_full_path():
    """Includes have the form usdlive/common/core/Id.h and not ../core/Id.h, so that these rules find every
    include."""
    offences = [
        found for found in all_includes()
        if found[3].startswith((".", "/"))
        or found[0].as_posix().startswith(("client/src/", "server/src/")) and (ROOT / found[0].parent / found[3]).is_file()
    ]
    assert not offences, listed(offences)


def test_installed_headers_include_no_private_ones():
    """All of client/include is installed, and no header of client/src is: so no header of client/include includes
    one."""
    offences = [
        found for found in all_includes()
        if found[0].as_posix().startswith("client/include/") and area_of_include(found[3])
        and not found[3].startswith("usdlive/")
    ]
    assert not offences, listed(offences)
