"""Inputs and results of a campaign: options, a display, the points' results, how it ended."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any, Protocol

from drivers.prepared import Prepared
from rig.campaign.words import say
from rig.errors import EXIT_DONE, EXIT_NOT_ALL_VALID, EXIT_REFUSED, EXIT_STOPPED, EXIT_UNKNOWN_STATE
from rig.matrix.plan import Plan
from rig.recording.quality.point_quality import PointQuality
from rig.recording.quality.verdict import Kind, Reason, blamed
from rig.signals.peak_force import PeakForce
from rig.test_point import TestPoint
from rig.text_file import FirstRead

WARMING_UP = "warming up"
NOT_RUN = "not run"


class RigState(StrEnum):
    """What is known about the rig when a campaign has ended."""

    SAFE = "safe"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class PreparedProcesses:
    """Processes of a campaign that have loaded their programs before it; None: they are loaded when it starts.

    Attributes:
        station: of `rig.station.process`.
        rig: of `simulators.prepared`.
    """

    station: Prepared | None = None
    rig: Prepared | None = None

    @classmethod
    def new(cls, *, simulate: bool) -> PreparedProcesses:
        """What a campaign on a real or a simulated rig needs; nothing is loaded before `prepare`."""
        return cls(Prepared("rig.station.process"), Prepared("simulators.prepared") if simulate else None)

    def prepare(self) -> None:
        """Load those that are not waiting already."""
        for process in (self.rig, self.station):
            if process is not None:
                process.prepare()

    def close(self) -> None:
        """End those that wait."""
        for process in (self.rig, self.station):
            if process is not None:
                process.close()


@dataclass(frozen=True)
class CampaignOptions:
    """One campaign as asked for on the command line.

    Attributes:
        matrix_path: the matrix file.
        out: the folder in which the campaign's directory is made.
        bench_path: the bench file of the rig to use; None together with `simulate`.
        simulate: start a simulated rig and use the bench file it prints.
        speed: simulated seconds per wall second, passed to the simulated rig.
        seed: seed of the simulated rig.
        simulator_args: further arguments for `python -m simulators`, as given.
        resume_path: the directory of an earlier campaign to continue (then `out` does not count); None for a new one.
        requalified: what was checked or replaced after a stop that demands it, in the operator's words; empty: nothing.
        attended: an operator is at the terminal and can be asked to set a current.
        serial_number: of the specimen, where it is not the one in the matrix file; empty: as in the file.
        confirmed: codes of the stops whose causes the operator has confirmed before resuming; None: resuming confirms
            all of them, as at the terminal, where they are printed.
        drives_path: an earlier run from whose commands the iterations of signals start; None: from the signals.
        planned: `plan_digest` of the plan that the operator saw on a page; empty: none.
        files: contents of the matrix, the bench file and the files that they name; these bytes are run and stored.
        prepared: processes that have loaded their programs in advance.
    """

    matrix_path: Path
    out: Path
    bench_path: Path | None = None
    simulate: bool = False
    speed: float = 1.0
    seed: int = 0
    simulator_args: tuple[str, ...] = ()
    resume_path: Path | None = None
    requalified: str = ""
    attended: bool = False
    serial_number: str = ""
    confirmed: frozenset[str] | None = None
    planned: str = ""
    drives_path: Path | None = None
    files: FirstRead = field(default_factory=FirstRead, compare=False, repr=False)
    prepared: PreparedProcesses = field(default_factory=PreparedProcesses, compare=False, repr=False)


@dataclass(frozen=True)
class PointResult:
    """How one test point ended."""

    point: TestPoint
    file: Path | None
    verdict: str
    reasons: tuple[str, ...] = ()
    lost_samples: int = 0
    quality: Mapping[str, float] = field(default_factory=dict)
    iteration: Mapping[str, Any] | None = None

    @property
    def id(self) -> str:
        """Name of the point."""
        return self.point.id

    @property
    def peak_force(self) -> PeakForce | None:
        """Largest force in rebound and in compression (N), as `rig.signals.peak_force`; None where it is not known."""
        return PointQuality.read(self.quality).loop.peak_force

    @property
    def slugs(self) -> tuple[str, ...]:
        """The reasons' names."""
        return tuple(Reason.stored(line, Kind.SUSPECT).slug for line in self.reasons)

    def to_json(self) -> dict[str, Any]:
        """The keys of one entry of `points` in `rig run --json`; `file` absolute or null."""
        peak = self.peak_force
        return {
            "id": self.id,
            "file": None if self.file is None else str(self.file.resolve()),
            "verdict": self.verdict,
            "reasons": list(self.reasons),
            "waveform": self.point.waveform,
            "amplitude_m": self.point.amplitude_m,
            "frequency_Hz": self.point.frequency_Hz,
            "current_A": self.point.current_A,
            "described": self.point.described,
            "lost_samples": self.lost_samples,
            "peak_force_rebound_N": None if peak is None else peak.rebound_N,
            "peak_force_compression_N": None if peak is None else peak.compression_N,
            "blamed": [blamed(reason) for reason in self.reasons],
            "quality": {name: value for name, value in self.quality.items() if math.isfinite(value)},
            "iteration": None if self.iteration is None else dict(self.iteration),
        }


