"""Tests the command line tool: its verbs, their arguments, output and exit codes."""

import json
import os
import signal
import subprocess
import time

import pytest
from conftest import wait

ROOT = '#usda 1.0\n\ndef Xform "World"\n{\n    def Sphere "Ball"\n    {\n        double radius = 1\n    }\n}\n\n'


def usdlive(*arguments: str) -> str:
    return subprocess.run([os.environ["USDLIVE_BIN"], *arguments], capture_output=True, text=True,
                          timeout=60, check=True).stdout


@pytest.fixture
def served(project, serve):
    (project / "sets").mkdir()
    (project / "root.usda").write_text(ROOT)
    (project / "sets" / "hall.usda").write_text("#usda 1.0\n")
    return serve(project)


def test_layers_and_their_content_are_printed(served):
    assert usdlive("ls", served.url).split() == ["root.usda", "sets/hall.usda"]
    assert usdlive("cat", f"{served.url}/root.usda") == ROOT
    tree = usdlive("tree", f"{served.url}/root.usda")
    assert "World" in tree and "Xform" in tree and "Ball" in tree and "Sphere" in tree


def test_the_log_shows_authors_edits_and_earlier_values(served, editor):
    ada = editor(served, "ada", "root.usda")
    ada.run("ball = stage.GetPrimAtPath('/World/Ball')\nball.GetAttribute('radius').Set(2.0)")
    first = ada.flush()
    ada.run("ball.GetAttribute('radius').Set(3.0)")
    ada.flush()
    log = usdlive("log", served.url)
    assert "ada" in log and "/World/Ball.radius" in log
    assert "radius = 2" in usdlive("cat", f"{served.url}/root.usda", "--revision", str(first))
    assert "radius = 3" in usdlive("cat", f"{served.url}/root.usda")


def test_watching_edits_as_they_arrive(served, editor):
    watch = subprocess.Popen([os.environ["USDLIVE_BIN"], "watch", served.url, "--json"],
                             stdout=subprocess.PIPE, text=True)
    try:
        time.sleep(1)
        ada = editor(served, "ada", "root.usda")
        ada.run("stage.DefinePrim('/World/New')")
        ada.flush()
        line = ""
        while "/World/New" not in line:
            line = watch.stdout.readline()
            assert line
        assert json.loads(line)["user"] == "ada"
    finally:
        watch.send_signal(signal.SIGINT)
        assert watch.wait(timeout=10) == 0


def test_saving_writes_the_files(served, editor):
    ada = editor(served, "ada", "root.usda")
    ada.run("stage.GetPrimAtPath('/World/Ball').GetAttribute('radius').Set(4.0)")
    ada.flush()
    assert "radius = 1" in (served.folder / "root.usda").read_text()
    assert "root.usda" in usdlive("save", served.url)
    assert (served.folder / "root.usda").read_text() == ada.text("root.usda")


VERBS = ("serve", "page", "join", "ls", "who", "cat", "tree", "log", "watch", "save", "reload", "upload", "checkpoint", "checkpoints", "mute",
         "unmute", "lock", "unlock", "completion")


def ended(*arguments: str, **environment: str) -> tuple[int, str, str]:
    """Returns exit code, output and errors."""
    ran = subprocess.run([os.environ["USDLIVE_BIN"], *arguments], capture_output=True, text=True, timeout=60,
                         env={**os.environ, **environment})
    return ran.returncode, ran.stdout, ran.stderr


def test_help_names_every_verb():
    text = usdlive("--help")
    for verb in VERBS:
        assert verb in text
    for verb in VERBS[1:-1]:
        assert f"Usage: usdlive {verb} " in usdlive("help", verb) == usdlive(verb, "--help")
    for text in (usdlive("serve", "--help"), usdlive("help", "serve")):
        assert "Usage: usdlive serve " in text and "usdlive-server" not in text
    assert usdlive("--version").startswith("usdlive 0.")


