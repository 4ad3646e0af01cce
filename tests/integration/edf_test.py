"""The file format `edf` in stock usd-core: dynamic payloads by data providers, and what happens when these fail."""

import json
import os
import pathlib
import subprocess
import sys

import pytest
from edf import PLUGINS, calls, fresh, parameters, plugin_path, prim, scene
from stage_dump import differences

HERE = pathlib.Path(__file__).parent


def generated(name, /, **arguments):
    return prim(name, parameters("generator", **arguments))


def probed(name, behaviour, /, **arguments):
    return prim(name, parameters("test", behaviour=behaviour, **arguments))


@pytest.mark.parametrize("arc, errors", [("references", 1), ("payload", 0)])
def test_a_reference_passes_no_parameters_and_says_so(tmp_path, arc, errors):
    scene(tmp_path, generated("A", size="2x1x1").replace("payload =", arc + " ="), "def \"B\" (payload = @./x.edf@)\n{\n}\n")
    (tmp_path / "x.edf").touch()
    ran = fresh(tmp_path, """
        stage = Usd.Stage.Open("scene.usda")
        result = [len(names(stage, "/A")), len(errors(stage))]""")
    assert ran.result == [2 - 2 * errors, errors]
    assert ran.warnings.count("no payload uses it; references and sublayers pass no parameters") == errors


# --- arguments -----------------------------------------------------------------------------------------


def test_arguments_of_the_metadata_are_in_the_identifier_of_the_layer(tmp_path):
    scene(tmp_path, generated("A", size="4x2x1", spacing="3"))
    ran = fresh(tmp_path, """
        stage = Usd.Stage.Open("scene.usda")
        result = [names(stage), arguments(stage), edf(stage)]""")
    assert ran.result[0] == [f"Item_{i}" for i in range(8)]
    assert ran.result[1] == [{"dataProviderId": "generator", "providerArgs:shape": "grid",
                              "providerArgs:size": "4x2x1", "providerArgs:spacing": "3"}]
    assert ran.result[2][0].startswith("anon:edf:content.edf:SDF_FORMAT_ARGS:")
    assert "anon" not in ran.warnings


def test_one_value_gives_one_argument_one_gives_many_and_many_give_one(tmp_path):
    scene(tmp_path, generated("One", spacing="7"), generated("Many", preset="village"),
          generated("Of", columns=3, rows=2, levels=1, spacing="9"))
    ran = fresh(tmp_path, """
        stage = Usd.Stage.Open("scene.usda")
        result = [[names(stage, path).__len__() for path in ("/One", "/Many", "/Of")], arguments(stage)]""")
    assert ran.result[0] == [100, 64, 6]
    found = {one["providerArgs:spacing"]: one for one in ran.result[1]}
    assert found["20"] == {"dataProviderId": "generator", "providerArgs:shape": "buildings", "providerArgs:size": "8x8x1",
                           "providerArgs:spacing": "20", "providerArgs:seed": "3"}, "1:N"
    assert found["7"]["providerArgs:size"] == "10x10x1", "1:1"
    assert found["9"]["providerArgs:size"] == "3x2x1" and "providerArgs:rows" not in found["9"], "N:1"


def test_equal_arguments_share_one_layer_that_is_read_once(tmp_path):
    scene(tmp_path, *(probed(name, "well", name="same") for name in "ABC"), probed("D", "well", name="other"),
          # The same content, said in another way.
          generated("E", size="2x2x1"), generated("F", columns="2", rows=2, levels="1"))
    ran = fresh(tmp_path, """
        stage = Usd.Stage.Open("scene.usda")
        result = [len(edf(stage)), [names(stage, "/" + one) for one in "ABCDEF"]]""")
    assert ran.result == [3, [["A"]] * 4 + [[f"Item_{i}" for i in range(4)]] * 2]
    assert sorted(calls(tmp_path)) == ["read well other", "read well same"]


@pytest.mark.parametrize("text", ["a&b=c", "50%", "%26", "x]", "[y", "ü ö", "a:SDF_FORMAT_ARGS:b=c", "line\nend", ""])
def test_any_text_arrives_at_the_provider(tmp_path, text):
    scene(tmp_path, prim("A", parameters("hello", name="x")))
    code = f"""
        stage = Usd.Stage.Open("scene.usda")
        change(stage.GetPrimAtPath("/A"), name={text!r})
        hello = stage.GetPrimAtPath("/A/Hello")
        result = hello.GetAttribute("greeting").Get() if hello else errors(stage)"""
    found = fresh(tmp_path, code).result
    assert found == "Hello, " + text if text else "</A>" in found[0]


@pytest.mark.parametrize("asset", ["anon:edf:x.edf", "anon:edf:100%natural.edf", "anon:edf:%s%n%d.edf"])
def test_no_text_of_an_anonymous_asset_is_a_format(tmp_path, asset):
    """Sdf gives the identifier of an anonymous layer to printf."""
    texts = ["Bo", "a&s&s&s&n", "%s%s%s%n", "50%", "%p"]
    scene(tmp_path, prim("A", parameters("hello", name="x")))
    code = f"""
        stage = Usd.Stage.Open("scene.usda")
        prim = stage.GetPrimAtPath("/A")
        prim.GetPayloads().SetPayloads([Sdf.Payload({asset!r})])
        result = []
        for text in {texts!r}:
            change(prim, name=text)
            layers = [layer.identifier for layer in stage.GetUsedLayers() if layer.identifier.startswith({asset!r})]
            result.append([stage.GetPrimAtPath("/A/Hello").GetAttribute("greeting").Get(), len(layers)])"""
    assert fresh(tmp_path, code).result == [["Hello, " + text, 1] for text in texts]


