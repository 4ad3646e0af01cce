"""Tests one project over DDS and WebSocket at the same time, in separate processes on loopback."""

import os
import pathlib
import random
import re
import signal
import subprocess
import time
import urllib.request

import pytest
from conftest import HERE, Peer, Server, cat
from parts_test import EMPTY, PASTE, SEEN, WATCH

ROOT = '#usda 1.0\n\ndef Xform "World"\n{\n    int64 ada\n    int64 bo\n    int64 cy\n}\n'
NAMES = ("ada", "bo", "cy")


class DdsServer(Server):
    """The same server; `url` is still its WebSocket address."""

    @property
    def dds(self) -> str:
        return f"dds://{self.folder.name}"


@pytest.fixture
def server(tmp_path, dds_domain):
    folder = tmp_path / f"shot{random.SystemRandom().getrandbits(32):08x}"
    folder.mkdir()
    (folder / "root.usda").write_text(ROOT)
    server = DdsServer(folder, tmp_path / "server.log", "--dds", "--dds-domain", str(dds_domain)).start()
    yield server
    if server.process.poll() is None:
        assert server.stop() == 0, server.log.read_text()


@pytest.fixture
def join(tmp_path):
    peers: list[Peer] = []

    def start(url: str, user: str) -> Peer:
        peers.append(Peer(url, user, "root.usda", tmp_path / f"{user}{len(peers)}.log"))
        return peers[-1]

    yield start
    for peer in peers:
        peer.process.kill()
        peer.process.wait()


@pytest.fixture
def three(server, join):
    """Two editors over DDS and one over WebSocket."""
    return [join(server.dds, "ada"), join(server.dds, "bo"), join(server.url, "cy")]


def usdlive(*arguments: str) -> subprocess.CompletedProcess:
    return subprocess.run([os.environ["USDLIVE_BIN"], *arguments], capture_output=True, text=True,
                          timeout=60)


def write(editor: Peer, name: str, first: int, last: int, pause: float = 0.0) -> None:
    editor.run(f"import time\na = stage.GetAttributeAtPath('/World.{name}')\n"
               f"for i in range({first}, {last}):\n a.Set(i * 7, i); live.tick(); time.sleep({pause})")


def synced(server: DdsServer, editors) -> str:
    revision = max(editor.flush() for editor in editors)
    for editor in editors:
        editor.catch_up(revision)
    over_dds = usdlive("cat", f"{server.dds}/root.usda")
    assert over_dds.returncode == 0, over_dds.stderr
    texts = {editor.text("root.usda") for editor in editors}
    assert texts == {over_dds.stdout} == {cat(server, "root.usda")}
    return over_dds.stdout


def metric(server: DdsServer, name: str, label: str = 'transport="dds"') -> float:
    with urllib.request.urlopen(f"http://127.0.0.1:{server.port}/metrics", timeout=20) as page:
        return float(re.search(rf"^{name}{{{label}}} (\S+)$", page.read().decode(), re.MULTILINE)[1])


def test_cp1_a_checkpoint_made_over_dds_is_there_over_both(server, three):
    ada, _, cy = three
    write(ada, "ada", 0, 5)
    made = ada.run("one = live.create_checkpoint('lunch')\nresult = [one.name, one.revision, one.user]")
    assert made == ["lunch", ada.flush(), "ada"]
    for editor in (ada, cy):
        assert editor.run("result = [[c.name, c.revision, c.user] for c in live.checkpoints()]") == [made]


def test_m8_editors_of_both_transports_have_the_same(server, three):
    for editor, name in zip(three, NAMES):
        editor.process.stdin.write('"import time\\na = stage.GetAttributeAtPath(\'/World.' + name +
                                   '\')\\nfor i in range(200): a.Set(i * 7, i); live.tick(); '
                                   'time.sleep(0.003)"\n')
        editor.process.stdin.flush()
    for editor in three:
        editor._answer()
    text = synced(server, three)
    assert text.count("1393") == 3  # the last value of each editor


def test_m11_previews_end_with_their_gesture(server, three):
    """Previews use another topic than the commit that ends them, but arrive before it."""
    ada, bo, cy = three
    for turn in range(20):
        ada.run("live.begin_gesture()\na = stage.GetAttributeAtPath('/World.ada')\n"
                f"for i in range(5): a.Set({turn * 100} + i); live.tick()\nlive.end_gesture()\nlive.tick()")
    text = synced(server, three)
    assert "int64 ada = 1904" in text


