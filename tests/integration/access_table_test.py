"""The table of roles, kinds of opinion and actions, by a real server (AC3, AC6, AC7, AC11). For each kind and action there
is a rule that denies it and one that allows it: the server refuses exactly this, and a client says so without asking."""

from __future__ import annotations

import itertools
import json
import time

import pytest
import usdlive
from conftest import wait
from pxr import Gf, Sdf, Tf
from studio import Studio, usdlive_  # noqa: F401

ROOT = """#usda 1.0

def Xform "World"
{
    def Cube "Box" (
        variants = {
            string look = "red"
        }
        prepend variantSets = "look"
    )
    {
        double size = 1
        double note = 1
        color3f inputs:color = (1, 0, 0)
        double3 xformOp:translate = (0, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        variantSet "look" = {
            "blue" {
            }
            "red" {
            }
        }
    }
}
"""
ROLES = ["viewer", "reviewer", "editor", "admin"]
BOX = Sdf.Path("/World/Box")
counter = itertools.count(2)


def set_default(name, value):
    return lambda layer: setattr(layer.GetAttributeAtPath(BOX.AppendProperty(name)), "default", value(float(next(counter))))


def define(layer):
    prim = Sdf.CreatePrimInLayer(layer, f"/World/New{next(counter)}")
    prim.specifier = Sdf.SpecifierDef


def refer(layer):
    layer.GetPrimAtPath(BOX).referenceList.Prepend(Sdf.Reference(primPath=f"/World/R{next(counter)}"))


KINDS = {
    "transform": set_default("xformOp:translate", lambda n: Gf.Vec3d(n)),
    "geometry": set_default("size", float),
    "shading": set_default("inputs:color", lambda n: Gf.Vec3f(n)),
    "property": set_default("note", float),
    "animation": lambda layer: layer.SetTimeSample(BOX.AppendProperty("size"), 1.0, float(next(counter))),
    "variants": lambda layer: layer.GetPrimAtPath(BOX).variantSelections.update({"look": f"red{next(counter)}"}),
    "composition": refer,
    "schema": lambda layer: setattr(layer.GetPrimAtPath(BOX), "typeName", f"Cube{next(counter)}"),
    "metadata": lambda layer: setattr(layer.GetPrimAtPath(BOX), "comment", str(next(counter))),
    "namespace": define,
}


class Lost(Exception):
    """Work that came back."""


def flushed(live) -> None:
    """Sends what was written. Raises Lost if the server has refused it. (Events of lost work come once in a second.)"""
    before = live.revision
    assert live.flush()
    if live.revision == before:
        raise Lost


def failed(outcome) -> None:
    if outcome.failed:
        raise Lost(f"{outcome.failed[0].code}: {outcome.failed[0].message}")


def locked(live) -> None:
    live.lock("root.usda")
    flushed(live)
    live.unlock("root.usda")
    flushed(live)


def taken_over(live) -> None:
    live.unlock("locked.usda")
    flushed(live)


def muted(live) -> None:
    live.mute("root.usda", "set.usda")
    flushed(live)
    live.unmute("root.usda", "set.usda")
    flushed(live)


@pytest.fixture
def table(serve, tmp_path, monkeypatch, request):
    """The users have the fast backend, or that of the parameter."""
    folder = tmp_path / "shots"
    folder.mkdir()
    (folder / "root.usda").write_text(ROOT)
    for name in ("set.usda", "locked.usda"):
        (folder / name).write_text("#usda 1.0\n")
    made = Table(Studio(folder, serve, tmp_path, monkeypatch), tmp_path, getattr(request, "param", None))
    yield made
    for live in made.lives.values():
        live.close(timeout=0)