# --- which opinion, and when it is read again ----------------------------------------------------------


def test_the_strongest_opinion_decides(tmp_path):
    weaker = parameters("generator", size="2x1x1")
    scene(tmp_path, prim("A", weaker), name="weak.usda")
    scene(tmp_path, prim("A", parameters("generator", size="3x1x1"), asset="", word="over"), name="strong.usda")
    scene(tmp_path, name="root.usda", header="    subLayers = [@strong.usda@, @weak.usda@]\n")
    scene(tmp_path, 'def "A" (references = @weak.usda@</A>\n' + parameters("generator", size="4x1x1") + ") {\n}\n",
          name="referencing.usda")
    scene(tmp_path, 'def "A" (\n    payload = @anon:edf:v.edf@\n    variants = { string v = "on" }\n'
          '    prepend variantSets = "v"\n)\n{\n    variantSet "v" = {\n        "on" (\n'
          + parameters("generator", size="6x1x1") + "        ) {\n        }\n        \"off\" {\n        }\n    }\n}\n",
          name="variant.usda")
    ran = fresh(tmp_path, """
        stage = Usd.Stage.Open("root.usda")
        prim = stage.GetPrimAtPath("/A")
        counts = {"sublayer": len(names(stage))}
        with Usd.EditContext(stage, stage.GetSessionLayer()):
            change(prim, size="5x1x1")
        counts["session"] = len(names(stage))
        stage.GetSessionLayer().Clear()
        counts["session cleared"] = len(names(stage))
        stage.MuteLayer(os.path.abspath("strong.usda"))
        counts["muted"] = len(names(stage))
        counts["referencing"] = len(names(Usd.Stage.Open("referencing.usda")))
        variants = Usd.Stage.Open("variant.usda")
        counts["variant"] = len(names(variants))
        variants.GetPrimAtPath("/A").GetVariantSet("v").SetVariantSelection("off")
        counts["no opinion"] = len(names(variants))
        result = counts""")
    assert ran.result == {"sublayer": 3, "session": 5, "session cleared": 3, "muted": 2, "referencing": 4, "variant": 6,
                          "no opinion": 0}


def test_single_keys_of_the_arguments_compose(tmp_path):
    scene(tmp_path, prim("A", parameters("generator", size="2x1x1", spacing="3")), name="weak.usda")
    scene(tmp_path, prim("A", "    EdfDataParameters = { dictionary providerArgs = { string spacing = \"5\" } }\n",
                         asset="", word="over"), header="    subLayers = [@weak.usda@]\n")
    ran = fresh(tmp_path, 'result = arguments(Usd.Stage.Open("scene.usda"))')
    assert ran.result[0]["providerArgs:size"] == "2x1x1" and ran.result[0]["providerArgs:spacing"] == "5"


def test_clearing_falls_back(tmp_path):
    scene(tmp_path, prim("A", parameters("generator", size="2x1x1")), name="weak.usda")
    scene(tmp_path, prim("A", parameters("generator", size="3x1x1"), asset="", word="over"),
          header="    subLayers = [@weak.usda@]\n")
    ran = fresh(tmp_path, """
        stage = Usd.Stage.Open("scene.usda")
        prim = stage.GetPrimAtPath("/A")
        counts = [len(names(stage))]
        prim.ClearMetadataByDictKey("EdfDataParameters", "providerArgs:size")
        counts.append(len(names(stage)))
        Sdf.Layer.FindOrOpen("weak.usda").GetPrimAtPath("/A").ClearInfo("EdfDataParameters")
        counts.append(len(names(stage)))
        prim.ClearMetadata("EdfDataParameters")
        counts.append(len(names(stage)))
        result = [counts, errors(stage), [list(one) for one in arguments(stage)]]""")
    assert ran.result == [[3, 2, 100, 0], [], [["dataProviderId"]]], "own, of the sublayer, the provider's default, without a provider"


CHANGES = """
        resynced = []
        def note(notice, sender):
            resynced.extend(str(path) for path in notice.GetResyncedPaths())
        listener = Tf.Notice.Register(Usd.Notice.ObjectsChanged, note, stage)
        def after(edit):
            resynced.clear()
            before = open(os.environ["EDF_TEST_LOG"]).read().count("\\n")
            edit()
            return [sorted(resynced), open(os.environ["EDF_TEST_LOG"]).read().count("\\n") - before]
"""