@dataclass(frozen=True)
class Wait:
    """What the damper's temperature cost before a point.

    Attributes:
        point: id of the point that could not begin yet.
        phase: `warming up` (one program) or `cooling down`.
        from_degC: the coil's temperature then.
        to_degC: the one it must reach.
        planned_s: motion of the warm-up program, or the forecast of cooling down (s, rig's clock).
    """

    point: str
    phase: str
    from_degC: float
    to_degC: float
    planned_s: float

    @property
    def text(self) -> str:
        """For the operator and the journal."""
        return say("warming" if self.phase == WARMING_UP else "cooling", **asdict(self))


@dataclass(frozen=True)
class CampaignFinding:
    """Something about the whole session that no single point shows.

    Attributes:
        slug: its name.
        blamed: `bench`, `specimen` or `test`.
        text: what happened, the numbers, what to do.
        instruments: which instruments disagree.
        values: the numbers (SI) by name.
    """

    slug: str
    blamed: str
    text: str
    instruments: tuple[str, ...] = ()
    values: Mapping[str, float] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """One entry of `findings` in `rig run --json`."""
        return {
            "slug": self.slug, "blamed": self.blamed, "text": self.text, "instruments": list(self.instruments),
            "values": dict(self.values),
        }  # fmt: skip


@dataclass(frozen=True)
class StopReport:
    """How a campaign was stopped.

    Attributes:
        kind: `S2`, `S1` or `SO`.
        slug: of the first cause.
        proved: the station proved standstill.
        current_zero: it proved 0 A, too.
        current_left_A: the current that the last measurement shows, too large for 0 A (A); None: 0 A, or not measured.
        current_timeout_s: own time-out (s) of a current source that was silent, which has passed; None elsewhere.
        pressure_off: the hydraulics are proved off.
        pressure: what was last seen of them: `off`, `low`, `on`, `unknown` (the controller does not show it), `none`
            (nothing to take away), or empty (not heard).
        moved: anything had moved before.
        unfinished: id of the point that was prepared or running; empty when there was none.
        resume: fault matrix's word on going on: `a`, `c` (typing `--resume` confirms), `n` (requalify first).
        halted: the controller brought the motion to rest where it was, or was commanded to (kind `SO`).
        faded: the controller faded the motion out over a cycle. Neither: nothing was seen to end a motion.
    """

    kind: str
    slug: str
    proved: bool
    current_zero: bool
    pressure_off: bool
    moved: bool
    unfinished: str
    resume: str
    halted: bool
    faded: bool = False
    pressure: str = ""
    current_left_A: float | None = None
    current_timeout_s: float | None = None

    @property
    def state_text(self) -> str:
        """The state of the rig, as far as it was proved: standstill, current and pressure separately."""
        if not self.moved:
            parts = [] if self.current_left_A is None else [self._current]
            parts += [self._pressure] if self.pressure and not self.pressure_off else []
            return ", ".join(("no motion had started", *parts))
        ended = "motion halted" if self.halted else "motion ramped down" if self.faded else "rod at rest"
        motion = ended if self.proved else "standstill is not confirmed"
        return f"{motion}, {self._current}, {self._pressure}"

    @property
    def _current(self) -> str:
        if self.current_left_A is not None:
            return f"COIL CURRENT STILL ON ({self.current_left_A:.3g} A measured; disconnect the coil's supply)"
        if self.current_zero:
            return "coil at 0 A"
        if self.current_timeout_s is None:
            return "coil current not confirmed"
        passed = f"the current source's time-out of {self.current_timeout_s:.3g} s has passed"
        return f"coil current not measured ({passed})"

    @property
    def _pressure(self) -> str:
        if self.pressure_off:
            return "hydraulics off"
        others = {
            "none": "actuator holds its position (no hydraulics to switch off)",
            "unknown": "HYDRAULICS NOT CONFIRMED OFF: in this state, for example after a trip, the controller does not "
            "report whether pressure is on; inspect and reset the controller, or define [pressure] in its register "
            "map",
        }
        return others.get(self.pressure, "HYDRAULICS STILL ON")

    @property
    def not_proved(self) -> tuple[str, ...]:
        """What a safe state would have needed, by name."""
        facts = (("standstill", self.proved), ("0 A", self.current_zero), (
            "hydraulics off", self.pressure_off or self.pressure == "none"
        ))
        return tuple(name for name, proved in facts if not proved)

    def to_json(self) -> dict[str, Any]:
        """The keys of `stop` in `rig run --json`."""
        return asdict(self) | {"text": self.state_text, "stands": self.state_text}


