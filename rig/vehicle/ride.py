"""The ride study: the same car on the same road with every damper, what differs, and how sure that difference is."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.errors import RigError
from rig.vehicle.car import Car
from rig.vehicle.fitted_damper import FittedDamper
from rig.vehicle.laws import Control
from rig.vehicle.motion import CornerDamper, DrivenCar, Ride
from rig.vehicle.response import BANDS, Response, difference_dB, figures, response
from rig.vehicle.road import Road
from rig.vehicle.structure import Structure, structure

PHASES = {"in phase": 0.0, "antiphase": 180.0}
STEPS_S = (1e-3, 5e-4, 2.5e-4, 1.25e-4)
CLOSE_dB = 0.1
SAME_SHARE = 0.01
"""A step is small enough where half of it changes no response by more dB, or no motion's RMS by a larger share."""
COVERED = (2.5, 97.5)
"""Percentiles of a 95 % interval."""
FEWEST_DRAWS = 8
HIGHEST_M = 10.0
"""Heave of a car that no longer drives."""
SPEEDS_m_s = np.geomspace(0.01, 3.0, 26)
"""Of a damper's rod, at which it is looked at whether its force drives."""


class NotComparable(RigError):
    """What was asked for cannot be compared on this car."""

    exit_code = 2
    slug = "ride"


@dataclass(frozen=True)
class Variant:
    """One damper under one law.

    Attributes:
        name: for people and as key of the answer.
        fit: the damper, its draws.
        control: what commands its coils.
    """

    name: str
    fit: FittedDamper
    control: Control


@dataclass(frozen=True)
class Driven:
    """What one variant did on the road with one phase: the best values first, then the draws."""

    responses: tuple[Response, ...]
    numbers: tuple[dict[str, float], ...]
    ride: Ride


@dataclass(frozen=True)
class RideStudy:
    """All variants on all phases.

    Attributes:
        car, road: what was driven.
        own: the car's equations.
        step_s: of the integration.
        variants: what was compared.
        driven: by phase ("chosen", and of a sweep "in phase", "antiphase") and variant's name.
        step_close: half the step changes nothing that matters; False where the smallest step was not small enough.
    """

    car: Car
    road: Road
    own: Structure
    step_s: float
    variants: tuple[Variant, ...]
    driven: dict[str, dict[str, Driven]] = field(repr=False)
    step_close: bool = True

    def pairs(self) -> list[tuple[str, str]]:
        """Names of every two variants."""
        return list(itertools.combinations([variant.name for variant in self.variants], 2))

    def difference(
        self, phase: str, motion: str, band: str, pair: tuple[str, str]
    ) -> tuple[float, tuple[float, float] | None] | None:
        """Largest difference (dB) of two variants in a band and its 95 % interval; None: that motion is not excited.

        The interval is None where neither has draws. A draw of one is compared with a draw of the other.
        """
        one, other = (self.driven[phase][name].responses for name in pair)
        best = difference_dB(one[0], other[0], motion, BANDS[band])
        if best is None:
            return None
        count = max(len(one), len(other)) - 1
        if count < FEWEST_DRAWS:
            return best, None
        drawn = [
            difference_dB(_of(one, index), _of(other, index), motion, BANDS[band]) for index in range(1, count + 1)
        ]
        low, high = np.percentile([value for value in drawn if value is not None], COVERED)
        return best, (float(min(low, best)), float(max(high, best)))

    def beyond(self, variant: str) -> dict[str, float] | None:
        """Share of the time for which a damper was beyond its fit's tests, by quantity; None: they are not known.

        Of all dampers of the car together, on the road where that was longest; empty: nowhere.
        """
        covered = next(one.fit.covered for one in self.variants if one.name == variant)
        if covered is None:
            return None
        shares: dict[str, float] = {}
        for by_name in self.driven.values():
            ride = by_name[variant].ride
            values = {"displacement_m": ride.extension_m, "velocity_m_s": ride.speed_m_s, "current_A": ride.current_A}
            for name, where in covered.outside(values).items():
                shares[name] = max(shares.get(name, 0.0), float(np.mean(np.any(where, axis=1))))
        return shares

    def number(self, variant: str, name: str) -> tuple[float, tuple[float, float] | None]:
        """One of `response.figures` on the chosen phase, and its 95 % interval (None: no draws)."""
        values = [numbers[name] for numbers in self.driven["chosen"][variant].numbers]
        if len(values) - 1 < FEWEST_DRAWS:
            return values[0], None
        low, high = np.percentile(values[1:], COVERED)
        return values[0], (float(min(low, values[0])), float(max(high, values[0])))


def _of(responses: Sequence[Response], index: int) -> Response:
    return responses[index] if len(responses) > index else responses[0]