def test_big_values_and_large_commits_arrive_complete(server, three):
    ada, bo, cy = three
    ada.run("import numpy\npoints = numpy.arange(3 * 500_000, dtype=numpy.float32).reshape(-1, 3)\n"
            "UsdGeom.Points.Define(stage, '/World/Cloud').GetPointsAttr().Set("
            "Vt.Vec3fArrayFromBuffer(points))")
    bo.run("with Sdf.ChangeBlock():\n"
           " for i in range(20_000): Sdf.CreatePrimInLayer(stage.GetRootLayer(), f'/Many/P{i}')")
    for editor in three:
        editor.run("assert live.wait(lambda: stage.GetAttributeAtPath('/World/Cloud.points') and "
                   "stage.GetAttributeAtPath('/World/Cloud.points').Get() is not None and "
                   "len(stage.GetAttributeAtPath('/World/Cloud.points').Get()) == 500_000, 60)\n"
                   "assert live.flush(20)")
    synced(server, three)


def test_editors_resume_after_kill_9(server, three):
    for turn in range(3):
        for editor, name in zip(three, NAMES):
            write(editor, name, turn * 20, turn * 20 + 10, 0.002)
        server.kill()
        for editor, name in zip(three, NAMES):
            write(editor, name, turn * 20 + 10, turn * 20 + 20)
        server.start()
        text = synced(server, three)
        assert text.count(str((turn * 20 + 19) * 7)) >= 3


def test_an_editor_that_hangs_does_not_slow_the_others(server, three):
    ada, bo, cy = three
    bo.process.send_signal(signal.SIGSTOP)
    slowest = ada.run(
        "import time\nslowest = 0\na = stage.GetAttributeAtPath('/World.ada')\n"
        "for i in range(1500):\n"
        " a.Set(i * 7, i); begin = time.monotonic(); live.tick()\n"
        " while live.pending: live.tick(); time.sleep(0.001)\n"
        " slowest = max(slowest, time.monotonic() - begin)\n"
        "result = slowest")
    bo.process.send_signal(signal.SIGCONT)
    assert slowest < 2.0, f"an edit waited {slowest:.2f} s"
    synced(server, three)


def test_a_clean_stop_and_start_is_noticed_at_once(server, three):
    ada, bo, cy = three
    assert server.stop() == 0
    ada.run("assert live.wait(lambda: not live.connected, 5)")
    assert usdlive("ls", "dds://").stdout == ""
    server.start()
    for editor, name in zip(three, NAMES):
        write(editor, name, 0, 10)
    synced(server, three)


def test_projects_are_listed(server):
    listed = usdlive("ls", "dds://")
    assert listed.returncode == 0
    assert listed.stdout == f"{server.dds}\t{server.url}\trevision 0\n"
    assert usdlive("ls", server.dds).stdout == "root.usda\n"


def test_commits_are_sent_once_for_all(server, join):
    editors = [join(server.dds, name) for name in ("ada", "bo", "eve")]
    editors[0].flush()
    before = metric(server, "usdlive_sent_frames_total")
    write(editors[0], "ada", 0, 100, 0.01)
    settle_at = editors[0].flush()
    for editor in editors:
        editor.catch_up(settle_at)
    frames = metric(server, "usdlive_sent_frames_total") - before
    assert 0 < frames < 150, "each commit was sent to each client separately"


@pytest.mark.parametrize("options, what", [
    (["--dds-interface", "nope0"], "no network interface 'nope0'"),
    (["--dds-interface", 'lo"/>'], "no network interface 'lo\"/>'"),
    (["--dds-config", "missing.xml"], "missing.xml cannot be read"),
    (["--dds-config", "cut.xml"], "cut.xml is not a configuration of Cyclone DDS"),
    (["--dds-config", "wrong.xml"], "wrong.xml: nope0: does not match an available interface"),
    (["--dds-config", "unknown.xml"], "unknown element"),
])
def test_a_wrong_setting_is_said_in_a_line(tmp_path, project, options, what):
    (project / "root.usda").write_text(ROOT)
    interface = '<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="{}"/></Interfaces></General>'
    (tmp_path / "cut.xml").write_text(interface.format("lo"))
    (tmp_path / "wrong.xml").write_text(interface.format("nope0") + "</Domain></CycloneDDS>")
    (tmp_path / "unknown.xml").write_text(interface.format("lo") + "<Nonsense/></Domain></CycloneDDS>")
    ended = subprocess.run([os.environ["USDLIVE_BIN"], "serve", str(project), "--port", "0",
                            "--min-free-mib", "1", "--dds", *options],
                           capture_output=True, text=True, timeout=20, cwd=tmp_path)
    assert ended.returncode == 1
    assert what in ended.stderr and ended.stderr.count("\n") == 1, ended.stderr
    assert ended.stdout == ""