def test_only_relevant_metadata_composes_again_and_only_the_affected_payload(tmp_path):
    scene(tmp_path, prim("A", parameters("test", behaviour="well", name="weak")), name="weak.usda")
    scene(tmp_path, prim("A", parameters("test", name="1"), asset="", word="over"), probed("B", "well", name="2"),
          prim("C", asset=""), header="    subLayers = [@weak.usda@]\n")
    ran = fresh(tmp_path, """
        stage = Usd.Stage.Open("scene.usda")
        a, b, c = (stage.GetPrimAtPath("/" + one) for one in "ABC")
        weak = Sdf.Layer.FindOrOpen("weak.usda").GetPrimAtPath("/A")
        inA = stage.GetPrimAtPath("/A/A")
        """ + CHANGES + """
        result = {
            "another argument": after(lambda: change(a, name="3")),
            "the same again": after(lambda: change(a, name="3")),
            "arguments that another payload has": after(lambda: change(a, name="2")),
            "other metadata": after(lambda: a.SetMetadata("customData", {"name": "9"})),
            "documentation": after(lambda: a.SetDocumentation("text")),
            "another key": after(lambda: a.SetMetadataByDictKey("EdfDataParameters", "note", "text")),
            "a weaker opinion": after(lambda: weak.SetInfoDictionaryValue("EdfDataParameters", "providerArgs",
                                      {"behaviour": "well", "name": "weaker"})),
            "a prim without a payload": after(lambda: change(c, name="4")),
            "an attribute": after(lambda: a.CreateAttribute("x", Sdf.ValueTypeNames.Int).Set(1)),
            "a prim of the content": after(lambda: inA.SetMetadata("customData", {"a": 1})),
            "the provider": after(lambda: b.SetMetadataByDictKey("EdfDataParameters", "dataProviderId", "generator")),
        }""")
    unaffected = [[], 0]
    assert ran.result == {
        "another argument": [["/A"], 1],
        "the same again": unaffected,
        "arguments that another payload has": [["/A"], 0],
        "other metadata": unaffected,
        "documentation": unaffected,
        "another key": unaffected,
        "a weaker opinion": unaffected,
        "a prim without a payload": unaffected,
        "an attribute": [["/A.x"], 0],
        "a prim of the content": unaffected,
        "the provider": [["/B"], 0],
    }


def test_opinions_that_become_the_strongest_are_followed(tmp_path):
    """The rule for weaker opinions must not miss changes: every order of two edits ends as a newly opened stage."""
    scene(tmp_path, prim("A", parameters("generator", size="1x1x1", spacing="2")), name="weak.usda")
    scene(tmp_path, prim("A", asset="", word="over"), name="middle.usda")
    scene(tmp_path, prim("A", asset="", word="over"), header="    subLayers = [@middle.usda@, @weak.usda@]\n")
    ran = fresh(tmp_path, """
        import itertools, random
        stage = Usd.Stage.Open("scene.usda")
        layers = [stage.GetRootLayer(), Sdf.Layer.FindOrOpen("middle.usda"), Sdf.Layer.FindOrOpen("weak.usda"),
                  stage.GetSessionLayer()]
        chance = random.Random(7)
        wrong = []
        for step in range(400):
            with Sdf.ChangeBlock():
                for layer in chance.sample(layers, chance.choice([1, 1, 2])):
                    spec = Sdf.CreatePrimInLayer(layer, "/A")
                    kind = chance.randrange(5)
                    args = {key: chance.choice(values) for key, values in
                            {"size": ["1x1x1", "2x1x1", "3x1x1"], "spacing": ["2", "3"]}.items() if chance.random() < 0.6}
                    if kind == 0:
                        spec.ClearInfo("EdfDataParameters")
                    elif kind == 1:
                        spec.SetInfo("EdfDataParameters", {"providerArgs": args})
                    elif kind == 2:
                        spec.SetInfo("EdfDataParameters", {"dataProviderId": "generator", "providerArgs": args})
                    elif kind == 3:
                        spec.SetInfo("EdfDataParameters", {"providerArgs": "no dictionary"})
                    else:
                        spec.SetInfo("EdfDataParameters", {"note": "x"})
            again = Usd.Stage.Open(stage.GetRootLayer(), stage.GetSessionLayer())
            if names(stage) != names(again) or arguments(stage) != arguments(again):
                wrong.append([step, names(stage), names(again)])
        result = wrong""")
    assert ran.result == []


def test_unload_and_load_keep_the_arguments(tmp_path):
    scene(tmp_path, probed("A", "well", name="1"))
    ran = fresh(tmp_path, """
        stage = Usd.Stage.Open("scene.usda", Usd.Stage.LoadNone)
        counts = [len(names(stage)), os.path.exists(os.environ["EDF_TEST_LOG"])]
        stage.Load("/A"); counts += [names(stage), edf(stage)]
        stage.Unload("/A"); counts.append(names(stage))
        stage.Load("/A"); counts += [names(stage), edf(stage)]
        result = counts""")
    assert ran.result[:2] == [0, False], "an unloaded payload is not read"
    assert ran.result[2] == ["A"] and ran.result[4] == [] and ran.result[5] == ["A"]
    assert ran.result[3] == ran.result[6]


# --- the layer -----------------------------------------------------------------------------------------


def test_a_layer_can_be_neither_edited_nor_saved_nor_written(tmp_path):
    (tmp_path / "x.edf").touch()
    ran = fresh(tmp_path, """
        layer = Sdf.Layer.FindOrOpen("x.edf", {"dataProviderId": "test", "providerArgs:behaviour": "well"})
        format = layer.GetFileFormat()
        def refused(what):
            try:
                return not what()
            except Tf.ErrorException:
                return True
        result = [layer.permissionToEdit, layer.permissionToSave, format.SupportsReading(), format.SupportsWriting(),
                  format.SupportsEditing(), refused(lambda: Sdf.CreatePrimInLayer(layer, "/B")), refused(lambda: layer.Save(force=True)),
                  refused(lambda: layer.Export("y.edf")), refused(lambda: Sdf.Layer.CreateNew("z.edf")),
                  [str(prim.path) for prim in layer.rootPrims], layer.defaultPrim]""")
    assert ran.result == [False, False, True, False, False, True, True, True, True, ["/Data"], "Data"]
    assert not (tmp_path / "y.edf").exists() and not (tmp_path / "z.edf").exists()


