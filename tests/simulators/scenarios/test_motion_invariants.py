"""The checks of the rod's motion and of the coil's current on synthetic histories, faulty and healthy."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from matrices import matrix_text
from numpy.typing import NDArray

from rig.bench.model import Bench
from rig.recording.recorded_point import RecordedPoint
from simulators.scenarios.invariants import programmed_current
from simulators.scenarios.motion_invariants import MOTION_CHECKS, Motion
from simulators.scenarios.scenario import EVERY_S, Noted
from simulators.scenarios.stop_invariants import STOP_CHECKS
from simulators.scenarios.view import View

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
AMPLITUDE_M, FREQUENCY_Hz = 0.060, 1.5
"""Planned 0.565 m/s of the 0.8 m/s that the bench allows; 5.3 m/s^2 of 60; 85 mm of travel; a halt brakes 20 m/s^2."""
LATCHED_S = 2.0
Array = NDArray[np.float64]


@dataclass
class History:
    """A rod's motion of 4 s: positions (m) and speeds (m/s) each millisecond, set-points, a stop at `LATCHED_S`."""

    position_m: Callable[[Array], Array]
    stopped: bool = False
    begun: tuple[tuple[float, str], ...] = ()
    fault_ends_s: float = math.inf
    pressure_off_s: float = math.inf
    setpoints: tuple[tuple[float, float, float], ...] = ()
    hidden_way: bool = False
    bench: str = "streamed-bench.toml"
    drive: str = "demo-streamed"
    slug: str = "modbus-busy"
    stopped_by: str = ""

    def view(self, root: Path) -> View:
        """As the checks see it."""
        bench = (EXAMPLES / self.bench).read_text(encoding="utf-8").replace("demo-streamed", self.drive)
        (root / "bench.toml").write_text(bench, encoding="utf-8")
        matrix = matrix_text("0 A", amplitude=f"{1e3 * AMPLITUDE_M:g} mm", frequency=f"{FREQUENCY_Hz:g} Hz")
        (root / "matrix.toml").write_text(matrix, encoding="utf-8")
        t_s = np.arange(0.0, 4.0, 1e-3)
        rows = np.zeros((len(t_s), 7))
        rows[:, 0], rows[:, 3] = 1e9 * t_s, self.position_m(t_s)
        rows[:, 1] = np.gradient(rows[:, 3], t_s)
        rows[:, 5] = np.where(t_s < self.pressure_off_s, 2.0, 0.0)
        trips = [{"latched_ns": 1e9 * LATCHED_S, "t_ns": 1e9 * LATCHED_S, "slug": self.slug}]
        setpoints = [(1e9 * at_s, *values) for at_s, *values in self.setpoints]
        log = (Noted(round(1e9 * LATCHED_S), "FOREIGN", self.stopped_by),) if self.stopped_by else ()
        truth = SimpleNamespace(arrays=rows, log=log, setpoints=setpoints)
        seen = SimpleNamespace(
            scenario=SimpleNamespace(root=root), session=SimpleNamespace(truth=truth),
            spans=lambda faults: [
                (1e9 * at_s, 1e9 * self.fault_ends_s) for at_s, fault in self.begun if fault in faults
            ],
            station=lambda *_: trips if self.stopped else [], reset_ns=lambda _: 4e9,
            way_hidden_between=lambda *_: self.hidden_way,
            between=lambda from_ns, to_ns: rows[(rows[:, 0] >= from_ns) & (rows[:, 0] < to_ns)],
        )  # fmt: skip
        return cast("View", seen)


def sine(t_s: Array) -> Array:
    """The planned motion."""
    return AMPLITUDE_M * np.sin(2.0 * np.pi * FREQUENCY_Hz * t_s)


def faded(t_s: Array) -> Array:
    """The planned motion, faded out over one cycle after the stop."""
    return sine(t_s) * np.clip(1.0 - (t_s - LATCHED_S - 0.02) * FREQUENCY_Hz, 0.0, 1.0)


def halted(t_s: Array) -> Array:
    """Halted at 20 m/s^2 from where it is at the stop."""
    speed_m_s = 2.0 * np.pi * FREQUENCY_Hz * AMPLITUDE_M
    since_s = np.clip(t_s - LATCHED_S, 0.0, speed_m_s / 20.0)
    return np.where(t_s < LATCHED_S, sine(t_s), speed_m_s * since_s - 10.0 * since_s**2)


def thrown(t_s: Array) -> Array:
    """Held at the stop, and 0.3 s later thrown to where the sine would be by then."""
    held = np.where(t_s < LATCHED_S, sine(t_s), 0.0)
    share = np.clip((t_s - LATCHED_S - 0.3) / 0.06, 0.0, 1.0)
    return held + 0.075 * 0.5 * (1.0 - np.cos(np.pi * share))


