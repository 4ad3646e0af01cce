"""The wheel of ./run wheel installs on a Linux without system packages, and what is installed works there."""

import importlib.metadata
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import sysconfig
import time
import zipfile

import pip
import pytest

CHECKOUT = pathlib.Path(__file__).parents[2]
# The libraries that each Linux has, as the manylinux policies list them (PEP 600).
OF_ANY_LINUX = {"ld-linux-x86-64.so.2", "libc.so.6", "libdl.so.2", "libgcc_s.so.1", "libm.so.6", "libpthread.so.0",
                "librt.so.1", "libstdc++.so.6", "libz.so.1"}
OF_OPENUSD = re.compile(r"lib(usd_ms-\w+\.so|tbb-\w+\.so\.2)")
# The functions that others call in a library of ours. OpenUSD calls no symbol of a plug-in.
INTERFACES = {
    "_usdlive": {"PyInit__usdlive"},
    "_session": {"PyInit__session"},
    "usdliveEdf": {"usdliveEdfBeginTick1", "usdliveEdfEndTick1", "usdliveEdfReloadArrived1"},
    "usdliveEdfGenerator": set(),
    "usdliveEdfMuseum": set(),
    "usdliveEdfTable": set(),
    "usdliveObj": set(),
    "usdliveResolver": {"usdliveResolverInterface3"},
}

# The files of a wheel are made once.
pytestmark = pytest.mark.xdist_group("wheel")


def output(*command, **options) -> str:
    done = subprocess.run([str(word) for word in command], check=False, text=True, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, **options)
    assert done.returncode == 0, done.stdout[-5000:]
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> pathlib.Path:
    folder = tmp_path_factory.mktemp("wheels")
    python = CHECKOUT / "build" / "env" / "wheel" / "bin" / "python"
    assert python.exists(), "the environment that makes wheels is missing: ./run setup creates it"
    output(python, CHECKOUT / ".ci" / "wheel.py", os.environ["USDLIVE_BUILD"], folder)
    return next(folder.glob("usdlive-*.whl"))


@pytest.fixture(scope="module")
def content(wheel, tmp_path_factory) -> pathlib.Path:
    """The folder of an unpacked wheel."""
    folder = tmp_path_factory.mktemp("unpacked")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    return folder


def elf_files(folder: pathlib.Path) -> list[pathlib.Path]:
    found = [path for path in folder.rglob("*") if path.is_file() and path.open("rb").read(4) == b"\x7fELF"]
    assert found
    return found


def needed(file: pathlib.Path) -> set[str]:
    return set(re.findall(r"\(NEEDED\).*\[(.*)\]", output("readelf", "-d", file)))


def test_what_the_wheel_needs_is_in_it_or_on_any_linux(content):
    files = elf_files(content)
    own = {file.name for file in files}
    assert any(name.startswith("librocksdb-") for name in own) and any(name.startswith("libddsc-") for name in own)
    for file in files:
        others = {name for name in needed(file) - own - OF_ANY_LINUX if not OF_OPENUSD.fullmatch(name)}
        assert not others, file
    assert not [name for name in own if name.startswith(("libusd", "libtbb"))], "OpenUSD is that of usd-core"


def test_each_library_in_the_wheel_has_its_licence(content):
    carried = list(content.glob("usdlive.libs/*"))
    texts = list(content.glob("usdlive-*.dist-info/licenses/*/copyright"))
    assert len(carried) > 10 and 5 < len(texts) <= len(carried)
    assert all(text.stat().st_size > 200 for text in texts)


def test_libraries_of_ours_export_their_interface_only(content):
    libraries = {file.name.split(".")[0]: file for file in elf_files(content / "usdlive") if ".so" in file.name}
    exported = {name: {line.split()[-1] for line in output("nm", "-D", "--defined-only", file).splitlines()}
                for name, file in libraries.items()}
    assert exported == INTERFACES


def test_the_wheel_is_stripped_and_small(wheel, content):
    for file in elf_files(content):
        assert ".symtab" not in output("readelf", "-SW", file), file
    assert sum(path.stat().st_size for path in content.rglob("*") if path.is_file()) < 150e6
    assert re.fullmatch(r"usdlive-[0-9.]+-cp311-cp311-manylinux_2_[0-9]+_x86_64\.whl", wheel.name)


def test_the_page_is_in_the_wheel_with_its_licences(content):
    page = content / "usdlive" / "page" / "static"
    index = (page / "index.html").read_text()
    script = re.search(r'src="/(assets/[^"]+[.]js)"', index)[1]
    assert (page / script).stat().st_size > 100_000
    assert "<script>" not in index and "style=" not in index, "the gateway's policy allows nothing inline"
    licences = (page / "licences.md").read_text()
    assert all(name in licences for name in ("three", "preact"))


# --- on a bare Linux ---