@pytest.mark.parametrize("behaviour", ["all kinds", "deferred"])
def test_export_transfer_flatten_and_text_lose_nothing(tmp_path, behaviour):
    scene(tmp_path, probed("A", behaviour))
    (tmp_path / "x.edf").touch()
    ran = fresh(tmp_path, """
        def opened(asset="anon:edf:x.edf", where=[0]):
            where[0] += 1
            args = {"dataProviderId": "test", "providerArgs:behaviour": %r, "providerArgs:copy": str(where[0])}
            return Sdf.Layer.FindOrOpen(asset, args)
        def content(layer):
            found = {}
            def visit(path):
                spec = layer.GetObjectAtPath(path)
                if spec is None:  # a target
                    return
                found[str(path)] = {key: str(spec.GetInfo(key)) for key in spec.ListInfoKeys() if key != "timeSamples"}
                if path.IsPropertyPath():
                    found[str(path)]["samples"] = [(time, layer.QueryTimeSample(path, time))
                                                   for time in layer.ListTimeSamplesForPath(path)]
            layer.Traverse("/", visit)
            return found
        copies = {"itself": opened()}
        for ending in ("usda", "usdc"):
            opened().Export("copy." + ending)
            copies[ending] = Sdf.Layer.FindOrOpen("copy." + ending)
        copies["transfer"] = Sdf.Layer.CreateAnonymous(".usda")
        copies["transfer"].TransferContent(opened())
        copies["text"] = Sdf.Layer.CreateAnonymous(".usda")
        copies["text"].ImportFromString(opened().ExportToString())
        copies["spec"] = Sdf.Layer.CreateAnonymous(".usda")
        assert Sdf.CopySpec(opened(), "/Data", copies["spec"], "/Data")
        copies["spec"].defaultPrim = "Data"
        Sdf.Layer.SetDetachedLayerRules(Sdf.Layer.DetachedLayerRules().IncludeAll())
        copies["detached"] = opened("x.edf")  # anonymous layers are never detached
        assert copies["detached"].IsDetached()
        want = content(copies["itself"])
        result = [{name: content(layer) for name, layer in copies.items() if content(layer) != want}, sorted(want)]
        flat = Usd.Stage.Open("scene.usda").Flatten()
        result.append(sorted(path.replace("/A", "/Data", 1) for path in content(flat) if path != "/"))
        """ % behaviour)
    assert ran.result[0] == {}
    paths = ran.result[1]
    if behaviour == "deferred":
        assert len(paths) == 2 + 2 + 2 * (4 + 2 * 4), paths
    else:
        assert paths == ["/", "/Data", "/Data/All", "/Data/All.moving", "/Data/All.others", "/Data/All.still",
                         "/Data/All/Class"]
    assert ran.result[2] == [path for path in paths if path != "/"]


# --- deferred reading ----------------------------------------------------------------------------------

DEFERRED = """
        log = os.environ["EDF_TEST_LOG"]
        open(log, "w").close()
        def layer(**more):
            args = {"dataProviderId": "test", "providerArgs:behaviour": "deferred"}
            args.update({"providerArgs:" + key: value for key, value in more.items()})
            return Sdf.Layer.FindOrOpen("anon:edf:x.edf", args)
        def read():
            lines = [line.removeprefix("children ") for line in open(log).read().splitlines() if "children" in line]
            open(log, "w").close()
            return lines
"""


def test_deferred_children_are_read_by_whatever_needs_them(tmp_path):
    ran = fresh(tmp_path, DEFERRED + """
        found = {}
        one = layer(); spec = one.GetPrimAtPath("/Data/One")
        found["opened"] = [read(), one.IsDetached(), spec.typeName]
        found["children"] = [[child.name for child in spec.nameChildren], read()]
        found["again"] = [len(spec.nameChildren), read()]
        found["a path below"] = [one.GetPrimAtPath("/Data/Two/X/Y").name, read()]
        found["no such path"] = [one.GetPrimAtPath("/Data/One/Z/Z"), read()]
        listed = layer(copy="1")
        target = Sdf.Layer.CreateAnonymous()
        assert Sdf.CopySpec(listed, "/Data/Two", target, "/Two")
        found["copy"] = [str(target.GetPrimAtPath("/Two/X/Y").path), sorted(read())]
        whole = layer(copy="2")
        whole.Export("whole.usda")
        found["all"] = [sorted(read()), whole.IsDetached()]
        masked = Usd.Stage.OpenMasked(layer(copy="3"), Usd.StagePopulationMask(["/Data/Two/X"]))
        found["mask"] = [names(masked, "/Data"), sorted(set(read()))]
        result = found""")
    everything = sorted(f"/Data/{a}{b}" for a in ("One", "Two") for b in ("", "/X", "/Y"))
    assert ran.result["opened"] == [[], False, "Scope"]
    assert ran.result["children"] == [["X", "Y"], ["/Data/One"]]
    assert ran.result["again"] == [2, []]
    assert ran.result["a path below"] == ["Y", ["/Data/Two", "/Data/Two/X"]]
    assert ran.result["no such path"] == [None, []]
    assert ran.result["copy"] == ["/Two/X/Y", ["/Data/Two", "/Data/Two/X", "/Data/Two/Y"]], "a copy lists the fields"
    assert ran.result["all"] == [everything, True]
    assert "/Data/One" not in ran.result["mask"][1] and "/Data/Two/X" in ran.result["mask"][1]


