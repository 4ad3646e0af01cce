"""Tests who gets in and who may do what, with real processes (AC1-AC7)."""

from __future__ import annotations

import json
import pathlib
import re
import time

import pytest
import usdlive
from conftest import Server, wait
from pxr import Sdf, Usd
from studio import ROOT, Studio, invited, opened, project, studio, usdlive_, user  # noqa: F401 (fixtures)


def test_nobody_gets_in_without_a_token(studio):
    """AC1"""
    for path in ("/", "/projects", "/metrics", "/files", "/files/root.usda"):
        status, text = studio.get(path, "0" * 64)
        assert status == 401 and "usdlive join" in text, path
    assert studio.get("/healthz") == (200, '{"status":"ok"}\n')
    assert studio.get("/join") == (405, "only POST\n")
    # The log is not filled by somebody who goes on.
    assert studio.server.log.read_text().count("sign-in refused") < 10
    with pytest.raises(usdlive.Error, match="usdlive join"):
        usdlive.connect(studio.server.url)
    listed = usdlive_("ls", studio.server.url)
    assert listed.returncode == 1 and "usdlive join" in listed.stderr


def test_an_invitation_lets_one_person_in_once(studio, project):
    """AC2"""
    invitation = invited("add", "ann", project)
    studio.be("ann")
    joined = usdlive_("join", invitation)
    assert joined.returncode == 0 and joined.stdout.startswith("You are ann at ws://"), joined.stderr
    home = pathlib.Path(studio.home("ann")) / "usdlive"
    assert (home / "servers.json").stat().st_mode & 0o777 == 0o600
    with usdlive.connect(studio.server.url) as live:
        assert (live.user, live.role) == ("ann", "editor")
    assert usdlive_("ls", studio.server.url).stdout.startswith("root.usda")
    studio.be("eve")
    again = usdlive_("join", invitation)
    assert again.returncode == 1 and "used already" in again.stderr
    assert usdlive_("ls", studio.server.url).returncode == 1
    # A damaged invitation is not sent anywhere, and its code is not shown.
    damaged = usdlive_("join", invitation[:-1])
    assert damaged.returncode == 1 and "damaged" in damaged.stderr and invitation[-60:-1] not in damaged.stderr


def test_no_secret_is_logged_or_stored(studio, project):
    live = studio.join("ann", "editor")
    token = studio.token("ann")
    studio.get("/projects", token[::-1])
    live.close()
    studio.server.stop()
    for file in (studio.server.log, *project.rglob("*")):
        if file.is_file():
            data = file.read_bytes()
            assert token.encode() not in data and token[::-1].encode() not in data, file


def test_users_act_in_their_own_name(studio):
    """AC1"""
    ann = studio.join("ann", "editor")
    ann.close()
    studio.be("ann")
    with pytest.raises(usdlive.Error, match="signed in as ann, not as chief"):
        usdlive.connect(studio.server.url, user="chief")


def test_the_owner_of_the_process_needs_no_invitation(studio, project, tmp_path, monkeypatch, serve):
    """AC1"""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "owner"))
    other = tmp_path / "other"
    other.mkdir()
    user("add", "ann", "--at", "127.0.0.1:1", other)
    server = serve(other)
    token = tmp_path / "owner" / "usdlive" / "local" / str(server.port)
    assert token.stat().st_mode & 0o777 == 0o600
    with usdlive.connect(server.url, user="ada") as live:
        assert (live.user, live.role) == ("ada", "admin")
    server.stop()
    assert not token.exists()


def test_a_viewer_sees_and_does_not_edit(studio):
    """AC3"""
    ann, vic = studio.join("ann", "editor"), studio.join("vic", "viewer")
    stage, _ = opened(ann)
    seen, layer = opened(vic)
    assert vic.role == "viewer" and not layer.permissionToEdit
    stage.GetPrimAtPath("/World/Props/Box").GetAttribute("size").Set(2.0)
    ann.flush()
    wait(lambda: seen.GetPrimAtPath("/World/Props/Box").GetAttribute("size").Get() == 2.0, vic)
    studio.be("vic")
    locked = usdlive_("lock", studio.server.url, "root.usda")
    assert locked.returncode == 1 and "viewer" in locked.stderr
    for words in (("save", studio.server.url), ("reload", studio.server.url, "root.usda"),
                  ("checkpoint", studio.server.url, "one")):
        ran = usdlive_(*words)
        assert ran.returncode == 1 and "viewer" in ran.stderr, (words, ran.stderr)


