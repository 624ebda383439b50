"""Ends of a campaign that nothing may keep it from: a disk, a folder, a terminal, a display, another master."""

from __future__ import annotations

import errno
import fcntl
import os
import pty
import signal
import struct
import subprocess
import termios
import threading
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from end_states import assert_stopped
from matrices import LONG_SECOND_POINT, TWO_POINTS
from true_states import Truth
from watched_campaign import FINISH_S, RIG, Campaign, answer_of, resumed, wait_until

from drivers.roles import Command, State
from rig.recording.conversion.recovery import recover
from rig.recording.journal.campaign_log import read_log
from rig.station.client import StationClient

if TYPE_CHECKING:
    from conftest import BeginScenario, InMotion, Run
    from scenario_campaign import ScenarioCampaign
    from watched_campaign import Ending

RESTING = TWO_POINTS.replace("cycles = 6", 'cycles = 6\nrest = "15 s"')
"""At speed 5 there are 3 s between the points."""


def assert_ended_without_pressure(ending: Ending, slug: str) -> None:
    """Exit 4 by name within a minute; nothing started, the pressure is gone in truth."""
    assert ending.stopped_from_ns is not None
    assert (ending.truth.log[-1].host_ns - ending.stopped_from_ns) / 1e9 < 60.0
    assert ending.exit_code == 4, ending.output
    assert (ending.answer["stopped_by"], ending.answer["rig_state"]) == (slug, "safe")
    assert ending.truth.state[-1] == State.OFF
    assert len(ending.truth.all("START")) == 1
    assert ending.truth.all("HYDRAULICS_OFF", text="DONE")


def after_the_first_point(begin_scenario: BeginScenario) -> ScenarioCampaign:
    """A campaign between its two points: the first one's file is there."""
    campaign = begin_scenario(matrix=RESTING)
    campaign.wait_for("START")
    campaign.until((campaign.folder / "points" / "p001.h5").exists, "p001.h5")
    assert not campaign.happened("START", count=2)
    return campaign


@pytest.mark.nightly
def test_a_disk_that_fills_between_two_points_ends_the_campaign_with_the_pressure_off(
    begin_scenario: BeginScenario,
) -> None:
    campaign = after_the_first_point(begin_scenario)
    campaign.stage.disk.refuses = errno.ENOSPC
    ending = campaign.finish(campaign.now_ns)
    assert_ended_without_pressure(ending, "disk-full")
    assert "p002 not finished" in ending.output
    assert f"rig run --resume {ending.folder}" in ending.output
    # The journal's last line fitted only in part: what it told is not known.
    campaign.assert_completed(requalified="looked at: the disk was full, nothing else")


@pytest.mark.nightly
def test_a_folder_that_is_taken_away_ends_the_campaign_with_the_pressure_off(begin_scenario: BeginScenario) -> None:
    campaign = after_the_first_point(begin_scenario)
    points = campaign.folder / "points"
    points.rename(points.with_name("taken"))
    ending = campaign.finish(campaign.now_ns)
    points.with_name("taken").rename(points)
    assert_ended_without_pressure(ending, "dir-readonly")
    campaign.assert_completed()


@pytest.mark.nightly
def test_a_finaliser_that_dies_stops_the_rig_and_its_points_are_recovered(moving: InMotion) -> None:
    campaign = moving(matrix=LONG_SECOND_POINT)
    campaign.until((campaign.folder / "points" / "p001.h5").exists, "p001.h5")
    killed_ns = campaign.now_ns
    campaign.send(signal.SIGKILL, "rig.recording.conversion.finaliser")
    ending = campaign.finish(killed_ns)
    assert_stopped(ending, "task-dies", broken=None)
    assert (ending.folder / "points" / "p002.journal").exists()
    points = campaign.do(lambda: recover(ending.folder))
    assert [(point.id, point.verdict) for point in points] == [("p002", "invalid")]
    assert ending.point("p002").reasons[0].startswith("task-dies")