def test_many_threads_read_a_deferred_prim_once(tmp_path):
    scene(tmp_path, *(probed(f"P{i}", "deferred", name="shared") for i in range(20)))
    ran = fresh(tmp_path, """
        stage = Usd.Stage.Open("scene.usda")
        result = len(list(stage.Traverse()))""", PXR_WORK_THREAD_LIMIT="8")
    assert ran.result == 20 * (1 + 2 + 4 + 8)
    lines = calls(tmp_path)
    assert len(lines) == len(set(lines)) == 1 + 2 + 4


@pytest.mark.parametrize("behaviour, cause", [
    ("deferred, fails", "the shelf is empty"),
    ("deferred, throws", "it threw an exception: the shelf fell"),
    ("deferred, hangs", "it did not answer within 1500 ms"),
    ("deferred, own property", "there is no prim /Data/One for the property late"),
])
def test_failing_deferred_reads_leave_no_children_and_a_warning(tmp_path, behaviour, cause):
    scene(tmp_path, probed("A", behaviour), generated("B", size="2x1x1"))
    ran = fresh(tmp_path, """
        stage = Usd.Stage.Open("scene.usda")
        result = [names(stage), names(stage, "/A/One"), names(stage, "/B"), errors(stage)]""")
    assert ran.result == [["One", "Two"], [], ["Item_0", "Item_1"], []]
    assert "provider 'test' of the plug-in edfTest could not read the children of /Data/One" in ran.warnings
    assert cause in ran.warnings


# --- providers that fail -------------------------------------------------------------------------------


@pytest.mark.parametrize("behaviour, cause", [
    ("fails", "the well is dry"),
    ("fails without a reason", "it gave no reason"),
    ("throws", "it threw an exception: the well is deep"),
    ("throws a number", "it threw an exception that is no std::exception"),
    ("throws when created", "it threw an exception: no provider today"),
    ("posts an error", "posted by the provider"),
    ("hangs", "it did not answer within 1500 ms"),
    ("refuses", "refuses its arguments: these arguments are wrong"),
    ("bad name", "'1 2' is no name of a prim"),
    ("bad type", "'a b' is no type of a prim"),
    ("outside", "there is no prim /Other for the child A"),
    ("twice", "/Data/A was created twice"),
    ("bad value", "the value of /Data.a is of type string, not int"),
    ("unknown field", "the field nonsense is unknown here"),
    ("schemas as tokens", "the field apiSchemas is of type"),
    ("own children", "the field primChildren cannot be set"),
    ("lazy", "the children of /Data cannot be deferred"),
])
def test_a_failing_provider_is_an_error_of_its_payload_alone(tmp_path, behaviour, cause):
    scene(tmp_path, probed("A", behaviour), probed("B", "well"))
    ran = fresh(tmp_path, """
        stage = Usd.Stage.Open("scene.usda")
        result = [names(stage), names(stage, "/B"), errors(stage)]""")
    assert ran.result[:2] == [[], ["A"]]
    [error] = ran.result[2]
    assert "Unresolved payload" in error and "</A>" in error and "dataProviderId=test" in error, error
    [warning] = [line for line in ran.warnings.splitlines() if "cannot be read" in line]
    assert "'test'" in warning and "edfTest" in warning and cause in warning, warning
    assert "anon:edf:content.edf:SDF_FORMAT_ARGS:" in warning


def test_a_provider_that_never_returns_is_called_four_times_at_most(tmp_path):
    scene(tmp_path, *(probed(f"P{i}", "never returns", name=str(i)) for i in range(6)), probed("Z", "well"))
    ran = fresh(tmp_path, """
        begin = time.monotonic()
        stage = Usd.Stage.Open("scene.usda")
        result = [errors(stage), names(stage, "/Z"), time.monotonic() - begin]""",
                PXR_WORK_THREAD_LIMIT="1", USDLIVE_EDF_TIME_LIMIT="0.2")
    assert len(ran.result[0]) in (6, 7), "the last one is well, if it is asked before the fourth"
    assert ran.warnings.count("did not answer within 200 ms") == 4
    assert ran.warnings.count("4 earlier calls have not returned yet") >= 2
    assert len([line for line in calls(tmp_path) if "never returns" in line]) == 4


def plug_info(folder, name, types, library="none.so"):
    folder.mkdir()
    (folder / "plugInfo.json").write_text(json.dumps({"Plugins": [{
        "Name": name, "Type": "library", "Root": ".", "LibraryPath": library, "ResourcePath": ".",
        "Info": {"Types": types}}]}))
    return folder


