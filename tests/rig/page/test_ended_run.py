"""What the page shows of a run that has ended: from its files, whatever they say."""

from __future__ import annotations

import json
import os
import shutil
import struct
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from rig.page.ended_run import EndedRun, recorded_frame
from rig.page.watched_run import WatchedRun
from rig.station.live_folder import replace_json

FIRST_VERSION = Path(__file__).parents[1] / "recording" / "first_version.h5"
RESULT = {
    "event": "result", "valid": 1, "total": 2, "rig_state": "safe", "stopped_by": "operator", "detail": "Ctrl-C",
    "points": [
        {
            "id": "p001", "file": "/elsewhere/points/p001.h5", "verdict": "valid", "reasons": [],
            "peak_force_rebound_N": 800.0, "peak_force_compression_N": -900.0,
            "quality": {"coil_temperature_low_degC": 23.5, "coil_temperature_high_degC": 24.5},
        },
        {"id": "p002", "file": None, "verdict": "not run", "reasons": []},
    ],
}  # fmt: skip


def journal(run: Path, *events: dict[str, Any]) -> EndedRun:
    (run / "points").mkdir(exist_ok=True)
    (run / "journal.jsonl").write_text("".join(json.dumps(event) + "\n" for event in events))
    return EndedRun(run)


def test_the_last_result_says_how_it_ended_however_long_the_journal(tmp_path: Path) -> None:
    filling = [{"event": "station", "what": "late", "text": "x" * 1000}] * 1500
    ended = journal(tmp_path, *filling, RESULT)
    assert (ended.result["valid"], ended.result["stopped_by"], ended.result["lines"]) == (1, "operator", ["Ctrl-C"])
    assert {name: point["verdict"] for name, point in ended.points.items()} == {"p001": "valid", "p002": "not run"}


def test_a_session_that_says_nothing_at_its_end_is_cut_off_whatever_the_one_before_reported(tmp_path: Path) -> None:
    again = {"event": "judged", "id": "p002", "file": "p002.h5", "verdict": "suspect", "reasons": ["skew"]}
    worse = {"event": "judged", "id": "p001", "file": "p001-2.h5", "verdict": "invalid", "reasons": []}
    ended = journal(tmp_path, RESULT, {"event": "connected"}, again, worse)
    assert ended.result["cut_off"] is True
    assert {name: point["verdict"] for name, point in ended.points.items()} == {"p001": "valid", "p002": "suspect"}
    state = WatchedRun(tmp_path).state()
    assert (state["running"], state["ended"]) == (False, {"cut_off": True})


def test_of_a_run_cut_off_a_point_is_shown_by_its_file_and_not_by_a_later_attempt_without_one(tmp_path: Path) -> None:
    recorded = {"event": "judged", "id": "p001", "file": "/r/points/p001.h5", "verdict": "invalid", "reasons": ["a"]}
    ended = journal(tmp_path, recorded, {**recorded, "file": None, "reasons": ["b"]})
    assert [point["file"] for point in ended.result["points"]] == ["/r/points/p001.h5"]
    ended = journal(tmp_path, recorded, {**recorded, "file": "/r/points/p001-attempt2.h5"})
    assert [point["file"] for point in ended.result["points"]] == ["/r/points/p001-attempt2.h5"]


@pytest.mark.parametrize("text", ["", "[]\nnull\n{\n", '{"event": "result", "points": null}\n'])
def test_a_journal_that_says_little_is_no_reason_to_fail(tmp_path: Path, text: str) -> None:
    (tmp_path / "journal.jsonl").write_text(text)
    assert EndedRun(tmp_path).points == {}
    assert EndedRun(tmp_path).file_of("p001") is None


@pytest.mark.parametrize("odd", [
    {"peak_force_rebound_N": 10**400}, {"file": "a" * 300}, {"file": "\0"},
    {"quality": {"coil_temperature_low_degC": 10**400, "coil_temperature_high_degC": 1}},
])  # fmt: skip
def test_values_that_no_run_writes_do_not_end_the_page(tmp_path: Path, odd: dict[str, Any]) -> None:
    ended = journal(tmp_path, {**RESULT, "points": [{"id": "p001", "verdict": "valid", **odd}]})
    point = ended.points["p001"]
    assert (point["verdict"], point["file"], point["peak_force_rebound_N"]) == ("valid", False, None)
    (tmp_path / "station.json").write_text('{"auxiliary": 3}')
    assert WatchedRun(tmp_path).description()["devices"] == []


def test_a_journal_without_line_ends_is_read_in_pieces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rig.page.ended_run.JSON_LIMIT_BYTES", 4000)
    monkeypatch.setattr("rig.page.watched_run.JSON_LIMIT_BYTES", 4000)
    ended = journal(tmp_path, {"filling": "x" * 20_000}, RESULT)
    assert ended.result["valid"] == 1
    monkeypatch.setattr("rig.page.ended_run.MOST_READ_BYTES", 10_000)
    with (tmp_path / "journal.jsonl").open("a") as file:
        file.write("\0" * 10_000)
    watched = WatchedRun(tmp_path)
    assert (watched.state()["ended"], [event["text"] for event in watched.news()]) == ({"cut_off": True}, ["Ctrl-C"])
    with (tmp_path / "journal.jsonl").open("a") as file:
        file.write(json.dumps({"event": "warning", "text": "later"}) + "\n")
    assert [event["text"] for event in watched.news()] == ["later"], "what was no line is not kept"


