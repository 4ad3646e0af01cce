"""The schema libraries of plugins/, in stock usd-core and in the C++ stage; and the generator that makes them."""

import json
import os
import pathlib
import runpy
import shutil
import subprocess
import sys

import pytest
import stage_dump as dumped
from schemas_oracle_test import CODELESS, PACKAGES, ask, differences

ROOT = pathlib.Path(__file__).resolve().parents[2]
BUILD = pathlib.Path(os.environ["USDLIVE_BUILD"])
PLUGINS = BUILD / "usd-plugins"
GENERATOR = ROOT / "plugins" / "schemaTools" / "generateSchema.py"
OWN = ["usdliveSession", "usdliveSource", "usdliveMuseum"]


def fresh(code, *plugins, arguments=()):
    """Runs code in a Python process that has usd-core and none of our modules."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    environment["PXR_PLUGINPATH_NAME"] = os.pathsep.join(map(str, plugins))
    return subprocess.run([sys.executable, "-c", code, *map(str, arguments)], text=True, capture_output=True,
                          env=environment)


def output(code, *plugins, arguments=()):
    ran = fresh(code, *plugins, arguments=arguments)
    assert ran.returncode == 0, ran.stderr[-4000:]
    return ran.stdout


STOCK = """
from pxr import Sdf, Tf, Usd
kinds = Usd.SchemaRegistry()
def kind(name): return str(kinds.FindSchemaInfo(name).kind).split(".")[-1]
stage = Usd.Stage.CreateInMemory()
mesh, scope = stage.DefinePrim("/Mesh", "Mesh"), stage.DefinePrim("/Scope", "Scope")
task = stage.DefinePrim("/Task", "UsdliveTask")
series = stage.DefinePrim("/Series", "UsdliveTimeSeries")

for name, expected in {"UsdliveAnnotation": "AbstractTyped", "UsdliveNote": "ConcreteTyped",
                       "UsdliveTask": "ConcreteTyped", "UsdliveSessionAPI": "SingleApplyAPI",
                       "UsdliveApprovalAPI": "MultipleApplyAPI", "UsdliveDataSource": "AbstractTyped",
                       "UsdliveTable": "ConcreteTyped", "UsdliveTimeSeries": "ConcreteTyped",
                       "UsdliveProvenanceAPI": "SingleApplyAPI", "UsdliveScanAPI": "SingleApplyAPI",
                       "UsdliveFeedAPI": "MultipleApplyAPI"}.items():
    assert kind(name) == expected, name

# Types and what they inherit.
for name in ("UsdliveTask", "UsdliveNote", "UsdliveAnnotation"):
    assert task.IsA(name), name
assert not task.IsA("UsdliveTable") and not mesh.IsA("UsdliveNote")
assert task.GetPropertyNames() == ["about", "assignee", "author", "created", "due", "frame", "image", "priority",
                                   "state", "text"]
assert task.GetAttribute("state").Get() == "open" and not task.GetAttribute("state").IsAuthored()
assert task.GetAttribute("author").GetVariability() == Sdf.VariabilityUniform
assert task.GetAttribute("state").GetMetadata("allowedTokens") == ["open", "done", "declined"]
assert task.GetAttribute("frame").GetTypeName() == Sdf.ValueTypeNames.TimeCode
assert series.GetAttribute("content").Get() == "timeseries", "a fallback that an inheriting type changes"
assert series.GetAttribute("keyColumn").Get() == "id", "one that it inherits"
# Built-in API schemas, also inherited ones.
assert series.GetAppliedSchemas() == ["UsdliveProvenanceAPI"] and series.HasAPI("UsdliveProvenanceAPI")
# An abstract type is none that a prim can have.
assert not stage.DefinePrim("/Abstract", "UsdliveAnnotation").GetPropertyNames()
assert kinds.FindAbstractPrimDefinition("UsdliveAnnotation").GetPropertyNames()
assert kinds.FindConcretePrimDefinition("UsdliveAnnotation") is None

