"""Unsent work of the portable backend survives the end of its process, and comes back in either backend."""

import pathlib
import signal
import subprocess
import time

import pytest
from conftest import cat
from portable_editors import BUILT_FOR, NEWEST, OLDEST, all_synced, environment, portable, python_of, served  # noqa: F401

BIG = ("stage.DefinePrim('/Big').CreateAttribute('a', Sdf.ValueTypeNames.IntArray).Set(Vt.IntArray(list(range(7, 100_007))))\n"
       "assert stage.GetPrimAtPath('/Big').GetAttribute('a').Get()[0] == 7\n")
EDITS = ("stage.DefinePrim('/World/Unsent', 'Sphere').CreateAttribute('radius', Sdf.ValueTypeNames.Double).Set(5.5)\nlive.tick()\n"
         "stage.GetPrimAtPath('/World').SetDocumentation('written while away')\nlive.tick()\n" + BIG + "live.tick()")


def journals(tmp_path: pathlib.Path) -> list[pathlib.Path]:
    return sorted((tmp_path / "state").rglob("*.journal"))


def written(tmp_path: pathlib.Path, content: bytes) -> pathlib.Path:
    """Waits until a journal has these bytes."""
    end = time.monotonic() + 10
    while time.monotonic() < end:
        for path in journals(tmp_path):
            if content in path.read_bytes():
                return path
        time.sleep(0.02)
    raise AssertionError(f"no journal has {content!r}: {journals(tmp_path)}")


def killed_with_unsent_work(server, portable, tmp_path, version: str, code: str = EDITS, mark: bytes = b"Big") -> pathlib.Path:
    """An editor edits while the server is away, and is killed. Returns its journal."""
    editor = portable(server, version, "ada")
    server.kill()
    editor.run("assert live.wait(lambda: not live.connected, 20)")
    editor.run(code)
    journal = written(tmp_path, mark)
    editor.process.kill()
    editor.process.wait()
    return journal


@pytest.mark.parametrize("writer, sender", [(OLDEST, BUILT_FOR), (BUILT_FOR, NEWEST)])
def test_the_work_of_a_killed_editor_comes_back_once(served, portable, tmp_path, writer, sender):
    server = served()
    killed_with_unsent_work(server, portable, tmp_path, writer)
    server.start()
    assert "Unsent" not in cat(server, "root.usda")
    later = portable(server, sender, "ada")
    assert later.run("live.tick(); result = [len(event.work) for event in happened if type(event).__name__ == 'UnsentFound']") == [1]
    about = later.run("work, = live.unsent_work(); result = [work.about.transactions, work.about.layers, str(work)]")
    assert about[:2] == [3, ["root.usda"]] and "were not sent; they are kept in" in about[2]
    # The work as a layer.
    text = later.run("result = work.as_layer('root.usda').ExportToString()")
    assert 'over "World"' in text and "double radius = 5.5" in text and 'doc = "written while away"' in text
    assert later.run("made = work.as_layer('root.usda'); result = list(made.GetAttributeAtPath('/Big.a').default)[:2]") == [7, 8]
    assert later.run("result = list(work.send())") == [3, 0, 0]
    assert later.run("result = live.unsent_work()") == [] and journals(tmp_path) == []
    other = portable(server, NEWEST if sender == BUILT_FOR else BUILT_FOR, "bo")
    later.run("assert live.wait(lambda: (p := stage.GetPrimAtPath('/Big')) and p.GetAttribute('a').Get(), 20)")
    assert "double radius = 5.5" in all_synced(server, later, other)
    assert later.run("result = stage.GetPrimAtPath('/Big').GetAttribute('a').Get()[0]") == 7


