"""What has to be said before a campaign is resumed: by the fault matrix's classes, from the journal."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from rig.campaign.confirmation import confirm, confirm_all, open_stops, resume_class, resume_command, unconfirmed
from rig.errors import EXIT_REFUSED, Refused
from rig.faults.matrix import MATRIX


def trip(slug: str, what: str = "trip", stop: str = "S2") -> dict[str, Any]:
    return {"event": "station", "what": what, "slug": slug, "stop": stop, "detail": f"{slug} seen", "utc": "2026-01-02"}


def slugs(*lines: dict[str, Any]) -> list[str]:
    return [stop.slug for stop in unconfirmed(lines)]


REQUALIFY = sorted(slug for slug, row in MATRIX.items() if row.resume == "n")


def test_the_matrix_decides_what_needs_a_requalification() -> None:
    grave = {"estop", "coil-open-short", "current-stuck", "stop-ignored", "load-train", "actuator-reboot"}
    assert grave <= set(REQUALIFY)
    assert {resume_class(slug) for slug in REQUALIFY} == {"n"}
    assert resume_class("stroke-limit") == "c"


@pytest.mark.parametrize("slug", REQUALIFY)
@pytest.mark.parametrize("what", ["trip", "also"])
def test_a_grave_stop_is_refused_without_words_and_accepted_with_them(slug: str, what: str) -> None:
    stops = unconfirmed([trip("sigint"), trip(slug, what)])
    with pytest.raises(Refused, match=f"(?s){slug} .*--requalified") as caught:
        confirm(stops, "")
    assert (caught.value.slug, caught.value.exit_code) == ("requalify", EXIT_REFUSED)
    confirm(stops, "coil replaced")


@pytest.mark.parametrize("slug", sorted(slug for slug, row in MATRIX.items() if row.resume == "c"))
def test_resuming_confirms_every_other_stop_and_says_what_to_look_at(slug: str) -> None:
    stops = unconfirmed([trip(slug)])
    confirm(stops, "")
    (stop,) = stops
    assert f"{slug} (S2, 2026-01-02): {slug} seen; inspect {stop.look_at}" in stop.text
    assert len(stop.look_at) > 10


def test_what_was_confirmed_once_is_not_requested_again_but_a_later_stop_is() -> None:
    begun = {"event": "resumed"}
    assert slugs(trip("sigint"), begun) == []
    assert slugs(trip("estop"), begun) == ["estop"], "resuming alone requalifies nothing"
    assert slugs(trip("estop"), {"event": "requalified", "text": "x"}, begun) == []
    assert slugs(trip("estop"), {"event": "requalified"}, begun, trip("estop")) == ["estop"]


def test_a_stop_before_arming_is_known_by_the_result() -> None:
    assert slugs({"event": "result", "stopped_by": "sigint", "detail": "Ctrl-C"}) == ["sigint"]
    assert slugs({"event": "result", "stopped_by": None}) == []


def test_an_empty_or_torn_journal_confirms_nothing(tmp_path: Path) -> None:
    assert open_stops(tmp_path) == ()
    (tmp_path / "journal.jsonl").write_text(json.dumps(trip("estop")) + "\n{\"event\": \"requal", encoding="utf-8")
    assert [stop.slug for stop in open_stops(tmp_path)] == ["estop", "journal-damaged"]


@pytest.mark.parametrize("damaged", [b"\0" * 80, b'{"utc": "2026', b"[1]", b"{}", b"\xff\xfe", b"[" * 100_000])
def test_a_line_that_cannot_be_read_may_have_been_an_estop_until_somebody_has_requalified(
    tmp_path: Path, damaged: bytes
) -> None:
    journal = tmp_path / "journal.jsonl"
    ended, resumed = (json.dumps(line).encode() for line in (trip("sigint"), {"event": "resumed"}))
    journal.write_bytes(ended + b"\n" + damaged + b"\n\n" + resumed + b"\n")
    with pytest.raises(Refused, match=r"line 2 of journal\.jsonl cannot be read") as caught:
        confirm(open_stops(tmp_path), "")
    assert caught.value.slug == "requalify"
    confirm(open_stops(tmp_path), "rig looked at")
    with journal.open("ab") as file:
        file.write(b'{"event": "requalified"}\n' + resumed + b"\n")
    assert open_stops(tmp_path) == ()


def test_a_journal_that_is_gone_may_have_reported_of_an_estop(tmp_path: Path) -> None:
    (tmp_path / "points").mkdir()
    assert open_stops(tmp_path) == ()
    (tmp_path / "points" / "p001.h5").touch()
    for left in (None, "", json.dumps({"event": "phase", "phase": "connecting"}) + "\n"):
        if left is not None:
            (tmp_path / "journal.jsonl").write_text(left, encoding="utf-8")
        with pytest.raises(Refused, match=r"journal\.jsonl is missing or truncated"):
            confirm(open_stops(tmp_path), "")
    (tmp_path / "journal.jsonl").write_text(json.dumps({"event": "connected"}) + "\n", encoding="utf-8")
    assert open_stops(tmp_path) == ()


def test_the_command_to_go_on_can_be_pasted_into_a_shell() -> None:
    assert resume_command(Path("logs/a b")) == "rig run --resume 'logs/a b'"
    assert resume_command(Path("logs/a"), "n").startswith("rig run --resume logs/a --requalified ")


def test_a_stop_that_the_operator_was_not_shown_is_confirmed_by_nobody() -> None:
    stops = unconfirmed([trip("sigint"), trip("stroke-limit", "also")])
    confirm_all(stops, None)
    confirm_all(stops, frozenset({"sigint", "stroke-limit", "earlier"}))
    for confirmed in (frozenset({"sigint"}), frozenset[str]()):
        with pytest.raises(Refused, match="stroke-limit seen") as caught:
            confirm_all(stops, confirmed)
        assert (caught.value.slug, caught.value.exit_code) == ("stops-changed", EXIT_REFUSED)
