"""What pages may ask a campaign for, and what they are shown of it."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from rig.campaign.live_link import LiveLink, Request, Wish
from rig.campaign.manual_current import PageManualCurrent, RehearsedManualCurrent
from rig.campaign.operator_link import Signals
from rig.campaign.results import PointResult
from rig.campaign.sequencer import event as ev
from rig.errors import Stopped
from rig.recording.journal.campaign_log import CampaignLog, read_log
from rig.recording.quality.stopped_point import STOPPED_POINT
from rig.recording.quality.verdict import invalid
from rig.station.live_folder import STATION_SOCKET, bound, held, make_live_folder, read_json, received, send_message
from rig.test_point import TestPoint


@pytest.fixture
def link(tmp_path: Path) -> Iterator[LiveLink]:
    made = LiveLink(place=tmp_path)
    yield made
    made.close()


def say(link: LiveLink, **message: object) -> bool:
    return send_message(link.folder / "application.sock", message)


def test_wishes_are_taken_in_their_order_and_a_stop_before_all(link: LiveLink) -> None:
    for do in ("pause", "start", "stop"):
        assert say(link, do=do, by="Ada")
    assert link.take() == [Wish(Request.STOP, "Ada"), Wish(Request.PAUSE, "Ada"), Wish(Request.START, "Ada")]
    assert link.take() == []


@pytest.mark.parametrize("message", [{}, {"do": "reset"}, {"do": "begin"}, {"do": ["stop"]}, {"do": None}])
def test_what_is_no_wish_is_thrown_away(link: LiveLink, message: dict[str, Any]) -> None:
    assert say(link, **message)
    assert link.take() == []


def test_a_stop_is_the_operators_with_the_name_in_one_line(link: LiveLink) -> None:
    signals = Signals(live=link)
    say(link, do="stop", by="Ada\n<script>\x1b[2J" + "x" * 200)
    (abort,) = signals.take()
    assert isinstance(abort, ev.Abort)
    assert (abort.cause.slug, str(abort.stop)) == ("operator", "S2")
    assert abort.cause.detail.isprintable()
    assert "<script>" in abort.cause.detail
    assert len(abort.cause.detail) < 120


def test_a_stop_before_the_rig_is_connected_ends_the_campaign_there(link: LiveLink) -> None:
    signals = Signals(live=link)
    say(link, do="pause", by="Ada")
    signals.check()
    say(link, do="stop", by="Ada")
    with pytest.raises(Stopped, match="Stop requested on the page by Ada"):
        signals.check()
    assert [type(event) for event in signals.take()] == [ev.PauseAsked]


def test_pause_and_start_are_the_same_pause_as_ctrl_z(link: LiveLink) -> None:
    signals = Signals(live=link)
    say(link, do="start", by="Ada")
    assert signals.take() == []
    for do, expected, paused in (
        ("pause", ev.PauseAsked, True), ("pause", None, True), ("start", ev.ResumeAsked, False), ("start", None, False),
    ):
        say(link, do=do, by="Ada")
        assert [type(event) for event in signals.take()] == ([] if expected is None else [expected])
        assert (signals.paused, link.paused) == (paused, paused)


def test_a_held_campaign_begins_when_every_earlier_stop_is_confirmed(tmp_path: Path) -> None:
    link = LiveLink(held=True, place=tmp_path)
    link.confirm = ({"slug": "estop"}, {"slug": "sigint"})
    signals = Signals(live=link)
    for confirmed in ([], ["estop"], "estop sigint", None):
        say(link, do="start", by="Ada", confirmed=confirmed)
        assert signals.take() == []
        assert signals.held
    say(link, do="start", by="Ada", confirmed=["sigint", "estop"])
    assert signals.take() == [ev.Begin()]
    assert not signals.held
    link.close()


def test_a_flood_is_taken_a_few_at_a_time_and_its_stop_first_of_those(link: LiveLink) -> None:
    sent = 0
    while sent < 1000 and say(link, do="pause", by="x"):
        sent += 1
    turns = 0
    while link.take():
        turns += 1
    assert turns == -(-sent // 8)


def test_words_typed_on_the_page_are_kept_in_the_run(link: LiveLink, tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir()
    log = CampaignLog(run)
    with link.following(log):
        assert read_json(run / "live.json")["folder"] == str(link.folder)
        say(link, do="words", by="Ada", operator="Ada", specimen="MR-7 after 1e6 cycles")
        say(link, do="words", by="Ada", note="<script>alert(1)</script>\nwarm\x00")
        assert link.take() == []
    log.close()
    assert not (run / "live.json").exists()
    kept = json.loads((run / "operator.json").read_text())
    assert (kept["operator"], kept["specimen"]) == ("Ada", "MR-7 after 1e6 cycles")
    assert [note["text"] for note in kept["notes"]] == ["<script>alert(1)</script>\nwarm"]
    assert [line["event"] for line in read_log(run)] == ["operator", "operator"]
    say(link, do="words", by="Ada", note="too late")
    assert link.take() == []


def test_what_is_shown_of_a_campaign_stands_in_whole_files(link: LiveLink) -> None:
    link.display.phase("running")
    link.display.progress("p001", 3, 12.5, {})
    result = PointResult(TestPoint("p001", "sine", 0.03, 2.0, 1.0), Path("points/p001.h5"), "valid")
    link.display.point_done(replace(result, quality={
        "coil_temperature_low_degC": 23.5, "coil_temperature_high_degC": 24.0,
        "peak_force_rebound_N": 800.0, "peak_force_compression_N": -900.0,
    }))  # fmt: skip
    link.display.message("warning", "<b>")
    state = read_json(link.folder / "state.json")
    assert (state["phase"], state["point"], state["cycles"], state["time_left_s"]) == ("running", "p001", 3, 12.5)
    assert state["messages"][0]["text"] == "<b>"
    assert read_json(link.folder / "results.json")["p001"] == {
        "verdict": "valid", "reasons": [], "slugs": [], "stopped": False, "file": "p001.h5", "coil_degC": [23.5, 24.0],
        "peak_force_rebound_N": 800.0, "peak_force_compression_N": -900.0,
    }  # fmt: skip
    doubted = replace(result, verdict="suspect", reasons=("zero-return: 12 N",))
    never = PointResult(TestPoint("p002", "sine", 0.03, 2.0, 1.0), None, "not run")
    points = (doubted, never)
    ended = SimpleNamespace(points=points, valid=0, total=2, rig_state="safe", stopped_by=None, exit_code=5)
    link.display.ended(cast("Any", ended), ["done"])
    assert read_json(link.folder / "state.json")["ended"]["lines"] == ["done"]
    verdicts = {name: point["verdict"] for name, point in read_json(link.folder / "results.json").items()}
    assert verdicts == {"p001": "suspect"}, "a verdict that the end of the session changed does not stay as it was"
    stopped = replace(result, point=TestPoint("p003", "sine", 0.03, 2.0, 1.0), verdict="invalid", reasons=(
        str(invalid("ecu-silent", STOPPED_POINT)),
    ))  # fmt: skip
    link.display.point_done(stopped)
    assert read_json(link.folder / "results.json")["p003"]["stopped"]
    assert [read_json(link.folder / "state.json")[name] for name in ("valid", "suspect", "invalid")] == [0, 1, 1]


def test_a_current_set_by_hand_is_confirmed_on_the_page_for_this_question_alone(link: LiveLink) -> None:
    hand = PageManualCurrent(link, None)
    say(link, do="set", by="Ada", number=1)
    link.take()
    assert not hand.answered(), "nothing was asked"
    for number, current_A in ((1, 0.5), (2, 0.0)):
        hand.ask(current_A)
        link.display.phase("asking")
        assert read_json(link.folder / "state.json")["asked"] == {"current_A": current_A, "number": number}
        for wrong in (number - 1, number + 1, str(number), None):
            say(link, do="set", by="Ada", number=wrong)
            link.take()
            assert not hand.answered(), f"{wrong!r} is no answer to question {number}"
        say(link, do="set", by="Ada", number=number)
        link.take()
        assert hand.answered()
        assert not hand.answered(), "once"
    link.display.phase("running")
    assert read_json(link.folder / "state.json")["asked"] is None


def test_who_answers_first_of_page_and_terminal_counts(link: LiveLink) -> None:
    hand = PageManualCurrent(link, RehearsedManualCurrent())
    hand.ask(0.5)
    assert hand.answered()
    assert link.requested_A is None, "the page no longer asks"


def test_why_a_campaign_did_not_begin_stands_on_the_page(link: LiveLink) -> None:
    link.display.refused("infeasible", "p001 is too fast")
    ended = read_json(link.folder / "state.json")["ended"]
    assert (ended["refused"], ended["lines"]) == ("infeasible", ["p001 is too fast"])


def test_the_folder_goes_with_the_campaign(tmp_path: Path) -> None:
    link = LiveLink(place=tmp_path)
    link.display.phase("running")
    link.close()
    assert not link.folder.exists()


def test_the_folder_is_its_owners_alone_and_a_killed_campaigns_is_taken_away(tmp_path: Path) -> None:
    left, lock = make_live_folder(tmp_path)
    assert left.stat().st_mode & 0o777 == 0o700
    alive, _ = make_live_folder(tmp_path)
    assert left.exists()
    assert held(left / "live.lock")
    os.close(lock)  # as the end of its process does
    make_live_folder(tmp_path)
    assert not left.exists()
    assert alive.exists()


def test_a_live_folder_may_lie_deeper_than_the_kernel_takes_an_address(tmp_path: Path) -> None:
    place = tmp_path / ("deep" * 30)
    place.mkdir()
    live, lock = make_live_folder(place)
    with bound(live / STATION_SOCKET) as inbox:
        assert send_message(live / STATION_SOCKET, {"do": "stop"})
        assert received(inbox) == {"do": "stop"}
        assert (live / STATION_SOCKET).stat().st_mode & 0o777 == 0o600
    assert not send_message(place / "gone" / STATION_SOCKET, {"do": "stop"})
    os.close(lock)
