"""Rows injected around the processes: signals, dying and stalled processes, clocks, disks, a second host."""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from protocols.actuator import State
from rig.clock import monotonic_ns
from rig.recording.recovery import recover

if TYPE_CHECKING:
    from conftest import Campaign, Ending, Start

pytestmark = pytest.mark.wire

Judge = Callable[..., None]

TRUTH_ROW_BYTES = 30
TRUTH_RATE_HZ = 1000.0
FADE_S = 0.5 + 0.2
FINISH_S = 150.0
RIG = str(Path(sys.executable).with_name("rig"))
SEAMS = Path(__file__).with_name("seams")
EXAMPLES = Path(__file__).parents[2] / "examples"

MATRIX = """
format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
prior = "demo"
[matrix]
amplitude = ["20 mm"]
frequency = ["2 Hz"]
current = ["0.5 A", "1.5 A"]
cycles = 6
"""
LONG = (
    MATRIX[: MATRIX.index("[matrix]")]
    + """
[[point]]
id = "p001"
amplitude = "20 mm"
frequency = "2 Hz"
current = "0.5 A"
cycles = 4
[[point]]
id = "p002"
amplitude = "20 mm"
frequency = "2 Hz"
current = "1.5 A"
cycles = 60
"""
)


@pytest.fixture
def in_motion(start: Start) -> Callable[..., Campaign]:
    """A campaign whose second point has run for a while."""

    def begin(seconds: float = 1.6, **options: object) -> Campaign:
        campaign = start(**options)
        campaign.wait_for("START", count=2)
        run_on(campaign, seconds)
        return campaign

    return begin


def simulated_s(campaign: Campaign) -> float:
    """The simulated rig's clock, from the size of its live record."""
    return (campaign.folder / "truth.h5.part").stat().st_size / TRUTH_ROW_BYTES / TRUTH_RATE_HZ


def run_on(campaign: Campaign, seconds: float) -> None:
    """Let the simulated rig run on for so long on its clock."""
    until_s, pause = simulated_s(campaign) + seconds, threading.Event()
    while simulated_s(campaign) < until_s:
        assert campaign.process.poll() is None, campaign.process.communicate()[1]
        pause.wait(0.005)


def ended(campaign: Campaign, number: int) -> Ending:
    """Send a signal and wait for the end."""
    sent_ns = monotonic_ns()
    campaign.process.send_signal(number)
    return campaign.finish(sent_ns)


def resumed(folder: Path, *arguments: str) -> tuple[int, dict]:
    """`rig run --resume` on a campaign's directory: exit code and answer."""
    done = subprocess.run(
        [RIG, "run", "--resume", str(folder), "--json", "--no-identify", *arguments],
        capture_output=True, text=True, timeout=FINISH_S, check=False,
    )  # fmt: skip
    return done.returncode, json.loads(done.stdout)


def assert_completed(folder: Path, kept: str = "p001") -> None:
    """Resuming finishes the campaign: the finished point is not touched, all points are there once and valid."""
    file = folder / "points" / f"{kept}.h5"
    before = file.read_bytes() if file.exists() else None
    code, answer = resumed(folder)
    assert code == 0, answer
    assert [(each["id"], each["verdict"]) for each in answer["points"]] == [("p001", "valid"), ("p002", "valid")]
    assert sorted(path.name for path in (folder / "points").glob("*.h5")) == ["p001.h5", "p002.h5"]
    assert before is None or file.read_bytes() == before
    assert not list((folder / "points").glob("*.journal"))


def quiet_after(ending: Ending, stop_s: float, zero_s: float) -> None:
    """0 A within the coil's lag of its command and standstill within the fade-out of its command, and for good."""
    truth = ending.truth
    assert np.abs(truth.current_A[truth.since(zero_s + 0.25)]).max() < 0.05
    assert np.abs(truth.velocity_m_s[truth.since(stop_s + FADE_S)]).max() < 2e-3


# Signals


@pytest.mark.row("sigint", "sigint-storm")
def test_ctrl_c_stops_and_a_storm_of_further_ones_changes_nothing_and_cuts_nothing_short(
    in_motion: Callable[..., Campaign], assert_stopped: Judge
) -> None:
    campaign = in_motion()
    sent_ns = monotonic_ns()
    campaign.process.send_signal(signal.SIGINT)
    for code in ("FADE_STOP", "HYDRAULICS_OFF"):
        campaign.wait_for(code)
        for _ in range(5):
            campaign.process.send_signal(signal.SIGINT)
    assert_stopped(campaign.finish(sent_ns), "sigint")