@dataclass(frozen=True)
class CampaignResult:
    """How a campaign ended.

    Attributes:
        campaign: the campaign's directory.
        points: every point of the matrix in planned order, the ones never begun included (verdict `not run`).
        valid: how many points are valid.
        total: how many points the matrix has.
        rig_state: `safe` (what the end or the stop promised is proved: standstill, 0 A, pressure) or `unknown`.
        stopped_by: slug of the first cause when the campaign was stopped, else None.
        detail: the first cause in words, empty when the campaign ran to its end.
        refused: True when the rig refused before anything moved.
        wall_s: wall seconds from the first point's start to the last point's end (0 when none ran).
        motion_s: planned seconds of motion of the points that ran, on the rig's clock.
        start_temperature_degC: the coil's first reading of this session; None where there was none.
        waits: warming up and cooling down in this session, in order.
        findings: what the session as a whole showed about its instruments.
        stop: how it was stopped; None when it ran to its end or was refused.
        confirmed: stops of earlier sessions whose repair the operator confirmed by resuming.
        endurance: the endurance tests in numbers (`EnduranceBook.to_json`).
        setpoints: how late the set-points were that were streamed to the actuator; None where it has a generator.
    """

    campaign: Path
    points: tuple[PointResult, ...]
    valid: int
    total: int
    rig_state: RigState
    stopped_by: str | None
    detail: str
    refused: bool
    wall_s: float
    motion_s: float
    start_temperature_degC: float | None = None
    waits: tuple[Wait, ...] = ()
    findings: tuple[CampaignFinding, ...] = ()
    stop: StopReport | None = None
    confirmed: tuple[Mapping[str, str], ...] = ()
    setpoints: Mapping[str, float] | None = None
    endurance: tuple[Mapping[str, Any], ...] = ()

    @property
    def exit_code(self) -> int:
        """The command's exit code before identification: the first that applies of 7, 3, 4, 5, 0."""
        if self.rig_state == RigState.UNKNOWN:
            return EXIT_UNKNOWN_STATE
        if self.refused:
            return EXIT_REFUSED
        if self.stopped_by is not None:
            return EXIT_STOPPED
        return EXIT_DONE if self.valid == self.total else EXIT_NOT_ALL_VALID

    def to_json(self) -> dict[str, Any]:
        """The keys of `rig run --json` that the campaign knows; `fit` and `report` are the caller's."""
        return {
            "campaign": str(self.campaign.resolve()),
            "points": [point.to_json() for point in self.points],
            "valid": self.valid,
            "total": self.total,
            "rig_state": self.rig_state,
            "stopped_by": self.stopped_by,
            "wall_s": self.wall_s,
            "motion_s": self.motion_s,
            "start_temperature_degC": self.start_temperature_degC,
            "waits": [asdict(wait) for wait in self.waits],
            "findings": [finding.to_json() for finding in self.findings],
            "stop": None if self.stop is None else self.stop.to_json(),
            "confirmed": [dict(stop) for stop in self.confirmed],
            "setpoints": None if self.setpoints is None else dict(self.setpoints),
            "endurance": [dict(test) for test in self.endurance],
        }


class Display(Protocol):
    """What the operator sees while a campaign runs; every method returns quickly and raises nothing."""

    def planned(self, plan: Plan) -> None:
        """The plan was accepted; the rig is about to be connected."""

    def phase(self, text: str) -> None:
        """The campaign entered another phase, in words."""

    def progress(self, point_id: str, cycles_done: int, time_left_s: float, live: Mapping[str, float]) -> None:
        """Live numbers, about 10 times a wall second.

        Args:
            point_id: the point that is prepared or runs; empty between points.
            cycles_done: whole cycles done of its program, ramps included.
            time_left_s: estimated wall seconds to the end of the campaign.
            live: last values by name: `position_m`, `force_N`, `current_A`, `coil_temperature_degC` (those known).
        """

    def point_done(self, result: PointResult) -> None:
        """A point's file was written and judged (or the point was lost)."""

    def message(self, level: str, text: str) -> None:
        """Something the operator should read; `level` is `info`, `warning` or `error`."""
