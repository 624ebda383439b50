"""All characteristics of a run: every valid loop, the comparison over currents, the special tests.

Gas force and friction come from a slow triangle without current.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rig.characteristics.cached_loop import cached_loop
from rig.characteristics.force_table import ForceTable, force_tables
from rig.characteristics.loop import (
    MIDDLE,
    LoopCharacteristics,
    Measured,
    over_cycles,
    without_cut_ends,
)
from rig.errors import IdentificationFailed, RigError, evaluating, some
from rig.fits.plain import plain
from rig.identification.models.measurement import Measurement
from rig.identification.points.current_steps import CurrentLag, lag_of
from rig.identification.points.preparation import prepare
from rig.identification.points.response_steps import ResponseTest, response_tests
from rig.recording.quality.campaign_delay import pooled_skews
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run
from rig.signals.arrays import FloatArray
from rig.signals.cycles import find_cycles, full_cycles
from rig.signals.test_set import MOTION_SHARE, TestSet, are_separable
from rig.test_point import LOOP, RESPONSE

FEWEST_SAMPLES = 10
SHOWN = 4
"""Most tests listed in a remark."""
DOUBTS = frozenset({"few-cycles", "no-repeat", "one-cycle-no-series", "time-errors"})
"""Warnings of a test's preparation that its standard values are to be read with."""


@dataclass(frozen=True)
class DynamicRange:
    """How much more force a current gives than 0 A, in the same motion at peak velocity.

    `id` is the loop with current. `rebound` and `jounce` are ratios of force, NaN where the force at peak velocity is
    not known; `std` is the standard uncertainty of the rebound ratio. Force offsets (gas) are taken off both: half the
    sum of rebound and jounce at 0 A.
    """

    motion: tuple[str, float, float]
    current_A: float
    rebound: float
    jounce: float
    std: float
    id: str = ""

    def to_json(self) -> dict[str, Any]:
        """Every attribute, the motion spelled out."""
        waveform, amplitude_m, frequency_Hz = self.motion
        ratios = {"rebound": self.rebound, "jounce": self.jounce, "std": self.std}
        return {
            "waveform": waveform,
            "amplitude_m": amplitude_m,
            "frequency_Hz": frequency_Hz,
            "current_A": self.current_A,
            "id": self.id,
            **{name: value if math.isfinite(value) else None for name, value in ratios.items()},
        }


@dataclass(frozen=True)
class Characteristics:
    """What a run says of its damper without a model.

    `left_out` has a line for each point that does not say it all, `remarks` one for what makes its values doubtful;
    `response_left_out` a line for each response point that cannot be used, or not all of it.
    """

    loops: tuple[LoopCharacteristics, ...]
    dynamic_range: tuple[DynamicRange, ...]
    friction: tuple[FrictionTest, ...]
    lag: CurrentLag | None
    left_out: tuple[str, ...]
    remarks: tuple[str, ...] = ()
    groups: TestSet | None = None
    response: tuple[ResponseTest, ...] = ()
    response_left_out: tuple[str, ...] = ()

    @property
    def signature(self) -> tuple[LoopCharacteristics, ...]:
        """The loops at 0 A, by peak speed: the damper as it is without its coil."""
        return tuple(sorted((x for x in self.loops if x.level_A == 0.0), key=lambda loop: loop.peak_speed_m_s))

    @property
    def force_tables(self) -> tuple[ForceTable, ...]:
        """Force over velocity, a table for each waveform (PVP, constant velocity)."""
        return force_tables(self.loops)

    def to_json(self) -> dict[str, Any]:
        """Plain types; the keys are in `docs/json.md`."""
        lag = self.lag
        return {
            "loops": [loop.to_json() for loop in self.loops],
            "force_tables": [table.to_json() for table in self.force_tables],
            "signature": [loop.id for loop in self.signature],
            "dynamic_range": [value.to_json() for value in self.dynamic_range],
            "friction": [value.to_json() for value in self.friction],
            "lag": None
            if lag is None
            else {
                "eta_1_s": lag.eta_1_s,
                "low": lag.interval_1_s[0],
                "high": lag.interval_1_s[1],
                "delay_s": lag.delay_s,
                "rmse_A": lag.rmse_A,
                "steps": lag.steps,
            },
            "response": [test.to_json() for test in self.response],
            "response_left_out": list(self.response_left_out),
            "left_out": list(self.left_out),
            "remarks": list(self.remarks),
            "test_set": None if self.groups is None else plain(self.groups.summary),
        }


