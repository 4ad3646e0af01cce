"""Tests the audit log, and the commands that change access rules (AU1-AU4, AC6), with real processes."""

from __future__ import annotations

import json
import re
import threading

import pytest
import usdlive
from conftest import wait
from studio import opened, project, studio, usdlive_, user  # noqa: F401 (fixtures)


def audit(folder, *words: object) -> list[dict]:
    """Returns the records, whose chain is whole."""
    ran = usdlive_("audit", folder, "--json", *words)
    assert ran.returncode == 0, ran.stderr
    return [json.loads(line) for line in ran.stdout.splitlines()]


def events(folder, *words: object) -> list[str]:
    return [record["event"] for record in audit(folder, *words)]


def head(folder) -> str:
    return re.search(r"\d+:[0-9a-f]{64}", usdlive_("audit", folder).stderr).group()


def test_who_did_what_is_recorded(studio):
    """AU1"""
    ann = studio.join("ann", "editor")
    stage, layer = opened(ann)
    stage.GetPrimAtPath("/World/Props/Box").GetAttribute("size").Set(2.0)
    ann.flush()
    ann.save("root.usda")
    denied = usdlive_("deny", studio.folder, "--user", "ann", "--path", "/World/Props/**", "--kind", "geometry")
    assert denied.returncode == 0, denied.stderr
    assert denied.stdout == ("rule 1 denies geometry in /World/Props/** to ann\n"
                             "The running server has taken the change.\n")
    stage.GetPrimAtPath("/World/Props/Box").GetAttribute("size").Set(3.0)
    with pytest.warns(RuntimeWarning, match="rule 1 denies"):
        ann.flush()
    assert studio.get("/projects", "0" * 64)[0] == 401
    user("role", "ann", "viewer", studio.folder)
    user("remove", "ann", studio.folder)
    wait(lambda: "sign-in refused" in events(studio.folder))
    records = audit(studio.folder)
    assert [record["number"] for record in records] == list(range(1, len(records) + 1))

    def one(event: str, **fields: str) -> dict:
        found = [record for record in records
                 if record["event"] == event and all(record.get(name) == value for name, value in fields.items())]
        assert found, (event, fields, records)
        return found[0]

    one("user added", detail="ann as editor")
    one("user added", detail="chief as admin")
    one("invitation used", user="ann", **{"from": "127.0.0.1"})
    assert one("signed in", user="ann", project="shots")["detail"].startswith("with the token ")
    one("layer saved", user="ann", layer="root.usda", project="shots")
    one("access rule added", project="shots", detail="rule 1 denies geometry in /World/Props/** to ann")
    assert "rule 1" in one("edits refused", user="ann", layer="root.usda")["detail"]
    one("role set", detail="ann is viewer")
    one("user removed", detail="ann")
    text = "".join(path.read_text() for path in (studio.folder / ".usdlive").glob("audit*"))
    assert studio.token("ann") not in text, "a token is never recorded"
    assert events(studio.folder, "--user", "ann", "--event", "layer saved") == ["layer saved"]
    assert len(audit(studio.folder, "--last", "3")) == 3
    assert usdlive_("audit", studio.folder, "--event", "user removed").stdout.count("\n") == 1


def test_every_change_of_the_records_is_found(studio):
    """AU2"""
    folder = studio.folder
    for role in ("viewer", "editor", "viewer"):
        user("role", "chief", role, folder)
    noted = head(folder)
    user("role", "chief", "admin", folder)
    path = folder / ".usdlive" / "audit.jsonl"
    whole = path.read_text()
    lines = whole.splitlines(keepends=True)
    assert len(lines) >= 5
    assert usdlive_("audit", folder, "--expect", noted).returncode == 0

    def damage(text: str, *words: str) -> str:
        path.write_text(text)
        ran = usdlive_("audit", folder, *words)
        assert ran.returncode == 1 and "the audit log was changed" in ran.stderr, (text, ran.stderr)
        return ran.stderr

    assert "line 3" in damage("".join(lines[:1]) + lines[1].replace("viewer", "editor") + "".join(lines[2:]))
    assert "line 2" in damage("".join(lines[:1] + lines[2:]))
    assert "line 2" in damage("".join([lines[0], lines[2], lines[1], *lines[3:]]))
    assert "line 1" in damage("".join(["{}\n", *lines[1:]]))
    assert "line 2" in damage("".join([lines[0], "\n", *lines[1:]]))
    # Nothing follows the last record, so that its hash has to be known.
    path.write_text("".join(lines[:2]))
    assert usdlive_("audit", folder).returncode == 0
    assert "does not have the record" in damage("".join(lines[:2]), "--expect", noted)
    path.write_text(whole)
    for words, why in ((("--expect", "5"), "NUMBER:HASH"), (("--expect", "x:" + "0" * 64), "NUMBER:HASH")):
        ran = usdlive_("audit", folder, *words)
        assert ran.returncode == 1 and why in ran.stderr