def test_a_removed_user_is_out_within_a_second(studio, project):
    """AC4"""
    ann, bob = studio.join("ann", "editor"), studio.join("bob", "editor")
    stage, _ = opened(ann)
    watching, _ = opened(bob)
    stage.GetPrimAtPath("/World/Props/Box").GetAttribute("size").Set(2.0)
    ann.flush()
    assert "has taken the change" in user("remove", "ann", project)
    # From here on nothing of ann may be accepted.
    stage.GetPrimAtPath("/World/Props/Box").GetAttribute("size").Set(3.0)
    removed = time.monotonic()
    while ann.connected and time.monotonic() < removed + 5:
        ann.tick()
        time.sleep(0.01)
    assert not ann.connected and time.monotonic() - removed < 1
    assert studio.get("/projects", studio.token("ann"))[0] == 401
    end = time.monotonic() + 0.5
    while time.monotonic() < end:
        bob.tick()
        ann.tick()
        time.sleep(0.01)
    assert watching.GetPrimAtPath("/World/Props/Box").GetAttribute("size").Get() == 2.0


def test_a_changed_role_reaches_an_open_editor(studio, project):
    """AC4"""
    ann = studio.join("ann", "editor")
    _, layer = opened(ann)
    assert layer.permissionToEdit
    studio.be("ann")  # connecting again needs the token
    user("role", "ann", "viewer", project)
    wait(lambda: ann.role == "viewer" and not layer.permissionToEdit, ann)
    user("role", "ann", "editor", project)
    wait(lambda: ann.role == "editor" and layer.permissionToEdit, ann)


def test_a_revoked_token_ends_one_machine(studio, project):
    """AC4"""
    ann = studio.join("ann", "editor")
    first = studio.token("ann")
    again = invited("invite", "ann", project)
    studio.be("laptop")
    laptop = usdlive.connect(again)
    listed = json.loads(next(line for line in user("list", "--json", project).splitlines() if '"ann"' in line))
    user("revoke", listed["tokens"][0]["id"], project)
    wait(lambda: not ann.connected, ann)
    assert studio.get("/projects", first)[0] == 401
    laptop.tick()
    assert laptop.connected
    laptop.close()


def test_a_program_signs_in_with_its_token(studio, project, tmp_path, monkeypatch):
    """AC12"""
    made = user("add", "farm", "--service", "--role", "viewer", "--expires", "90d", project)
    token = re.search(r"usdlive-token://\S+", made).group()
    assert token.startswith(f"usdlive-token://farm@127.0.0.1:{studio.server.port}/") and "has taken" in made
    assert re.search(r"farm  viewer, a service account\n  token \w{8} of \S+, until 20", user("list", project))
    studio.be("node")
    assert usdlive_("ls", studio.server.url).returncode == 1
    monkeypatch.setenv("USDLIVE_TOKEN", token)
    with usdlive.connect(studio.server.url) as live:
        assert (live.user, live.role) == ("farm", "viewer")
    assert not (pathlib.Path(studio.home("node")) / "usdlive" / "servers.json").exists(), "nothing is kept"
    monkeypatch.delenv("USDLIVE_TOKEN")
    file = tmp_path / "token"
    file.write_text(token + "\n")
    monkeypatch.setenv("USDLIVE_TOKEN_FILE", str(file))
    opened = usdlive_("ls", studio.server.url)
    assert opened.returncode == 1 and f"chmod 600 {file}" in opened.stderr and token[-20:] not in opened.stderr
    file.chmod(0o600)
    assert usdlive_("ls", studio.server.url).stdout.startswith("root.usda")
    # It is revoked as any token is, and nobody joins with the account.
    live = usdlive.connect(studio.server.url)
    listed = json.loads(next(line for line in user("list", "--json", project).splitlines() if '"farm"' in line))
    assert listed["service"] and listed["tokens"][0]["endsAt"] > time.time() + 89 * 86_400
    user("revoke", listed["tokens"][0]["id"], project)
    wait(lambda: not live.connected, live)
    live.close(timeout=0)
    assert usdlive_("ls", studio.server.url).returncode == 1
    file.write_text(re.search(r"usdlive-token://\S+", user("token", "farm", project)).group())
    assert usdlive_("ls", studio.server.url).returncode == 0
    for words, why in ((("invite", "farm"), "service account"), (("token", "chief"), "no service account"),
                       (("add", "eve", "--expires", "3d"), "--service"), (("token", "farm", "--expires", "3"), "unit"),
                       (("token", "farm", "--expires", "0d"), "--expires")):
        ran = usdlive_("user", *words, project)
        assert ran.returncode != 0 and why in ran.stderr, (words, ran.stderr)
    token = file.read_text()[-64:]
    assert token not in studio.server.log.read_text() + (project / ".usdlive" / "audit.jsonl").read_text()