# API schemas.
assert mesh.CanApplyAPI("UsdliveScanAPI")
refused = scope.CanApplyAPI("UsdliveScanAPI")
assert not refused and "PointBased" in refused.whyNot, refused.whyNot
assert not mesh.CanApplyAPI("UsdliveFeedAPI", "key"), "the name of one of its properties"
assert mesh.ApplyAPI("UsdliveScanAPI") and mesh.HasAPI("UsdliveProvenanceAPI")
assert mesh.GetAppliedSchemas() == ["UsdliveScanAPI", "UsdliveProvenanceAPI"]
assert mesh.ApplyAPI("UsdliveFeedAPI", "heat") and mesh.HasAPI("UsdliveFeedAPI", "heat")
assert mesh.HasAPI("UsdliveFeedAPI") and not mesh.HasAPI("UsdliveFeedAPI", "cold")
assert mesh.GetAttribute("usdlive:feed:heat:scale").Get() == 1.0
assert mesh.GetRelationship("usdlive:feed:heat:source")
assert mesh.RemoveAPI("UsdliveFeedAPI", "heat") and not mesh.GetAttribute("usdlive:feed:heat:scale")
print("as expected")
"""


@pytest.mark.parametrize("plugins", [[PLUGINS], [PLUGINS / name for name in OWN]], ids=["one folder", "each"])
def test_stock_usd_core_has_the_schemas(plugins):
    assert output(STOCK, *plugins) == "as expected\n"


def test_definitions_are_the_same_in_cpp_beside_those_of_others(tmp_path):
    assert differences(tmp_path, [PLUGINS, *(PACKAGES / folder for folder in CODELESS)], 5, 400) == []


def test_what_can_be_applied_is_the_same_in_cpp():
    names = ["UsdliveScanAPI", "UsdliveFeedAPI:heat", "UsdliveFeedAPI:key", "UsdliveFeedAPI", "UsdliveApprovalAPI:fx",
             "UsdliveApprovalAPI:state", "UsdliveSessionAPI", "UsdliveSessionAPI:a", "UsdliveNote", "NewtonSceneAPI"]
    lines = "".join(f"{name} {kind}\n" for name in names for kind in ("Mesh", "Scope", "UsdliveTask", "PhysicsScene"))
    from schemas_oracle_test import APPLYING
    plugins = [PLUGINS, PACKAGES / CODELESS[0]]
    expected = subprocess.run([sys.executable, "-c", APPLYING], input=lines, text=True, check=True, capture_output=True,
                              env={**os.environ, "PXR_PLUGINPATH_NAME": os.pathsep.join(map(str, plugins))}).stdout
    found = "".join(line.split()[0] + "\n" for line in ask(["applying"], plugins, lines).splitlines())
    assert found == expected
    assert 0 < found.count("no") < found.count("yes") + found.count("no")


SCENE = """#usda 1.0
(
    defaultPrim = "World"
    upAxis = "Y"
)

def Xform "World" (
    prepend apiSchemas = ["UsdliveSessionAPI", "UsdliveApprovalAPI:fx"]
)
{
    uniform int64 usdlive:session:revision = 12
    token usdlive:approval:fx:state.timeSamples = { 1: "waiting", 5: "approved" }

    def Points "Scan" (
        prepend apiSchemas = ["UsdliveScanAPI", "UsdliveFeedAPI:heat"]
    )
    {
        rel usdlive:feed:heat:source = </World/Data>
        uniform asset usdlive:provenance:source = @scan.e57@
    }

    def UsdliveTimeSeries "Data"
    {
        uniform string uri = "file:heat.csv"
        uniform token[] columns = ["a", "b"]
    }

    def UsdliveTask "Task"
    {
        rel about = </World/Scan>
        string text = "clean up"
    }

    def UsdliveAnnotation "NoType"
    {
        string text = "kept"
    }
}
"""


def test_the_composed_stage_is_the_same_in_cpp(tmp_path):
    scene = tmp_path / "scene.usda"
    scene.write_text(SCENE)
    environment = {**os.environ, "PXR_PLUGINPATH_NAME": str(PLUGINS)}
    ours = subprocess.run([os.environ["USDLIVE_BIN"], "dump", "--composed", scene, "--base", tmp_path], text=True, capture_output=True,
                          env=environment)
    assert ours.returncode == 0, ours.stderr
    wanted = tmp_path / "wanted.json"
    (tmp_path / "list").write_text(f"{scene}\t\t{tmp_path}\t{wanted}\n")
    subprocess.run([sys.executable, pathlib.Path(__file__).parent / "stage_dump.py", tmp_path / "list"], check=True,
                   env=environment)
    assert list(dumped.differences(json.loads(wanted.read_text()), json.loads(ours.stdout))) == []
    assert '"keyColumn"' in ours.stdout, "the properties of the schemas are in the dump"


# --- the generated classes -----------------------------------------------------------------------------

START = """#usda 1.0

