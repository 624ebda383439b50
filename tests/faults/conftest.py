"""The fault suite's frame: `rig run` as a user starts it, one fault, and what must then be true in truth and files.

A test of a row is marked `row("slug")` and named in `rig.fault_matrix`; `test_matrix.py` compares the two.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

from protocols.actuator import State
from rig.clock import monotonic_ns
from rig.fault_matrix import MATRIX
from rig.recording.campaign_log import read_log
from rig.recording.run import RecordedPoint

RIG = str(Path(sys.executable).with_name("rig"))
FINISH_S = 150.0
COIL_LAG_S = 0.250
NO_CURRENT_A = 0.05
STILL_M_S = 2e-3
STOP_COMMANDS = ("FADE_STOP", "HALT", "HYDRAULICS_OFF")
OWN_STOPS = ("TRIP",)
"""The controller stops by itself, where no command reaches it."""
SETTLING_S = {"S2": 0.200, "S1": 0.200, "SO": 0.300}
EXIT_CODES = {"S2": 4, "S1": 4, "SO": 4, "R": 3, "P": 5, "W": 0}

TWO_POINTS = """
format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
mid_stroke = "0 mm"
prior = "demo"
[matrix]
waveform = ["sine"]
amplitude = ["20 mm"]
frequency = ["2 Hz"]
current = ["0.5 A", "1.5 A"]
cycles = 6
[identify]
enabled = false
[campaign]
current_settled = "20 mA"
"""
"""Each point moves for 4 s; the second one's cycles begin a little more than 4 s after the first one's."""
PERIOD_S = 0.5
IN_POINT_2_S = 6.3

BRISK_POINTS = TWO_POINTS.replace('"2 Hz"', '"4 Hz"')
"""For tests at speed 1: each point moves for 2 s."""
BRISK_PERIOD_S = 0.25


@dataclass(frozen=True)
class Happening:
    """A line of the simulated rig's log: its clock (s), the host's clock (ns), what."""

    time_s: float
    host_ns: int
    code: str
    text: str


@dataclass(frozen=True)
class Truth:
    """What really happened: arrays on the simulated clock (s), and the log of commands, trips and faults."""

    time_s: NDArray[np.float64]
    displacement_m: NDArray[np.float64]
    velocity_m_s: NDArray[np.float64]
    force_N: NDArray[np.float64]
    current_A: NDArray[np.float64]
    state: NDArray[np.float64]
    log: list[Happening]

    @classmethod
    def load(cls, path: Path) -> Truth:
        with h5py.File(path) as file:
            data, events = file["entry/data"], file["entry/events"]
            names = ("time", "displacement", "velocity", "force", "current", "controller_state")
            arrays = [np.asarray(data[name][:], np.float64) for name in names]
            columns = (events["time_ns"][:], events["code"][:], events["text"][:])
        log = []
        for time_ns, code, said in zip(*columns, strict=True):
            text, _, host_ns = said.decode().rpartition("; host_ns=")
            log.append(Happening(1e-9 * float(time_ns), int(host_ns), code.decode(), text))
        return cls(*arrays, log)

    def all(self, *codes: str, text: str = "", after: Happening | None = None) -> list[Happening]:
        """Lines of these codes that contain `text`, from `after` on."""
        since_ns = 0 if after is None else after.host_ns
        return [each for each in self.log if each.code in codes and text in each.text and each.host_ns >= since_ns]

    def first(self, *codes: str, text: str = "", after: Happening | None = None) -> Happening:
        """The first such line; fails when there is none."""
        found = self.all(*codes, text=text, after=after)
        assert found, f"no {codes} {text!r} after {after} in {self.log}"
        return found[0]

    def since(self, time_s: float) -> slice:
        """The samples from `time_s` on."""
        return slice(int(np.searchsorted(self.time_s, time_s)), None)


@dataclass(frozen=True)
class Ending:
    """A campaign that has ended: what it answered, what it wrote, what really happened."""

    exit_code: int
    answer: dict[str, Any]
    folder: Path
    said: str
    stopped_from_ns: int | None = None
    """Host time of a fault injected around the process; None for one that the simulated rig logged itself."""

    @cached_property
    def truth(self) -> Truth:
        """What really happened; a simulated rig that outlives its campaign is waited for."""
        path = self.folder / "truth.h5"
        wait_until(path.exists, "truth.h5", 60.0)
        return Truth.load(path)

    @cached_property
    def log(self) -> list[dict[str, Any]]:
        """The campaign's journal."""
        return read_log(self.folder)

    def trips(self) -> list[tuple[str, str]]:
        """Slug and stop of every latched first cause."""
        return [(line["slug"], line["stop"]) for line in self.log if line.get("what") == "trip"]

    def warned(self) -> list[str]:
        """Slugs the station only warned of while the campaign went on."""
        return [line["slug"] for line in self.log if line.get("what") == "warning"]

    def point(self, name: str) -> RecordedPoint:
        """A finished or stopped point's file."""
        return RecordedPoint.open(self.folder / "points" / f"{name}.h5")

    def verdicts(self) -> dict[str, str]:
        """Verdicts of the campaign's points as it answered them."""
        return {each["id"]: each["verdict"] for each in self.answer["points"]}