def test_the_token_of_a_program_ends(studio, project, monkeypatch):
    """AC12: its sessions end within a second of its end."""
    token = re.search(r"usdlive-token://\S+", user("add", "farm", "--service", "--expires", "1m", project)).group()
    users = project / ".usdlive" / "users.json"
    studio.be("node")
    monkeypatch.setenv("USDLIVE_TOKEN", token)
    accounts = json.loads(users.read_text())
    end = int(time.time()) + 3
    accounts["users"]["farm"]["tokens"][0]["endsAt"] = end
    accounts["version"] += 1
    users.write_text(json.dumps(accounts))
    wait(lambda: json.loads((project / ".usdlive" / "users.followed").read_text())["version"] == accounts["version"])
    live = usdlive.connect(studio.server.url)
    wait(lambda: not live.connected, live)
    assert end <= time.time() < end + 2
    live.close(timeout=0)
    refused = usdlive_("ls", studio.server.url)
    assert refused.returncode == 1 and "token" in refused.stderr


def test_a_project_without_a_role_does_not_exist(tmp_path, monkeypatch):
    """AC3"""
    folder = tmp_path / "all"
    for name in ("open", "secret"):
        (folder / name).mkdir(parents=True)
        (folder / name / "root.usda").write_text(ROOT)
    user("add", "ann", "--at", "127.0.0.1:1", folder)
    server = Server(folder, tmp_path / "server.log")
    server.program += ["--projects"]
    server.start()
    user("role", "ann", "none", "--project", "secret", folder)
    invitation = invited("invite", "ann", folder)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "ann"))
    assert usdlive_("join", invitation).returncode == 0
    assert "secret" not in usdlive_("ls", server.url).stdout
    with pytest.raises(usdlive.Error, match="no project"):
        usdlive.connect(f"{server.url}/secret")
    with usdlive.connect(f"{server.url}/open") as live:
        assert live.role == "editor"
    assert server.stop() == 0


def test_an_admin_lists_the_users_of_a_project_and_nobody_else_does(studio, project, tmp_path, serve):
    """AC27"""
    for name, role in (("eve", "admin"), ("ann", "viewer"), ("out", "editor")):
        studio.join(name, role)
    user("role", "out", "none", project)
    wait(lambda: not studio.joined[-1].connected, studio.joined[-1])
    known = [{"name": "ann", "role": "viewer"}, {"name": "chief", "role": "admin"}, {"name": "eve", "role": "admin"}]
    for path in ("/users", f"/{project.name}/users"):
        status, text = studio.get(path, studio.token("eve"))
        assert (status, json.loads(text)) == (200, {"project": project.name, "users": known})
        assert studio.get(path, studio.token("ann")) == (403, "ann is a viewer here; an admin can list the users\n")
        assert studio.get(path)[0] == 401 and studio.get(path, studio.token("out"))[0] == 404
    assert studio.get("/other/users", studio.token("eve"))[0] == 404
    (tmp_path / "free").mkdir()
    studio.server = serve(tmp_path / "free")
    status, text = studio.get("/users")
    assert status == 404 and "asks nobody to sign in" in text