def write_stop(campaign: ScenarioCampaign, url: str, sequence: int) -> None:
    """Another Modbus client's FADE_STOP: registers 300 and 301 of device 1, as bytes."""
    host, port = url.removeprefix("modbus-tcp://").split(":")
    values = struct.pack(">2H", Command.FADE_STOP, sequence)
    pdu = struct.pack(">BBHHB", 1, 16, 300, 2, len(values)) + values
    client = campaign.stage.machine.connect((host, int(port)), timeout=5.0)
    client.sendall(struct.pack(">3H", 7, 0, len(pdu)) + pdu)
    assert client.recv(64)[7] == 16
    client.close()


@pytest.mark.few(1)
@pytest.mark.parametrize("speed", [1.0, 5.0])
def test_another_clients_stop_ends_the_campaign_and_nothing_starts_after_it(
    begin_scenario: BeginScenario, speed: float
) -> None:
    campaign = begin_scenario(speed=speed)
    campaign.move(1.2)
    bench = tomllib.loads((campaign.folder / "bench.toml").read_text(encoding="utf-8"))
    campaign.do(lambda: write_stop(campaign, bench["actuator"]["url"], 40_000))
    ending = campaign.finish()
    assert ending.exit_code == 4, ending.output
    assert (ending.answer["stopped_by"], ending.answer["rig_state"]) == ("second-master", "safe")
    assert len(ending.truth.all("START")) == 1
    assert ending.verdicts() == {"p001": "invalid", "p002": "not run"}


READS_LATE_NS = 2_000_000


@pytest.mark.few(1)
@pytest.mark.parametrize(("speed", "seconds"), [(1.0, 0.6), (5.0, 3.0)])
def test_an_application_that_was_at_rest_hears_why_the_station_stopped_before_it_makes_something_of_it(
    begin_scenario: BeginScenario, monkeypatch: pytest.MonkeyPatch, speed: float, seconds: float
) -> None:
    """On waking it sees a motion that somebody has ended, or that time is over; the reason is still in its pipe."""
    campaign = begin_scenario(speed=speed, real_time=speed == 1.0)
    take, kernel = StationClient._take, campaign.stage.kernel

    def late(client: StationClient, message: dict[str, object]) -> None:
        if message.get("event") == "trip":
            kernel.sleep_ns(READS_LATE_NS)
        take(client, message)

    monkeypatch.setattr(StationClient, "_take", late)
    campaign.move(1.2)
    campaign.send(signal.SIGSTOP)
    campaign.wait_for("FADE_STOP")
    campaign.run_on(seconds)
    campaign.send(signal.SIGCONT)
    ending = campaign.finish()
    assert (ending.exit_code, ending.answer["stopped_by"]) == (4, "host-stalled"), ending.output
    stops = [line["slug"] for line in read_log(ending.folder) if line.get("what") in {"trip", "also"}]
    assert stops == ["host-stalled"]
    assert ending.point("p001").reasons[0].startswith("host-stalled")


# On real processes


def on_a_terminal(tmp_path: Path) -> tuple[subprocess.Popen[bytes], int, Path]:
    """`rig run` in the foreground of a terminal of its own: the process, the terminal's other end, where it writes."""
    matrix, out = tmp_path / "matrix.toml", tmp_path / "out"
    matrix.write_text(LONG_SECOND_POINT, encoding="utf-8")
    out.mkdir()
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [RIG, "run", str(matrix), "--simulate", "--speed", "5", "--no-identify", "--out", str(out), "--",
         "--no-real-time"],
        stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
    )  # fmt: skip
    os.close(theirs)
    return process, ours, out