def test_loops_are_those_of_the_file_in_the_runs_own_folder(tmp_path: Path) -> None:
    ended = journal(tmp_path, RESULT)
    assert ended.points["p001"]["file"] is False
    assert ended.file_of("p001") is None
    shutil.copy(FIRST_VERSION, tmp_path / "points" / "p001.h5")
    shown = EndedRun(tmp_path).points
    assert (shown["p001"]["file"], shown["p001"]["coil_degC"], shown["p002"]["coil_degC"]) == (True, [23.5, 24.5], None)
    assert [shown["p001"][f"peak_force_{way}_N"] for way in ("rebound", "compression")] == [800.0, -900.0]
    path = ended.file_of("p001")
    assert path is not None
    frame = recorded_frame(path)
    assert frame is not None
    kind, blocks, base_s, end_s = struct.unpack_from("<IIdd", frame)
    place, series = 24, {}
    for _ in range(blocks):
        channel, _, count = struct.unpack_from("<HHI", frame, place)
        series[channel] = np.frombuffer(frame, "<f4", 2 * count, place + 8).reshape(2, count)
        place += 8 + 8 * count
    assert (kind, place) == (2, len(frame))
    with h5py.File(FIRST_VERSION) as file:
        data = {name: np.float64(file["entry/data"][name][:]) for name in ("time", "force", "displacement")}
    assert end_s == data["time"][-1]
    at = np.searchsorted(data["time"], base_s + np.float64(series[203][0]) - 1e-4)
    assert len(at) > 50
    assert np.array_equal(series[203][1], np.float32(data["force"][at]))
    assert np.array_equal(series[201][1], np.float32(data["displacement"][at]))


def test_an_imported_run_has_no_journal_and_is_shown_by_its_files(tmp_path: Path) -> None:
    (tmp_path / "points").mkdir()
    shutil.copy(FIRST_VERSION, tmp_path / "points" / "p001.h5")
    (tmp_path / "campaign.json").write_text(json.dumps({"id": tmp_path.name, "imported": True, "specimen": "A"}))
    shown = WatchedRun(tmp_path)
    ended = shown.state()["ended"]
    assert (ended["imported"], ended["valid"], ended["total"]) == (True, 1, 1)
    point = shown.description()["points"][0]
    assert (point["waveform"], point["amplitude_m"], point["file"]) == ("sine", 0.05, "p001.h5")
    result = shown.results()["points"][point["id"]]
    assert result["file"] is True
    assert result["peak_force_compression_N"] < result["peak_force_rebound_N"]
    (tmp_path / "points" / "p001.h5").write_bytes(b"no HDF5")
    assert WatchedRun(tmp_path).results()["points"] == {}


def test_units_and_signs_of_the_page_are_those_of_display(tmp_path: Path) -> None:
    (tmp_path / "matrix.toml").write_text('[display]\nforce = "lbf"\npositive = "compression"\n')
    display = WatchedRun(tmp_path).description()["display"]
    assert (display["force"]["unit"], display["force"]["sign"], display["temperature"]["sign"]) == ("lbf", -1, 1)
    assert 445.0 / display["force"]["scale"] == pytest.approx(100.04, abs=0.01)


def test_the_points_of_an_ended_run_are_described_in_the_units_of_display(tmp_path: Path) -> None:
    (tmp_path / "matrix.toml").write_text('[display]\ndisplacement = "in"\n')
    point = {"id": "p001", "verdict": "valid", "described": "sine 25.4 mm 2 Hz 0.5 A", "amplitude_m": 0.0254}
    journal(tmp_path, {**RESULT, "points": [point]})
    assert WatchedRun(tmp_path).description()["points"][0]["described"] == "sine 1 in 2 Hz 0.5 A"


def test_a_damaged_file_and_an_unknown_point_show_nothing(tmp_path: Path) -> None:
    ended = journal(tmp_path, RESULT)
    path = tmp_path / "points" / "p001.h5"
    path.write_bytes(FIRST_VERSION.read_bytes()[:3000])
    assert ended.file_of("p001") == path
    assert recorded_frame(path) is None
    assert ended.file_of("../../etc/passwd") is None


