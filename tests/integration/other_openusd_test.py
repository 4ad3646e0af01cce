"""In a process with another OpenUSD, or with none, `import usdlive` and the commands say what was found, what is needed
and what to do."""

import os
import pathlib
import shutil
import subprocess
import sys

import pytest

PACKAGES = pathlib.Path(os.environ["USDLIVE_BUILD"]) / "python"
BASE = os.path.realpath(sys.executable)  # without the packages of the environment
WANTED = "usdlive needs usd-core==26.8 for Python 3.11"


def run(*command, path=()) -> subprocess.CompletedProcess:
    """Runs a command with these folders in PYTHONPATH."""
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "LD_LIBRARY_PATH")}
    environment["PYTHONPATH"] = os.pathsep.join(map(str, path))
    return subprocess.run([str(word) for word in command], env=environment, text=True, capture_output=True, timeout=60)


def refused(*command, path=()) -> str:
    """Runs a command that must fail; returns the last line of what it says."""
    done = run(*command, path=path)
    assert done.returncode == 1, done.stdout + done.stderr
    return done.stderr.splitlines()[-1]


def refused_import(path, code="import usdlive", python=sys.executable) -> str:
    message = refused(python, "-c", code, path=[*path, PACKAGES])
    assert message.startswith(f"ImportError: {WANTED}"), message
    return message


def pretend_pxr(folder: pathlib.Path, version: str) -> pathlib.Path:
    """Makes a module pxr that says that it is this version; returns the folder for PYTHONPATH."""
    package = folder / "pxr"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "Usd.py").write_text(f"def GetVersion():\n    return {(0, *map(int, version.split('.')))}\n")
    return folder


def test_without_openusd():
    message = refused_import([], python=BASE)
    assert f"{BASE} has no module pxr. Install it: {BASE} -m pip install usd-core==26.8" in message


def test_blender_has_its_own():
    message = refused_import([], "import sys, types; sys.modules['bpy'] = types.ModuleType('bpy'); import usdlive", python=BASE)
    assert message.endswith("has no module pxr. Blender has its own: call bpy.utils.expose_bundled_modules() before the import "
                            "of usdlive.")


def test_another_version_comes_first(tmp_path):
    message = refused_import([pretend_pxr(tmp_path, "25.5")])
    assert f"found OpenUSD 25.5 in {tmp_path}/pxr. " in message
    assert "has it, but the module pxr comes from elsewhere. Remove that place from PYTHONPATH" in message


def test_another_version_is_all_there_is(tmp_path):
    message = refused_import([pretend_pxr(tmp_path, "26.11")], python=BASE)
    assert f"found OpenUSD 26.11 in {tmp_path}/pxr. Install usdlive in an environment of its own" in message


def test_another_version_was_imported_before(tmp_path):
    pretend_pxr(tmp_path, "25.5")
    message = refused_import([], f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import pxr; del sys.path[0]; import usdlive")
    assert f"found OpenUSD 25.5 in {tmp_path}/pxr. " in message
    assert "it was imported before usdlive. Import usdlive first" in message


def test_another_build_of_the_same_version(tmp_path):
    message = refused_import([pretend_pxr(tmp_path, "26.8")])
    assert f"found OpenUSD 26.8 in {tmp_path}/pxr, which is another build of it. " in message


def test_half_of_openusd(tmp_path):
    (tmp_path / "pxr").mkdir()
    message = refused_import([tmp_path], python=BASE)
    assert f"found pxr in {tmp_path}/pxr, which cannot be loaded (cannot import name 'Usd'" in message
    assert f"{BASE} -m pip install usd-core==26.8" in message


def test_a_second_openusd_in_the_process(tmp_path):
    # Its name is that of a library of a stock OpenUSD. Its content does not matter here.
    library = tmp_path / "libusd_sdf.so"
    shutil.copy(next(PACKAGES.glob("usdlive/_usdlive*.so")), library)
    message = refused_import([], f"import pxr.Usd, ctypes; ctypes.CDLL({str(library)!r}); import usdlive")
    assert f"no other OpenUSD in the process; found {library} beside " in message


@pytest.fixture
def package(tmp_path):
    """A folder with the package as a wheel installs it. The programs only print where they find libraries."""
    site = tmp_path / "site"
    shutil.copytree(PACKAGES / "usdlive", site / "usdlive", ignore=shutil.ignore_patterns("_plugins", "*.so", "omni"))
    shutil.copy(PACKAGES / "usdlive_program.py", site)
    (site / "usdlive" / "bin").mkdir()
    for name in ("usdlive", "usdlive-server"):
        program = site / "usdlive" / "bin" / name
        program.write_text('#!/bin/sh\necho "$0 $1 ${LD_LIBRARY_PATH-nowhere else}"\n')
        program.chmod(0o755)
    return site


def test_another_python(package):
    built_for = package / "usdlive" / "_built_for.py"
    built_for.write_text(built_for.read_text().replace("3.11", "3.10"))
    message = refused(sys.executable, "-c", "import usdlive", path=[package])
    assert message == (f"ImportError: usdlive needs usd-core==26.8 for Python 3.10; this is Python 3.11 ({sys.executable}). "
                       f"Install usdlive with this Python: {sys.executable} -m pip install usdlive")


COMMAND = "import usdlive_program; usdlive_program.usdlive()"


def test_the_command_without_openusd(package):
    message = refused(BASE, "-c", COMMAND, "ls", path=[package])
    assert message == (f"usdlive: {WANTED}; found no OpenUSD, because {BASE} has no module pxr. Install it: "
                       f"{BASE} -m pip install usd-core==26.8")


def test_the_server_with_another_openusd(package, tmp_path):
    message = refused(BASE, "-c", COMMAND.replace("usdlive()", "usdlive_server()"), path=[package, pretend_pxr(tmp_path, "25.5")])
    assert message.startswith(f"usdlive-server: {WANTED}; found OpenUSD 25.5 in {tmp_path}/pxr. Install usdlive in an environment")


def test_the_command_runs_beside_another_openusd(package, tmp_path):
    """The libraries decide, and not which module pxr comes first."""
    from usdlive import _built_for

    libraries = package / "usd_core.libs"
    libraries.mkdir()
    (libraries / _built_for.USD_LIBRARY).write_text("")
    done = run(BASE, "-c", COMMAND, "ls", path=[package, pretend_pxr(tmp_path, "25.5")])
    assert done.stdout == f"{package}/usdlive/bin/usdlive ls nowhere else\n"
    libraries.rename(tmp_path / "usd_core.libs")
    done = run(BASE, "-c", COMMAND, "ls", path=[package, pretend_pxr(tmp_path / "more", "25.5"), tmp_path])
    assert done.stdout == f"{package}/usdlive/bin/usdlive ls {tmp_path}/usd_core.libs\n"


def test_the_command_without_its_program(package):
    shutil.rmtree(package / "usdlive" / "bin")
    message = refused(BASE, "-c", COMMAND, path=[package])
    assert message == (f"usdlive: there is no program {package}/usdlive/bin/usdlive. Install the package again: "
                       f"{BASE} -m pip install --force-reinstall usdlive")
