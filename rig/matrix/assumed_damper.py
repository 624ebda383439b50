"""What is assumed of the specimen (`[specimen] prior`): a parameter set by its name, or a fit beside the file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.dampers import DamperModel, model, parameter_set
from rig.dampers.covered import BEYOND, LEAST
from rig.matrix.point import TestPoint
from rig.vehicle.fit_values import fit_values

if TYPE_CHECKING:  # it loads the compiler
    from rig.vehicle.motion import CornerDamper

ENDING = ".json"
SPEED_M_S = 0.1
"""Of the damper's rod, at which a law's currents are compared."""
LEAST_RISE = 0.02
"""Of the force at that speed, by which the most current has to raise it."""


@dataclass(frozen=True)
class AssumedDamper:
    """A damper with known parameters; two are the same where name or content are.

    Attributes:
        key: name of the parameter set, or SHA-256 (hex) of the fit's file.
        told: which one, for people.
        model: its force.
        values: complete parameters, SI.
        content: of the fit's file; empty for a set.
    """

    key: str
    told: str = field(compare=False)
    model: DamperModel = field(compare=False)
    values: Mapping[str, float] = field(compare=False)
    content: Mapping[str, Any] = field(compare=False, default_factory=dict)

    @property
    def corner(self) -> CornerDamper:
        """The same as the damper of a car."""
        from rig.vehicle.motion import CornerDamper

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

    def hints(self, points: Iterable[TestPoint]) -> tuple[str, ...]:
        """What a reader of a forecast has to know of a fit: that it is rough, or asked beyond its tests."""
        if not self.content:
            return ()
        hints = [*self._extrapolated(tuple(points))]
        if self.content.get("adequate") is False:
            hints.append(f"{self.told} does not describe its own tests to their noise: forecasts are as rough")
        warmth = self.content.get("temperature")
        reference_degC = warmth.get("reference_degC") if isinstance(warmth, Mapping) else None
        if isinstance(reference_degC, (int, float)):
            hints.append(f"{self.told} is forecast at {reference_degC:.4g} degC all the time")
        return tuple(hints)

    def _extrapolated(self, points: tuple[TestPoint, ...]) -> Iterator[str]:
        asked = {
            "displacement_m": (max((point.amplitude_m for point in points), default=0.0), "m"),
            "velocity_m_s": (max((point.peak_speed_m_s for point in points), default=0.0), "m/s"),
            "current_A": (max((point.current_A for point in points), default=0.0), "A"),
        }
        for name, (most, unit) in asked.items():
            tested = _tested_most(self.content.get("tested"), name)
            if most > (1.0 + BEYOND) * tested + LEAST.get(name, 0.0):
                yield (
                    f"{self.told} was fitted to tests of up to {tested:.3g} {unit}, and the points reach "
                    f"{most:.3g} {unit}: forces beyond are extrapolated"
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
        FileProblem: see `fit_values`.
    """
    fit = fit_values(path)
    return AssumedDamper(fit.sha256, f"the fit {path.name}", fit.model, fit.values, fit.content)


def _tested_most(tested: object, name: str) -> float:
    """The largest magnitude of a quantity in a fit's tests; infinite where the file does not say."""
    ends = tested.get(name) if isinstance(tested, Mapping) else None
    if isinstance(ends, (list, tuple)) and ends and all(isinstance(end, (int, float)) for end in ends):
        return max(abs(float(end)) for end in ends)
    return math.inf