@pytest.mark.nightly
@pytest.mark.wire
def test_a_terminal_that_is_closed_stops_the_rig_and_the_exit_code_says_so(tmp_path: Path) -> None:
    process, ours, out = on_a_terminal(tmp_path)
    shown = bytearray()
    open_still = threading.Event()
    open_still.set()

    def read() -> None:
        while open_still.is_set():
            shown.extend(os.read(ours, 4096))

    threading.Thread(target=read, daemon=True).start()
    campaign = Campaign(process, out)  # type: ignore[arg-type]
    wait_until(lambda: campaign.happened("START") if any(out.iterdir()) else False, "the first point")
    campaign.run_on(0.5)
    open_still.clear()
    wait_until(lambda: not threading.active_count() or len(shown) > 0, "the display")
    os.close(ours)
    assert process.wait(FINISH_S) == 4
    folder = campaign.folder
    wait_until((folder / "truth.h5").exists, "truth.h5")
    truth = Truth.load(folder / "truth.h5")
    assert truth.state[-1] == State.OFF
    result = next(line for line in read_log(folder) if line["event"] == "result")
    assert (result["stopped_by"], result["rig_state"]) == ("sigterm", "safe")


@pytest.mark.nightly
@pytest.mark.wire
def test_a_display_that_nobody_reads_does_not_keep_the_operator_from_stopping(tmp_path: Path) -> None:
    matrix, out = tmp_path / "matrix.toml", tmp_path / "out"
    matrix.write_text(LONG_SECOND_POINT, encoding="utf-8")
    out.mkdir()
    reading, writing = os.pipe()
    fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, 4096)
    os.write(writing, bytes(4096))
    process = subprocess.Popen(
        [RIG, "run", str(matrix), "--simulate", "--speed", "5", "--no-identify", "--out", str(out), "--",
         "--no-real-time"],
        stdout=writing, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    os.close(writing)
    campaign = Campaign(process, out)  # type: ignore[arg-type]
    wait_until(lambda: campaign.happened("START") if any(out.iterdir()) else False, "the first point")
    campaign.run_on(0.5)
    process.send_signal(signal.SIGINT)
    wait_until(lambda: any(line["event"] == "result" for line in read_log(campaign.folder)), "the result")
    with os.fdopen(reading, "rb") as pipe:
        pipe.read()
    assert process.wait(FINISH_S) == 4
    truth = Truth.load(campaign.folder / "truth.h5")
    assert truth.state[-1] == State.OFF
    assert [line["slug"] for line in read_log(campaign.folder) if line.get("what") == "trip"] == ["sigint"]


@pytest.mark.nightly
@pytest.mark.wire
def test_ctrl_c_is_reported_as_what_it_is_and_how_to_go_on(in_motion: InMotion) -> None:
    campaign = in_motion()
    campaign.process.send_signal(signal.SIGINT)
    ending = campaign.finish()
    assert (
        "Stopped by operator (Ctrl-C): motion ramped down, coil at 0 A, hydraulics off. p002 not finished. "
        f"Continue with: rig run --resume {ending.folder}"
    ) in ending.output
    assert "error" not in ending.output
    assert "full cycles" not in ending.output
    assert ending.output.index("p002") < ending.output.index("ended")
    code, answer = resumed(ending.folder)
    assert code == 0, answer
    assert [stop["slug"] for stop in answer["confirmed"]] == ["sigint"]


@pytest.mark.nightly
@pytest.mark.wire
def test_after_an_e_stop_a_campaign_is_only_resumed_once_the_specimen_is_requalified(run_wired: Run) -> None:
    ending = run_wired("estop@5")
    assert ending.exit_code == 4, ending.output
    assert "--requalified" in ending.output
    code, refused = resumed(ending.folder)
    assert (code, refused["slug"]) == (3, "requalify")
    assert "estop" in refused["error"]
    assert not [line for line in read_log(ending.folder) if line["event"] == "resumed"]
    words = "joints checked, 0 A signature repeated"
    code, answer = resumed(ending.folder, "--requalified", words)
    assert code == 0, answer
    assert "estop" in [stop["slug"] for stop in answer["confirmed"]]
    assert [line["text"] for line in read_log(ending.folder) if line["event"] == "requalified"] == [words]
    assert words in (ending.folder / "campaign.json").read_text(encoding="utf-8")
    code, answer = answer_of("--resume", str(ending.folder), "--no-identify")
    assert (code, answer["confirmed"]) == (0, [])