def test_wrong_words_are_explained_and_end_with_2():
    assert ended("bogus")[0] == 2
    code, out, error = ended("lgo")
    assert (code, out) == (2, "") and "unknown command: lgo. Did you mean `usdlive log`?" in error
    for words in (("log", "-n", "-3"), ("log", "-n", "0"), ("log", "-n", "many"), ("ls", "--bogus"), (), ("cat",),
                  ("lock", "http://h"), ("checkpoint",), ("upload", "a.png"), ("completion", "tcsh"), ("cat", "../up.usda")):
        code, out, error = ended(*words, USDLIVE_URL="127.0.0.1:1")
        assert (code, out) == (2, "") and error, words
    code, _, error = ended("ls", "127.0.0.1:1")
    assert code == 1 and "Is `usdlive serve` running there?" in error


def test_a_server_and_layers_are_named_in_one_way(served):
    address = served.url.removeprefix("ws://")
    text = usdlive("cat", f"{served.url}/root.usda")
    assert usdlive("cat", address, "root.usda") == usdlive("cat", f"{address}/root.usda") == text
    assert ended("cat", "root.usda", USDLIVE_URL=address)[1] == text
    assert ended("ls", USDLIVE_URL=served.url)[1].split() == ["root.usda", "sets/hall.usda"]

    assert usdlive("lock", address, "root.usda", "sets/hall.usda", "--user", "ada") == \
        "root.usda is locked by ada\nsets/hall.usda is locked by ada\n"
    code, out, error = ended("unlock", address, "root.usda", USDLIVE_USER="bob")
    assert (code, out) == (1, "") and "locked by ada" in error
    assert ended("unlock", address, "root.usda", USDLIVE_USER="ada")[1] == "root.usda is unlocked\n"

    assert usdlive("mute", address, "root.usda", "sets/hall.usda") == \
        usdlive("mute", f"{served.url}/root.usda", "sets/hall.usda").replace("was already", "is")
    assert usdlive("unmute", address, "--root", "root.usda", "sets/hall.usda").startswith("sets/hall.usda is no longer")
    code, _, error = ended("unmute", address, "root.usda", "none.usda")
    assert code == 1 and "no layer none.usda" in error


def test_json_of_every_verb_that_prints(served, editor):
    def read(*words):
        return json.loads(usdlive(*words, "--json"))

    ada = editor(served, "ada", "root.usda")
    ada.run("ball = stage.GetPrimAtPath('/World/Ball')\n"
            "ball.CreateAttribute('points', Sdf.ValueTypeNames.Float3Array).Set([(1, 2, 0.1)] * 30000)\n"
            "ball.GetAttribute('radius').Set(0.1, 24.0)\n"
            "ball.CreateAttribute('far', Sdf.ValueTypeNames.Double).Set(float('inf'))\n"
            "ball.GetPrim().SetCustomDataByKey('studio:id', 7)\n"
            "ball.GetReferences().AddReference('a.usda', '/A')")
    ada.flush()
    assert [state["layer"] for state in read("ls", served.url)] == ["root.usda", "sets/hall.usda"]
    assert read("ls", served.url)[0]["editors"] == ["ada"]

    def is_listed():
        ada.run("live.tick()")  # PS2: the presence of an editor that does nothing for 3 s is removed
        return [one["user"] for one in read("who", served.url)] == ["ada"]

    wait(is_listed, timeout=60)

    layer = read("cat", served.url, "root.usda")
    specs = {spec["path"]: spec["fields"] for spec in layer["specs"]}
    assert specs["/World/Ball.points"]["default"] == {"type": "float3[]", "value": [[1, 2, 0.1]] * 30000}
    assert specs["/World/Ball.radius"]["timeSamples"]["value"] == [[24, 0.1]]
    assert specs["/World/Ball.far"]["default"]["value"] == "inf"
    assert specs["/World/Ball"]["customData"]["value"] == {"studio": {"id": 7}}
    assert specs["/World/Ball"]["references"]["value"]["prepended"] == \
        [{"asset": "a.usda", "prim": "/A", "offset": 0, "scale": 1}]
    assert specs["/World"]["specifier"]["value"] == "def"

    (world,) = read("tree", served.url, "root.usda")
    assert (world["type"], [child["name"] for child in world["children"]]) == ("Xform", ["Ball"])

    edits = [edit for line in usdlive("log", served.url, "--json").splitlines() for edit in json.loads(line)["edits"]]
    values = {edit["path"]: edit["value"] for edit in edits if edit.get("field") == "default"}
    assert values["/World/Ball.points"] == [[1, 2, 0.1]] * 30000

    assert read("save", served.url)["saved"] == ["root.usda"]
    assert read("checkpoint", served.url, "dinner: 1")["name"] == "dinner: 1"
    assert [one["name"] for one in read("checkpoints", served.url)] == ["dinner: 1"]
    assert read("lock", served.url, "sets/hall.usda")[0]["changed"] is True
    assert read("unlock", served.url, "sets/hall.usda")[0]["changed"] is True
    assert read("log", served.url, "root.usda", "-n", "1")["edits"]


