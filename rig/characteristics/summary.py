"""All characteristics of a run: every valid loop, the comparison over currents, the special tests."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rig.characteristics.friction import FrictionTest, friction_of
from rig.characteristics.loop import LoopCharacteristics, characterise_loop
from rig.errors import RigError
from rig.identification.current_lag import CurrentLag, lag_of
from rig.identification.measurement import Measurement
from rig.identification.preparation import prepare
from rig.recording.quality.campaign_delay import pooled_skews
from rig.recording.run import Run


@dataclass(frozen=True)
class DynamicRange:
    """How much more force a current gives than 0 A, in the same motion at peak velocity.

    `rebound` and `jounce` are ratios of force, NaN where the force at peak velocity is not known; `std` is the standard
    uncertainty of the rebound ratio. Force offsets (gas) are taken off both: half the sum of rebound and jounce at 0 A.
    """

    motion: tuple[str, float, float]
    current_A: float
    rebound: float
    jounce: float
    std: float

    def to_json(self) -> dict[str, Any]:
        """Every attribute, the motion spelled out."""
        waveform, amplitude_m, frequency_Hz = self.motion
        ratios = {"rebound": self.rebound, "jounce": self.jounce, "std": self.std}
        return {
            "waveform": waveform,
            "amplitude_m": amplitude_m,
            "frequency_Hz": frequency_Hz,
            "current_A": self.current_A,
            **{name: value if math.isfinite(value) else None for name, value in ratios.items()},
        }


@dataclass(frozen=True)
class Characteristics:
    """What a run says of its damper without a model; `left_out` has a line for each point that does not say it all."""

    loops: tuple[LoopCharacteristics, ...]
    dynamic_range: tuple[DynamicRange, ...]
    friction: tuple[FrictionTest, ...]
    lag: CurrentLag | None
    left_out: tuple[str, ...]

    @property
    def signature(self) -> tuple[LoopCharacteristics, ...]:
        """The loops at 0 A, by peak speed: the damper as it is without its coil."""
        return tuple(sorted((x for x in self.loops if x.current_A == 0.0), key=lambda loop: loop.peak_speed_m_s))

    def to_json(self) -> dict[str, Any]:
        """Plain types; the keys are in `docs/json.md`."""
        lag = self.lag
        return {
            "loops": [loop.to_json() for loop in self.loops],
            "signature": [loop.id for loop in self.signature],
            "dynamic_range": [each.to_json() for each in self.dynamic_range],
            "friction": [each.to_json() for each in self.friction],
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
            "left_out": list(self.left_out),
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
    left_out = []
    for point in run.points:
        if point.verdict == "invalid":
            left_out.append(f"{point.id}: invalid")
            continue
        try:
            if point.kind == "loop":
                measured = known.get(point.id) or prepare(point, skews.get(point.id))
                loops.append(characterise_loop(point, measured))
                left_out += _unknown(loops[-1])
            elif point.kind == "friction":
                friction.append(friction_of(point))
        except RigError as error:
            left_out.append(f"{point.id}: {error}")
    lag, refused = lag_of(run.usable)
    return Characteristics(tuple(loops), tuple(dynamic_range(loops)), tuple(friction), lag, (*left_out, *refused))


def _unknown(loop: LoopCharacteristics) -> list[str]:
    """What of a loop is not known, in words."""
    values = {
        "force at peak velocity in rebound": loop.rebound_N,
        "force at peak velocity in jounce": loop.jounce_N,
        "energy per cycle and equivalent damping": loop.energy_J,
    }
    names = [name for name, each in values.items() if not math.isfinite(each.value)]
    return [f"{loop.id}: {', '.join(names)}: no force samples over a stretch of every cycle"] if names else []


def dynamic_range(loops: Sequence[LoopCharacteristics]) -> list[DynamicRange]:
    """Every loop with current and a known peak force against the one at 0 A with the same motion."""
    passive = {loop.motion: loop for loop in loops if loop.current_A == 0.0}
    ranges = []
    for loop in sorted(loops, key=lambda each: (each.motion, each.current_A)):
        rest = passive.get(loop.motion)
        if rest is None or loop.current_A == 0.0:
            continue
        gas_N = 0.5 * (rest.rebound_N.value + rest.jounce_N.value)
        rebound_N, jounce_N = rest.rebound_N.value - gas_N, rest.jounce_N.value - gas_N
        if not (rebound_N > 0.0 > jounce_N):
            continue
        if math.isnan(loop.rebound_N.value) and math.isnan(loop.jounce_N.value):
            continue
        ratio = (loop.rebound_N.value - gas_N) / rebound_N
        std = math.hypot(loop.rebound_N.std / rebound_N, ratio * rest.rebound_N.std / rebound_N)
        ranges.append(DynamicRange(loop.motion, loop.current_A, ratio, (loop.jounce_N.value - gas_N) / jounce_N, std))
    return ranges