def characterise(run: Run, prepared: Mapping[str, Measurement] | None = None) -> Characteristics:
    """Measure every valid or suspect point of a run; what cannot be measured is named.

    Args:
        run: the run.
        prepared: measurements already made of its points, by id; None: made here, with one skew for all points.
    """
    known = {} if prepared is None else prepared
    skews = pooled_skews(run.usable) if prepared is None else {}
    loops: list[LoopCharacteristics] = []
    friction: list[FrictionTest] = []
    left_out, remarks = [*run.unreadable], []
    for point in run.points:
        if point.kind == RESPONSE or point.after_cycles:
            continue  # these have sections of their own in the report
        if point.verdict == "invalid":
            left_out.append(f"{point.id}: invalid")
            continue
        try:
            with evaluating("it"):
                if point.kind == LOOP:
                    measured = known.get(point.id) or prepare(point, skews.get(point.id))
                    whole, ends_cut = without_cut_ends(measured)
                    loops.append(cached_loop(point, whole))
                    remarks += [f"{point.id}: {warning}" for warning in measured.warnings if warning.slug in DOUBTS]
                    left_out += [*_unknown(loops[-1]), *(f"{point.id}: {end}" for end in ends_cut)]
                elif point.kind == "friction":
                    friction.append(friction_of(point))
        except RigError as error:
            left_out.append(f"{point.id}: {error}")
    response, response_left_out = response_tests(run.points)
    lag, refused = lag_of(run.usable, response)
    placed, groups = _placed(loops)
    remarks += _merged(loops, groups)
    return Characteristics(
        placed, tuple(dynamic_range(placed)), tuple(friction), lag, (*left_out, *refused), tuple(remarks),
        groups if loops else None, response, tuple(response_left_out),
    )  # fmt: skip


def _merged(loops: Sequence[LoopCharacteristics], groups: TestSet) -> Iterator[str]:
    """Remarks on tests of one motion whose measured frequencies can be separated: repeats, or two tested motions."""
    motions = groups.motions
    for number in range(len(motions)):
        members = [loops[k] for k in motions.members(number) if loops[k].motion_read.requested is None]
        values = [loop.motion_read.frequency_Hz for loop in members if math.isfinite(loop.motion_read.frequency_Hz)]
        if values and are_separable(min(values), max(values), max(one.motion_read.frequency_std_Hz for one in members)):
            yield (
                f"{some([loop.id for loop in members], most=SHOWN)}: frequencies of "
                f"{min(values):.4g} to {max(values):.4g} Hz are evaluated as repeats of one motion, because they "
                f"differ by less than {100 * MOTION_SHARE:.0f} %"
            )


def _placed(loops: Sequence[LoopCharacteristics]) -> tuple[tuple[LoopCharacteristics, ...], TestSet]:
    """The loops with the level of current and the motion to which each belongs; a level without current is 0 A."""
    groups = TestSet.of([loop.current for loop in loops], [loop.motion_read for loop in loops])
    levels, motions = groups.currents, groups.motions
    placed = []
    for number, loop in enumerate(loops):
        level = levels.of_test[number]
        level_A = loop.current_A if level is None else 0.0 if level == levels.zero else levels.names_A[level]
        group = motions.motions[motions.of_test[number]].nominal
        placed.append(replace(loop, level_A=level_A, group=group, amplitude_level_m=motions.amplitude_m(number)))
    return tuple(placed), groups


def _unknown(loop: LoopCharacteristics) -> list[str]:
    """What of a loop is not known, in words."""
    values = {
        "force at peak velocity in rebound": loop.rebound_N,
        "force at peak velocity in compression": loop.jounce_N,
        "energy per cycle and equivalent damping": loop.energy_J,
    }
    names = [name for name, measured in values.items() if not math.isfinite(measured.value)]
    return [f"{loop.id}: {', '.join(names)}: force samples are missing in part of every cycle"] if names else []


