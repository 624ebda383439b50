"""The expected damper (`[specimen] prior`): a parameter set by its name, or a fit in the folder of the matrix file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rig.dampers import DamperModel, model, parameter_set
from rig.dampers.covered import BEYOND, LEAST
from rig.fits.entries import TestedRange
from rig.fits.fit_record import FitRecord
from rig.signals.force_motion import force_error
from rig.signals.force_target import SpeedOfForce
from rig.signals.record import STEP_S, Record, between_ramps
from rig.test_point import TestPoint

if TYPE_CHECKING:  # it loads the compiler
    from rig.vehicle.motion import CornerDamper

ENDING = ".json"
SPEED_M_S = 0.1
"""Of the damper's rod, at which a law's currents are compared."""
INVERSE_M_S, INVERSE_ROWS, INVERSE_BEND = 3.0, 1001, 8.0
"""Highest speed of the inverse, and its rows, which are close to each other at low speeds."""
LEAST_RISE_N = 1e-6
"""Between two rows: the inverse of a force that does not rise is not defined."""
LEAST_RISE = 0.02
"""Of the force at that speed, by which the most current has to raise it."""


@dataclass(frozen=True)
class AssumedDamper:
    """A damper with known parameters; two are the same where name or content are.

    Attributes:
        key: name of the parameter set, or SHA-256 (hex) of the fit's file.
        description: which one, for people.
        model: its force.
        values: complete parameters, SI.
        fit: the fit; None for a set.
    """

    key: str
    description: str = field(compare=False)
    model: DamperModel = field(compare=False)
    values: Mapping[str, float] = field(compare=False)
    fit: FitRecord | None = field(compare=False, default=None)

    @property
    def corner(self) -> CornerDamper:
        """The same as the damper of a car."""
        from rig.vehicle.motion import CornerDamper  # loads numba and pydantic

        return CornerDamper(self.model, dict(self.values))

    def rise_N(self, most_A: float) -> tuple[float, float]:
        """Force (N) at `SPEED_M_S` without current, and how much more it is with `most_A`; of both ways the lesser."""
        ways = []
        for way in (1.0, -1.0):
            none_N, most_N = (
                way * float(self.model.force_at(self.values, way * SPEED_M_S, current_A)) for current_A in (0.0, most_A)
            )
            ways.append((none_N, most_N - none_N))
        return min(ways, key=lambda pair: pair[1])

    def speed_of_force(self, current_A: float) -> SpeedOfForce:
        """Inverse of the force on the sliding branch at a constant current; friction and hysteresis are not in it."""
        share = np.linspace(-1.0, 1.0, INVERSE_ROWS)
        speed_m_s = INVERSE_M_S * np.sinh(INVERSE_BEND * share) / math.sinh(INVERSE_BEND)
        force_N = np.asarray(self.model.force_at(self.values, speed_m_s, current_A), np.float64)
        rising_N = np.maximum.accumulate(force_N) + LEAST_RISE_N * np.arange(INVERSE_ROWS)
        return SpeedOfForce(rising_N, speed_m_s)

    def with_forecast(self, record: Record, current_A: float) -> Record:
        """The record of a force target with the error that it has with this damper; any other as it is."""
        target = record.force
        if target is None:
            return record
        motion = record.motion(record.amplitude_m)
        force_N = np.asarray(self.model.force(self.values, *motion, current_A, STEP_S), np.float64)
        inside = between_ramps(record, len(force_N))
        error = force_error(target.force_N[inside], force_N[inside])
        return replace(record, force=replace(target, forecast_error=error))

    @property
    def eta_1_s(self) -> float | None:
        """Rate of the coil's lag (1/s); None where neither the parameter set nor the fit determines it."""
        return self.values.get("eta") if self.fit is None else self.fit.corrections.coil_eta_1_s

    def hints(self, points: Iterable[TestPoint]) -> tuple[str, ...]:
        """What a reader of a forecast has to know of a fit: that it is rough, or used beyond its tests."""
        if self.fit is None:
            return ()
        hints = [*self._extrapolated(self.fit.tested, tuple(points))]
        if self.fit.adequate is False:
            hints.append(
                f"{self.description} does not fit its own tests within measurement noise; forecasts contain this "
                "error as well"
            )
        if self.fit.temperature is not None:
            hints.append(f"{self.description}: forecast at a constant damper temperature, "
                f"{self.fit.temperature.reference_degC:.4g} degC")
        return tuple(hints)

    def _extrapolated(self, tested: TestedRange | None, points: tuple[TestPoint, ...]) -> Iterator[str]:
        ranges = {} if tested is None else dict(tested.ranges())
        reached = {
            "displacement_m": (max((point.amplitude_m for point in points), default=0.0), "m"),
            "velocity_m_s": (max((point.peak_speed_m_s for point in points), default=0.0), "m/s"),
            "current_A": (max((point.current_A for point in points), default=0.0), "A"),
        }
        for name, (most, unit) in reached.items():
            ends = ranges.get(name)
            largest = math.inf if ends is None else max(map(abs, ends))
            if most > (1.0 + BEYOND) * largest + LEAST.get(name, 0.0):
                yield (
                    f"{self.description} was fitted to tests up to {largest:.3g} {unit}; the points reach {most:.3g} "
                    f"{unit}, so their forces are extrapolated"
                )


def is_fit_file(prior: object) -> bool:
    """Whether a prior is the name of a fit's file, and not of a parameter set."""
    return isinstance(prior, str) and prior.casefold().endswith(ENDING)


def of_set(name: str) -> AssumedDamper:
    """The damper of a parameter set.

    Raises:
        UnknownName: there is no such set.
    """
    known = parameter_set(name)
    return AssumedDamper(
        name, f"the parameter set {name}", model(known.model, "printed" if known.hysteresis == "printed" else "kwok"),
        known.values,
    )


def of_fit(path: Path) -> AssumedDamper:
    """The damper of a fit.

    Raises:
        FileProblem: it is no fit, or not one with a value of every parameter.
    """
    fit = FitRecord.load(path)
    return AssumedDamper(fit.sha256, f"the fit {path.name}", *fit.known_damper(), fit)
