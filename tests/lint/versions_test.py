"""Checks that docs/versions.md and docs/embedding.md have the numbers of the sources, and that the changelog begins with the
version that is built."""

import pathlib
import re

ROOT = pathlib.Path(__file__).resolve().parents[2]
DOCUMENT = (ROOT / "docs" / "versions.md").read_text(encoding="utf-8")


def constant(file, name):
    """The number of a constant in a source."""
    return re.search(rf"\b{name} = (\d+);", (ROOT / file).read_text(encoding="utf-8")).group(1)


def number_of(what):
    """The third cell of a row of the table of formats."""
    return re.search(rf"^\| {what} \|[^|]*\|([^|]*)\|", DOCUMENT, re.MULTILINE).group(1).strip()


def test_the_numbers_of_formats_are_those_of_the_sources():
    store = "server/src/storage/StoreFolder.h"
    assert number_of("the history of a project") == f"{constant(store, 'kFormat')}; reads from {constant(store, 'kOldestFormat')} on"
    assert number_of("accounts") == constant("server/src/auth/Accounts.cpp", "kFormat")
    assert number_of("access rules") == constant("common/src/access/AccessRules.cpp", "kFormat")
    dump = (ROOT / "client/src/cli/StageDump.cpp").read_text(encoding="utf-8")
    assert f'"format", "{number_of("what a stage shows, as JSON").strip("`")}"' in dump


def test_the_versions_of_the_protocol_are_those_of_the_sources():
    frame = "common/include/usdlive/common/protocol/Frame.h"
    newest, oldest = constant(frame, "kProtocolVersion"), constant(frame, "kOldestProtocolVersion")
    said = f"speaks protocol version {newest}, and no older one" if newest == oldest else f"protocol versions {oldest} to {newest}"
    assert said in DOCUMENT
    assert number_of("commits, values and frames") == f"the protocol's, {newest}"


def test_the_table_of_editors_has_what_the_wheel_needs():
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    openusd = re.search(r'^dependencies = \["usd-core==([\d.]+)"\]', project, re.MULTILINE).group(1)
    python = re.search(r'^requires-python = ">=([\d.]+)"', project, re.MULTILINE).group(1)
    embedding = (ROOT / "docs" / "embedding.md").read_text(encoding="utf-8")
    assert f"| `usd-core` {openusd}, CPython {python} | **works**" in embedding


def test_the_table_of_openusd_has_each_environment_of_the_tests():
    """The name of a list of packages, and the row of the table, have the version that the list installs."""
    rows = set(re.findall(r"^\| [\d.]+ \| `([^`]+)`[^|]*\| `./run ([^`]+)` \| ", DOCUMENT, re.MULTILINE))
    wanted = {("usd-core==26.8", "test")}
    for path in (ROOT / ".ci").glob("requirements-*pxr-*.txt"):
        package, version = re.search(r"^(usd-core|bpy)==([\w.]+)$", path.read_text(encoding="utf-8"), re.MULTILINE).groups()
        soak, name = re.fullmatch(r"requirements-(soak-)?pxr-(.+)\.txt", path.name).groups()
        assert name == (f"bpy-{version}" if package == "bpy" else version)
        wanted.add((f"{package}=={version}", "soak versions" if soak else "test"))
    assert rows == wanted


def test_the_changelog_has_the_version_that_is_built():
    built = re.search(r"project\(usdlive VERSION (\S+)", (ROOT / "CMakeLists.txt").read_text(encoding="utf-8")).group(1)
    newest = re.search(r"^## (\S+)", (ROOT / "docs" / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE).group(1)
    assert newest == built and f"find_package(usdlive {built.rpartition('.')[0]})" in DOCUMENT