def test_a_killed_server_leaves_whole_records(studio):
    """AU3. What a killed process has not written completely is no damage, and the chain goes on."""
    done = threading.Event()

    def guess() -> None:
        while not done.is_set():
            try:
                studio.get("/projects", "0" * 64)
            except OSError:
                return

    guessers = [threading.Thread(target=guess) for _ in range(4)]
    for one in guessers:
        one.start()
    wait(lambda: "sign-in refused" in events(studio.folder))
    studio.server.kill()
    done.set()
    for one in guessers:
        one.join()
    path = studio.folder / ".usdlive" / "audit.jsonl"
    with path.open("a") as file:
        file.write('{"number":')
    before = audit(studio.folder)
    user("role", "chief", "viewer", studio.folder)
    after = audit(studio.folder)
    assert after[:-1] == before and after[-1]["event"] == "role set"


def test_a_log_that_cannot_be_written_stops_nobody(studio):
    """AU4"""
    path = studio.folder / ".usdlive" / "audit.jsonl"
    kept = path.read_text()
    path.unlink()
    path.mkdir()
    ran = usdlive_("user", "role", "chief", "viewer", studio.folder)
    assert ran.returncode == 1 and "it is done, but not in the audit log" in ran.stderr
    assert '"viewer"' in (studio.folder / ".usdlive" / "users.json").read_text()
    assert studio.get("/projects", "0" * 64)[0] == 401
    wait(lambda: "the audit log cannot be written" in studio.server.log.read_text())
    path.rmdir()
    path.write_text(kept)
    assert studio.get("/projects", "1" * 64)[0] == 401
    # Nothing of what was recorded meanwhile is missing.
    wait(lambda: events(studio.folder).count("sign-in refused") >= 2)
    assert "the audit log is written again" in studio.server.log.read_text()


@pytest.mark.parametrize("backend", ["fast", "portable"])
def test_an_editor_asks_what_it_may(studio, backend):
    """AC8"""
    ann, eve = studio.join("ann", "editor", backend), studio.join("eve", "reviewer", backend)
    opened(ann)
    stage, layer = opened(eve)
    may = ann.may_edit("root.usda", "/World/Props", "transform")
    assert may and may.why == ""
    assert not eve.may_edit("root.usda") and not layer.permissionToEdit
    assert eve.may_edit("root.usda").why == "a reviewer may not, and no rule allows it"

    told = []
    for live in (ann, eve):
        live.add_handler(lambda event, live=live: told.append(live)
                         if isinstance(event, usdlive.events.RightsChanged) else None)
    for words in (("deny", "--user", "ann", "--path", "/World/Props/**", "--kind", "transform"),
                  ("grant", "--user", "eve", "--path", "/World/Hero")):
        assert usdlive_(words[0], studio.folder, *words[1:]).returncode == 0
    wait(lambda: ann in told and eve in told, ann, eve)
    assert told == [ann, eve] or told == [eve, ann], "who is not concerned is not told"
    may = ann.may_edit("root.usda", "/World/Props/Box.xformOp:translate", "transform")
    assert not may and may.why == "rule 1 denies transform in /World/Props/** to ann"
    assert ann.may_edit("root.usda", "/World/Props/Box", "geometry") and ann.may_edit("root.usda", "/World/Props")
    # A reviewer who may write something in a layer can.
    assert layer.permissionToEdit
    assert eve.may_edit("root.usda", "/World/Hero", "metadata") and not eve.may_edit("root.usda", "/World")
    stage.GetPrimAtPath("/World/Hero").SetDocumentation("by eve")
    assert eve.flush()
    # Nobody sees the rules about others.
    assert eve.may_edit("root.usda", "/World/Props", "transform").why == "a reviewer may not, and no rule allows it"
    ann.lock("root.usda")
    ann.flush()
    wait(lambda: not eve.may_edit("root.usda", "/World/Hero"), eve)
    assert eve.may_edit("root.usda", "/World/Hero").why == "root.usda is locked by ann"
    assert ann.may_edit("root.usda", "/World")
    for words, why in ((("root.usda", "World"), "path"), (("root.usda", "/", "colour"), "transform, geometry"),
                       (("../root.usda",), "root.usda")):
        with pytest.raises(usdlive.Error, match=why):
            ann.may_edit(*words)
    # An editor that connects later knows it at once.
    studio.be("ann")
    with usdlive.connect(studio.server.url, backend=backend) as later:
        assert not later.may_edit("root.usda", "/World/Props", "transform")