def test_rules_follow_their_file(studio, project):
    """AC6, AC7: an animator may write time samples of the hero, and nothing else."""
    ann = studio.join("ann", "editor")
    stage, layer = opened(ann)
    rules = project / ".usdlive" / "access.json"

    def write(path: str, time_code=Usd.TimeCode.Default(), value=(1, 2, 3)) -> bool:
        """Returns whether the server took the edit."""
        attribute = stage.GetPrimAtPath(path).CreateAttribute("xformOp:translate", Sdf.ValueTypeNames.Double3)
        before = ann.revision
        attribute.Set(value, time_code)
        ann.flush()
        return ann.revision > before

    assert write("/World/Props/Box")
    rules.write_text(json.dumps({"format": 1, "rules": [
        {"effect": "deny", "users": ["ann"]},
        {"effect": "allow", "users": ["ann"], "paths": ["/World/Hero/**"], "kinds": ["animation"]}]}))
    wait(lambda: 'access rules changed detail="rules: 2"' in studio.server.log.read_text(), ann)
    assert write("/World/Hero", 1.0)
    assert not write("/World/Hero", value=(4, 5, 6))
    assert not write("/World/Props/Box", 2.0)
    # Unreadable rules change nothing, and the log says what is wrong with them.
    rules.write_text('{"format": 1,\n "rules": [}')
    wait(lambda: "access.json: line 2 is not JSON" in studio.server.log.read_text(), ann)
    assert not write("/World/Props/Box", 3.0)
    rules.write_text('{"format": 1, "rules": []}')
    wait(lambda: 'access rules changed detail="rules: 0"' in studio.server.log.read_text(), ann)
    assert write("/World/Props/Box", 4.0)


def test_a_server_refuses_to_start_with_files_that_it_cannot_trust(project, tmp_path):
    def start(*options: str) -> str:
        ran = usdlive_("serve", project, "--port", "0", *options)
        assert ran.returncode == 1, ran.stdout
        return ran.stderr

    user("add", "ann", "--at", "127.0.0.1:1", project)
    users = project / ".usdlive" / "users.json"
    users.chmod(0o644)
    assert f"chmod 600 {users}" in start()
    users.chmod(0o600)
    good = users.read_text()
    users.write_text(good.replace("editor", "boss"))
    assert "the role of the user ann is none of none, viewer" in start()
    users.write_text(good)
    (project / ".usdlive" / "access.json").write_text('{"format": 1, "rules": [{"effect": "perhaps"}]}')
    assert "the effect of rule 1" in start()


def test_a_network_is_served_only_safely(project):
    def start(*options: str) -> str:
        ran = usdlive_("serve", project, "--port", "0", "--host", "0.0.0.0", *options)
        assert ran.returncode == 1, ran.stdout
        return ran.stderr

    refused = start()
    assert "usdlive user add" in refused and "--insecure" in refused
    user("add", "ann", "--at", "127.0.0.1:1", project)
    refused = start()
    assert "--tls auto" in refused and "--insecure" in refused


def test_one_minute_from_a_folder_to_a_safe_server(project, tmp_path, monkeypatch):
    """An invitation is all that the other end needs, also one that was made before the server ran."""
    server = Server(project, tmp_path / "server.log", "--host", "0.0.0.0", "--tls", "auto")
    first = invited("add", "ann", "--at", f"wss://127.0.0.1:{server.port}", project)
    server.start()
    second = invited("invite", "ann", "--at", f"127.0.0.1:{server.port}", project)
    pin = re.compile(r"\?pin=sha256:[0-9a-f]{64}$")
    assert pin.search(first).group() == pin.search(second).group()
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "ann"))
    with usdlive.connect(first) as ann:
        stage, _ = opened(ann)
        stage.GetPrimAtPath("/World/Props/Box").GetAttribute("size").Set(5.0)
        ann.flush()
    # Now the server is known, and no scheme is needed.
    with usdlive.connect(f"127.0.0.1:{server.port}") as ann:
        assert (ann.user, ann.role) == ("ann", "editor")
        assert opened(ann)[0].GetPrimAtPath("/World/Props/Box").GetAttribute("size").Get() == 5.0
    stage = Usd.Stage.Open(f"usdlive://127.0.0.1:{server.port}/root.usda")
    assert stage.GetPrimAtPath("/World/Props/Box").GetAttribute("size").Get() == 5.0
    # Somebody else at the address gets neither the code nor the token.
    server.stop()
    (project / ".usdlive" / "tls" / "certificate.pem").unlink()
    server.start()
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "laptop"))
    with pytest.raises(usdlive.Error, match="has changed"):
        usdlive.connect(second)
    assert server.stop() == 0