def test_plug_ins_that_cannot_be_used(tmp_path):
    derived = {"bases": ["IEdfDataProvider"]}
    plugins = [
        plug_info(tmp_path / "gone", "goneLibrary", {"EdfGone": {**derived, "dataProviderId": "gone"}}),
        plug_info(tmp_path / "broken", "brokenLibrary", {"EdfBroken": {**derived, "dataProviderId": "broken"}}, "broken.so"),
        plug_info(tmp_path / "again", "zSecond", {"ZSecond": {**derived, "dataProviderId": "hello"}}),
        plug_info(tmp_path / "nothing", "nothing", {"EdfNothing": derived}),
        plug_info(tmp_path / "odd", "odd", {"EdfOdd": "text"}),
        tmp_path / "bad",
    ]
    (tmp_path / "broken" / "broken.so").write_bytes(b"\x7fELF and no more")
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "plugInfo.json").write_text('{"Plugins": [')
    ids = ["gone", "broken", "undefined", "foreign", "unheard", "hello"]
    scene(tmp_path, *(prim(name.capitalize(), parameters(name)) for name in ids))
    # A malformed plugInfo.json is an error of OpenUSD as soon as it looks for plug-ins.
    ran = fresh(tmp_path, """
        try:
            Plug.Registry()
            Usd.Stage.CreateInMemory()
        except Tf.ErrorException as error:
            assert "bad" in str(error), error
        stage = Usd.Stage.Open("scene.usda")
        result = [errors(stage), names(stage, "/Hello")]""", *plugins)
    assert len(ran.result[0]) == 5 and not any("</Hello>" in error for error in ran.result[0])
    found = {name: next((line for line in ran.warnings.splitlines()
                         if f"dataProviderId={name}@ cannot be read" in line), "") for name in ids}
    assert "plug-in goneLibrary" in found["gone"] and "could not be loaded" in found["gone"]
    assert "plug-in brokenLibrary" in found["broken"] and "could not be loaded" in found["broken"]
    assert "plug-in edfTest" in found["undefined"] and "does not define the type EdfUndefinedProvider" in found["undefined"]
    assert "another version of DataProvider.h" in found["foreign"]
    assert "no plug-in has the provider 'unheard'; known are:" in found["unheard"] and "omniMet" in found["unheard"]
    assert found["hello"] == "" and ran.result[1] == ["Hello"]
    assert "no text dataProviderId for EdfNothing" in ran.warnings
    assert "no text dataProviderId for EdfNamelessProvider" in ran.warnings
    assert "both have the provider 'hello'" in ran.warnings
    assert ran.warnings.count("no text dataProviderId for EdfNothing") == 1, "said once"


def test_a_library_is_loaded_on_first_use(tmp_path):
    scene(tmp_path, generated("A", size="1x1x1"))
    ran = fresh(tmp_path, """
        loaded = lambda: sorted(name for name in ("usdliveEdf", "usdliveEdfGenerator", "usdliveEdfMuseum", "edfTest")
                                if Plug.Registry().GetPluginWithName(name).isLoaded)
        before = loaded()
        stage = Usd.Stage.Open("scene.usda")
        result = [before, loaded()]""")
    assert ran.result == [[], ["usdliveEdf", "usdliveEdfGenerator"]]


def test_a_provider_registered_later_is_found(tmp_path):
    late = pathlib.Path(plugin_path()).name  # helloProvider
    folder = plugin_path().split(os.pathsep)[-1]
    scene(tmp_path, prim("A", parameters("hello")))
    ran = fresh(tmp_path, f"""
        stage = Usd.Stage.Open("scene.usda")
        before = len(errors(stage))
        Plug.Registry().RegisterPlugins({folder!r})
        stage.Reload()
        result = [before, names(stage), errors(stage)]""", PXR_PLUGINPATH_NAME=str(PLUGINS))
    assert ran.result == [1, ["Hello"], []], late


@pytest.mark.parametrize("metadata, cause", [
    ("int[] dataProviderId = [1]", "dataProviderId is of type"),
    ('string dataProviderId = "test"\n        string providerArgs = "x"', "providerArgs is of type string"),
    ('string dataProviderId = "test"\n        dictionary providerArgs = { double[] size = [1, 2] }',
     "providerArgs:size is of type"),
    ('string dataProviderId = "test"\n        dictionary providerArgs = { dictionary a = { int b = 1 } }',
     "providerArgs:a is of type"),
    ('string dataProviderId = "generator"\n        dictionary providerArgs = { string size = "many" }',
     "size is 'many', which is no number"),
    ('string dataProviderId = "generator"\n        dictionary providerArgs = { string size = "200x200" }',
     "more than 10000 items"),
    ('string dataProviderId = "generator"\n        dictionary providerArgs = { double spacing = inf }',
     "spacing is not finite"),
])
def test_metadata_of_the_wrong_type_is_an_error_of_the_payload(tmp_path, metadata, cause):
    scene(tmp_path, prim("A", "    EdfDataParameters = {\n        " + metadata + "\n    }\n"), generated("B", size="1x1x1"))
    ran = fresh(tmp_path, """
        stage = Usd.Stage.Open("scene.usda")
        result = [errors(stage), names(stage), names(stage, "/B")]""")
    assert len(ran.result[0]) == 1 and "</A>" in ran.result[0][0], ran.result
    assert cause in ran.warnings
    assert ran.result[1:] == [[], ["Item_0"]]


def test_warnings_of_a_provider_name_the_payload(tmp_path):
    scene(tmp_path, probed("A", "warns"))
    ran = fresh(tmp_path, 'result = errors(Usd.Stage.Open("scene.usda"))')
    assert ran.result == []
    assert "provider 'test' of the plug-in edfTest: one part is missing" in ran.warnings
    assert "anon:edf:content.edf" in ran.warnings


