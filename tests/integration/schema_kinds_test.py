"""The classes that generateSchema.py writes for a schema of every kind: random scripts, which the classes in C++ and
Python and pxr.Usd run on one layer each, have the same output and the same layer."""

import os
import pathlib
import subprocess
import sys

import pytest

BUILD = pathlib.Path(os.environ["USDLIVE_BUILD"])
LIBRARY = BUILD / "test-plugins" / "studioKinds"
START = """#usda 1.0

def "A"
{
}

def Scope "B"
{
}

def KindsLamp "C" (
    prepend apiSchemas = ["KindsDimAPI", "CollectionAPI:x"]
)
{
}

def KindsRoom "D" (
    active = false
)
{
}
"""


def output(*command, text=None):
    ran = subprocess.run([str(word) for word in command], input=text, text=True, capture_output=True,
                         env={**os.environ, "PXR_PLUGINPATH_NAME": str(LIBRARY)})
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


def python(*words):
    return output(sys.executable, pathlib.Path(__file__).parent / "schema_kinds.py", LIBRARY / "kinds.py", *words)


@pytest.mark.parametrize("seed", range(20))
def test_classes_of_every_kind_do_what_pxr_does(tmp_path, seed):
    pxr, own, cpp = files = [tmp_path / f"{name}.usda" for name in ("pxr", "own", "cpp")]
    for file in files:
        file.write_text(START)
    lines = python("script", seed, pxr, own).splitlines()
    asked = [line.rpartition(" ")[0] for line in lines]
    answers = output(BUILD / "bin" / "schema_kinds_probe", cpp, text="\n".join(asked)).splitlines()
    assert [f"{line} {answer}" for line, answer in zip(asked, answers, strict=True)] == lines
    assert own.read_text() == pxr.read_text()
    assert cpp.read_text() == pxr.read_text()


def test_an_attribute_of_every_type_is_written():
    assert int(python("types")) > 100