def Xform "Listed" (
    prepend apiSchemas = ["CollectionAPI:a"]
    append apiSchemas = ["CollectionAPI:b"]
)
{
}

def Xform "Other"
{
}

def Xform "Explicit" (
    apiSchemas = ["UsdliveSessionAPI", "CollectionAPI:a"]
)
{
}
"""

WITH_PXR = """
import sys
from pxr import Sdf, Usd
stage = Usd.Stage.Open(sys.argv[1])
listed, other = stage.GetPrimAtPath("/Listed"), stage.GetPrimAtPath("/Other")
listed.ApplyAPI("UsdliveSessionAPI"); listed.ApplyAPI("UsdliveSessionAPI")
listed.GetAttribute("usdlive:session:project").Set("ws://127.0.0.1:7447/shot")
listed.GetAttribute("usdlive:session:revision").Set(1234)
other.ApplyAPI("UsdliveSessionAPI"); other.RemoveAPI("UsdliveSessionAPI")
stage.GetPrimAtPath("/Explicit").RemoveAPI("UsdliveSessionAPI")
listed.ApplyAPI("UsdliveApprovalAPI", "light"); listed.ApplyAPI("UsdliveApprovalAPI", "fx:water")
listed.RemoveAPI("UsdliveApprovalAPI", "fx:water")
state = listed.GetAttribute("usdlive:approval:light:state")
state.Set("approved"); state.Set("revise", 5)
note = stage.DefinePrim("/Notes/first", "UsdliveNote")
note.GetAttribute("text").Set("too dark"); note.GetAttribute("author").Set("ada")
note.GetAttribute("frame").Set(Sdf.TimeCode(12)); note.GetAttribute("image").Set("./drawing.png")
note.GetRelationship("about").SetTargets(["/Other", "/Listed.usdlive:session:project"])
task = stage.DefinePrim("/Notes/second", "UsdliveTask")
task.GetAttribute("assignee").Set("bo"); task.GetAttribute("text").Set("inherited")
stage.GetRootLayer().Save()
"""

WITH_PYTHON = """
import sys
import usdlive
from usdlive.schemas import Annotation, ApprovalAPI, Note, SessionAPI, Task
from pxr import Sdf, Usd
stage = Usd.Stage.Open(sys.argv[1])
listed, other = stage.GetPrimAtPath("/Listed"), stage.GetPrimAtPath("/Other")
session = SessionAPI.apply(listed); SessionAPI.apply(listed)
assert session.revision == 0 and session.project is None
session.project, session.revision = "ws://127.0.0.1:7447/shot", 1234
assert session.revision == 1234
SessionAPI.apply(other).remove(); SessionAPI(stage.GetPrimAtPath("/Explicit")).remove()
light, fx = ApprovalAPI.apply(listed, "light"), ApprovalAPI.apply(listed, "fx:water")
assert [one.instance for one in ApprovalAPI.all(listed)] == ["light", "fx:water"]
fx.remove()
assert light.state == "waiting"
light.state = "approved"; light.attribute("state").Set("revise", 5)
note = Note.define(stage, "/Notes/first")
note.text, note.author, note.frame, note.image = "too dark", "ada", 12, "./drawing.png"
note.about = "/Other"
assert note.about == [Sdf.Path("/Other")]
note.about = [Sdf.Path("/Other"), "/Listed.usdlive:session:project"]
assert note.about == [Sdf.Path("/Other"), Sdf.Path("/Listed.usdlive:session:project")]
task = Task.define(stage, "/Notes/second")
task.assignee, task.text = "bo", "inherited"
assert task.priority == "normal" and Annotation(task.prim).text == "inherited"
assert note and task and Annotation(note.prim) and session and light
assert not (Task(note.prim) or fx or SessionAPI(other) or Note(Usd.Prim()))
def refuses(error, part, action):
    try: action()
    except error as raised: assert part in str(raised), raised
    else: raise AssertionError(part)