def resumed(t_s: Array) -> Array:
    """Held by its controller in a gap of 0.3 s, then led back softly to the fade that went on meanwhile."""
    share = 0.5 * (1.0 - np.cos(np.pi * np.clip((t_s - LATCHED_S - 0.32) / 0.1, 0.0, 1.0)))
    return np.where(t_s < LATCHED_S, sine(t_s), share * faded(t_s))


def drifting(t_s: Array) -> Array:
    """The planned motion whose centre goes out to 30 mm."""
    return sine(t_s) + 0.030 * np.clip(t_s, 0.0, 1.0)


def late_end(t_s: Array) -> Array:
    """At 80 mm the rod still moves at 0.79 m/s towards the end at 85 mm, where it stands at once."""
    return np.clip(0.79 * (t_s - 1.0), 0.0, 0.0835)


def left_alone(t_s: Array) -> Array:
    """Led to 0.79 m/s within 0.1 s, until 1.0557 s, where the rod stands at once."""
    since_s = np.clip(t_s - 0.9, 0.0, 0.1)
    return np.clip(3.95 * since_s**2 + 0.79 * np.clip(t_s - 1.0, 0.0, None), 0.0, 0.0835)


def shaken(t_s: Array) -> Array:
    """Little, but with 90 m/s^2 for milliseconds: a servo loop at a set-point, not what a generator commands."""
    return 0.0004 * np.sin(np.sqrt(90.0 / 0.0004) * t_s)


def swinging(t_s: Array) -> Array:
    """70 m/s^2 at 16 Hz, of 60."""
    return 0.007 * np.sin(100.0 * t_s)