def test_of_two_processes_one_sends_the_work(served, portable, tmp_path):
    server = served()
    killed_with_unsent_work(server, portable, tmp_path, OLDEST, "stage.DefinePrim('/World/Unsent'); live.tick()", b"Unsent")
    server.start()
    one, two = portable(server, OLDEST, "ada"), portable(server, NEWEST, "ada")
    for each in (one, two):
        each.run("work, = live.unsent_work()")
    # `one` sends to a server that does not answer, and holds the journal meanwhile.
    server.process.send_signal(signal.SIGSTOP)
    one.process.stdin.write('"try: work.send(timeout=1)\\nexcept usdlive.Error as error: result = error.code"\n')
    one.process.stdin.flush()
    time.sleep(0.3)
    try:
        assert two.run("try: work.send()\nexcept usdlive.Error as error: result = error.code") == "storageLocked"
        assert two.run("result = live.unsent_work()") == []
    finally:
        assert one._answer() == "notConnected"
        server.process.send_signal(signal.SIGCONT)
    assert two.run("work, = live.unsent_work(); result = list(work.send())") == [1, 0, 0]
    assert one.run("result = live.unsent_work()") == []
    # The work of a process that lives is its own.
    server.kill()
    one.run("assert live.wait(lambda: not live.connected, 20); stage.DefinePrim('/World/Living'); live.tick()")
    written(tmp_path, b"Living")
    server.start()
    assert two.run("result = live.unsent_work()") == []
    assert all_synced(server, one, two).count('"Living"') == 1


def test_what_is_damaged_in_a_journal_is_reported_and_kept(served, portable, tmp_path):
    server = served()
    journal = killed_with_unsent_work(server, portable, tmp_path, NEWEST,
                                      "stage.DefinePrim('/World/Whole'); live.tick(); stage.DefinePrim('/World/Hurt'); live.tick()", b"Hurt")
    journal.write_bytes(journal.read_bytes().replace(b"Hurt", b"hurt"))
    server.start()
    later = portable(server, OLDEST, "ada")
    errors = later.run("live.tick(); result = [event.message for event in happened if type(event).__name__ == 'ServerError']")
    kept = journal.with_suffix(".damaged")
    assert len(errors) == 1 and "is damaged" in errors[0] and errors[0].endswith(str(kept))
    assert later.run("result = [list(work.send()) for work in live.unsent_work()]") == [[1, 0, 0]]
    assert later.run("result = live.unsent_work()") == [] and b"hurt" in kept.read_bytes()
    text = all_synced(server, later)
    assert '"Whole"' in text and "urt" not in text


def test_close_says_what_was_not_sent_and_keeps_it(served, portable, tmp_path):
    server = served()
    editor = portable(server, NEWEST, "ada")
    server.kill()
    editor.run("import warnings; assert live.wait(lambda: not live.connected, 20); stage.DefinePrim('/World/Left')\n"
               "with warnings.catch_warnings(record=True) as warned:\n    warnings.simplefilter('always')\n"
               "    left = live.close(0.1)")
    assert editor.run("result = [left.edits, left.file, str(warned[0].message) == str(left)]") == [
        1 + 1, str(journals(tmp_path)[0]), True]
    assert editor.run("result = live.close()") is None
    server.start()
    later = portable(server, OLDEST, "ada")
    assert later.run("result = [list(work.send()) for work in live.unsent_work()]") == [[1, 0, 0]]
    assert '"Left"' in cat(server, "root.usda")


def test_a_script_that_ends_without_close_has_sent_its_edits(served, portable):
    server = served()
    script = ("import bundled_pxr, sys, usdlive\nfrom pxr import Usd\nlive = usdlive.connect(sys.argv[1], user='ada')\n"
              "stage = live.open_stage('root.usda')\nstage.DefinePrim('/World/AtTheEnd')\n")
    subprocess.run([python_of(NEWEST), "-c", script, server.url], check=True, env=environment())
    assert '"AtTheEnd"' in cat(server, "root.usda")


def test_lost_work_is_kept_as_a_layer(served, portable):
    server = served()
    bo, ada = portable(server, BUILT_FOR, "bo"), portable(server, OLDEST, "ada")
    bo.run("live.lock('root.usda'); assert live.flush()")
    ada.run("stage.DefinePrim('/World/Refused', 'Cube').CreateAttribute('width', Sdf.ValueTypeNames.Float).Set(3)")
    ada.run("live.flush()\nlost, = [event for event in happened if type(event).__name__ == 'Lost']")
    assert ada.run("result = [lost.code, lost.refused, lost.index]") == ["locked", True, 0]
    assert "float width = 3" in ada.run("result = live.lost_work_as_layer(lost.index, 'root.usda').ExportToString()")
    assert not ada.run("result = bool(stage.GetPrimAtPath('/World/Refused'))")