refuses(ValueError, "/Listed", lambda: ApprovalAPI.apply(listed, "state"))
refuses(TypeError, "abstract", lambda: Annotation.define(stage, "/No"))
refuses(AttributeError, "does not have the schema 'UsdliveSessionAPI'",
        lambda: setattr(SessionAPI(other), "user", "bo"))
refuses(AttributeError, "no property 'txet'", lambda: setattr(note, "txet", "x"))
stage.GetRootLayer().Save()
"""


def test_classes_in_cpp_and_python_author_what_pxr_authors(tmp_path):
    files = {name: tmp_path / f"{name}.usda" for name in ("pxr", "python", "cpp")}
    for file in files.values():
        file.write_text(START)
    output(WITH_PXR, PLUGINS, arguments=[files["pxr"]])
    python = subprocess.run([sys.executable, "-c", WITH_PYTHON, files["python"]], text=True, capture_output=True)
    assert python.returncode == 0, python.stderr
    cpp = subprocess.run([BUILD / "bin" / "schema_probe", files["cpp"]], text=True, capture_output=True,
                         env={**os.environ, "PXR_PLUGINPATH_NAME": str(PLUGINS)})
    assert cpp.returncode == 0, cpp.stdout + cpp.stderr
    text = files["pxr"].read_text()
    assert files["python"].read_text() == text
    assert files["cpp"].read_text() == text
    assert cpp.stdout.splitlines() == [
        "fallback 0", "nothing none", "revision 1234", "fallback waiting", "at 7 revise",
        "/Other", "/Listed.usdlive:session:project", "priority normal", "through the base inherited", "111011000",
        "name of a property: </Listed>: cannot apply 'UsdliveApprovalAPI:state': "
        "one of its properties is named 'state'",
        "no instance: </Listed>: cannot apply 'UsdliveApprovalAPI': it needs the name of an instance",
        "no path: cannot define <>: it is no path of a prim, or a prim above it is inactive or not loaded",
        *[f"locked: cannot edit <{path}>: the stage's edit target does not reach it, or its layer may not be edited"
          for path in ("/Notes/first", "/Notes/first", "/Listed")], "1"]


def test_importing_usdlive_registers_the_plug_ins():
    code = ("import usdlive\nfrom pxr import Plug, Usd\n"
            "names = [plugin.name for plugin in Plug.Registry().GetAllPlugins()]\n"
            f"print([names.count(name) for name in {OWN}], bool(Usd.SchemaRegistry().FindSchemaInfo('UsdliveNote')),"
            " usdlive.plugins.register())")
    for path in ({}, {"PXR_PLUGINPATH_NAME": str(PLUGINS)}):
        ran = subprocess.run([sys.executable, "-c", code], text=True, capture_output=True, env={**os.environ, **path})
        assert (ran.stdout, ran.stderr) == ("[1, 1, 1] True []\n", "")
    named = subprocess.run([sys.executable, "-m", "usdlive.plugins"], text=True, capture_output=True, check=True)
    assert output(STOCK, named.stdout.strip()) == "as expected\n" and named.stderr == ""


ORIGIN = """
import sys
from pxr import Usd
stage = Usd.Stage.Open(sys.argv[1])
prim = stage.GetDefaultPrim()
assert prim.HasAPI("UsdliveSessionAPI")
names = ("project", "layer", "revision", "checkpoint", "user")
print([prim.GetAttribute("usdlive:session:" + name).Get() for name in names])
print(prim.GetAttribute("usdlive:session:time").Get())
"""


def test_a_file_that_leaves_the_project_says_where_it_came_from(project, serve, tmp_path):
    import time

    import usdlive
    from pxr import Usd
    (project / "shot.usda").write_text('#usda 1.0\n(\n    defaultPrim = "World"\n)\ndef Xform "World"\n{\n}\n')
    server = serve(project)
    with usdlive.connect(server.url, user="ada") as ada:
        stage = ada.open_stage("shot.usda")
        stage.DefinePrim("/World/New", "Cube")
        assert ada.flush() and ada.revision > 0
        flat = Usd.Stage.Open(stage.Flatten())
        ada.write_origin(flat.GetDefaultPrim(), layer="shot.usda")
        assert flat.Export(str(tmp_path / "flat.usda"))
        names, when = output(ORIGIN, PLUGINS, arguments=[tmp_path / "flat.usda"]).splitlines()
        assert names == str([server.url, "shot.usda", ada.revision, None, "ada"])
        assert abs(time.time() - time.mktime(time.strptime(when, "%Y-%m-%dT%H:%M:%SZ")) + time.timezone) < 60
        assert ada.flush() and not ada.open_layer("shot.usda").GetPrimAtPath("/World").HasInfo("apiSchemas")


# --- the generator -------------------------------------------------------------------------------------

STUDIO = """#usda 1.0
(
    subLayers = [@usd/schema.usda@, @usdGeom/schema.usda@]
)