class Table:
    def __init__(self, studio, tmp_path, backend):
        self.studio, self.why = studio, ""
        self.lives = {role: studio.join(f"a-{role}", role, backend) for role in ROLES}
        for live in self.lives.values():
            for name in ("root.usda", "set.usda", "locked.usda"):
                live.open_layer(name)
        texture = tmp_path / "a.png"
        texture.write_bytes(b"a texture")
        self.actions = {
            "save": lambda live: failed(live.save("root.usda")),
            "reload": lambda live: failed(live.reload("root.usda")),
            "lock": locked,
            "takeOver": taken_over,
            "mute": muted,
            "upload": lambda live: live.upload(texture, f"tex/{next(counter)}.png"),
            "createLayer": lambda live: live.create_layer(f"new{next(counter)}.usda"),
            "checkpoint": lambda live: live.create_checkpoint(f"c{next(counter)}"),
            "compact": lambda live: live.ask("compactHistory", days=1_000)}

    def rule(self, *rules) -> None:
        """Sets the rules, and waits until the clients know them."""
        path = self.studio.folder / ".usdlive" / "access.json"
        before = self.studio.server.log.read_text().count("access rules changed")
        path.write_text(json.dumps({"format": 1, "rules": list(rules)}))
        wait(lambda: self.studio.server.log.read_text().count("access rules changed") > before, *self.lives.values())
        for live in self.lives.values():  # the rules come before an answer that was asked for later
            live.ask("listCheckpoints")
            live.tick()

    def refuses(self, role: str, what: str) -> bool:
        """Lets a user do something. Returns whether they were refused; `why` is the reason of a request."""
        live, chief, self.why = self.lives[role], self.lives["admin"], ""
        if what == "takeOver":
            chief.lock("locked.usda")
            assert chief.flush()
            wait(lambda: "locked.usda" in live.layer_states() and live.layer_states()["locked.usda"].locked, live)
        wait(lambda: live.revision >= max(one.revision for one in self.lives.values()), live)
        try:
            if what in KINDS:
                KINDS[what](live.opened_layer("root.usda"))
                flushed(live)
            else:
                self.actions[what](live)
        except (usdlive.Error, Tf.ErrorException, Lost) as error:
            self.why = str(error)
            return True
        return False

    def is_refused_by(self, role: str, what: str, rule: str) -> bool:
        """Lets a user do what is refused until the reason names the rule. One event stands for all refusals of a second."""
        live, happened = self.lives[role], []
        live.add_handler(happened.append)
        end = time.monotonic() + 5
        named = False
        while not named and time.monotonic() < end:
            assert self.refuses(role, what)
            reasons = [self.why, *(event.message for event in happened if isinstance(event, usdlive.events.Lost))]
            named = any(rule in reason for reason in reasons)
            time.sleep(0.05)
        live.remove_handler(happened.append)
        return named

    def says(self, role: str, what: str) -> bool:
        live = self.lives[role]
        if what in KINDS:
            return bool(live.may_edit("root.usda", str(BOX), what))
        place = {"checkpoint": None, "compact": None, "upload": "tex/a.png", "createLayer": "new.usda",
                 "takeOver": "locked.usda"}.get(what, "root.usda")
        return bool(live.may_do(what, place))


# The least role that may do it.
LEAST = {**dict.fromkeys(KINDS, "editor"), "save": "editor", "reload": "editor", "lock": "editor", "takeOver": "admin",
         "mute": "editor", "upload": "editor", "createLayer": "editor", "checkpoint": "reviewer", "compact": "admin"}


@pytest.mark.parametrize("table", ["fast", "portable"], indirect=True)
def test_a_role_by_itself(table):
    """AC3"""
    for role, what in itertools.product(ROLES, LEAST):
        if what == "upload" and not hasattr(table.lives[role], "upload"):
            continue
        may = ROLES.index(role) >= ROLES.index(LEAST[what])
        assert table.refuses(role, what) != may, (role, what, table.why)
        assert table.says(role, what) == may, (role, what)


def refused_to(table, role: str, rule: str) -> set[str]:
    """Lets a user do everything. Returns what was refused."""
    refused = {what for what in LEAST if table.refuses(role, what)}
    assert refused == {what for what in LEAST if not table.says(role, what)}, (role, rule)
    return refused


def test_a_rule_about_one_thing(table):
    """AC6, AC7, AC11: a rule takes exactly this from an editor, and gives exactly this to a viewer."""
    for_admins = {what for what, least in LEAST.items() if least == "admin"}
    for what in LEAST:
        member = {"kinds" if what in KINDS else "actions": [what]}
        table.rule({"effect": "deny", "users": ["a-editor"], **member}, {"effect": "allow", "users": ["a-viewer"], **member})
        concerned = {"metadata", "lock", "mute"} if what == "metadata" else {what}
        assert refused_to(table, "editor", what) == concerned | for_admins, what
        assert what == "takeOver" or table.is_refused_by("editor", what, f"rule 1 denies {what} to a-editor")
        assert refused_to(table, "viewer", what) == set(LEAST) - concerned, what


def test_a_rule_about_everything(table):
    """AC11: who is denied everything does nothing; what administrators do is given by name only."""
    table.rule({"effect": "deny", "users": ["a-editor"]}, {"effect": "allow", "users": ["a-viewer"]},
               {"effect": "allow", "users": ["a-reviewer"], "layers": ["root.usda"]}, {"effect": "deny", "roles": ["admin"]})
    assert refused_to(table, "editor", "deny") == set(LEAST)
    assert refused_to(table, "viewer", "allow") == {"takeOver", "compact"}
    assert refused_to(table, "reviewer", "allow a layer") == {"takeOver", "compact", "upload", "createLayer"}
    assert not refused_to(table, "admin", "deny")