def wait_until(true: Callable[[], bool], what: str, timeout_s: float = 60.0) -> None:
    """Wait for a state of files or processes that nothing announces."""
    deadline_ns, pause = monotonic_ns() + int(timeout_s * 1e9), threading.Event()
    while not true():
        assert monotonic_ns() < deadline_ns, f"{what} did not come within {timeout_s:g} s"
        pause.wait(0.01)


@dataclass
class Campaign:
    """`rig run` under way."""

    process: subprocess.Popen[str]
    out: Path
    lines: list[str] = field(default_factory=list)

    @property
    def folder(self) -> Path:
        """The campaign's directory, once it is made."""
        wait_until(lambda: self.process.poll() is not None or any(self.out.iterdir()), "the campaign's directory")
        return next(iter(self.out.iterdir()))

    def happened(self, code: str, text: str = "", count: int = 1) -> bool:
        """Whether the simulated rig's live log has `count` such lines."""
        path = self.folder / "truth.h5.events.jsonl"
        if not path.exists():
            return False
        complete = [line for line in path.read_text(encoding="utf-8").splitlines(keepends=True) if line[-1] == "\n"]
        lines = [json.loads(line) for line in complete]
        return sum(line["code"] == code and text in line["text"] for line in lines) >= count

    def wait_for(self, code: str, text: str = "", count: int = 1) -> None:
        """Wait until the simulated rig has logged it."""
        wait_until(
            lambda: self.process.poll() is not None or self.happened(code, text, count), f"{count} x {code} {text}"
        )
        assert self.process.poll() is None, f"it ended before {code} {text}: {self.process.communicate()[1]}"

    def station_pid(self) -> int:
        """Process id of the station."""
        found = subprocess.check_output(["pgrep", "-P", str(self.process.pid), "-f", "rig.station"], text=True)
        return int(found.split()[0])

    def finish(self, stopped_from_ns: int | None = None) -> Ending:
        """Wait for the end."""
        answer, said = self.process.communicate(timeout=FINISH_S)
        folders = list(self.out.iterdir())
        folder = folders[0] if folders else self.out
        return Ending(self.process.returncode, json.loads(answer) if answer else {}, folder, said, stopped_from_ns)


Start = Callable[..., Campaign]
Run = Callable[..., Ending]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """Starts `rig run` on a simulated rig; what still runs at the end of the test is ended."""
    begun: list[Campaign] = []

    def begin(
        *simulator: str, matrix: str = TWO_POINTS, speed: float = 5.0, arguments: tuple[str, ...] = ()
    ) -> Campaign:
        path, out = tmp_path / f"matrix{len(begun)}.toml", tmp_path / f"out{len(begun)}"
        path.write_text(matrix, encoding="utf-8")
        out.mkdir()
        command = [RIG, "run", str(path), "--simulate", "--speed", str(speed), "--seed", "1", "--no-identify", "--json"]
        process = subprocess.Popen(
            [*command, "--out", str(out), *arguments, "--", *simulator],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ | {"COLUMNS": "200"},
            cwd=tmp_path,
        )  # fmt: skip
        begun.append(Campaign(process, out))
        return begun[-1]

    yield begin
    for campaign in begun:
        if campaign.process.poll() is None:
            campaign.process.send_signal(signal.SIGTERM)
            campaign.process.communicate(timeout=FINISH_S)


@pytest.fixture
def run(start: Start) -> Run:
    """Runs a campaign with faults of the simulated rig to its end: `run("estop@6")`."""

    def to_the_end(
        *faults: str, simulator: tuple[str, ...] = (), matrix: str = TWO_POINTS, speed: float = 5.0
    ) -> Ending:
        injected = [part for fault in faults for part in ("--fault", fault)]
        return start(*injected, *simulator, matrix=matrix, speed=speed).finish()

    return to_the_end


@pytest.fixture
def start_brisk(start: Start) -> Start:
    """Starts a short campaign at speed 1, where the rows' times are meant."""
    return lambda *simulator: start(*simulator, matrix=BRISK_POINTS, speed=1.0)


@pytest.fixture
def run_brisk(start_brisk: Start) -> Run:
    """Runs such a campaign with faults of the simulated rig to its end."""

    def to_the_end(*faults: str, simulator: tuple[str, ...] = ()) -> Ending:
        injected = [part for fault in faults for part in ("--fault", fault)]
        return start_brisk(*injected, *simulator).finish()

    return to_the_end