def streamed(*between_s: float) -> tuple[tuple[float, float, float], ...]:
    """Set-points of the swinging motion, taken at these distances (s) again and again."""
    times_s = np.cumsum(between_s * (400 // len(between_s)))
    return tuple(zip(times_s, swinging(times_s), 0.7 * np.cos(100.0 * times_s), strict=True))


@pytest.mark.parametrize(
    ("history", "found"),
    [
        (History(sine), set()),
        (History(faded, stopped=True), set()),
        (History(halted, stopped=True), set()),
        (History(sine, stopped=True), {"slows-down"}),
        (History(resumed, stopped=True), {"slows-down"}),
        (History(thrown, stopped=True), {"slows-down", "speed", "acceleration"}),
        (History(lambda t_s: 1.48 * sine(t_s)), {"travel", "stopping-distance", "speed"}),
        (History(drifting), {"travel", "stopping-distance"}),
        (History(drifting, begun=((0.0, "second-master:offset"),)), set()),
        (History(drifting, begun=((0.0, "second-master:offset"),), fault_ends_s=1.0), {"travel", "stopping-distance"}),
        (History(drifting, begun=((0.0, "load-train"),)), {"travel", "stopping-distance"}),
        (History(lambda t_s: 1.48 * sine(t_s), begun=((0.0, "actuator-frozen:slips"),)), {"speed"}),
        (History(thrown, stopped=True, begun=((2.1, "setpoints-lost"),), fault_ends_s=2.31), set()),
        (
            History(thrown, stopped=True, begun=((1.5, "setpoints-lost"),), fault_ends_s=2.0),
            {"slows-down", "speed", "acceleration"},
        ),
        (
            History(thrown, stopped=True, begun=((2.1, "modbus-write-lost"),), fault_ends_s=2.31),
            {"slows-down", "speed", "acceleration"},
        ),
        (
            History(thrown, stopped=True, begun=((2.1, "modbus-write-lost"),), fault_ends_s=2.31, drive="float-drive"),
            {"slows-down"},
        ),
        (History(resumed, stopped=True, begun=((1.9, "stop-ignored"),)), set()),
        (History(resumed, stopped=True, begun=((3.0, "stop-ignored"),)), {"slows-down"}),
        (History(resumed, stopped=True, begun=((1.0, "load-train"),), pressure_off_s=LATCHED_S), set()),
        (History(resumed, stopped=True, begun=((1.0, "load-train"),)), {"slows-down"}),
        (History(late_end), {"acceleration", "stopping-distance"}),
        (History(left_alone, setpoints=((0.99, 0.0320, 0.711), (1.0, 0.0395, 0.79))), {"stopping-distance"}),
        (
            History(left_alone, setpoints=((1.02, 0.0553, 0.79), (1.03, 0.0632, 0.79))),
            {"acceleration", "stopping-distance"},
        ),
        (History(late_end, bench="demo-bench.toml"), {"speed", "acceleration", "stopping-distance"}),
        (History(shaken), set()),
        (History(shaken, bench="demo-bench.toml"), {"acceleration"}),
        (History(sine, setpoints=((1.0, 0.0, 0.56), (1.01, 0.0056, 0.56))), set()),
        (History(sine, setpoints=((1.0, 0.0, 0.0), (1.01, 0.06, 0.0))), {"setpoints"}),
        (History(sine, setpoints=((1.0, 0.0, 0.56), (1.3, 0.05, -0.3))), {"setpoints"}),
        (History(swinging, setpoints=streamed(0.010)), {"acceleration"}),
        (History(swinging, setpoints=streamed(0.008, 0.012)), set()),
        (History(swinging, setpoints=streamed(0.008, 0.012), bench="demo-bench.toml"), {"acceleration", "speed"}),
        (History(halted, stopped=True, setpoints=((1.99, -0.0056, 0.56), (2.1, 0.008, 0.05))), set()),
        (History(halted, stopped=True, setpoints=((1.99, -0.0056, 0.56), (2.1, 0.008, 0.3))), {"set-in-motion"}),
    ],
)
def test_what_the_rod_must_not_do_is_found_and_a_healthy_motion_is_not(
    history: History, found: set[str], tmp_path: Path
) -> None:
    view = history.view(tmp_path)
    assert {name for name, check in MOTION_CHECKS.items() if list(check(view))} == found


@pytest.mark.parametrize(("hidden_way", "found"), [(False, True), (True, False)])
def test_a_controller_that_cannot_be_reached_is_given_its_watchdog_s_time(
    hidden_way: bool, found: bool, tmp_path: Path
) -> None:
    """It goes on for 0.5 s, then it fades out by itself."""

    def later(t_s: Array) -> Array:
        return sine(t_s) * np.clip(1.0 - (t_s - LATCHED_S - 0.6) * FREQUENCY_Hz, 0.0, 1.0)

    view = History(later, stopped=True, hidden_way=hidden_way, bench="demo-bench.toml").view(tmp_path)
    assert bool(list(MOTION_CHECKS["slows-down"](view))) is found


def slow(t_s: Array) -> Array:
    """A move at 10 mm/s."""
    return 0.01 * t_s


@pytest.mark.parametrize(
    ("history", "moving_s", "found"),
    [
        (History(faded, stopped=True, slug="second-master"), 1.1, False),
        (History(faded, stopped=True, slug="second-master"), 1.3, True),
        (History(faded, stopped_by="panel-stop"), 1.6, True),
        (History(slow, stopped_by="panel-stop"), 1.6, False),
        (History(slow, stopped_by="foreign-stop"), 1.6, True),
    ],
)
def test_after_a_stop_by_another_master_set_points_only_fade_out_unless_it_left_no_trace(
    history: History, moving_s: float, found: bool, tmp_path: Path
) -> None:
    """A fade of one cycle at 1.5 Hz is over after 0.67 s; a halt of less than two polls shows only if acknowledged."""
    history.setpoints = ((LATCHED_S + moving_s, 0.0, 0.03),)
    assert bool(list(STOP_CHECKS["foreign-stop"](history.view(tmp_path)))) is found


def test_a_users_own_streamed_map_says_for_how_long_the_drive_goes_on() -> None:
    bench = Bench.load(EXAMPLES / "streamed-bench.toml")
    own = EXAMPLES.parent / "tests" / "simulators" / "maps" / "single-bits.toml"
    bench = bench.model_copy(update={"actuator": replace(bench.actuator, register_map=str(own))})
    assert Motion(bench, ()).goes_on_s == bench.actuator.poll_s


class _Truth:
    """Rows of a rod that moves from 1 s to 5 s, with these currents (A) in turn, each for 1 s."""

    def __init__(self, *levels_A: float) -> None:
        time_s = np.arange(0.0, 6.0, EVERY_S)
        self.rows = np.zeros((time_s.size, 7))
        self.rows[:, 0] = 1e9 * time_s
        self.rows[:, 1] = np.where((time_s >= 1.0) & (time_s < 5.0), 0.1, 0.0)
        self.rows[:, 2] = np.asarray(levels_A)[np.clip(time_s - 1.0, 0.0, 3.0).astype(int)]

    def between(self, from_ns: float, to_ns: float) -> np.ndarray[Any, np.dtype[np.float64]]:
        return self.rows[(self.rows[:, 0] >= from_ns) & (self.rows[:, 0] < to_ns)]


@pytest.mark.parametrize(
    ("levels_A", "other_s"),
    [((0.2, 1.0, 0.2, 1.0), 0.0), ((0.2, 0.2, 0.2, 1.0), 0.75), ((1.0, 0.2, 1.0, 0.2), 3.15)],
)
def test_a_current_program_is_checked_step_by_step(levels_A: tuple[float, ...], other_s: float) -> None:
    """As commanded; one step missing; in the wrong order."""
    point = SimpleNamespace(motion_s=4.0, steps_in_motion=((0.0, 0.2), (1.0, 1.0), (2.0, 0.2), (3.0, 1.0)))
    rows, low_A, high_A = programmed_current(cast("View", _Truth(*levels_A)), cast("RecordedPoint", point), 0.5e9)
    other = (rows[:, 2] < low_A - 0.1) | (rows[:, 2] > high_A + 0.1)
    assert EVERY_S * np.count_nonzero(other) == pytest.approx(other_s, abs=0.06)