over "GLOBAL" (
    customData = {
        string libraryName = "studio"
        string libraryPath = "."
        string libraryPrefix = "Studio"
        bool skipCodeGeneration = true
    }
)
{
}

class StudioLamp "StudioLamp" (
    inherits = </Xformable>
    customData = {
        string className = "Lamp"
    }
    doc = "A lamp of the studio."
)
{
    color3f studio:tint = (1, 0.5, 0)
    matrix4d[] studio:places
}

class "StudioDimAPI" (
    inherits = </APISchemaBase>
    customData = {
        token apiSchemaType = "singleApply"
        string className = "DimAPI"
        token[] apiSchemaAutoApplyTo = ["StudioLamp"]
    }
)
{
    float studio:dim = 0.25
}
"""


def generate(source, folder, *options):
    return subprocess.run([sys.executable, GENERATOR, source, folder, *options], text=True, capture_output=True)


def test_a_fresh_schema_is_picked_up(tmp_path):
    source, folder = tmp_path / "schema.usda", tmp_path / "studio"
    source.write_text(STUDIO)
    made = generate(source, folder, "--cpp", tmp_path / "Studio.h", "--python", tmp_path / "studio.py")
    assert made.returncode == 0, made.stderr
    assert differences(tmp_path, [folder, PLUGINS], 6, 200) == []
    asked = ("from pxr import Usd\nstage = Usd.Stage.CreateInMemory()\nlamp = stage.DefinePrim('/L', 'StudioLamp')\n"
             "print(lamp.IsA('Xformable'), lamp.GetAppliedSchemas(), lamp.GetAttribute('studio:dim').Get())")
    assert output(asked, folder) == "True ['StudioDimAPI'] 0.25\n"
    assert "std::optional<pxr::VtArray<pxr::GfMatrix4d>> places(" in (tmp_path / "Studio.h").read_text()
    assert "#include <pxr/base/gf/vec3f.h>" in (tmp_path / "Studio.h").read_text()
    compile((tmp_path / "studio.py").read_text(), "studio.py", "exec")

    # Nothing is written without a change, and what is removed from the source is removed from the library.
    times = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    assert generate(source, folder).returncode == 0
    assert {path: path.stat().st_mtime_ns for path in folder.iterdir()} == times
    source.write_text(STUDIO[:STUDIO.index('class "StudioDimAPI"')])
    assert generate(source, folder).returncode == 0
    assert output(asked, folder) == "True [] None\n" or "StudioDim" not in (folder / "plugInfo.json").read_text()


def test_accessors_hide_no_member_of_the_classes(tmp_path):
    from usdlive import _schema_access

    classes = (_schema_access.TypedSchema, _schema_access.ApiSchema, _schema_access.MultipleApiSchema,
               _schema_access.NonAppliedApiSchema)
    members = {name for one in classes for name in dir(one) if not name.startswith("_")} | {"prim", "instance"}
    assert members <= runpy.run_path(str(GENERATOR))["TAKEN"]["accessors.py.jinja"]
    source = tmp_path / "schema.usda"
    source.write_text(STUDIO.replace("    matrix4d[] studio:places", "    matrix4d[] studio:lambda"))
    made = generate(source, tmp_path / "studio", "--python", tmp_path / "studio.py")
    assert made.returncode != 0 and "accessor 'lambda'" in made.stderr


@pytest.mark.parametrize("change, part", [
    (("inherits = </Xformable>", "inherits = </Nothing>"), "Nothing"),
    (("color3f studio:tint", "notype studio:tint"), "notype"),
    (('class "StudioDimAPI"', 'class "StudioDim"'), "API suffix"),
    (("    matrix4d[] studio:places", "    matrix4d[] other:tint"), "two properties of 'StudioLamp' end with 'tint'"),
    (("    matrix4d[] studio:places", "    matrix4d[] studio:class"), "accessor 'class'"),
    (("    matrix4d[] studio:places", "    matrix4d[] studio:targets"), "accessor 'targets'"),
    (("#usda 1.0", "no layer"), "schema.usda"),
])
def test_a_malformed_schema_is_an_error_that_names_it(tmp_path, change, part):
    source, folder = tmp_path / "schema.usda", tmp_path / "studio"
    source.write_text(STUDIO.replace(*change))
    made = generate(source, folder, "--cpp", tmp_path / "Studio.h")
    assert made.returncode != 0
    assert part in made.stderr and str(source) in made.stderr, made.stderr
    assert not (tmp_path / "Studio.h").exists()


# --- plug-ins that do not fit --------------------------------------------------------------------------


def test_two_libraries_with_one_identifier_are_reported(tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(PLUGINS / "usdliveSession", copy)
    info = json.loads((copy / "plugInfo.json").read_text())
    info["Plugins"][0]["Name"] = "copied"
    types = info["Plugins"][0]["Info"]["Types"]
    info["Plugins"][0]["Info"]["Types"] = {
        "Copied" + name: {**value, "bases": ["UsdTyped" if "Typed" in value["schemaKind"] else "UsdAPISchemaBase"]}
        for name, value in types.items()}
    (copy / "plugInfo.json").write_text(json.dumps(info))
    problems = ask(["definitions", str(tmp_path / "ours.usda")], [PLUGINS, copy], "UsdliveNote\n")
    assert "schema 'UsdliveNote': plug-in 'usdliveSession' declares it, too; the one of plug-in 'copied' is used" \
        in problems
    from pxr import Sdf
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "ours.usda"))
    assert "text" in layer.GetPrimAtPath("/_0").properties, "one of them works"


REPORTED = """
import sys
from pxr import Plug, Tf
try:
    Plug.Registry().GetAllPlugins()
    raise AssertionError("not reported")
