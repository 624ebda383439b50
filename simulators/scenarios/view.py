"""A session of a world as its judges see it: what happened, what was journalled, what was true."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from drivers.capabilities import Capabilities
from rig.bench.model import Bench
from rig.faults.matrix import MATRIX
from rig.matrix.model import load_matrix
from rig.recording.recorded_point import RecordedPoint
from rig.test_point import TestPoint
from simulators.scenarios.plan import OF_THE_STATION, OTHER_STOPS, STALLS
from simulators.scenarios.scenario import Scenario, Session

T = TypeVar("T")
Findings = Iterator[tuple[str, float]]
"""What does not hold, and when (ns of the host's clock)."""

STILL_M_S = 5e-3
NO_CURRENT_A = 0.05
KILLING = frozenset({"application-killed", "station-killed", "power-cut"})
UNSEEN = frozenset({"modbus", "rtu", "controller", "can", "ecu"})
"""Places of the fault matrix where a fault may hide whether the rig has stopped."""
WAY = frozenset({"modbus", "rtu", "controller"})
"""Those of the way to the controller."""
STUCK_CURRENT = frozenset({"current-stuck", "supply-not-zero"})
"""Rows in which no command takes the current away."""
PLAIN = frozenset({"second-master:span", "second-master:offset", "second-master:jumps", "ecu-overtemp:coil"})
"""Faults at those places that hide nothing."""
PRESSING = frozenset({"load-train:jammed"})
"""Faults that press on the rod where it stands, or let go of it."""
SLIPPING = frozenset({"actuator-frozen:slips"})
"""Faults by which a controller drives a rod that it holds out of its place, and says that it is at rest."""
STARTING = ("centring", "checking the sensors with a slow move")


@functools.lru_cache(maxsize=32)
def _read(read: Callable[[Path], Any], path: Path, _stamp: tuple[int, int, int]) -> Any:  # noqa: ANN401
    return read(path)


def read_once(read: Callable[[Path], T], path: Path) -> T:
    """What `read` returns for a file: every check reads the same few files, so each is read once until it changes.

    Raises:
        OSError: there is no such file; and what `read` raises.
    """
    status = path.stat()
    result: T = _read(read, path, (status.st_ino, status.st_size, status.st_mtime_ns))
    return result


def bench_of(view: View) -> Bench | None:
    """The bench of a scenario; None where it has none."""
    path = view.scenario.root / "bench.toml"
    return read_once(Bench.load, path) if path.exists() else None


def capabilities_of(view: View) -> Capabilities | None:
    """What the controller of a scenario can do; None where it has no bench."""
    bench = bench_of(view)
    return None if bench is None else bench.actuator.capabilities


def points_of(view: View) -> tuple[TestPoint, ...] | None:
    """The points of a scenario's matrix; None where it has none."""
    path = view.scenario.root / "matrix.toml"
    return read_once(_points, path) if path.exists() else None


def _points(path: Path) -> tuple[TestPoint, ...]:
    return tuple(load_matrix(path).points())


def description(path: Path) -> RecordedPoint:
    """A recorded point of which only what is read is checked.

    Raises:
        FileProblem: as `RecordedPoint.open`.
    """
    return RecordedPoint.open(path, whole=False)


class View:
    """A session with its lines of the journal."""

    def __init__(self, scenario: Scenario, session: Session) -> None:
        self.scenario = scenario
        self.session = session
        self.lines = [
            line for line in scenario.journal
            if session.began_ns <= int(line.get("host_ns", 0)) <= max(session.rest_ns, session.ended_ns)
        ]
        self.killed = any(event.what in KILLING for _, event in session.happened)

    @property
    def by_hand(self) -> bool:
        """An operator sets the current: a stop cannot remove it, it is requested."""
        bench = bench_of(self)
        return bench is not None and bench.ecu.by_hand

    @property
    def stalled_s(self) -> float:
        """For how long the station was kept from running (s)."""
        stalls = (event for _, event in self.session.happened if event.what in OF_THE_STATION)
        return sum(event.lasts_s or 0.0 for event in stalls)

    def station(self, *what: str) -> list[dict[str, Any]]:
        """Events of the station of these kinds."""
        return [line for line in self.lines if line.get("event") == "station" and line.get("what") in what]

    def between(self, from_ns: float, to_ns: float) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Rows of the truth in a time."""
        rows = self.session.truth.arrays
        return rows[(rows[:, 0] >= from_ns) & (rows[:, 0] < to_ns)]

    def at_s(self, host_ns: float) -> float:
        """Seconds since the world began."""
        return (host_ns - self.scenario.kernel.start_ns) * 1e-9

    def faults(self) -> set[str]:
        """Rows whose fault the devices had in this session."""
        return {name.partition(":")[0] for name in self.faults_by_name()}

    def faults_by_name(self) -> set[str]:
        """The same, each as `SLUG` or `SLUG:VARIANT`."""
        return {line.text for line in self.session.truth.log if line.code == "FAULT"}

    @staticmethod
    def hiding_places(faults: Iterable[str]) -> set[str]:
        """Places of the fault matrix at which one of these faults (`SLUG` or `SLUG:VARIANT`) may hide something."""
        slugs = (name.partition(":")[0] for name in faults if name not in PLAIN)
        return {MATRIX[slug].place for slug in slugs if slug in MATRIX}

    @property
    def hidden_devices(self) -> bool:
        """Something is wrong with controller, current source or the ways to them, and may hide something."""
        return bool(self.hiding_places(self.faults_by_name()) & UNSEEN)

    @property
    def hidden(self) -> bool:
        """Something may hide whether the rig has stopped, or keep those who see it from running."""
        return self.hidden_devices or any(
            event.what in KILLING or event.what in STALLS or event.what in OTHER_STOPS
            for _, event in self.session.happened
        )

    @property
    def hidden_way(self) -> bool:
        """Something may be wrong with the way to the controller, or with the task on it."""
        return bool(self.hiding_places(self.faults_by_name()) & WAY) or any(
            event.what in KILLING or event.what in STALLS for _, event in self.session.happened
        )

    @property
    def hidden_pressure(self) -> bool:
        """Something may keep the station from taking the pressure away, or from seeing that it is gone."""
        return self.hidden_devices or any(
            event.what in {"station-killed", "power-cut", *OTHER_STOPS} for _, event in self.session.happened
        )

    def resetting_ns(self, after_ns: float) -> float:
        """When a reset after a stop began; the session's end when none did."""
        resets = [
            int(line["host_ns"]) for line in self.lines
            if str(line.get("phase")).startswith("resetting") and int(line["host_ns"]) > after_ns
        ]
        return resets[0] if resets else self.session.rest_ns

    def reset_ns(self, after_ns: float) -> float:
        """When the station forgot a stop; the session's end when it did not: a refused reset leaves it latched."""
        phases = [
            line for line in self.lines if line.get("event") == "phase" and int(line["host_ns"]) > after_ns
        ]
        for line, following in pairwise(phases):
            if str(line["phase"]).startswith("resetting") and following.get("after") == "Done":
                return float(following["host_ns"])
        return float(self.session.rest_ns)

    def spans(self, faults: frozenset[str]) -> list[tuple[float, float]]:
        """From when to when (ns) each of these faults of the devices was there; infinite where it stays."""
        spans, log = [], self.session.truth.log
        for place, line in enumerate(log):
            if line.code == "FAULT" and line.text in faults:
                ends = (other.host_ns for other in log[place:] if (other.code, other.text) == ("FAULT_ENDS", line.text))
                spans.append((float(line.host_ns), float(next(ends, math.inf))))
        return spans

    def way_hidden_between(self, from_ns: float, to_ns: float) -> bool:
        """Something was wrong with the way to the controller at a time between, or with the station that uses it."""
        return bool(self.hiding_places(self.active(from_ns, to_ns)) & WAY) or any(
            at_ns <= to_ns and (what.what in KILLING or at_ns + 1e9 * (what.lasts_s or 0.0) >= from_ns)
            for at_ns, what in self.session.happened if what.what in KILLING or what.what in STALLS
        )

    def begun(self, until_ns: float) -> list[tuple[float, str]]:
        """Faults of the devices until then: when (ns), `SLUG` or `SLUG:VARIANT`."""
        return [
            (line.host_ns, line.text) for line in self.session.truth.log
            if line.code == "FAULT" and line.host_ns <= until_ns
        ]

    def pressed_ns(self, since_ns: float) -> float:
        """When something began, or ceased, to press on the rod where it stands; infinite where nothing did since then.

        The plant is brought up to date once a tick: what a fault does in that tick was there before its line.
        """
        return self._begins_ns(PRESSING, since_ns, "FAULT", "FAULT_ENDS")

    def slips_ns(self, since_ns: float) -> float:
        """When a controller began to drive a rod that it holds out of its place; infinite where none did since then."""
        return self._begins_ns(SLIPPING, since_ns, "FAULT")

    def _begins_ns(self, faults: frozenset[str], since_ns: float, *codes: str) -> float:
        tick_ns = 1e9 * self.scenario.plan.tick_s
        return min((
            line.host_ns - tick_ns for line in self.session.truth.log
            if line.code in codes and line.text in faults and line.host_ns >= since_ns
        ), default=math.inf)

    def active(self, from_ns: float, to_ns: float) -> set[str]:
        """Faults of the devices that were there at any time between, each as `SLUG` or `SLUG:VARIANT`."""
        ended = {
            line.text for line in self.session.truth.log if line.code == "FAULT_ENDS" and line.host_ns < from_ns
        }
        return {fault for _, fault in self.begun(to_ns)} - ended

    def without_current(self, from_ns: float) -> bool:
        """From then to the session's end the current source was asked for none, and none flowed."""
        commands = [line for line in self.session.truth.log if line.code == "SET_CURRENT"]
        earlier = sum(line.host_ns < from_ns for line in commands)
        if any(float(line.text.split()[0]) != 0.0 for line in commands[max(0, earlier - 1):]):
            return False
        rows = self.between(from_ns, self.session.ended_ns)
        return not np.any(np.abs(rows[:, 2]) > NO_CURRENT_A)

    def stays(self, fault: str) -> bool:
        """A fault that was drawn does not end by itself."""
        return math.isinf(self.lasts_s(fault))

    def lasts_s(self, fault: str) -> float:
        """For how long a fault that was drawn lasts (s); 0 where none was."""
        lasting = (given.lasts_s for given in self.scenario.plan.events if given.what == fault)
        return max((math.inf if lasts_s is None else lasts_s for lasts_s in lasting), default=0.0)

    def restarted_ns(self, after_ns: float) -> float:
        """When the rig was started again after a stop; the session's end when it was not."""
        again = [
            int(line["host_ns"]) for line in self.lines
            if line.get("phase") in STARTING and int(line["host_ns"]) > after_ns
        ]
        return again[0] if again else self.session.rest_ns