def test_a_missing_server_is_reported(dds_domain):
    ended = usdlive("ls", "dds://nobody")
    assert ended.returncode == 1
    assert ended.stderr == (f"usdlive: no server of dds://nobody was found in DDS domain {dds_domain} on lo\n")


def test_without_dds_nothing_is_served(dds_domain, tmp_path, project, serve):
    (project / "root.usda").write_text(ROOT)
    serve(project)
    assert usdlive("ls", "dds://").stdout == ""


def stranger(*arguments: str) -> subprocess.Popen:
    return subprocess.Popen([os.environ["USDLIVE_BUILD"] + "/bin/stranger", *arguments], stdout=subprocess.PIPE,
                            stderr=subprocess.PIPE, text=True)


def read_by_a_tool(seconds: float) -> str:
    said, error = stranger("read", str(seconds)).communicate(timeout=60)
    assert error == ""
    return said


@pytest.mark.parametrize("what, reason", [
    ("notGreeted", "notGreeted"),
    ("otherClient", "otherClient"),
    ("otherConnection", "otherClient"),
    ("otherProtocol", "otherProtocol"),
    ("malformed", "malformed"),
])
def test_dd13_odd_samples_are_counted_logged_once_and_ignored(server, join, what, reason):
    ada = join(server.dds, "ada")
    ada.run("happened.clear()")
    write(ada, "ada", 0, 10)
    sender = stranger("send", what, "50")
    while sender.poll() is None:  # ada works meanwhile
        write(ada, "ada", 10, 20, 0.01)
    assert sender.communicate() == ("", "")
    synced(server, [ada])
    assert metric(server, "usdlive_ignored_samples_total", f'reason="{reason}"') == 50
    assert ada.run("result = [type(e).__name__ for e in happened if type(e).__name__ in ('Lost', 'Disconnected')]") == []
    logged = [line for line in server.log.read_text().splitlines() if "samples ignored" in line]
    assert len(logged) == 1 and reason in logged[0], logged
    assert metric(server, "usdlive_connections") >= 1


def anonymous_mib(server: DdsServer) -> float:
    """Returns how much memory the server's process has that is not a file's."""
    text = pathlib.Path(f"/proc/{server.process.pid}/smaps_rollup").read_text()
    return int(re.search(r"^Anonymous:\s+(\d+)", text, re.MULTILINE)[1]) / 1024


@pytest.mark.parametrize("what", ["garbage", "connections"])
def test_dd16_a_participant_that_sends_as_fast_as_it_can_takes_bounded_memory(server, join, what):
    ada, bo = join(server.dds, "ada"), join(server.dds, "bo")
    for editor, name in ((ada, "ada"), (bo, "bo")):
        editor.run("happened.clear()")
        write(editor, name, 0, 10)
    before = most = anonymous_mib(server)
    sender, number = stranger("flood", what, "4"), 10
    while sender.poll() is None:  # the others work meanwhile
        write(ada, "ada", number, number + 5, 0.01)
        write(bo, "bo", number, number + 5, 0.01)
        most, number = max(most, anonymous_mib(server)), number + 5
    said, error = sender.communicate()
    assert error == "" and int(said) > 1_000
    text = synced(server, [ada, bo])
    assert text.count(f" {number - 1}: {(number - 1) * 7}") >= 1 and number > 15
    assert most - before < 250, f"{most - before} MiB after {said} samples"
    for editor in (ada, bo):
        assert editor.run("result = [type(e).__name__ for e in happened if type(e).__name__ in ('Lost', 'Disconnected')]") == []
    reason = "notGreeted" if what == "garbage" else "tooMany"
    assert metric(server, "usdlive_ignored_samples_total", f'reason="{reason}"') > 100
    if what == "connections":
        assert metric(server, "usdlive_connections_total") < 200


