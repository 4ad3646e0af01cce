"""The playhead that a group shares (PS4)."""

import json

import pytest
import usdlive
from conftest import connect, wait
from portable_editors import NEWEST, OLDEST, portable, served  # noqa: F401


@pytest.fixture
def three(project, serve):
    (project / "shot.usda").write_text("#usda 1.0\n")
    server = serve(project)
    with connect(server, "ada") as ada, connect(server, "bo") as bo, connect(server, "cy") as cy:
        yield ada, bo, cy


def all_have(lives, leader, time):
    wait(lambda: all((live.playhead.leader, live.playhead.time) == (leader, time) for live in lives), *lives)


def of(user, live):
    """The presence of a user as somebody else sees it; None: there is none."""
    return next((one for one in live.presences() if one.user == user), None)


def test_one_leads_others_follow_and_anybody_takes_over(three):
    ada, bo, cy = three
    assert bo.playhead.time is None and bo.playhead.leader is None and not bo.playhead.leads
    ada.playhead.take(12)
    all_have(three, "ada", 12)
    assert ada.playhead.show(13.5)
    all_have(three, "ada", 13.5)
    assert not bo.playhead.show(99), "who does not lead changes nothing"

    bo.playhead.take(40)
    assert bo.playhead.leader == "bo"
    all_have(three, "bo", 40)
    assert not ada.playhead.leads and not ada.playhead.show(14)
    ada.playhead.release()  # does not lead
    all_have(three, "bo", 40)

    bo.playhead.release()
    all_have(three, None, None)


def test_of_two_who_take_over_at_once_one_leads(three):
    ada, bo, cy = three
    for live in three:
        assert live.playhead.leader is None
    ada.playhead.take(1)
    bo.playhead.take(2)
    wait(lambda: ada.playhead.leads != bo.playhead.leads, *three)
    winner, time = ("ada", 1) if ada.playhead.leads else ("bo", 2)
    all_have(three, winner, time)


def test_a_playhead_goes_on_between_messages_but_not_for_ever(three):
    ada, bo, _ = three
    assert bo.playhead.time is None
    ada.playhead.take(100, rate=1_000_000)
    wait(lambda: bo.playhead.time is not None and bo.playhead.time > 100, ada, bo)
    wait(lambda: bo.playhead.time == 100 + 250_000, ada, bo)
    assert ada.playhead.time == 100, "the leader knows its own time"
    ada.playhead.show(50, rate=-1_000_000)
    wait(lambda: bo.playhead.time == 50 - 250_000, ada, bo)
    ada.playhead.show(7)
    all_have((ada, bo), "ada", 7)


def test_the_presence_keeps_what_else_it_has(three):
    ada, bo, _ = three
    ada.show_presence(selection=["/World"], time=3, edit_target="shot.usda", data='{"tool": "brush"}')
    ada.playhead.take(12)
    wait(lambda: bo.playhead.time == 12, ada, bo)
    shown = of("ada", bo)
    assert (shown.selection, shown.edit_target, shown.time) == (("/World",), "shot.usda", 12)
    assert json.loads(shown.data)["tool"] == "brush"
    ada.show_presence(selection=["/World/Ball"], time=4)
    wait(lambda: of("ada", bo).selection == ("/World/Ball",), ada, bo)
    assert bo.playhead.time == 12 and ada.playhead.leads

    ada.playhead.release()
    wait(lambda: bo.playhead.time is None, ada, bo)
    assert (of("ada", bo).time, of("ada", bo).data) == (4, "")
    ada.playhead.take(5)
    ada.hide_presence()
    assert not ada.playhead.leads
    wait(lambda: bo.playhead.leader is None and of("ada", bo) is None, ada, bo)


def test_who_leaves_leads_no_longer(three):
    ada, bo, cy = three
    ada.playhead.take(12)
    all_have(three, "ada", 12)
    ada.close()
    assert ada.playhead.time is None and not ada.playhead.leads and not ada.playhead.show(13)
    ada.playhead.release()
    wait(lambda: bo.playhead.leader is None and cy.playhead.leader is None, bo, cy)
    bo.playhead.take(3)
    all_have((bo, cy), "bo", 3)


def test_a_wrong_number_or_other_data_changes_nothing(three):
    ada, bo, _ = three
    for time, rate in ((float("nan"), 0), (float("inf"), 0), (1, float("-inf")), (10 ** 400, 0), (10 ** 5000, 0)):
        with pytest.raises(usdlive.Error, match="finite"):
            ada.playhead.take(time, rate=rate)
    assert not ada.playhead.leads
    ada.show_presence(data="free text")
    with pytest.raises(usdlive.Error, match="JSON object"):
        ada.playhead.take(1)
    assert not ada.playhead.leads and ada.playhead.leader is None
    ada.show_presence()
    ada.playhead.take(1)
    with pytest.raises(usdlive.Error, match="Release the playhead"):
        ada.show_presence(data="[1]")
    assert ada.playhead.show(2)
    all_have((ada, bo), "ada", 2)


ODD = ["", "no JSON", "[]", "3", "null", '{"playhead": 3}', '{"playhead": {}}',
       '{"playhead": {"claim": true, "key": "k", "rate": 0}}', '{"playhead": {"claim": 0, "key": "k", "rate": 0}}',
       '{"playhead": {"claim": 1e400, "key": "k", "rate": 0}}', '{"playhead": {"claim": 9007199254740993, "key": "k", "rate": 0}}',
       '{"playhead": {"claim": 1, "key": 2, "rate": 0}}', '{"playhead": {"claim": 1, "key": "k", "rate": NaN}}',
       '{"playhead": {"claim": 1, "key": "k", "rate": "0"}}', '{"playhead": {"claim": 1, "key": "k", "rate": 1' + "0" * 400 + "}}",
       "[" * 50_000]


def test_odd_data_of_others_leads_nobody(three):
    ada, bo, cy = three
    assert bo.playhead.leader is None
    for number, data in enumerate(ODD):
        ada.show_presence(selection=[f"/P{number}"], time=1, data=data)
        wait(lambda number=number: getattr(of("ada", bo), "selection", None) == (f"/P{number}",), ada, bo)
        assert bo.playhead.leader is None, data
    ada.show_presence(time=1, data=json.dumps({"playhead": {"claim": 1 << 53, "key": "k", "rate": 0}}))
    wait(lambda: bo.playhead.leader == "ada", ada, bo)
    bo.playhead.take(2)  # the same claim, because there is no higher one
    assert bo.playhead.leader == "ada" and not bo.playhead.leads, "bo's key is a hexadecimal number, and that of ada is greater"


@pytest.mark.parametrize("version", [OLDEST, NEWEST])
def test_the_portable_backend_has_it_too(version, served, portable):
    server = served()
    editor = portable(server, version, "ada", "portable")
    with connect(server, "bo") as bo:
        assert bo.playhead.time is None
        editor.run("live.playhead.take(12)")
        wait(lambda: editor.run("result = live.tick()") is not None and bo.playhead.time == 12, bo)
        assert bo.playhead.leader == "ada"
        bo.playhead.take(3)
        wait(lambda: editor.run("live.tick(); result = [live.playhead.leads, live.playhead.time]") == [False, 3], bo)