@pytest.mark.row("sigterm")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP], ids=["sigterm", "sighup"])
def test_the_end_of_the_session_also_takes_the_pressure_away(
    in_motion: Callable[..., Campaign], assert_stopped: Judge, number: int
) -> None:
    assert_stopped(ended(in_motion(), number), "sigterm")


@pytest.mark.row("sigkill")
def test_a_killed_application_leaves_a_rig_at_rest_and_a_campaign_that_resumes(
    in_motion: Callable[..., Campaign],
) -> None:
    ending = ended(in_motion(), signal.SIGKILL)
    assert ending.exit_code == -signal.SIGKILL
    truth = ending.truth
    stop = truth.first("FADE_STOP")
    assert (stop.host_ns - ending.stopped_from_ns) / 1e9 < 5.0
    quiet_after(ending, stop.time_s, stop.time_s)
    assert truth.state[-1] == State.OFF
    recover(ending.folder)
    assert ending.point("p001").verdict == "valid"
    broken = ending.point("p002")
    assert (broken.verdict, broken.quality["recovered"]) == ("invalid", True)
    assert broken.reasons[0].startswith("INTERRUPTED")
    assert np.ptp(broken.displacement_m) > 0.035, "what was flushed before the kill is there"
    assert_completed(ending.folder)


@pytest.mark.row("sigkill")
def test_a_killed_station_leaves_controller_and_ecu_to_stop_by_themselves(in_motion: Callable[..., Campaign]) -> None:
    campaign = in_motion()
    killed_ns = monotonic_ns()
    os.kill(campaign.station_pid(), signal.SIGKILL)
    ending = campaign.finish(killed_ns)
    assert ending.exit_code == 7
    trip = next(each for each in ending.truth.all("TRIP", text="WATCHDOG") if each.host_ns > killed_ns)
    silent = ending.truth.first("ECU_FAULT", text="COMMAND_TIMEOUT")
    assert (trip.host_ns - killed_ns) / 1e9 < 5.0
    quiet_after(ending, trip.time_s, silent.time_s)
    assert (ending.point("p001").verdict, ending.point("p002").verdict) == ("valid", "invalid")
    assert_completed(ending.folder)


@pytest.mark.row("sigkill")
def test_a_killed_simulated_rig_is_a_rig_of_unknown_state_with_its_files_intact(
    in_motion: Callable[..., Campaign],
) -> None:
    campaign = in_motion()
    found = subprocess.check_output(["pgrep", "-P", str(campaign.process.pid), "-f", "simulators"], text=True)
    os.kill(int(found.split()[0]), signal.SIGKILL)
    ending = campaign.finish()
    assert ending.exit_code == 7
    assert (ending.point("p001").verdict, ending.point("p002").verdict) == ("valid", "invalid")
    assert_completed(ending.folder)
    assert (ending.folder / "truth-session1.h5.part").exists()


# Processes that stand still


@pytest.mark.row("host-stalled")
def test_an_application_that_stands_still_is_stopped_by_the_station_and_finds_it_so(
    in_motion: Callable[..., Campaign], assert_stopped: Judge
) -> None:
    campaign = in_motion(seconds=1.0, matrix=LONG)
    stalled_ns = monotonic_ns()
    campaign.process.send_signal(signal.SIGSTOP)
    campaign.wait_for("FADE_STOP")
    campaign.process.send_signal(signal.SIGCONT)
    assert_stopped(campaign.finish(stalled_ns), "host-stalled")