def settles_within_s(kind: str, speed: float, period_s: float) -> float:
    """Simulated time from the stop command to standstill: fade-out and 200 ms, or 300 ms; commands of a faster rig
    arrive up to one wall tick late on its clock."""
    fade_s = 0.0 if kind == "SO" else period_s
    return fade_s + SETTLING_S[kind] + 0.002 * speed


@pytest.fixture
def assert_stopped() -> Callable[..., None]:
    """Asserts the end state of a row whose reaction is a stop, as FAULTS says, on the simulated physics.

    `assert_stopped(ending, slug)`: exit code, first cause, order, time to the stop command, 0 A, standstill, files.
    """

    def judge(
        ending: Ending, slug: str, *, finished: tuple[str, ...] = ("p001",), broken: str | None = "p002",
        stop: str | None = None, speed: float = 5.0, first: str | None = None, settling_s: float | None = None,
        injected_as: str | None = None, period_s: float = PERIOD_S,
    ) -> None:
        row, truth = MATRIX[slug], ending.truth
        kind = stop or row.stop
        assert ending.exit_code == EXIT_CODES[kind], ending.said
        assert ending.answer["stopped_by"] == slug
        assert ending.answer["rig_state"] == "safe"
        assert [trip for trip, _ in ending.trips()] == [slug], "one latched cause, the first"
        assert ending.trips()[0][1] == kind
        fault_ns = ending.stopped_from_ns
        if fault_ns is None:
            fault_ns = truth.first("FAULT", text=injected_as or slug).host_ns
        zero, motion = stop_commands(truth, fault_ns, OWN_STOPS if first == "TRIP" else STOP_COMMANDS)
        assert motion.code == (first or ("HALT" if kind == "SO" else "FADE_STOP"))
        allowed_s = max(10.0 * (row.limit_s or 0.1), 1.0)
        assert (min(zero.host_ns, motion.host_ns) - fault_ns) / 1e9 <= allowed_s
        assert no_motion_command_after(truth, motion)
        assert_quiet(ending, zero, motion, settling_s or settles_within_s(kind, speed, period_s))
        if kind == "S1":
            # A latched trip stays the controller's state, with the pressure gone.
            assert truth.state[-1] in {State.OFF, State.TRIPPED}
            assert truth.all("HYDRAULICS_OFF", text="DONE", after=motion)
        for name in finished:
            assert ending.verdicts()[name] == "valid"
            assert ending.point(name).verdict == "valid"
        if broken is not None:
            point = ending.point(broken)
            assert point.verdict == "invalid"
            assert any(reason.startswith(slug) for reason in point.reasons), point.reasons

    return judge


def stop_commands(truth: Truth, fault_ns: int, codes: tuple[str, ...]) -> tuple[Happening, Happening]:
    """The current's and the motion's first stop command after the fault."""
    later = [each for each in truth.log if each.host_ns >= fault_ns]
    zero = [each for each in later if each.code == "SET_CURRENT" and each.text.startswith(("0.000", "-0.000"))]
    zero += [each for each in later if each.code == "ECU_FAULT"]
    motion = [each for each in later if each.code in codes]
    assert motion, f"no stop command after the fault: {later}"
    return (min(zero, key=lambda each: each.host_ns) if zero else motion[0]), motion[0]


def no_motion_command_after(truth: Truth, stop: Happening) -> bool:
    """Whether nothing that moves or raises the pressure was asked for after the stop (S1 lowers it first)."""
    return not truth.all("START", "MOVE_TO", "HYDRAULICS_ON", after=stop)


def assert_quiet(ending: Ending, zero: Happening, motion: Happening, settling_s: float) -> None:
    """|I| < 0.05 A within 250 ms of its command, standstill within `settling_s` of its command, and for good."""
    truth = ending.truth
    current_A = np.abs(truth.current_A[truth.since(zero.time_s + COIL_LAG_S)])
    assert current_A.size == 0 or current_A.max() < NO_CURRENT_A
    speed_m_s = np.abs(truth.velocity_m_s[truth.since(motion.time_s + settling_s)])
    assert speed_m_s.size > 0
    assert speed_m_s.max() < STILL_M_S


@pytest.fixture
def assert_refused() -> Callable[..., None]:
    """Asserts the end state of a row whose reaction is R: exit 3, the reason, nothing moved, a refusal record only."""

    def judge(ending: Ending, slug: str, *, still_m: float = 1e-6) -> None:
        assert ending.exit_code == 3, ending.said
        assert ending.answer["stopped_by"] == slug
        assert set(ending.verdicts().values()) <= {"not run"}
        assert not list((ending.folder / "points").iterdir())
        truth = ending.truth
        assert not truth.all("START")
        assert np.ptp(truth.displacement_m) <= still_m
        assert np.abs(truth.current_A).max() < NO_CURRENT_A
        assert any(slug in json.dumps(line) for line in ending.log)

    return judge