def test_errors_are_gone_after_the_metadata_is_right_or_a_reload(tmp_path):
    scene(tmp_path, probed("A", "fails"))
    ran = fresh(tmp_path, """
        stage = Usd.Stage.Open("scene.usda")
        counts = [len(errors(stage))]
        change(stage.GetPrimAtPath("/A"), behaviour="well")
        result = counts + [len(errors(stage)), names(stage)]""")
    assert ran.result == [1, 0, ["A"]]


# --- the table -----------------------------------------------------------------------------------------

TREE = '#usda 1.0\n(\n    defaultPrim = "Tree"\n)\ndef Sphere "Tree" {\n    double radius = 2\n}\ndef Cone "Fir" {\n}\n'
TABLE = """name,asset,prim,x,y,z,rotateY,scale,note
oak,./tree.usda,,1,2,-3.5,90,2,"tall, ""old"" one"
oak,./tree.usda,/Fir,,,,,,
,./tree.usda,,4,,,,,

place,,,7,,,,,
"""


def placed(name, **arguments):
    return prim(name, parameters("table", **arguments), asset="./content.edf")


@pytest.fixture
def forest(tmp_path):
    (tmp_path / "content.edf").touch()
    (tmp_path / "tree.usda").write_text(TREE)
    (tmp_path / "trees.csv").write_text(TABLE)
    return tmp_path


def test_rows_of_a_table_are_placements(forest):
    scene(forest, placed("A", table="./trees.csv"))
    ran = fresh(forest, """
        from pxr import UsdGeom
        stage = Usd.Stage.Open("scene.usda")
        place = lambda name: [round(x, 6) for x in UsdGeom.Xformable(stage.GetPrimAtPath("/A/" + name))
                              .GetLocalTransformation().Transform((1, 0, 0))]
        prims = [stage.GetPrimAtPath("/A/" + name) for name in names(stage)]
        result = [names(stage), [place(name) for name in names(stage)], [prim.IsInstance() for prim in prims],
                  [prim.GetTypeName() for prim in prims], prims[0].GetAttribute("table:note").Get(),
                  prims[0].GetAttribute("radius").Get(), stage.GetPrimAtPath("/A").GetTypeName(), errors(stage)]""")
    names, places, instances, types, note, radius, root, errors = ran.result
    assert names == ["oak", "oak_2", "Row_3", "place"]
    assert places == [[1, 2, -5.5], [1, 0, 0], [5, 0, 0], [8, 0, 0]]
    assert instances == [True, True, True, False] and root == "Xform" and errors == []
    assert note == 'tall, "old" one' and radius == 2


def test_a_changed_table_is_read_by_reload(forest):
    scene(forest, placed("A", table="./trees.csv", instanceable="false"))
    ran = fresh(forest, """
        stage = Usd.Stage.Open("scene.usda")
        layer = Sdf.Layer.FindOrOpen(edf(stage)[0])
        counts = [len(names(stage)), [os.path.basename(path) for path in layer.GetExternalAssetDependencies()]]
        stage.Reload()
        for text in ("asset,x\\n./tree.usda,1\\n", "asset\\n./tree.usda\\n./tree.usda\\n"):
            with open("trees.csv", "w") as file:
                file.write(text)
            os.utime("trees.csv", (len(text), len(text)))
            stage.Reload()
            counts.append(names(stage))
        counts.append([os.path.basename(path) for path in layer.GetExternalAssetDependencies()])
        result = counts""")
    assert ran.result == [4, ["trees.csv"], ["Row_1"], ["Row_1", "Row_2"], ["trees.csv"]]


@pytest.mark.parametrize("table, cause", [
    ("name,x\na,1\n", "line 1: there is no column 'asset'"),
    ("", "there is no row of columns"),
    ("asset,x\n./t.usda,one\n", "line 2: x is 'one', which is no number"),
    ("asset,x\n./t.usda,nan\n", "line 2: x is 'nan', which is no number"),
    ("asset\n./t.usda,1\n", "line 2: there are 2 cells in 1 columns"),
    ('asset,name\n./t.usda,"a\nb\n', "a quote is not closed"),
    ("asset,asset\n", "two columns have the name 'asset'"),
    ("asset,prim\n./t.usda,../x\n", "which is no absolute path of a prim"),
    ("asset,a b\n", "is no identifier"),
    ("asset\na\x01b\n", "asset has a control character"),
    ("asset\n" + "./t.usda\n" * 100_001, "more than 100000 rows"),
    ("asset," + ",".join(f"c{i}" for i in range(250)) + "\n" + ("," * 250 + "\n") * 8_000, "more than 2000000 cells"),
    ("asset,note\n./t.usda,caf\xe9\n".encode("latin-1"), "line 2: the text is not UTF-8, perhaps Latin-1; save"),
    ("asset\n./t.usda\n".encode("utf-16"), "line 1: the text is not UTF-8, perhaps UTF-16; save"),
], ids=lambda value: repr(value)[:40])  # pytest writes them into the environment, which has a limit
def test_malformed_tables_name_the_line(forest, table, cause):
    (forest / "bad.csv").write_bytes(table if isinstance(table, bytes) else table.encode())
    scene(forest, placed("A", table="./bad.csv"), placed("B", table="./trees.csv"))
    ran = fresh(forest, """
        stage = Usd.Stage.Open("scene.usda")
        result = [errors(stage), names(stage), len(names(stage, "/B"))]""")
    assert len(ran.result[0]) == 1 and "</A>" in ran.result[0][0], ran.result
    [warning] = [line for line in ran.warnings.splitlines() if "cannot be read" in line]
    assert cause in warning and "bad.csv" in warning and "usdliveEdfTable" in warning
    assert ran.result[1:] == [[], 4]


