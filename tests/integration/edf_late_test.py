"""Dynamic payloads whose provider is slow: no tick waits for it, and stages show the content once it is here."""

import time

import pytest
from edf import parameters, plugin_path, prim, scene
from museum import Museum

# A payload of level 1 needs three answers of the service, one after the other.
ANSWER, CONTENT = 0.35, 3 * 0.35
# A tick that waits for the content of one payload takes longer.
LONGEST = 0.5

FOLLOW = """
import time
frames = []
def frame():
    begin = time.monotonic()
    live.tick()
    frames.append(time.monotonic() - begin)
    time.sleep(0.005)
def until(condition, seconds=20):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, [str(error) for error in stage.GetCompositionErrors()]
        frame()
def counts(path):
    return [len(one.GetAllChildren()) for one in stage.GetPrimAtPath(path).GetAllChildren()]
"""
CHANGE = """
def change(path, **args):
    with Sdf.ChangeBlock():
        for key, value in args.items():
            stage.GetPrimAtPath(path).SetMetadataByDictKey("EdfDataParameters", "providerArgs:" + key, value)
    assert live.flush(20)
"""


@pytest.fixture
def museum():
    one = Museum(departments=2).start()
    yield one
    one.stop()


def shown(name, content="", asset="anon:edf:content.edf", **arguments):
    return prim(name, parameters("omniMet", dataLodLevel=1, **arguments), content, asset)


@pytest.fixture
def people(project, serve, editor, monkeypatch, museum):
    """people(prims) returns ada, who has no service and so never waits, and bo, who has the slow one."""
    monkeypatch.setenv("PXR_PLUGINPATH_NAME", plugin_path())
    monkeypatch.setenv("USDLIVE_EDF_CACHE", "0")
    monkeypatch.setenv("USDLIVE_EDF_REQUEST_SECONDS", "3")

    def start(*prims):
        (project / "file.edf").write_text("")
        scene(project, *prims, prim("X", asset=""), name="root.usda")
        server = serve(project)
        ada = editor(server, "ada", "root.usda")
        monkeypatch.setenv("USDLIVE_EDF_MUSEUM_URL", museum.url)
        bo = editor(server, "bo", "root.usda")
        ada.run(CHANGE)
        bo.run(FOLLOW)
        return ada, bo

    return start


def longest(bo):
    return bo.run("result = max(frames); frames.clear()")


@pytest.mark.parametrize("asset", ["anon:edf:content.edf", "./file.edf"])
def test_a_payload_that_somebody_changes_is_shown_when_its_service_has_answered(people, museum, asset):
    ada, bo = people(shown("A", lod1Count=1, asset=asset))
    assert bo.run("result = counts('/A')") == [1, 1]
    museum.requests.clear()
    museum.delay = ANSWER
    begin = time.monotonic()
    ada.run("change('/A', lod1Count=2); stage.GetPrimAtPath('/X').SetMetadata('comment', 'new'); live.flush(20)")
    bo.run("until(lambda: stage.GetPrimAtPath('/X').GetMetadata('comment') == 'new')")
    assert time.monotonic() - begin < CONTENT, "edits of others do not wait for the content"
    assert bo.run("result = [counts('/A'), [str(one) for one in stage.GetCompositionErrors()]]") == [[], []]
    bo.run("until(lambda: counts('/A') == [2, 2])")
    assert time.monotonic() - begin >= CONTENT
    assert longest(bo) < LONGEST
    assert museum.requests["/departments"] == 1
    bo.run("check_stage()")