def test_commands_name_mistakes(project, tmp_path):
    """Misuse of `usdlive user` names what is wrong and what to do."""
    def failed(*words: object) -> str:
        ran = usdlive_("user", *words)
        assert ran.returncode != 0, ran.stdout
        return ran.stderr

    assert "add --at HOST:PORT" in failed("add", "ann", project)
    assert "cannot be the name" in failed("add", "a/b", "--at", "h:1", project)
    assert not (project / ".usdlive" / "users.json").exists()
    user("add", "ann", "--at", "h:1", project)
    assert "already" in failed("add", "ann", "--at", "h:1", project)
    assert "'bob'" in failed("remove", "bob", project) and "'bob'" in failed("role", "bob", "viewer", project)
    assert "boss" in failed("role", "ann", "boss", project)
    assert "missing" in failed("list", tmp_path / "missing")
    assert "HOST:PORT" in failed("invite", "ann", "--at", "nowhere", project)
    assert failed().count("\n") >= 1


def test_rules_are_explained(project):
    """`usdlive access` decides as the server does."""
    def access(*words: object) -> str:
        ran = usdlive_("access", project, *words)
        assert ran.returncode == 0, ran.stderr
        return ran.stdout

    user("add", "ann", "--at", "h:1", project)
    assert "roles alone decide" in access()
    (project / ".usdlive" / "access.json").write_text(json.dumps({"format": 1, "rules": [
        {"effect": "deny", "roles": ["editor"], "paths": ["/World/Props/**"], "kinds": ["namespace", "schema"]}]}))
    sentence = "rule 1 denies schema, namespace in /World/Props/** to editor"
    assert access() == sentence + "\n"
    told = access("ann", "root.usda", "/World/Props/Box")
    assert f"no   namespace  ({sentence})" in told and "yes  transform  (the role decides)" in told
    assert access("ann", "root.usda", "/World", "namespace") == "ann is editor\nyes  namespace  (the role decides)\n"
    # Without a place it lists the actions (AC11).
    with_actions = json.dumps({"format": 1, "rules": [
        {"effect": "deny", "users": ["ann"], "actions": ["save", "lock"], "layers": ["root.*"]}]})
    (project / ".usdlive" / "access.json").write_text(with_actions)
    denied = "(rule 1 denies save, lock of root.* to ann)"
    assert access() == denied[1:-1] + "\n"
    told = access("ann", "root.usda").splitlines()
    assert told[0] == "ann is editor" and f"no   save  {denied}" in told and f"no   lock  {denied}" in told
    assert "yes  mute  (the role decides)" in told and "no   compact  (the role decides)" in told and len(told) == 10
    assert "yes  save  (the role decides)" in access("ann", "set.usda")
    for words, why in ((("bob", "root.usda", "/World"), "'bob'"), (("ann", "root.usda", "World"), "path"),
                       (("ann",), "LAYER"), (("ann", "root.usda", "/", "colour"), "colour")):
        ran = usdlive_("access", project, *words)
        assert ran.returncode != 0 and why in ran.stderr, (words, ran.stderr)


def test_who_may_read_a_project_may_read_its_past_and_nobody_else(studio, project):
    """AC3: reading is granted by project."""
    bob = studio.join("bob", "editor")
    stage, _ = opened(bob)
    for number in range(3):
        stage.GetPrimAtPath("/World").SetMetadata("comment", str(number))
        assert bob.flush()
    bob.close()
    ann = studio.join("ann", "viewer", stays=True)  # layers are fetched with the token of the user of this process
    newest = ann.revision
    past, player = ann.open_stage("root.usda", at=newest - 1), ann.player("root.usda")
    player.seek(newest - 1)
    for one in (past, player.stage):
        assert one.GetPrimAtPath("/World").GetMetadata("comment") == "1"
    assert next(ann.log(by="bob")).revision == newest and ann.blame("root.usda", "/World")
    user("role", "ann", "none", project)
    wait(lambda: not ann.connected, ann)
    for call in (lambda: ann.open_stage("root.usda", at=1), lambda: ann.player("root.usda"),
                 lambda: list(ann.log()), lambda: ann.blame("root.usda", "/World")):
        with pytest.raises(usdlive.Error) as raised:
            call()
        assert raised.value.code == "notConnected"
    ann.close(timeout=0)