def ride_study(
    car: Car, road: Road, fits: Sequence[FittedDamper], controls: Sequence[Control],
    on_progress: Callable[[int, int], None] | None = None, threads: int | None = None,
) -> RideStudy:
    """Drive every damper under every law, with all its draws, over the road; of a sweep in phase and antiphase too.

    Args:
        car: the car.
        road: the road.
        fits: dampers, one at least.
        controls: laws, one at least.
        on_progress: told (rides done, of how many).
        threads: rides at a time; None: one a core.

    Raises:
        NotComparable: no damper, two variants of one name, or a damper with which the car swings up without end.
    """
    variants = _variants(fits, controls)
    own = structure(car)
    roads = {"chosen": road}
    if road.sweep is not None and car.kind == "full":
        roads |= {name: road.with_phase(phase) for name, phase in PHASES.items()}
    step_s, close = _step(own, road, variants)
    under = {phase: given.under(car, step_s) for phase, given in roads.items()}
    jobs = [
        (phase, variant, damper)
        for phase in roads for variant in variants for damper in (variant.fit.damper, *variant.fit.draws)
    ]  # fmt: skip
    done: list[tuple[Response, dict[str, float], Ride | None]] = []

    def drive(job: tuple[str, Variant, CornerDamper]) -> tuple[Response, dict[str, float], Ride | None]:
        phase, variant, damper = job
        _, height_m, rate_m_s = under[phase]
        ride = _driven(own, variant, damper, (height_m, rate_m_s), step_s)
        kept = ride if damper is variant.fit.damper else None
        return response(ride, own.body, height_m[:, 0]), figures(ride, own), kept

    with ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        for result in pool.map(drive, jobs):
            done.append(result)
            if on_progress is not None:
                on_progress(len(done), len(jobs))
    return RideStudy(car, road, own, step_s, variants, _sorted(jobs, done), close)


def _driven(
    own: Structure, variant: Variant, damper: CornerDamper, under: tuple[FloatArray, FloatArray], step_s: float
) -> Ride:
    """The ride over the heights (m) and their rates (m/s) under the wheels, if the car comes through it.

    Raises:
        NotComparable: it swings up without end; where the damper drives, and what to do.
    """
    ride = DrivenCar(own, damper, control=variant.control).drive(*under, step_s)
    if float(np.max(np.abs(ride.place[:, 0]))) < HIGHEST_M:
        return ride
    drawn = damper is not variant.fit.damper
    which = "a Monte Carlo sample of the fit" if drawn else "this damper"
    raise NotComparable(
        f"{variant.name}: the motion of the car grows without bound (heave more than {HIGHEST_M:g} m): {which} adds "
        f"energy{_driving(damper, variant.control)}. Fix: use {'--members 0 (no Monte Carlo samples), ' * drawn}tests "
        "at the speeds and currents of the ride, or a model whose damping is never negative (`rig identify RUN "
        "--model sprung_bouc_wen`)"
    )


def _driving(damper: CornerDamper, control: Control) -> str:
    """From which speed on its force drives the rod, at the current where that is slowest."""
    values = {**damper.values, "eta": 1.0} if "eta" in damper.model.names else damper.values
    worst: tuple[float, float] | None = None
    for current_A in sorted({0.0, control.current_A, control.most_A}):
        halves = damper.model.force_at(values, SPEEDS_m_s, current_A) - damper.model.force_at(
            values, -SPEEDS_m_s, current_A
        )
        driving = np.flatnonzero(halves < 0.0)
        if driving.size and (worst is None or SPEEDS_m_s[driving[0]] < worst[0]):
            worst = float(SPEEDS_m_s[driving[0]]), current_A
    return "" if worst is None else f" (the damper force drives the rod at {worst[0]:.2g} m/s and {worst[1]:g} A)"


def _sorted(
    jobs: Sequence[tuple[str, Variant, CornerDamper]],
    done: Sequence[tuple[Response, dict[str, float], Ride | None]],
) -> dict[str, dict[str, Driven]]:
    driven: dict[str, dict[str, Driven]] = {}
    groups = itertools.groupby(zip(jobs, done, strict=True), key=lambda entry: (entry[0][0], entry[0][1].name))
    for (phase, name), group in groups:
        responses, numbers, rides = zip(*(result for _, result in group), strict=True)
        driven.setdefault(phase, {})[name] = Driven(responses, numbers, rides[0])
    return driven


def _variants(fits: Sequence[FittedDamper], controls: Sequence[Control]) -> tuple[Variant, ...]:
    several = len(controls) > 1
    made = tuple(
        Variant(f"{fit.name} ({control.law})" if several else fit.name, fit, control)
        for fit in fits for control in controls
    )  # fmt: skip
    names = [variant.name for variant in made]
    twice = sorted({name for name in names if names.count(name) > 1})
    if not made or twice:
        raise NotComparable(f"{', '.join(twice)}: given twice. Fix: remove one" if made else "no fit to simulate")
    return made


def _step(own: Structure, road: Road, variants: Sequence[Variant]) -> tuple[float, bool]:
    """The largest step (s) of which half changes no response, and whether there is one."""

    def tried(step_s: float) -> list[tuple[Response, FloatArray]]:
        _, height_m, rate_m_s = road.under(own.car, step_s)
        rides = [
            _driven(own, variant, variant.fit.damper, (height_m, rate_m_s), step_s) for variant in variants
        ]
        count = len(own.body)
        return [
            (response(ride, own.body, height_m[:, 0]), np.sqrt(np.mean(ride.acceleration[:, :count] ** 2, axis=0)))
            for ride in rides
        ]

    last = tried(STEPS_S[0])
    for step_s, finer_s in itertools.pairwise(STEPS_S):
        finer = tried(finer_s)
        if all(_close(one, other, own.body) for one, other in zip(last, finer, strict=True)):
            return step_s, True
        last = finer
    return STEPS_S[-1], False


def _close(one: tuple[Response, FloatArray], other: tuple[Response, FloatArray], body: tuple[str, ...]) -> bool:
    apart = [difference_dB(one[0], other[0], motion, BANDS["4-8 Hz"]) for motion in body]
    if any(value is not None and value > CLOSE_dB for value in apart):
        return False
    return bool(np.all(np.abs(one[1] - other[1]) <= SAME_SHARE * np.maximum(other[1], 1e-12)))
