"""A build from outside the tree: the installed package is moved to another place, works without the checkout,
and the example of the README runs."""

import os
import pathlib
import re
import shutil
import subprocess

import pytest
from conftest import cat

CHECKOUT = pathlib.Path(__file__).parents[2]
EXAMPLES = CHECKOUT / "client" / "examples"
EXAMPLE = EXAMPLES / "minimal"
# Files that only a checkout, or Python's development package, has.
OUT_OF_REACH = (str(CHECKOUT), os.environ["USDLIVE_BUILD"], "/usr/include/python3")


def output(*command, **options) -> str:
    done = subprocess.run([str(word) for word in command], check=False, text=True, stdout=subprocess.PIPE,
                          env=bare_environment(), **options)
    assert done.returncode == 0, done.stdout[-5000:]
    return done.stdout


def bare_environment() -> dict[str, str]:
    return {name: value for name, value in os.environ.items()
            if not name.startswith("USDLIVE_") and name not in ("PYTHONPATH", "LD_LIBRARY_PATH")}


@pytest.fixture(scope="module")
def prefix(tmp_path_factory):
    """The package, installed in one place and moved to another."""
    folder = tmp_path_factory.mktemp("installed")
    output("cmake", "--install", os.environ["USDLIVE_BUILD"], "--prefix", folder / "first", "--strip")
    (folder / "first").rename(folder / "moved")
    return folder / "moved"


def test_find_package_from_outside_the_tree(tmp_path, project, serve, prefix):
    (project / "shot.usda").write_text("#usda 1.0\n")
    source, build = tmp_path / "example", tmp_path / "build"
    shutil.copytree(EXAMPLE, source)
    output("cmake", "-G", "Ninja", "-S", source, "-B", build, f"-DCMAKE_PREFIX_PATH={prefix}",
           "-DCMAKE_BUILD_TYPE=Release")
    output("cmake", "--build", build)
    read = output("ninja", "-C", build, "-t", "deps") + (build / "build.ninja").read_text()
    assert f"{prefix}/lib/usdlive/include/pxr" in read, "the headers of the package are used"
    assert not [path for path in OUT_OF_REACH if path in read]
    assert str(prefix) in output("ldd", build / "minimal")
    assert str(CHECKOUT) not in output("ldd", build / "minimal")
    assert len((source / "main.cpp").read_text().splitlines()) <= 30
    server = serve(project)
    done = subprocess.run([build / "minimal", server.url, "shot.usda", "ada"], capture_output=True,
                          text=True, timeout=60, check=False, env=bare_environment())
    assert done.returncode == 0, done.stderr
    assert '"frame 119"' in cat(server, "shot.usda")


WARNINGS = "-Wall -Wextra -Werror -Wno-missing-field-initializers"


def test_the_example_of_the_layers_api_runs(tmp_path, project, serve, prefix):
    (project / "shot.usda").write_text("#usda 1.0\n(\n    subLayers = [@./set.usda@]\n)\n")
    (project / "set.usda").write_text('#usda 1.0\n\ndef "World" (\n    "before"\n    doc = "to be cleared"\n)\n{\n}\n')
    build = tmp_path / "build"
    output("cmake", "-G", "Ninja", "-S", EXAMPLES / "layers", "-B", build, f"-DCMAKE_PREFIX_PATH={prefix}",
           "-DCMAKE_BUILD_TYPE=Release", f"-DCMAKE_CXX_FLAGS={WARNINGS}")
    output("cmake", "--build", build)
    printed = output(build / "layers", serve(project).url, "shot.usda", "ada").splitlines()
    assert any(line.startswith("edited") and line.endswith("set.usda") for line in printed), printed
    assert any(line.startswith("lock_state_changed") and line.endswith("set.usda") for line in printed), printed
    assert any(line.startswith("refused /World") and "is locked" in line for line in printed), printed
    assert {"saved shot.usda", "saved set.usda"} <= set(printed)
    text = (project / "set.usda").read_text()
    assert '"edited by ada"' in text and "too late" not in text and "locked = 1" in text
    assert "to be cleared" not in text


def test_the_example_of_the_layers_api_compiles_over_a_usd_stage(tmp_path, prefix):
    """Against declarations of UsdStage, because the OpenUSD of the package has none."""
    declared = CHECKOUT / "tests" / "examples" / "openusd"
    build = tmp_path / "build"
    output("cmake", "-G", "Ninja", "-S", EXAMPLES / "layers", "-B", build, f"-DCMAKE_PREFIX_PATH={prefix}",
           f"-DCMAKE_CXX_FLAGS={WARNINGS} -I{declared}")
    output("cmake", "--build", build, "--target", "CMakeFiles/layers.dir/main.cpp.o")
    assert "UsdStageHost.h" in output("ninja", "-C", build, "-t", "deps")


def test_the_document_of_the_layers_api_quotes_the_example():
    source = "\n".join(line.strip() for line in (EXAMPLES / "layers" / "main.cpp").read_text().splitlines())
    document = (CHECKOUT / "docs" / "layers.md").read_text()
    blocks = re.findall(r"(?:^    .*\n)+", document, re.MULTILINE)
    assert len(blocks) > 3
    for block in blocks:
        assert "\n".join(line.strip() for line in block.splitlines()) in source, block


