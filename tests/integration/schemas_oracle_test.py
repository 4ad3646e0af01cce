"""Compares the prim definitions of the C++ schema registry with those of pxr.Usd for the same plug-ins."""

import json
import os
import pathlib
import subprocess
import sys

import pytest

HERE = pathlib.Path(__file__).parent
PROBE = pathlib.Path(os.environ["USDLIVE_BUILD"]) / "bin" / "stage_probe"
PACKAGES = pathlib.Path(os.environ["USDLIVE_PRODUCT_ENV"]) / "lib/python3.11/site-packages"
CODELESS = ["newton_usd_schemas", "physx_usd_schemas/PhysxSchema/resources",
            "physx_usd_schemas/OmniUsdPhysicsDeformableSchema/resources"]


def schema(kind, base, identifier, **more):
    return {"alias": {"UsdSchemaBase": identifier}, "bases": [base], "schemaIdentifier": identifier,
            "schemaKind": kind, **more}


def single(identifier, **more):
    return schema("singleApplyAPI", "UsdAPISchemaBase", identifier, **more)


def multiple(identifier, **more):
    return schema("multipleApplyAPI", "UsdAPISchemaBase", identifier, **more)


# These schemas cover the rules that real schemas use rarely.
TYPES = {
    "OddLamp": schema("concreteTyped", "UsdGeomSphere", "OddLamp"),
    "OddLamp_2": schema("concreteTyped", "UsdGeomSphere", "OddLamp_2"),
    "OddShellAPI": single("OddShellAPI"),
    "OddInnerAPI": single("OddInnerAPI"),
    "OddVersionedAPI": single("OddVersionedAPI", apiSchemaAutoApplyTo=["Gprim"]),
    "OddVersionedAPI_1": single("OddVersionedAPI_1", apiSchemaAutoApplyTo=["Sphere"]),
    "OddAutoAPI": single("OddAutoAPI", apiSchemaAutoApplyTo=["Imageable", "NoSuchType"]),
    "OddRoundAPI": single("OddRoundAPI"),
    "OddTripAPI": single("OddTripAPI"),
    "OddPartsAPI": multiple("OddPartsAPI", apiSchemaAllowedInstanceNames=["a", "b"],
                            apiSchemaInstances={"b": {"apiSchemaCanOnlyApplyTo": ["Gprim"]}}),
    "OddPartAPI": multiple("OddPartAPI", apiSchemaCanOnlyApplyTo=["Mesh", "OddLamp"]),
}
CLASSES = """#usda 1.0

class OddLamp "OddLamp" (
    apiSchemas = ["OddShellAPI", "OddPartsAPI:a"]
    customData = {
        token[] apiSchemaOverridePropertyNames = ["odd:a:count", "odd:shell", "noSuchProperty"]
    }
    hidden = true
)
{
    double radius = 2
    uniform int odd:a:count = 7 (
        uiHints = {
            dictionary both = {
                int lamp = 1
            }
        }
    )
    string odd:shell = "another type"
    float odd:inner (
        displayName = "of the lamp"
        uiHints = {
            int lamp = 1
        }
    )
}

class OddLamp_2 "OddLamp_2" (
    apiSchemas = ["OddVersionedAPI", "OddPartsAPI"]
)
{
    rel odd:inner
}

class "OddShellAPI" (
    apiSchemas = ["OddInnerAPI", "OddPartsAPI:b", "OddPartsAPI:__INSTANCE_NAME__", "NoSuchAPI"]
    customData = {
        token[] apiSchemaOverridePropertyNames = ["odd:b:count"]
    }
)
{
    float odd:shell = 1
    float odd:inner
    int odd:b:count (
        hidden = true
    )
}

class "OddInnerAPI"
{
    uniform float odd:inner = 3 (
        doc = "of the inner one"
        hidden = true
        uiHints = {
            int inner = 1
        }
        displayName = "of the inner one"
    )
    double radius = 5
}

class "OddVersionedAPI"
{
    int odd:old = 1
    int odd:both = 1
}

class "OddVersionedAPI_1"
{
    int odd:new = 1
    int odd:both = 2
}

class "OddAutoAPI" (
    assetInfo = {
        string name = "auto"
    }
    displayName = "auto"
    apiSchemas = ["OddRoundAPI"]
)
{
    asset odd:file
}

class "OddRoundAPI" (
    assetInfo = {
        string name = "round"
        string version = "1"
    }
    doc = "round"
    apiSchemas = ["OddTripAPI"]
)
{
    int odd:round = 1
}

class "OddTripAPI" (
    apiSchemas = ["OddRoundAPI"]
)
{
    int odd:trip = 1
}

class "OddPartsAPI" (
    apiSchemas = ["OddPartAPI:__INSTANCE_NAME__", "OddPartAPI:__INSTANCE_NAME__:sub", "OddInnerAPI"]
)
{
    int odd:__INSTANCE_NAME__:count = 3 (
        doc = "of parts"
        displayGroup = "parts"
        uiHints = {
            dictionary both = {
                int lamp = 2
                int parts = 2
            }
        }
    )
    opaque odd:__INSTANCE_NAME__
}

class "OddPartAPI"
{
    rel part:__INSTANCE_NAME__:of
    token odd:__INSTANCE_NAME__:count
    int not__INSTANCE_NAME__
}
"""