def test_a_table_that_is_gone_comes_back_with_a_reload(forest):
    scene(forest, placed("A", table="./later.csv"), placed("B"))
    ran = fresh(forest, """
        stage = Usd.Stage.Open("scene.usda")
        before = errors(stage)
        with open("later.csv", "w") as file:
            file.write("asset\\n./tree.usda\\n")
        stage.Reload()
        result = [before, names(stage)]""")
    assert len(ran.result[0]) == 2
    assert "there is no table" in ran.warnings and "later.csv" in ran.warnings
    assert "the argument 'table' names no file" in ran.warnings
    assert ran.result[1] == ["Row_1"]


def test_a_table_that_becomes_malformed_keeps_its_rows(forest):
    scene(forest, placed("A", table="./trees.csv"))
    ran = fresh(forest, """
        stage = Usd.Stage.Open("scene.usda")
        result = []
        for text in ("asset,x\\n./tree.usda,none\\n", "asset\\n./tree.usda\\n"):
            with open("trees.csv", "w") as file:
                file.write(text)
            os.utime("trees.csv", (len(text), len(text)))
            stage.Reload()
            result.append(len(names(stage)))""")
    assert ran.result == [4, 1]
    assert "so it keeps its content" in ran.warnings and "x is 'none', which is no number" in ran.warnings


# --- the generator and the C++ stage -------------------------------------------------------------------


def scenes_of_all_kinds(folder):
    (folder / "content.edf").touch()
    (folder / "tree.usda").write_text(TREE)
    (folder / "trees.csv").write_text(TABLE)
    relative = {"asset": "./content.edf"}
    scene(folder, prim("Weak", parameters("generator", size="2x2x2")), name="weak.usda")
    return [
        scene(folder, generated("A", shape="spiral", size="5x1x1"), generated("B", preset="village", columns=2, rows=2),
              prim("C", parameters("generator", size="3x1x1", prototype="./tree.usda"), **relative),
              prim("Weak", parameters("generator", size="1x1x1"), asset="", word="over"),
              header="    subLayers = [@weak.usda@]\n", name="one.usda"),
        scene(folder, placed("A", table="./trees.csv"), placed("B", table="./trees.csv", instanceable="false"),
              probed("C", "all kinds"), probed("D", "deferred"), name="two.usda"),
        scene(folder, probed("A", "fails"), prim("B", parameters("unheard")), probed("C", "well"), prim("D"), name="three.usda"),
        scene(folder, 'def "R" (\n    references = @one.usda@</A>\n' + parameters("generator", size="2x1x1") + ")\n{\n}\n",
              name="four.usda"),
    ]


def test_the_composed_stage_with_payloads_is_the_same_in_cpp(tmp_path):
    files = scenes_of_all_kinds(tmp_path)
    environment = {**os.environ, "PXR_PLUGINPATH_NAME": plugin_path(), "PXR_WORK_THREAD_LIMIT": "1"}
    wanted = [file.with_suffix(".want") for file in files]
    (tmp_path / "list").write_text("".join(f"{file}\t\t{tmp_path}\t{want}\n" for file, want in zip(files, wanted)))
    subprocess.run([sys.executable, HERE / "stage_dump.py", tmp_path / "list"], check=True, env=environment,
                   stderr=subprocess.DEVNULL)
    for file, want in zip(files, wanted):
        ours = subprocess.run([os.environ["USDLIVE_BIN"], "dump", "--composed", file, "--base", tmp_path], text=True,
                              capture_output=True, env=environment)
        assert ours.returncode == 0, ours.stderr
        one, other = json.loads(want.read_text()), json.loads(ours.stdout)
        assert list(differences(one, other)) == []
        assert len(one["prims"]) > 2


def test_generated_content_is_what_was_asked_for(tmp_path):
    scene(tmp_path, generated("A", shape="buildings", size="3x2x1", spacing="10", seed=4),
          generated("B", size="100x100x1"), generated("C", size="-3x5x1"),
          prim("D", parameters("generator", prototype="./tree.usda")))
    (tmp_path / "tree.usda").write_text(TREE)
    ran = fresh(tmp_path, """
        from pxr import UsdGeom
        stage = Usd.Stage.Open("scene.usda")
        boxes = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"])
        box = boxes.ComputeWorldBound(stage.GetPrimAtPath("/A")).ComputeAlignedRange()
        result = [list(box.GetMin()), list(box.GetMax()), len(names(stage, "/B")), len(names(stage, "/C")), errors(stage)]""")
    low, high, many, none, found = ran.result
    assert [round(x, 4) for x in low] == [-3.5, 0, -3.5] and high[0] == 23.5 and high[2] == 13.5 and 2.1 <= high[1] <= 21
    assert many == 10_000 and none == 0
    assert len(found) == 1 and "</D>" in found[0] and "relative to an anonymous layer" in ran.warnings