except Tf.ErrorException as error:
    print(error, file=sys.stderr)
"""


@pytest.mark.parametrize("text", ["{", '{"Plugins": 3}', '{"Plugins": [{"Name": "broken", "Type": "no such type"}]}'])
def test_a_malformed_plug_info_is_named_and_harms_nothing_else(tmp_path, text):
    (tmp_path / "plugInfo.json").write_text(text)
    # The first call from Python raises the error, the next ones work.
    ran = fresh(REPORTED + STOCK, tmp_path, PLUGINS)
    assert (ran.returncode, ran.stdout) == (0, "as expected\n"), ran.stderr
    assert str(tmp_path / "plugInfo.json") in ran.stderr
    path = f"{tmp_path}{os.pathsep}{PLUGINS}"
    ours = subprocess.run([sys.executable, "-c", "import usdlive\n" + STOCK], text=True, capture_output=True,
                          env={**os.environ, "PXR_PLUGINPATH_NAME": path})
    assert (ours.returncode, ours.stdout) == (0, "as expected\n"), ours.stderr
    assert str(tmp_path / "plugInfo.json") in ours.stderr
    cpp = subprocess.run([BUILD / "bin" / "stage_probe", "applying"], input="UsdliveSessionAPI Scope\n", text=True,
                         capture_output=True, env={**os.environ, "PXR_PLUGINPATH_NAME": path})
    assert cpp.stdout == "yes\n"
    assert str(tmp_path / "plugInfo.json") in cpp.stderr
