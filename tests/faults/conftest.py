"""The fault suite's frame: `rig run` as a user starts it, one fault, and what must then be true in truth and files.

A test of a row is marked `row("slug")` and named in `rig.faults.matrix`; `test_matrix.py` compares the two.
"""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from matrices import BRISK_POINTS, PERIOD_S, TWO_POINTS
from true_states import Happening, Truth
from watched_campaign import FINISH_S, RIG, Campaign, Ending
from world_campaign import SEED, WorldCampaign, begin

from rig.faults.matrix import MATRIX
from simulators.controller_firmware import State
from simulators.world.stage import Stage, load_everything

COIL_LAG_S = 0.250
NO_CURRENT_A = 0.05
STILL_M_S = 2e-3
STOP_COMMANDS = ("FADE_STOP", "HALT", "HYDRAULICS_OFF")
OWN_STOPS = ("TRIP",)
"""The controller stops by itself, where no command reaches it."""
SETTLING_S = {"S2": 0.200, "S1": 0.200, "SO": 0.300}
EXIT_CODES = {"S2": 4, "S1": 4, "SO": 4, "R": 3, "P": 5, "W": 0}

Start = Callable[..., Campaign]
InMotion = Callable[..., Campaign]
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
        # Real-time processes of several tests would keep each other from running; the benchmarks measure with them.
        process = subprocess.Popen(
            [*command, "--out", str(out), *arguments, "--", "--no-real-time", *simulator],
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


def injected(faults: tuple[str, ...]) -> tuple[str, ...]:
    """Arguments of the simulated rig for these faults."""
    return tuple(part for fault in faults for part in ("--fault", fault))


@pytest.fixture(scope="session")
def program() -> None:
    """Every module of the program is loaded: a world replaces what they found of the machine."""
    load_everything()


@pytest.fixture
def run(program: None, tmp_path: Path) -> Run:
    """Runs a campaign in virtual time, with faults of the simulated rig, to its end: `run("estop@6")`."""
    worlds = itertools.count()

    def to_the_end(
        *faults: str, simulator: tuple[str, ...] = (), matrix: str = TWO_POINTS, speed: float = 5.0
    ) -> Ending:
        folder = tmp_path / f"world{next(worlds)}"
        folder.mkdir()
        with Stage(SEED, folder) as stage:
            return begin(stage, folder, (*injected(faults), *simulator), matrix, speed).finish()

    return to_the_end


@pytest.fixture
def run_wired(start: Start) -> Run:
    """The same on real processes and wires, where only they have what a row is about."""

    def to_the_end(*faults: str, simulator: tuple[str, ...] = ()) -> Ending:
        return start(*injected(faults), *simulator).finish()

    return to_the_end


def second_point_running(start: Start) -> InMotion:
    """Starts campaigns that way, and lets their second point run for a while (simulated s)."""

    def begun(seconds: float = 1.6, **options: object) -> Campaign:
        campaign = start(**options)
        campaign.wait_for("START", count=2)
        campaign.run_on(seconds)
        return campaign

    return begun


@pytest.fixture
def in_motion(start: Start) -> InMotion:
    """Starts a campaign whose second point runs for a while (simulated s): `in_motion(seconds=1.6)`."""
    return second_point_running(start)


@pytest.fixture
def begin_world(program: None, tmp_path: Path) -> Iterator[Start]:
    """Starts a campaign in virtual time that waits to be looked at; one a test."""
    with ExitStack() as ends:

        def start_there(*simulator: str, matrix: str = TWO_POINTS, speed: float = 5.0) -> WorldCampaign:
            folder = tmp_path / "world"
            folder.mkdir()
            return begin(ends.enter_context(Stage(SEED, folder)), folder, simulator, matrix, speed)

        yield start_there


@pytest.fixture
def moving(begin_world: Start) -> InMotion:
    """The same in virtual time: `moving(seconds=1.6)`."""
    return second_point_running(begin_world)


@pytest.fixture
def start_brisk(start: Start) -> Start:
    """Starts a short campaign at speed 1, where the rows' times are meant."""
    return lambda *simulator: start(*simulator, matrix=BRISK_POINTS, speed=1.0)


@pytest.fixture
def run_brisk(run: Run) -> Run:
    """Runs a short one at speed 1, where the rows' times are meant."""
    return lambda *faults, simulator=(): run(*faults, simulator=simulator, matrix=BRISK_POINTS, speed=1.0)


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
        injected_as: str | None = None, period_s: float = PERIOD_S, slug_of_station: str | None = None,
    ) -> None:
        row, truth = MATRIX[slug], ending.truth
        kind = stop or row.end
        injected_as, slug = injected_as or slug, slug_of_station or slug
        assert ending.exit_code == EXIT_CODES[kind], ending.said
        assert ending.answer["stopped_by"] == slug
        assert ending.answer["rig_state"] == "safe"
        assert [trip for trip, _ in ending.trips()] == [slug], "one latched cause, the first"
        assert ending.trips()[0][1] == kind
        fault_ns = ending.stopped_from_ns
        if fault_ns is None:
            fault_ns = truth.first("FAULT", text=injected_as).host_ns
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
        assert [line["slug"] for line in ending.log if line["event"] == "refused"] == [slug]

    return judge