def test_a_page_of_a_run_that_is_resumed_twice_follows_it_each_time(tmp_path: Path) -> None:
    from rig.campaign.live_link import LiveLink
    from rig.recording.journal.campaign_log import CampaignLog

    run = tmp_path / "run"
    run.mkdir()
    journal(run, RESULT)
    watched = WatchedRun(run)
    assert watched.state()["ended"]["stopped_by"] == "operator"
    for session in range(2):
        link = LiveLink(place=tmp_path)
        log = CampaignLog(run)
        with link.following(log):
            link.display.phase(f"session {session}")
            assert watched.began_or_ended(watched.live_folder)
            assert not watched.began_or_ended(watched.live_folder)
            assert (watched.state()["running"], watched.state()["phase"]) == (True, f"session {session}")
        log.close()
        link.close()
        assert watched.state()["running"] is False


def test_the_note_the_trip_and_the_result_of_a_stop_are_one_event_in_either_order(tmp_path: Path) -> None:
    note = {"event": "info", "text": "stopped by operator (Ctrl-C): 0 A", "stop": "operator"}
    trip: dict[str, object] = {"event": "station", "what": "trip"}
    trip |= {"slug": "operator", "detail": "Ctrl-C"}
    said = {"event": "operator", "what": "said", "by": "Ada", "note": "Ctrl-C"}
    for first, second in ((note, trip), (trip, note)):
        journal(tmp_path, first)
        watched = WatchedRun(tmp_path)
        (alone,) = watched.news()
        with (tmp_path / "journal.jsonl").open("a") as file:
            for event in (second, said, RESULT, first, second):
                file.write(json.dumps(event) + "\n")
        stop, words, again = watched.news()
        assert (stop["slug"], stop["level"], stop["text"]) == ("operator", "error", note["text"])
        assert (stop["instead_of"], again["instead_of"]) == (alone["number"], again["number"] - 1)
        assert (words["by"], again["text"]) == ("Ada", note["text"])
        assert [event["text"] for event in watched.events] == [note["text"], "Ctrl-C", note["text"]]


def test_a_run_is_called_simulated_where_its_files_say_so_and_the_entered_specimen_is_told(tmp_path: Path) -> None:
    from rig.campaign.live_link import LiveLink

    run = tmp_path / "run"
    run.mkdir()
    assert WatchedRun(run).description()["simulated"] is False
    replace_json(run / "operator.json", {"specimen": "fluid lot 7"})
    link = LiveLink(place=tmp_path)
    try:
        watched = WatchedRun(run, link.folder)
        assert watched.description()["simulated"] is False
        link.belongs_to(tmp_path, ["tcp://rig"])
        assert watched.description()["simulated"] is False
        link.belongs_to(tmp_path, [])
        assert watched.description()["simulated"] is True
        link.display.phase("running")
        assert watched.state()["entered"] == "fluid lot 7"
    finally:
        link.close()
    replace_json(run / "campaign.json", {"simulated": {"seed": 0}})
    assert WatchedRun(run).description()["simulated"] is True


def test_a_ring_is_shown_only_while_its_campaign_lives(tmp_path: Path) -> None:
    journal(tmp_path, RESULT)
    replace_json(tmp_path / "station.json", {"ring_path": str(tmp_path / "gone.ring")})
    assert WatchedRun(tmp_path).ring() is None


def test_a_session_that_was_refused_states_why_and_keeps_the_points_of_those_before(tmp_path: Path) -> None:
    refused = {"event": "refused", "slug": "unreachable", "text": "load_cell: no such port"}
    ended = journal(tmp_path, RESULT, refused)
    assert (ended.result["refused"], ended.result["lines"]) == ("unreachable", ["load_cell: no such port"])
    assert ended.points["p001"]["verdict"] == "valid"
    at_connect = {**RESULT, "stopped_by": "unreachable"}
    assert journal(tmp_path, refused, at_connect).result["refused"] == "unreachable"
    assert "refused" not in journal(tmp_path, refused, {"event": "connected"}, RESULT).result
    stopped = journal(tmp_path, {**refused, "slug": "sigint"}).result
    assert (stopped["stopped_by"], "refused" in stopped) == ("sigint", False)


def test_the_trials_of_an_iterated_signal_are_those_of_the_newest_file_whatever_else_is_there(tmp_path: Path) -> None:
    assert WatchedRun(tmp_path).trials() is None
    (tmp_path / "drives").mkdir()
    (tmp_path / "drives" / "p002.h5").write_bytes(b"no HDF5")
    assert WatchedRun(tmp_path).trials() is None
    with h5py.File(tmp_path / "drives" / "p001.h5", "w") as file:
        file.attrs.update({
            "point": "p001", "record": "road", "follows": "displacement", "outcome": "", "reason": "",
            "start": "target", "tolerance": 0.02, "least_coherence": 0.8, "step_s": 0.001,
        })
        file["error"], file["delay"] = [0.2], [0.0]
        file["target"], file["measured"] = np.zeros(5), np.ones((1, 5))
        file["response/frequency"], file["response/coherence"] = [1.0, 2.0], [0.9, np.nan]
    os.utime(tmp_path / "drives" / "p002.h5", (0, 0))
    trials = WatchedRun(tmp_path).trials()
    assert trials is not None
    assert (trials["point"], trials["errors"], trials["coherence"]) == ("p001", [0.2], [0.9, None])