def test_what_is_installed_is_what_an_embedder_needs(prefix):
    """All of client/include, of the common headers only those that it includes, directly or not, and the headers
    for those who write parts of a plug-in."""
    include = prefix / "include"
    installed = {str(path.relative_to(include)) for path in include.rglob("*.h")}
    plugins = {str(path.relative_to(folder)) for folder in (CHECKOUT / "plugins").glob("*/include")
               for path in folder.rglob("*.h")}
    public = CHECKOUT / "client" / "include"
    needed = {str(path.relative_to(public)) for path in public.rglob("*.h")}
    found, waiting = set(needed), sorted(needed)
    while waiting:
        text = (include / waiting.pop()).read_text()
        included = set(re.findall(r'#include "(usdlive/[^"]+)"', text)) - found
        found |= included
        waiting += included
    assert installed - found <= plugins and found <= installed
    private = {str(path.relative_to(CHECKOUT / "client" / "src")) for path in (CHECKOUT / "client" / "src").rglob("*.h")}
    assert not [name for name in installed if name.removeprefix("usdlive/client/") in private]
    assert "usdlive/client/usd/Client.h" in installed and len(installed) < 60
    assert not [name for name in installed if "dds" in name or "generated" in name]


def test_every_installed_header_compiles_alone(tmp_path, prefix):
    """Those that include OpenUSD's layer.h anyway share a precompiled header of it, which is most of the work."""
    source, build = tmp_path / "headers", tmp_path / "build"
    shutil.copytree(EXAMPLE, source)
    include = prefix / "include"
    texts = {str(path.relative_to(include)): path.read_text() for path in include.rglob("*.h")}
    over_usd = {name for name, text in texts.items() if "#include <pxr/usd/sdf/layer.h>" in text}
    while more := {name for name in texts.keys() - over_usd
                   if over_usd & set(re.findall(r'#include "([^"]+)"', texts[name]))}:
        over_usd |= more
    assert len(over_usd) > 20 and len(texts) - len(over_usd) > 20
    with (source / "CMakeLists.txt").open("a") as project:
        for library, headers in (("over_usd", over_usd), ("plain", texts.keys() - over_usd)):
            files = [f"{library}{number}.cpp" for number in range(len(headers))]
            for file, header in zip(files, sorted(headers)):
                (source / file).write_text(f"#include <{header}>\n#include <{header}>\n")
            project.write(f"add_library({library} OBJECT {' '.join(files)})\n"
                          f"target_compile_features({library} PRIVATE cxx_std_20)\n"
                          f"target_compile_options({library} PRIVATE -Wall -Wextra -Werror)\n"
                          f"target_link_libraries({library} PRIVATE usdlive::client)\n")
        project.write("target_compile_options(plain PRIVATE -fsyntax-only)\n"
                      "target_precompile_headers(over_usd PRIVATE <pxr/usd/sdf/layer.h>)\n")
    output("cmake", "-G", "Ninja", "-S", source, "-B", build, f"-DCMAKE_PREFIX_PATH={prefix}")
    output("cmake", "--build", build, "--target", "over_usd", "plain", "--", "-k", "0")


def test_the_package_asks_only_for_what_programs_need(prefix):
    package = prefix / "lib" / "cmake" / "usdlive"
    text = "".join(path.read_text() for path in package.glob("*.cmake"))
    assert not re.findall(r"find_package\((?!Threads|OpenSSL|zstd|tl-expected|CycloneDDS)\w+", text)
    assert "flatbuffers" not in text and "Boost" not in text and "nlohmann" not in text


def test_installed_programs_need_no_checkout(tmp_path, project, serve, prefix):
    for program in ("usdlive", "usdlive-server"):
        libraries = output("ldd", prefix / "bin" / program)
        assert str(prefix) in libraries and "not found" not in libraries
        assert not [path for path in OUT_OF_REACH if path in libraries]
    (project / "shot.usda").write_text('#usda 1.0\ndef Xform "World" {}\n')
    server = serve(project)
    server.stop()
    server.program = [str(prefix / "bin" / "usdlive"), "serve"]
    server.start()
    assert 'def Xform "World"' in output(prefix / "bin" / "usdlive", "cat", f"{server.url}/shot.usda")


def test_nothing_installed_names_the_checkout(prefix):
    for file in (prefix / "lib" / "cmake").rglob("*.cmake"):
        assert not [path for path in OUT_OF_REACH if path in file.read_text()], file
    links = [path for path in prefix.rglob("*") if path.is_symlink()]
    assert all(not os.path.isabs(os.readlink(link)) and link.exists() for link in links)


def test_licences_of_copied_libraries_are_installed(prefix):
    licences = prefix / "share" / "doc" / "usdlive" / "licenses"
    for name in ("usd-core", "openusd", "tbb", "python"):
        assert any(file.stat().st_size > 500 for file in (licences / name).iterdir()), name