@pytest.mark.row("host-stalled")
def test_a_station_that_stands_still_leaves_controller_and_ecu_to_stop_by_themselves(
    in_motion: Callable[..., Campaign],
) -> None:
    campaign = in_motion(seconds=1.0, matrix=LONG)
    stalled_ns, station = monotonic_ns(), campaign.station_pid()
    os.kill(station, signal.SIGSTOP)
    campaign.wait_for("TRIP", "WATCHDOG", count=2)
    campaign.wait_for("ECU_FAULT", "COMMAND_TIMEOUT")
    os.kill(station, signal.SIGCONT)
    ending = campaign.finish(stalled_ns)
    assert ending.exit_code in {4, 7}
    trip = next(each for each in ending.truth.all("TRIP", text="WATCHDOG") if each.host_ns > stalled_ns)
    silent = ending.truth.first("ECU_FAULT", text="COMMAND_TIMEOUT")
    quiet_after(ending, trip.time_s, silent.time_s)
    assert not ending.truth.all("START", "MOVE_TO", after=trip)
    assert (ending.point("p001").verdict, ending.point("p002").verdict) == ("valid", "invalid")


# Clocks, threads and disks, by the seams


@pytest.fixture
def seam(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder in which files switch faults on in the campaign's processes."""
    folder = tmp_path / "seam"
    folder.mkdir()
    monkeypatch.setenv("RIG_TEST_SEAM", str(folder))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, (str(SEAMS), os.environ.get("PYTHONPATH", "")))))
    return folder


def switch_on(seam: Path, fault: str, amount: float = 1.0) -> int:
    """Switch a fault on; returns the host time just before (ns)."""
    now_ns = monotonic_ns()
    partial = seam / f"{fault}.tmp"
    partial.write_text(f"{amount}", encoding="utf-8")
    partial.rename(seam / fault)
    return now_ns


@pytest.mark.row("host-suspend")
def test_a_machine_that_slept_stops_and_never_continues(
    seam: Path, in_motion: Callable[..., Campaign], assert_stopped: Judge
) -> None:
    campaign = in_motion()
    assert_stopped(campaign.finish(switch_on(seam, "host-suspend", 3600.0)), "host-suspend")


@pytest.mark.row("clock-step")
@pytest.mark.parametrize("step_s", [-86400.0])
def test_a_step_of_the_wall_clock_is_logged_and_disturbs_nothing(
    seam: Path, in_motion: Callable[..., Campaign], step_s: float
) -> None:
    campaign = in_motion()
    stepped_ns = switch_on(seam, "clock-step", step_s)
    ending = campaign.finish()
    assert ending.exit_code == 0, ending.said
    said = [line for line in ending.log if line.get("slug") == "clock-step"]
    assert [line["stepped_s"] for line in said] == [pytest.approx(step_s, abs=0.5)]
    assert (said[0]["host_ns"] - stepped_ns) / 1e9 < 10.0
    assert set(ending.verdicts().values()) == {"valid"}


@pytest.mark.row("task-dies")
def test_a_thread_of_the_station_that_dies_stops_the_rig(
    seam: Path, in_motion: Callable[..., Campaign], assert_stopped: Judge
) -> None:
    campaign = in_motion()
    assert_stopped(campaign.finish(switch_on(seam, "task-dies")), "task-dies")


@pytest.mark.row("task-dies")
def test_a_finaliser_that_dies_stops_the_rig_and_its_points_are_recovered(
    in_motion: Callable[..., Campaign], assert_stopped: Judge
) -> None:
    campaign = in_motion(matrix=LONG)
    while not (campaign.folder / "points" / "p001.h5").exists():
        run_on(campaign, 0.2)
    found = subprocess.check_output(["pgrep", "-P", str(campaign.process.pid), "-f", "finaliser"], text=True)
    killed_ns = monotonic_ns()
    os.kill(int(found.split()[0]), signal.SIGKILL)
    ending = campaign.finish(killed_ns)
    assert_stopped(ending, "task-dies", broken=None)
    assert (ending.folder / "points" / "p002.journal").exists()
    assert [(each.id, each.verdict) for each in recover(ending.folder)] == [("p002", "invalid")]
    assert ending.point("p002").reasons[0].startswith("task-dies")


@pytest.mark.row("fsync-error")
def test_a_flush_that_failed_is_never_trusted(
    seam: Path, in_motion: Callable[..., Campaign], assert_stopped: Judge
) -> None:
    campaign = in_motion()
    ending = campaign.finish(switch_on(seam, "fsync-error"))
    assert_stopped(ending, "fsync-error", broken=None)
    assert_abandoned(ending, "fsync-error")