def wheel_of_installed(name: str, folder: pathlib.Path) -> None:
    """Packs an installed distribution as the wheel that it came from, because a test has no network."""
    package = importlib.metadata.distribution(name)
    files = [file for file in package.files if ".." not in file.parts and file.suffix != ".pyc"
             and file.name not in ("INSTALLER", "REQUESTED", "RECORD", "direct_url.json")]
    record = next(file for file in package.files if file.name == "RECORD")
    tag = re.search(r"^Tag: (.*)$", package.read_text("WHEEL"), re.MULTILINE)[1]
    with zipfile.ZipFile(folder / f"{name.replace('-', '_')}-{package.version}-{tag}.whl", "w") as archive:
        for file in files:
            archive.write(file.locate(), str(file))
        lines = [f"{file},{file.hash.mode}={file.hash.value},{file.size}" for file in files]
        archive.writestr(str(record), "\n".join([*lines, f"{record},,", ""]))


def copy_python(root: pathlib.Path) -> None:
    """Copies this Python without what was installed for it. Modules that need other libraries than those of any Linux
    are left out (ssl, ctypes)."""
    program = pathlib.Path(os.path.realpath(sys.executable))
    libraries = dict(re.findall(r"(\S+) => (/\S+)", output("ldd", program)))
    found = re.findall(r"^\s*(\S+) .* => (/\S+)$", output("/sbin/ldconfig", "-p"), re.MULTILINE)
    libraries |= {name: path for name, path in reversed(found) if name in OF_ANY_LINUX and "64" in path}
    for path in [str(program), "/lib64/ld-linux-x86-64.so.2", *libraries.values()]:
        target = root / path.lstrip("/")
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(os.path.realpath(path), target)
        target.chmod(0o755)
    modules = sysconfig.get_path("stdlib")

    def left_out(folder: str, names: list[str]) -> list[str]:
        files = [name for name in names if name.endswith(".so")]
        return [*{"dist-packages", "site-packages", "test", "__pycache__", "idlelib"} & {*names},
                *(name for name in files if needed(pathlib.Path(folder, name)) - {*libraries})]

    shutil.copytree(modules, root / modules.lstrip("/"), ignore=left_out, symlinks=False)


# Runs a command with another root folder, without a network but loopback.
IN_ROOT = ("unshare", "--mount", "--net", "--pid", "--fork", "--kill-child", "bash", "-euc",
           'root=$1; shift; ip link set lo up; mount -t proc proc "$root/proc"; mount --rbind /dev "$root/dev"\n'
           'exec "$@"', "-")


def in_root(root: pathlib.Path, *command: str) -> str:
    return output(*IN_ROOT, root, "chroot", root, *command,
                  env={"PATH": "/venv/bin:/usr/bin:/usr/sbin:/bin:/sbin", "HOME": "/tmp"}, timeout=300)


@pytest.fixture(scope="module")
def root(wheel, tmp_path_factory):
    """The folder of a Linux with Python, in which the wheel is installed, and the seconds that installing took."""
    if os.geteuid() != 0:
        pytest.skip("another root folder needs root")
    root = tmp_path_factory.mktemp("root")
    for name in ("proc", "dev", "tmp", "project", "wheels"):
        (root / name).mkdir()
    tried = subprocess.run([*IN_ROOT, root, "true"], check=False, text=True, capture_output=True)
    if tried.returncode != 0:
        pytest.skip(f"this system does not allow another root folder: {tried.stderr.strip()}")
    copy_python(root)
    for one in wheel.parent.glob("*.whl"):
        shutil.copy(one, root / "wheels")
    wheel_of_installed("usd-core", root / "wheels")
    shutil.copytree(pip.__path__[0], root / "pip" / "pip")
    python = os.path.realpath(sys.executable)
    in_root(root, python, "-m", "venv", "--without-pip", "/venv")
    start = time.monotonic()
    in_root(root, "/venv/bin/python", "-c", "import sys; sys.path.insert(0, '/pip')\n"
            "from pip._internal.cli.main import main\n"
            "sys.exit(main(['install', '-q', '--no-index', '--find-links', '/wheels', 'usdlive-omni']))")
    return root, time.monotonic() - start


def test_the_wheel_edits_live_on_a_bare_linux(root, capfd):
    root, seconds = root
    with capfd.disabled():
        print(f"\ninstalling the wheel with usd-core took {seconds:.1f} s")
    (root / "project" / "shot.usda").write_text('#usda 1.0\ndef "A"\n{\n    double x = 1\n}\n')
    shutil.copy(pathlib.Path(__file__).with_name("bare.py"), root / "bare.py")
    answer = json.loads(in_root(root, "/venv/bin/python", "/bare.py").splitlines()[-1])
    assert answer["seen"] == answer["resolved"] == 7.0 and answer["omni"] == "usdlive.omni.usd"
    assert "double x = 7" in answer["cat"]
    for name in ("server", "editor"):
        libraries = answer["libraries"][name]
        elsewhere = {pathlib.Path(path).name for path in libraries if not path.startswith("/venv/") and "/lib-dynload/" not in path}
        assert elsewhere <= OF_ANY_LINUX | {"libexpat.so.1"}, elsewhere
        usd = [path for path in libraries if OF_OPENUSD.fullmatch(pathlib.Path(path).name)]
        assert len(usd) == 2 and all("/site-packages/usd_core.libs/" in path for path in usd), usd