def test_refused_actions_are_recorded_with_the_rule(studio, tmp_path):
    """AC11, AU1"""
    ann = studio.join("ann", "editor")
    opened(ann)
    deny = [word for name in ("save", "reload", "lock", "upload", "createLayer", "checkpoint", "compact")
            for word in ("--action", name)]
    assert "has taken" in usdlive_("deny", studio.folder, "--user", "ann", *deny).stdout
    rule = "rule 1 denies save, reload, lock, upload, createLayer, checkpoint, compact to ann"
    wait(lambda: ann.may_do("save", "root.usda").why == rule, ann)
    texture = tmp_path / "a.png"
    texture.write_bytes(b"a")
    assert ann.save("root.usda").failed[0].message == f"ann may not save root.usda: {rule}"
    assert ann.reload("root.usda").failed[0].message == f"ann may not reload root.usda: {rule}"
    ann.lock("root.usda")
    ann.flush()
    for call in (lambda: ann.upload(texture, "a.png"), lambda: ann.create_layer("new.usda"),
                 lambda: ann.create_checkpoint("one"), lambda: ann.ask("compactHistory", days=0)):
        with pytest.raises(usdlive.Error, match=rule):
            call()
    refusals = ("save refused", "reload refused", "edits refused", "upload refused", "new layer refused",
                "checkpoint refused", "compaction refused")
    wait(lambda: set(refusals) <= set(events(studio.folder)))
    for record in audit(studio.folder):
        if record["event"] in refusals:
            assert record["user"] == "ann" and record["detail"].endswith(rule), record


def test_rules_are_changed_by_commands(studio):
    """AC6"""
    folder = studio.folder

    def run(*words: object):
        return usdlive_(words[0], folder, *words[1:])

    user("add", "ann", folder)
    assert run("deny", "--user", "ann").returncode == 0
    assert run("grant", "--user", "ann", "--path", "/World/**", "--kind", "animation", "--kind", "transform",
               "--layer", "*.usda").returncode == 0
    assert run("deny", "--role", "editor", "--role", "reviewer", "--kind", "namespace").returncode == 0
    assert run("access").stdout.splitlines() == [
        "rule 1 denies everything to ann",
        "rule 2 allows transform, animation in /World/** of *.usda to ann",
        "rule 3 denies namespace to reviewer, editor"]
    assert "rule 2" in run("access", "ann", "root.usda", "/World/Hero", "transform").stdout
    assert run("grant", "--user", "ann", "--action", "save", "--action", "takeOver").returncode == 0
    assert run("access").stdout.splitlines()[-1] == "rule 4 allows save, takeOver to ann"
    assert "yes  save  (rule 4" in run("access", "ann", "root.usda").stdout
    assert run("revoke", "4").returncode == 0
    assert run("revoke", "1").stdout.startswith("rule 1 denies everything to ann\n")
    assert "rule 1 allows transform" in run("access").stdout
    before = (folder / ".usdlive" / "access.json").read_text()
    for words, why in ((("deny", "--user", "bob"), "'bob'"), (("deny", "--role", "boss"), "boss"),
                       (("grant", "--kind", "colour"), "colour"), (("grant", "--action", "dance"), "dance"),
                       (("deny", "--action", "save", "--path", "/World"), "two rules"), (("grant", "--path", "World"), "begin with /"),
                       (("grant", "--layer", "nothing/*"), "'nothing/*'"),
                       (("grant", "--path", "/World/Nobody/**"), "'/World/Nobody/**'"),
                       (("grant", "--path", "/World/**", "--path", "/Worlds"), "'/Worlds'"), (("revoke", "3"), "no rule 3"),
                       (("revoke", "0"), "no rule 0"), (("revoke",), "NUMBER"), (("revoke", "x"), "NUMBER")):
        ran = run(*words)
        assert ran.returncode != 0 and why in ran.stderr, (words, ran.stderr)
    assert (folder / ".usdlive" / "access.json").read_text() == before
    assert run("deny", "--user", "bob", "--unchecked").returncode == 0
    (folder / ".usdlive" / "access.json").write_text("{")
    ran = run("deny", "--user", "ann")
    assert ran.returncode == 1 and "line 1" in ran.stderr
    assert (folder / ".usdlive" / "access.json").read_text() == "{"