def test_completion_knows_the_verbs_and_their_options():
    for shell in ("bash", "zsh", "fish"):
        script = usdlive("completion", shell)
        assert all(verb in script for verb in VERBS) and "checkpoint" in script
    done = subprocess.run(["bash", "-c", usdlive("completion", "bash") +
                           "COMP_WORDS=(usdlive log --fr) COMP_CWORD=2; _usdlive; echo ${COMPREPLY[@]}"],
                          capture_output=True, text=True, check=True)
    assert done.stdout == "--from\n"


def test_a_second_server_of_a_folder_names_the_first(served):
    code, _, error = ended("serve", str(served.folder), "--port", "0")
    assert code == 1 and f"already served at {served.url} by process {served.process.pid}" in error


def test_an_empty_folder_gets_advice(tmp_path):
    (tmp_path / "empty").mkdir()
    with subprocess.Popen([os.environ["USDLIVE_BIN"], "serve", str(tmp_path / "empty"), "--port", "0",
                           "--min-free-mib", "1", "--host", "0.0.0.0", "--insecure"],
                          stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as server:
        first, second = server.stdout.readline(), server.stdout.readline()
        server.send_signal(signal.SIGTERM)
    assert "(0 layers) at ws://" in first and "0.0.0.0" not in first
    assert "Put one there" in second


COPIED_ROOT = '''#usda 1.0
(
    customLayerData = {
        dictionary omni_layer = {
            dictionary locked = {
                bool "./sets/hall.usda" = 1
            }
            dictionary muteness = {
                bool "./sets/hall.usda" = 1
            }
            dictionary specs_locking = {
                string "/World/Ball" = "gone"
            }
        }
    }
    subLayers = [
        @./sets/hall.usda@
    ]
)

def Xform "World"
{
    def Sphere "Ball"
    {
        double radius = 1
    }
}

'''
COPIED_SET = '''#usda 1.0
(
    customLayerData = {
        dictionary omni_layer = {
            bool locked = 1
            string locked_by = "gone"
        }
    }
)

'''


@pytest.fixture
def copied(project):
    """A folder whose locks and mutes belong to people who are not connected."""
    (project / "sets").mkdir()
    (project / "root.usda").write_text(COPIED_ROOT)
    (project / "sets" / "hall.usda").write_text(COPIED_SET)
    return project


def test_an_administrator_ends_the_locks_of_a_copied_folder(copied, serve):
    url = serve(copied, "--admin", "chief").url
    code, out, error = ended("unlock", url, "--all", "--user", "bob")
    assert (code, out) == (1, "") and "serve with --admin bob" in error
    assert "root.usda: " in error and "sets/hall.usda is locked by gone" in error
    assert usdlive("cat", url, "root.usda") == COPIED_ROOT and usdlive("cat", url, "sets/hall.usda") == COPIED_SET

    assert usdlive("unlock", url, "--all", "--user", "chief").splitlines() == [
        "root.usda: ended 1 layer lock of Kit, 1 lock of a spec, 1 mute",
        "sets/hall.usda: ended the lock of gone"]
    text = usdlive("cat", url, "root.usda")
    assert "gone" not in text and "locked =" not in text and 'bool "./sets/hall.usda" = 1' not in text
    assert "gone" not in usdlive("cat", url, "sets/hall.usda")
    assert usdlive("lock", url, "sets/hall.usda", "--user", "bob") == "sets/hall.usda is locked by bob\n"
    usdlive("unlock", url, "--all", "--user", "chief")
    assert usdlive("unlock", url, "--all", "--user", "chief") == "nothing is locked or muted in 2 layers\n"
    assert json.loads(usdlive("unlock", url, "--all", "--user", "chief", "--json")) == []
    assert ended("unlock", url, "--all", "root.usda")[0] == 2


def test_links_are_followed_and_skipped_files_are_counted_and_logged(project, serve, tmp_path):
    (project / "v3").mkdir()
    for name in ("ROOT.USDA", "v3/hall.usda", "asset.usdz", "take:2.usda", b"\xff.usda".decode(errors="surrogateescape")):
        (project / name).write_text(ROOT)
    (project / "latest").symlink_to("v3")
    (project / "elsewhere").symlink_to(tmp_path)
    (project / "v3" / "up").symlink_to("..")
    server = serve(project)
    assert usdlive("ls", server.url).split() == ["ROOT.USDA", "latest/hall.usda", "v3/hall.usda"]
    assert usdlive("cat", server.url, "latest/hall.usda") == usdlive("cat", server.url, "ROOT.USDA") == ROOT
    log = server.log.read_text()
    for name, why in (("asset.usdz", "package"), ("take:2.usda", "colon"), ("\ufffd.usda", "UTF-8"),
                      ("elsewhere", "out of the project"), ("v3/up", "back to a folder"),
                      ("latest/up", "back to a folder")):
        assert any("file skipped" in line and name in line and why in line for line in log.splitlines()), name
    assert log.count("file skipped") == 6
    listed = usdlive("ls", server.url, "--skipped").splitlines()
    assert len(listed) == 6 and any("asset.usdz" in line and "package" in line for line in listed), listed
    listed = json.loads(usdlive("ls", server.url, "--skipped", "--json"))
    assert {"asset.usdz", "elsewhere", "v3/up"} <= {one["path"] for one in listed}, listed

    usdlive("lock", server.url, "latest/hall.usda", "--user", "ada")
    usdlive("save", server.url, "latest/hall.usda", "--user", "ada")
    assert 'locked_by = "ada"' in (project / "v3" / "hall.usda").read_text()
    assert (project / "latest").is_symlink()
    assert server.stop() == 0
    counted = subprocess.Popen([os.environ["USDLIVE_BIN"], "serve", str(project), "--port", "0", "--min-free-mib", "1"],
                               stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        assert "3 layers; 6 files are skipped, `usdlive ls --skipped` says why" in counted.stdout.readline()
    finally:
        counted.terminate()
        counted.wait(timeout=20)


def test_a_link_that_is_set_to_another_version_is_outdated_and_reloaded(project, serve):
    for version, radius in (("v3", 3), ("v4", 4)):
        (project / version).mkdir()
        (project / version / "hall.usda").write_text(ROOT.replace("radius = 1", f"radius = {radius}"))
    (project / "latest").symlink_to("v3")
    server = serve(project)
    assert "radius = 3" in usdlive("cat", server.url, "latest/hall.usda")
    (project / "latest").unlink()
    (project / "latest").symlink_to("v4")
    end = time.monotonic() + 20
    while "outdated" not in usdlive("ls", server.url, "--long"):
        assert time.monotonic() < end
        time.sleep(0.1)
    assert "latest/hall.usda" in usdlive("reload", server.url)
    assert "radius = 4" in usdlive("cat", server.url, "latest/hall.usda")
    assert "radius = 3" in usdlive("cat", server.url, "v3/hall.usda")


def test_the_log_names_users_and_their_actions(served, editor):
    """Names of users are logged without control characters, and a flood of refusals is not logged line by
    line."""
    url = served.url
    usdlive("lock", url, "root.usda", "--user", "ada \x1b[31m\x9b")
    for _ in range(3):
        ended("lock", url, "root.usda", "--user", "bob")
    usdlive("unlock", url, "root.usda", "--user", "ada \x1b[31m\x9b")
    usdlive("mute", url, "root.usda", "sets/hall.usda", "--user", "cy")
    usdlive("unmute", url, "root.usda", "sets/hall.usda", "--user", "cy")
    usdlive("save", url, "--user", "cy")
    usdlive("checkpoint", url, "before lunch", "--user", "cy")
    (served.folder / "root.usda").write_text(ROOT.replace("radius = 1", "radius = 7"))
    usdlive("reload", url, "root.usda", "--user", "dee")
    log = served.log.read_text()
    for line in ('user joined user=bob detail="usdlive command line"', "layer muted user=cy layer=sets/hall.usda",
                 "layer unmuted user=cy layer=sets/hall.usda", "layer saved user=cy layer=root.usda",
                 'checkpoint made user=cy detail="before lunch"', "layer reloaded user=dee layer=root.usda",
                 'layer locked user="ada \\u001b[31m\\u009b" layer=root.usda',
                 "edits refused user=bob layer=root.usda", 'layer unlocked user="ada \\u001b', "user left user=bob",
                 'layer imported user="ada \\u001b[31m\\u009b" layer=root.usda'):
        assert line in log, line
    assert "\x1b" not in log and "\x9b" not in log

    bob = editor(served, "bob", "root.usda")
    usdlive("lock", url, "root.usda", "--user", "cy")
    bob.run("layer = stage.GetRootLayer(); assert live.wait(lambda: not layer.permissionToEdit, 20)\n"
            "layer.SetPermissionToEdit(True)  # like an editor that ignores the lock\n"
            "for i in range(100):\n"
            "    stage.GetRootLayer().comment = str(i); live.flush(5)")
    added = served.log.read_text()[len(log):]
    assert 1 <= added.count("edits refused user=bob") <= 10


def on_a_terminal(*arguments: str) -> str:
    """The tool's output when both outputs are a terminal."""
    import pty
    process, terminal = pty.fork()
    if process == 0:
        os.execv(os.environ["USDLIVE_BIN"], ["usdlive", *arguments])
    written = b""
    while True:
        try:
            part = os.read(terminal, 65536)
        except OSError:  # the terminal has ended
            break
        if not part:
            break
        written += part
    assert os.waitpid(process, 0)[1] == 0
    os.close(terminal)
    return written.decode()


def test_a_progress_bar_on_a_terminal_only(project, serve):
    prims = "".join(f'def Xform "P{i}"\n{{\n    double3 xformOp:translate = ({i}, 0, 0)\n}}\n' for i in range(120_000))
    (project / "big.usda").write_text("#usda 1.0\n" + prims)
    server = serve(project)
    shown = on_a_terminal("tree", server.url, "big.usda")
    # Which of the tasks takes long enough to be shown depends on the machine.
    assert "importing big.usda" in shown or "fetching big.usda" in shown
    assert "P119999" in shown and shown.rfind("\x1b[K") < shown.find("P0 "), "the bar is still there"
    server.stop()
    (project / ".usdlive").rename(project.parent / "aside")
    server.start()
    ran = subprocess.run([os.environ["USDLIVE_BIN"], "tree", server.url, "big.usda"], capture_output=True, text=True)
    assert ran.returncode == 0 and "\x1b" not in ran.stdout and ran.stderr == ""


def test_colours_on_a_terminal_only(served, monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert "\x1b[" in on_a_terminal("tree", served.url, "root.usda")
    monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b[" not in on_a_terminal("tree", served.url, "root.usda")
    monkeypatch.delenv("NO_COLOR")
    assert "\x1b[" not in usdlive("tree", served.url, "root.usda")