def test_payloads_are_read_at_the_same_time_and_each_once(people, museum):
    ada, bo = people(*(shown(f"P{n}", lod1Count=0) for n in range(5)))
    museum.requests.clear()
    museum.delay = ANSWER
    begin = time.monotonic()
    ada.run("""
with Sdf.ChangeBlock():
    for n in range(5):
        stage.GetPrimAtPath(f'/P{n}').SetMetadataByDictKey('EdfDataParameters', 'providerArgs:lod1Count', n % 4 + 1)
assert live.flush(20)
""")
    # Arguments that come back while they are asked for.
    bo.run("until(lambda: stage.GetPrimAtPath('/P0').GetMetadata('EdfDataParameters')['providerArgs']['lod1Count'] == 1)")
    for count in (2, 1):
        ada.run(f"change('/P0', lod1Count={count})")
        bo.run("frame()")
    bo.run("until(lambda: [counts(f'/P{n}') for n in range(5)] == [[n % 4 + 1] * 2 for n in range(5)])")
    assert time.monotonic() - begin < 3 * CONTENT
    assert longest(bo) < LONGEST
    assert museum.requests["/departments"] == 4, "one read for each set of arguments"
    bo.run("check_stage()")


def test_a_service_that_does_not_answer_holds_no_tick_and_is_an_error_at_the_end(people, museum):
    ada, bo = people(shown("A", lod1Count=1))
    museum.delay = 60
    ada.run("change('/A', lod1Count=2)")
    bo.run("until(lambda: stage.GetCompositionErrors())")
    assert longest(bo) < LONGEST
    assert "its payloads are empty" in bo.log.read_text()
    museum.delay = 0
    ada.run("change('/A', lod1Count=3)")
    bo.run("until(lambda: counts('/A') == [3, 3])")
    assert bo.run("result = len(stage.GetCompositionErrors())") == 0


def test_deferred_parts_that_somebody_activates_are_read_in_the_background(people, museum):
    ada, bo = people(shown("A", 'over "Department_1" (active = false)\n{\n}\n', lod1Count=2, deferredRead="true"))
    assert bo.run("result = counts('/A')") == [0, 2]
    museum.delay = ANSWER
    museum.requests.clear()
    ada.run("stage.OverridePrim('/A/Department_1').SetActive(True); live.flush(20)")
    bo.run("until(lambda: stage.GetPrimAtPath('/A/Department_1').IsActive())")
    assert bo.run("result = counts('/A')") == [0, 2]
    bo.run("until(lambda: counts('/A') == [2, 2])")
    assert longest(bo) < LONGEST
    assert museum.requests["/departments"] == 0, "the rest is not read again"
    bo.run("check_stage()")


def test_what_an_editor_composes_outside_of_a_tick_has_its_content(people, museum):
    _, bo = people(shown("A", lod1Count=1))
    museum.requests.clear()
    museum.delay = ANSWER
    bo.run(CHANGE + "change('/A', lod1Count=2)")
    assert bo.run("result = counts('/A')") == [2, 2]
    assert museum.requests["/departments"] == 1
    # It waits for the call of a tick that is under way.
    assert bo.run("""
def change_within_a_frame():
    stage.GetPrimAtPath('/A').SetMetadataByDictKey('EdfDataParameters', 'providerArgs:lod1Count', 3)
live.without_waiting(change_within_a_frame)
before = counts('/A')
for one in stage.GetUsedLayers():
    if '.edf' in one.identifier:
        one.Reload(force=True)
result = [before, counts('/A')]
""") == [[], [3, 3]]
    assert museum.requests["/departments"] == 2


@pytest.mark.parametrize("code", ["", "del stage", "live.close()"])
def test_the_end_of_an_editor_does_not_wait_for_a_provider(people, museum, code):
    ada, bo = people(shown("A", lod1Count=1))
    museum.delay = 60
    ada.run("change('/A', lod1Count=2)")
    bo.run("until(lambda: counts('/A') == [])")
    begin = time.monotonic()
    bo.run(code)
    bo.close()
    assert bo.process.returncode == 0
    assert time.monotonic() - begin < 2


def test_a_service_that_was_down_is_asked_again(people, museum):
    museum.stop()
    ada, bo = people(shown("A", lod1Count=1), shown("B", lod1Count=1, asset="./file.edf"))
    assert bo.run("result = counts('/A') + counts('/B')") == []
    bo.run("for _ in range(20): frame()")
    museum.start()
    bo.run("until(lambda: counts('/A') == counts('/B') == [1, 1] and not stage.GetCompositionErrors())")
    museum.requests.clear()
    bo.run("for _ in range(500): frame()")
    assert not museum.requests
    assert longest(bo) < LONGEST