def dynamic_range(loops: Sequence[LoopCharacteristics]) -> list[DynamicRange]:
    """Every loop with current and a known peak force against the one at 0 A with the same motion."""
    placed = _placed(loops)[0]
    passive = {loop.motion: loop for loop in placed if loop.level_A == 0.0}
    ranges = []
    for loop in sorted(
        placed, key=lambda loop: (loop.waveform, loop.amplitude_level_m, loop.group[1], loop.level_A)
    ):  # fmt: skip
        rest = passive.get(loop.motion)
        if rest is None or loop.level_A == 0.0:
            continue
        gas_N = 0.5 * (rest.rebound_N.value + rest.jounce_N.value)
        rebound_N, jounce_N = rest.rebound_N.value - gas_N, rest.jounce_N.value - gas_N
        if not (rebound_N > 0.0 > jounce_N):
            continue
        if math.isnan(loop.rebound_N.value) and math.isnan(loop.jounce_N.value):
            continue
        ratio = (loop.rebound_N.value - gas_N) / rebound_N
        std = math.hypot(loop.rebound_N.std / rebound_N, ratio * rest.rebound_N.std / rebound_N)
        jounce = (loop.jounce_N.value - gas_N) / jounce_N
        ranges.append(DynamicRange(loop.motion, loop.level_A, ratio, jounce, std, loop.id))
    return ranges


@dataclass(frozen=True)
class FrictionTest:
    """What one slow test shows.

    Attributes:
        id: of the point.
        speed_m_s: mean slope of the measured flanks between the reversals, m/s.
        gas_force_N: half the sum of the forces up and down about mid-stroke, N, positive when it pulls the rod in.
        friction_N: half their difference, N.
        stiffness_N_m: slope of the mean force over displacement (a gas spring's), N/m.
    """

    id: str
    speed_m_s: float
    gas_force_N: Measured
    friction_N: Measured
    stiffness_N_m: Measured

    def to_json(self) -> dict[str, Any]:
        """Every attribute; measured ones as objects."""
        return {name: value.to_json() if isinstance(value, Measured) else value for name, value in vars(self).items()}


def friction_of(point: RecordedPoint) -> FrictionTest:
    """Evaluate a friction point.

    Raises:
        NoCycles: there is no whole cycle.
        IdentificationFailed: too few samples between the reversals.
    """
    cycles = full_cycles(find_cycles(point.time_s, point.displacement_m))
    half_m = MIDDLE * float(np.median(cycles.amplitude_m))
    gas, friction, stiffness, speeds = [], [], [], []
    for start_s, stop_s in itertools.pairwise(cycles.start_s):
        inside = (point.time_s >= start_s) & (point.time_s < stop_s)
        t, u, force = point.time_s[inside], point.displacement_m[inside] - cycles.mean_m, point.force_N[inside]
        top_s, bottom_s = _reversals(t, u, half_m)
        good = (np.abs(u) <= half_m) & np.isfinite(force)
        falling = (t > top_s) & (t < bottom_s)
        up, down = good & ~falling, good & falling
        if min(np.count_nonzero(up), np.count_nonzero(down)) < FEWEST_SAMPLES:
            raise IdentificationFailed(f"{point.id}: fewer than {FEWEST_SAMPLES} samples between the reversals")
        # The rise after the bottom belongs before the one that the cycle begins in the middle of: one straight flank.
        flank_s = np.where(t >= bottom_s, t - (stop_s - start_s), t) - start_s
        extending, compressing = (np.polyfit(u[part], force[part], 1) for part in (up, down))
        gas.append(0.5 * float(extending[1] + compressing[1]))
        friction.append(0.5 * float(extending[1] - compressing[1]))
        stiffness.append(0.5 * float(extending[0] + compressing[0]))
        rise, fall = (float(np.polyfit(flank_s[part], u[part], 1)[0]) for part in (up, down))
        speeds.append(0.5 * (rise - fall))
    speed_m_s = float(np.mean(speeds)) if speeds else math.nan
    return FrictionTest(point.id, speed_m_s, over_cycles(gas), over_cycles(friction), over_cycles(stiffness))


def _reversals(t: FloatArray, u: FloatArray, beyond_m: float) -> tuple[float, float]:
    """When a cycle turns at its top and at its bottom (s): the middle of the times spent beyond `beyond_m`.

    The noise of a single sample, whose derivative grows with the sampling rate, has no say in the direction.

    Raises:
        IdentificationFailed: no sample lies beyond.
    """
    above, below = t[u > beyond_m], t[u < -beyond_m]
    if above.size == 0 or below.size == 0:
        raise IdentificationFailed("a cycle of the friction test has no samples near its reversals")
    return float(np.mean(above)), float(np.mean(below))