def secured(folder, *names):
    """Keys made by the script: a folder for each name."""
    made = subprocess.run([HERE.parent.parent / "server/tools/dds-keys", folder, *names], capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    return folder


@pytest.fixture
def keys(tmp_path, dds_domain):
    return secured(tmp_path / "keys", "ada", "bo")


@pytest.fixture
def secure_server(tmp_path, dds_domain, keys):
    folder = tmp_path / f"safe{random.SystemRandom().getrandbits(32):08x}"
    folder.mkdir()
    (folder / "root.usda").write_text(ROOT)
    server = DdsServer(folder, tmp_path / "server.log", "--dds", "--dds-domain", str(dds_domain), "--dds-security",
                       str(keys / "server")).start()
    yield server
    assert server.stop() == 0, server.log.read_text()


def test_dd14_with_an_identity_one_edits_and_without_one_gets_nothing(secure_server, join, keys, tmp_path, monkeypatch):
    monkeypatch.setenv("USDLIVE_DDS_SECURITY", str(keys / "ada"))
    ada = join(secure_server.dds, "ada")
    monkeypatch.setenv("USDLIVE_DDS_SECURITY", str(keys / "bo"))
    bo = join(secure_server.dds, "bo")
    for editor, name in ((ada, "ada"), (bo, "bo")):
        write(editor, name, 0, 50)
    synced(secure_server, [ada, bo])  # edits that arrive during the lock are refused
    ada.run("live.lock('root.usda'); assert live.flush(20)")
    bo.run("assert live.wait(lambda: live.layer_states()['root.usda'].holder == 'ada', 20)")
    ada.run("live.unlock('root.usda'); assert live.flush(20)")
    text = synced(secure_server, [ada, bo])
    assert text.count("343") == 2
    assert usdlive("ls", "dds://").stdout.startswith(secure_server.dds)

    # Nobody else discovers the project, whatever they try.
    monkeypatch.setenv("USDLIVE_DDS_SECURITY", str(secured(tmp_path / "other", "eve") / "eve"))
    assert usdlive("ls", "dds://").stdout == ""
    monkeypatch.delenv("USDLIVE_DDS_SECURITY")
    assert usdlive("ls", "dds://").stdout == ""
    reading = stranger("read", "6")
    for turn in range(5):
        write(ada, "ada", 50, 60, 0.05)
    assert reading.communicate(timeout=60) == ("", "")
    sender = stranger("send", "notGreeted", "1")
    assert "there is no server" in sender.communicate(timeout=60)[1]
    assert metric(secure_server, "usdlive_ignored_samples_total", 'reason="notGreeted"') == 0
    # An editor may not act as a server either.
    monkeypatch.setenv("USDLIVE_DDS_SECURITY", str(keys / "bo"))
    monkeypatch.setenv("USDLIVE_DDS_DOMAIN", os.environ["USDLIVE_DDS_DOMAIN"])
    pretending = subprocess.run(
        [os.environ["USDLIVE_BIN"], "serve", str(tmp_path), "--port", "0", "--min-free-mib", "1", "--dds",
         "--dds-domain", os.environ["USDLIVE_DDS_DOMAIN"], "--dds-security", str(keys / "bo")],
        capture_output=True, text=True, timeout=20)
    *before, last = pretending.stderr.splitlines()
    assert pretending.returncode == 1 and last.startswith("usdlive-server: DDS: "), pretending.stderr
    # On a busy machine it may have discovered another participant before it is refused.
    met = re.compile(r'\S+ \S+ warning: DDS says="Remote secure participant [0-9a-f:]+ not allowed"')
    assert all(met.fullmatch(line) for line in before), before


def account(server: DdsServer, *arguments: str) -> None:
    done = usdlive("user", *arguments, str(server.folder))
    assert done.returncode == 0, done.stderr


def test_dd17_the_certificate_says_who_somebody_is_and_the_accounts_what_they_may(tmp_path, dds_domain, join, keys,
                                                                                 monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    folder = tmp_path / f"safe{random.SystemRandom().getrandbits(32):08x}"
    folder.mkdir()
    (folder / "root.usda").write_text(ROOT)
    secured(keys, "eve")
    for name, role in (("ada", "editor"), ("bo", "viewer")):
        assert usdlive("user", "add", name, "--role", role, "--at", "127.0.0.1:1", str(folder)).returncode == 0
    server = DdsServer(folder, tmp_path / "server.log", "--dds", "--dds-domain", str(dds_domain), "--dds-security",
                       str(keys / "server")).start()

    def entering(key: str, *options: str) -> subprocess.CompletedProcess:
        monkeypatch.setenv("USDLIVE_DDS_SECURITY", str(keys / key))
        return usdlive("cat", f"{server.dds}/root.usda", *options)

    monkeypatch.setenv("USDLIVE_DDS_SECURITY", str(keys / "ada"))
    ada = join(server.dds, "ada")
    assert ada.run("result = live.role") == "editor"
    write(ada, "ada", 0, 20)
    ada.flush()
    assert "133" in entering("ada").stdout  # under its own name
    monkeypatch.setenv("USDLIVE_DDS_SECURITY", str(keys / "bo"))
    bo = join(server.dds, "bo")
    assert bo.run("result = live.role") == "viewer"

    # ada's certificate under bo's name, and a certificate without an account.
    refused = entering("ada", "--user", "bo")
    assert refused.returncode != 0 and "you are signed in as ada, not as bo" in refused.stderr, refused.stderr
    refused = entering("eve")
    assert refused.returncode != 0 and "eve" in refused.stderr, refused.stderr

    # A removed user is out within a second.
    account(server, "remove", "ada")
    ada.run("import time\nuntil = time.monotonic() + 5\n"
            "while time.monotonic() < until and not any(type(e).__name__ in ('Lost', 'Disconnected') for e in happened): "
            "live.tick(); time.sleep(0.05)\nresult = [type(e).__name__ for e in happened]")
    assert "ada" in server.log.read_text() and "was ended" in server.log.read_text()
    assert server.stop() == 0, server.log.read_text()


@pytest.mark.parametrize("what", ["no folder", "no key", "key of another", "no certificate", "other permissions"])
def test_dd14_keys_that_are_wrong_are_said_in_a_line(tmp_path, project, keys, what):
    (project / "root.usda").write_text(ROOT)
    folder = keys / "server"
    if what == "no folder":
        folder = tmp_path / "nowhere"
    elif what == "no key":
        (folder / "identity.key").unlink()
    elif what == "key of another":
        (folder / "identity.key").write_bytes((keys / "ada/identity.key").read_bytes())
    elif what == "no certificate":
        (folder / "identity.pem").write_text("nonsense")
    else:
        (folder / "permissions.p7s").write_bytes((folder / "governance.p7s").read_bytes())
    ended = subprocess.run([os.environ["USDLIVE_BIN"], "serve", str(project), "--port", "0", "--min-free-mib", "1",
                            "--dds", "--dds-security", str(folder)], capture_output=True, text=True, timeout=20)
    assert ended.returncode == 1
    assert ended.stderr.startswith("usdlive-server: DDS: ") and ended.stderr.count("\n") == 1, ended.stderr
    assert str(folder) in ended.stderr


def test_dd11_any_dds_tool_reads_states_and_presences(server, join):
    ada = join(server.dds, "ada")
    bo = join(server.url, "bo")
    ada.run("live.lock('root.usda'); live.show_presence(['/World'], time=3.0); assert live.flush(20)")
    bo.run("live.show_presence(['/World/A']); assert live.wait(lambda: len(live.presences()) == 1, 20)")
    reading = stranger("read", "4")
    for turn in range(8):  # an editor that does not tick is treated as disconnected
        for editor in (ada, bo):
            editor.run("live.wait(lambda: False, 0.2)")
    read = reading.communicate(timeout=60)[0]
    assert re.search(r"^layer root.usda .* dirty writable locked by ada at \d{13} editor ada editor bo$", read,
                     re.MULTILINE), read
    assert re.search(r"^person \w+ ada in \S* ?#[0-9a-f]{6} selects /World at 3$", read, re.MULTILINE), read
    assert re.search(r"^person \w+ bo in \S* ?#[0-9a-f]{6} selects /World/A$", read, re.MULTILINE), read
    # A session that ended is removed, and a layer that returned to the plain state is written as such.
    reading = stranger("read", "4")
    ada.run("live.wait(lambda: False, 1.5)\nlive.unlock('root.usda'); assert live.flush(20); live.close()")
    read = reading.communicate(timeout=60)[0]
    assert read.rstrip().splitlines()[-1].startswith("person") and re.search(r"^person \w+ gone$", read, re.MULTILINE)
    assert [line for line in read.splitlines() if line.startswith("layer")][-1].endswith("writable editor bo"), read
    # The tool reads existing samples, and finds none of a server that ended.
    bo.run("live.close()")
    assert server.stop() == 0
    assert read_by_a_tool(1) == ""


def wait_all(editors, condition, seconds=20):
    """Waits in turns: an editor that runs no frames disappears for the others after 3 s (PS2)."""
    end = time.monotonic() + seconds
    waiting = list(editors)
    while waiting:
        assert time.monotonic() < end, [editor.run("result = str(live.presences())") for editor in editors]
        for editor in editors:
            if editor.run(f"live.tick(); result = bool({condition})") and editor in waiting:
                waiting.remove(editor)


def test_dd11_states_and_presences_are_sent_once_for_all(server, join):
    editors = [join(server.dds, name) for name in ("ada", "bo", "eve", "fay")]
    wait_all(editors, "len(live.presences()) == 3")
    before = metric(server, "usdlive_sent_frames_total")
    for frame in range(60):
        editors[0].run(f"live.show_presence(time={frame}.0); live.tick()")
        for editor in editors[1:]:
            editor.run("live.tick()")
        time.sleep(0.05)
    wait_all(editors[1:], "any(p.user == 'ada' and p.time == 59.0 for p in live.presences())")
    sent = metric(server, "usdlive_sent_frames_total") - before
    assert 20 < sent < 100, "each presence was sent to each client separately"
    editors[0].run("live.close()")
    wait_all(editors[1:], "len(live.presences()) == 2", 5)


def test_dd11_states_of_a_server_before_are_forgotten(server, join):
    ada, cy = join(server.dds, "ada"), join(server.url, "cy")
    ada.run("live.lock('root.usda'); assert live.flush(20)")
    locked = "(live.layer_states().get('root.usda') or type('', (), dict(locked=False, editors=()))).{}"
    for editor in (ada, cy):
        editor.run(f"assert live.wait(lambda: {locked.format('locked')}, 20)")
    server.kill()
    server.start()
    for editor in (ada, cy):
        editor.run(f"assert live.wait(lambda: live.connected and {locked.format('editors')} == ('ada', 'cy') and "
                   f"{locked.format('locked')}, 30), live.layer_states()")
    ada.run("live.unlock('root.usda'); assert live.flush(20)")
    for editor in (ada, cy):
        editor.run(f"assert live.wait(lambda: not {locked.format('locked')}, 20)")
    assert usdlive("ls", "-l", server.dds).stdout == usdlive("ls", "-l", server.url).stdout


def test_locks_and_people_cross_the_transports(server, join):
    ada, cy = join(server.dds, "ada"), join(server.url, "cy")
    ada.run("live.lock('root.usda'); live.show_presence(['/World'], time=3.0); assert live.flush(20)")
    cy.run("assert live.wait(lambda: live.layer_states().get('root.usda')"
           " and live.layer_states()['root.usda'].holder == 'ada'"
           " and any(p.time == 3.0 for p in live.presences()), 20)")
    who = usdlive("who", f"{server.dds}").stdout.splitlines()
    assert sum(line.startswith("ada") and line.endswith("/World  at 3") for line in who) == 1, who
    cy.run("lost = []\nlive.add_handler(lambda e: lost.append(e) if type(e).__name__ == 'Lost' else None)\n"
           "stage.GetRootLayer().SetPermissionToEdit(True)  # like an editor that ignores the lock\n"
           "a = stage.GetAttributeAtPath('/World.cy'); a.Set(5)\n"
           "assert live.wait(lambda: lost, 20) and lost[0].code == 'locked' and 'ada' in lost[0].message\n"
           "assert a.Get() is None")
    ada.run("live.unlock('root.usda'); assert live.flush(20)")
    cy.run("assert live.wait(lambda: not live.layer_states()['root.usda'].locked, 20)\na.Set(6)")
    synced(server, [ada, cy])


def test_fr8_a_commit_in_parts_arrives_over_both(tmp_path, dds_domain, join):
    folder = tmp_path / f"shot{random.SystemRandom().getrandbits(32):08x}"
    folder.mkdir()
    (folder / "root.usda").write_text(EMPTY)
    server = DdsServer(folder, tmp_path / "server.log", "--dds", "--dds-domain", str(dds_domain),
                       "--max-frame-mib", "1").start()
    try:
        ada, bo, cy = join(server.dds, "ada"), join(server.url, "bo"), join(server.dds, "cy")
        for author, name in ((ada, "Set"), (bo, "Kit")):
            before = author.flush()
            for peer in (ada, bo, cy):
                peer.run(WATCH.replace("/Set", f"/{name}"))
            author.run(PASTE.replace("'/Set'", f"'/{name}'").replace("f'/Set/", f"f'/{name}/"))
            assert author.run("assert live.flush(60); result = live.revision") == before + 1
            for peer in (ada, bo, cy):
                assert peer.run(SEEN) == before + 1
        text = cat(server, "root.usda")
        assert ada.text("root.usda") == bo.text("root.usda") == cy.text("root.usda") == text
    finally:
        assert server.stop() == 0, server.log.read_text()