@pytest.mark.row("disk-full")
def test_a_disk_that_is_full_stops_the_rig_and_what_was_written_is_recovered(
    in_motion: Callable[..., Campaign], assert_stopped: Judge
) -> None:
    campaign = in_motion(seconds=2.0)
    full_ns = monotonic_ns()
    journal = campaign.folder / "points" / "p002.journal"
    resource.prlimit(campaign.process.pid, resource.RLIMIT_FSIZE, (1 << 16, 1 << 16))
    ending = campaign.finish(full_ns)
    assert_stopped(ending, "disk-full", broken=None)
    assert journal.exists()
    assert_abandoned(ending, "disk-full")


def assert_abandoned(ending: Ending, slug: str) -> None:
    """The running point is invalid and has no file; its journal recovers to an invalid one with samples."""
    answered = {each["id"]: each for each in ending.answer["points"]}["p002"]
    assert (answered["verdict"], answered["file"]) == ("invalid", None)
    assert answered["reasons"][0].startswith(slug)
    assert [(each.id, each.verdict, each.error) for each in recover(ending.folder)] == [("p002", "invalid", "")]
    assert np.ptp(ending.point("p002").displacement_m) > 0.03


# Refusals before anything moves

def told(*arguments: str, env: dict[str, str] | None = None) -> tuple[int, dict]:
    """A `rig run` that is expected to be refused: exit code and answer."""
    done = subprocess.run(
        [RIG, "run", *arguments, "--json"], capture_output=True, text=True, timeout=FINISH_S, check=False,
        env=os.environ | (env or {}),
    )  # fmt: skip
    return done.returncode, json.loads(done.stdout)


@pytest.mark.row("dir-readonly")
@pytest.mark.parametrize("place", ["/sys/runs", "file/runs"])
def test_a_folder_that_cannot_be_written_is_refused_before_a_rig_is_touched(tmp_path: Path, place: str) -> None:
    matrix = tmp_path / "matrix.toml"
    matrix.write_text(MATRIX, encoding="utf-8")
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    code, answer = told(str(matrix), "--simulate", "--out", str(tmp_path / place))
    assert (code, answer["slug"]) == (3, "dir-readonly")
    assert place in answer["error"]
    assert (tmp_path / "file").read_text(encoding="utf-8") == "in the way"


@pytest.mark.row("two-instances")
def test_a_second_campaign_on_a_rig_is_refused_and_the_first_goes_on(
    in_motion: Callable[..., Campaign], tmp_path: Path
) -> None:
    matrix, elsewhere = tmp_path / "second.toml", tmp_path / "elsewhere"
    matrix.write_text(MATRIX, encoding="utf-8")
    elsewhere.mkdir()
    campaign = in_motion(seconds=0.2, matrix=LONG, speed=2.0)
    shutil.copy(campaign.folder / "bench.toml", tmp_path / "bench.toml")
    second = (str(matrix), "--bench", str(tmp_path / "bench.toml"), "--out", str(tmp_path / "second"))
    code, answer = told(*second)
    assert (code, answer["slug"]) == (3, "two-instances")
    code, answer = resumed(campaign.folder)
    assert (code, answer["slug"]) == (3, "two-instances")
    ending = campaign.finish()
    assert ending.exit_code == 0, ending.said
    assert set(ending.verdicts().values()) == {"valid"}
    assert len(ending.truth.all("START")) == 2


@pytest.mark.row("matrix-changed")
def test_a_changed_matrix_or_bench_is_not_resumed_and_a_double_id_not_loaded(
    in_motion: Callable[..., Campaign], tmp_path: Path
) -> None:
    ending = ended(in_motion(), signal.SIGINT)
    matrix = ending.folder / "matrix.toml"
    text = matrix.read_text(encoding="utf-8")
    matrix.write_text(text.replace('"20 mm"', '"25 mm"'), encoding="utf-8")
    code, answer = resumed(ending.folder)
    assert (code, answer["slug"]) == (3, "matrix-changed")
    matrix.write_text(text + "# a remark changes nothing\n", encoding="utf-8")
    bench = ending.folder / "bench.toml"
    changed = bench.read_text(encoding="utf-8").replace('force = "5000 N"', 'force = "6000 N"')
    (tmp_path / "bench.toml").write_text(changed, encoding="utf-8")
    assert changed != bench.read_text(encoding="utf-8")
    code, answer = resumed(ending.folder, "--bench", str(tmp_path / "bench.toml"))
    assert (code, answer["slug"]) == (3, "bench-changed")
    assert not (ending.folder / "truth-session1.h5").exists(), "no further rig was started"
    assert_completed(ending.folder)
    double = tmp_path / "double.toml"
    point = '[[point]]\nid = "p001"\namplitude = "20 mm"\nfrequency = "2 Hz"\ncurrent = "0 A"\n'
    double.write_text(text + point, encoding="utf-8")
    code, answer = told(str(double), "--simulate", "--out", str(tmp_path / "double"))
    assert code == 2
    assert "p001" in answer["error"]
    assert not (tmp_path / "double").exists()