def write_plugin(folder, types, classes, name="odd"):
    folder.mkdir()
    (folder / "plugInfo.json").write_text(json.dumps({"Plugins": [{
        "Name": name, "Type": "resource", "Root": ".", "LibraryPath": "", "ResourcePath": ".",
        "Info": {"Types": {"Studio" + key: value for key, value in types.items()},
                 "AutoApplyAPISchemas": {"OddInnerAPI": {"apiSchemaAutoApplyTo": ["Points"]}}}}]}))
    (folder / "generatedSchema.usda").write_text(classes)
    return folder


@pytest.fixture
def odd_schemas(tmp_path):
    return write_plugin(tmp_path / "odd", TYPES, CLASSES)


def differences(tmp_path, plugins, seed, count):
    ran = subprocess.run(
        [sys.executable, HERE / "definitions_oracle.py", PROBE, tmp_path / "ours.usda", str(seed), str(count)],
        env={**os.environ, "PXR_PLUGINPATH_NAME": os.pathsep.join(map(str, plugins))},
        capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr[-4000:]
    *found, last = ran.stdout.splitlines()
    assert int(last.split()[0]) > count
    return found


@pytest.mark.parametrize("seed", [1, 2])
def test_definitions_are_those_of_usd_core(tmp_path, seed):
    assert differences(tmp_path, [], seed, 300) == []


def test_definitions_of_codeless_schemas(tmp_path):
    assert differences(tmp_path, [PACKAGES / folder for folder in CODELESS], 3, 300) == []


def test_definitions_of_every_rule(tmp_path, odd_schemas):
    assert differences(tmp_path, [odd_schemas], 4, 300) == []


def ask(mode, plugins, text):
    return subprocess.run([PROBE, *mode], input=text, text=True, check=True, capture_output=True,
                          env={**os.environ, "PXR_PLUGINPATH_NAME": os.pathsep.join(map(str, plugins))}).stdout


APPLYING = """
import sys
from pxr import Usd
stage = Usd.Stage.CreateInMemory()
for line in sys.stdin:
    name, kind = line.split()
    schema, _, instance = name.partition(":")
    prim = stage.DefinePrim("/" + kind, kind)
    found = Usd.SchemaRegistry.GetTypeFromSchemaTypeName(schema)
    try:
        can = prim.CanApplyAPI(found, instance) if instance else prim.CanApplyAPI(found)
    except Exception:
        can = False
    print("yes" if can else "no")
"""


def test_what_can_be_applied_is_the_same(odd_schemas):
    names = ["OddShellAPI", "OddShellAPI:a", "OddPartsAPI", "OddPartsAPI:a", "OddPartsAPI:b", "OddPartsAPI:c",
             "OddPartAPI:x", "OddPartAPI:count", "OddPartAPI:x:of", "CollectionAPI:x", "CollectionAPI:includes",
             "LightAPI", "PhysicsRigidBodyAPI", "GeomModelAPI", "PrimvarsAPI", "Mesh"]
    lines = "".join(f"{name} {kind}\n" for name in names for kind in ("Mesh", "Scope", "OddLamp", "Sphere", "Unknown"))
    expected = subprocess.run([sys.executable, "-c", APPLYING], input=lines, text=True, check=True,
                              capture_output=True, env={**os.environ, "PXR_PLUGINPATH_NAME": str(odd_schemas)}).stdout
    found = [line.split()[0] for line in ask(["applying"], [odd_schemas], lines).splitlines()]
    differing = [(line, ours) for line, ours, theirs in zip(lines.splitlines(), found, expected.splitlines())
                 if ours != theirs]
    assert differing == []


def test_malformed_plug_ins_are_reported_and_passed_over(tmp_path, odd_schemas):
    broken = {
        "BrokenKind": schema("noSuchKind", "UsdTyped", "BrokenKind"),
        "BrokenAPI": single("BrokenAPI", apiSchemaCanOnlyApplyTo="Mesh"),
        "BrokenPartsAPI": multiple("BrokenPartsAPI", apiSchemaInstances=["a"]),
        "SecondLamp": {**schema("concreteTyped", "UsdTyped", "OddLamp"), "alias": {"UsdSchemaBase": "SecondLamp"}},
        "UsdNameAPI": single("UsdNameAPI", apiSchemaCanOnlyApplyTo=["UsdGeomMesh"]),
    }
    plugins = [odd_schemas, write_plugin(tmp_path / "broken", broken, "#usda 1.0\n", "broken"),
               write_plugin(tmp_path / "text", {"TextAPI": single("TextAPI")}, "no layer at all", "text")]
    (tmp_path / "json").mkdir()
    (tmp_path / "json" / "plugInfo.json").write_text("{")
    plugins.append(tmp_path / "json")
    problems = ask(["definitions", str(tmp_path / "ours.usda")], plugins, "OddLamp\n")
    for part in ["type 'StudioBrokenKind': 'schemaKind'", "'apiSchemaCanOnlyApplyTo' is no list",
                 "'apiSchemaInstances' is no dictionary", "schema 'OddLamp': plug-in 'odd' declares it, too",
                 "unknown schema 'UsdGeomMesh'", "of plug-in 'text' are without properties", "they include each other"]:
        assert part in problems
    # The valid parts work.
    from pxr import Sdf
    lamp = Sdf.Layer.FindOrOpen(str(tmp_path / "ours.usda")).GetPrimAtPath("/_0")
    assert lamp is not None