@pytest.mark.row("matrix-infeasible")
@pytest.mark.parametrize(
    ("change", "named"),
    [
        (('"20 mm"', '"90 mm"'), "stroke"),
        (('frequency = ["2 Hz"]', 'frequency = ["8 Hz"]'), "speed"),
        (('"1.5 A"', '"9 A"'), "current"),
    ],
    ids=["stroke", "speed", "current"],
)
def test_a_matrix_beyond_the_rig_is_refused_whole_and_names_point_and_reason(
    tmp_path: Path, change: tuple[str, str], named: str
) -> None:
    matrix = tmp_path / "matrix.toml"
    matrix.write_text(MATRIX.replace(*change), encoding="utf-8")
    bench = EXAMPLES / "demo-bench.toml"
    code, answer = told(str(matrix), "--bench", str(bench), "--out", str(tmp_path / "out"))
    assert (code, answer["slug"]) == (3, "matrix-infeasible")
    assert "p002" in answer["error"]
    assert named in answer["error"]
    assert not (tmp_path / "out").exists()


@pytest.mark.row("config-absurd")
@pytest.mark.parametrize(
    ("good", "absurd"),
    [
        ('force = "5 kN"', 'force = "5 mm"'),
        ('force = "5 kN"', 'force = "5"'),
        ('force = "5 kN"', 'force = "5000 kN"'),
        ('force = "5 kN"', 'force = "12 kN"'),
        ('speed = "0.8 m/s"', 'speed = "nan m/s"'),
        ('current = "3 A"', 'current = "-3 A"'),
        ('watchdog = "500 ms"', 'watchdog = "500 s"'),
    ],
    ids=["unit", "no-unit", "absurd", "beyond-sensor", "nan", "negative", "watchdog"],
)
def test_an_absurd_bench_is_refused_with_key_and_value_before_anything_is_connected(
    tmp_path: Path, good: str, absurd: str
) -> None:
    matrix, bench = tmp_path / "matrix.toml", tmp_path / "bench.toml"
    matrix.write_text(MATRIX, encoding="utf-8")
    text = (EXAMPLES / "demo-bench.toml").read_text(encoding="utf-8")
    assert good in text
    bench.write_text(text.replace(good, absurd), encoding="utf-8")
    code, answer = told(str(matrix), "--bench", str(bench), "--out", str(tmp_path / "out"))
    assert code == 2, "a file that cannot be used"
    key = absurd.split(" = ")[0]
    assert any(key in problem for problem in answer["problems"]), answer["problems"]
    assert not (tmp_path / "out").exists()


# The damper


@pytest.mark.row("wrong-damper")
def test_a_damper_stronger_than_its_prior_is_refused_before_the_matrix_moves(start: Start) -> None:
    ending = start("--fault", "wrong-damper").finish()
    assert (ending.exit_code, ending.answer["stopped_by"]) == (3, "wrong-damper")
    assert set(ending.verdicts().values()) == {"not run"}
    assert not list((ending.folder / "points").iterdir())
    assert not ending.truth.all("START")
    assert np.ptp(ending.truth.displacement_m) < 5e-3
    assert np.abs(ending.truth.current_A).max() < 0.05
    assert ending.truth.state[-1] == State.OFF


@pytest.mark.row("wrong-damper")
def test_another_damper_than_the_first_sessions_is_not_resumed(in_motion: Callable[..., Campaign]) -> None:
    ending = ended(in_motion(), signal.SIGINT)
    code, answer = resumed(ending.folder, "--", "--option", "damper.values.F0=-150.0")
    assert (code, answer["stopped_by"]) == (3, "wrong-damper")
    assert answer["valid"] == 1, "what was finished is kept"
    assert_completed(ending.folder)
