"""Whether load cell and LVDT agree with the controller's own force and position inputs: values in, reasons out.

Every point's sensor is fitted to the controller's input: `sensor = gain input + offset`, the sensor delayed by a lag.
If the two differ by more than instruments of their class may, one of them is wrong; the file cannot determine which, so
both are named and the bench is the cause. A single weak point is not conclusive: all points of one set of instruments
are pooled, and what only all combined show is reported for each of them. A zero that changes between the points is
fitted over time (drift) and over the coil current (crosstalk).

A difference counts if it is more than `k` standard deviations, and more than its tolerance and two of them; `k` keeps
the probability of a false alarm in a whole campaign, whatever its size, at `FALSE_ALARM`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import NormalDist
from typing import Literal, NamedTuple

from rig.recording.quality.point_quality import Agreement, Tolerances
from rig.recording.quality.verdict import Kind, Reason
from rig.signals.estimate import Estimate, ZeroChange, ZeroSeen, outlying, pooled, zero_changes

FALSE_ALARM = 1e-3
GROSS = 5.0
"""So many tolerances apart, a point is invalid and no longer only suspect."""
GAIN_FLOOR = 1e-3
"""What no fit of a gain resolves: linearity, filters, the load train (relative, one standard deviation a point)."""
OFFSET_FLOOR = 0.05
"""... and of an offset, as a share of its tolerance."""
LAG_FLOOR_S = 2e-5
COARSE_ZERO = 2.0
"""An offset known worse than its tolerance comes of too few polls in a loop, and so does its error: so much larger."""
WEAK_LAG = 2.0
"""Tolerances beyond which a loop's lag is too uncertain to be asked; alone, one is enough."""
LONE = 1.5
"""A gain or lag that a single loop shows must be so many times more certain: nothing confirms it, and thirty polls of a
coarse input tell its noise, and so the standard deviation, only to an eighth (gain -3.8 +- 0.8 % of a true 0)."""

SLUGS = frozenset({
    "load-cell-gain", "load-cell-zero", "force-input-lag", "lvdt-gain", "lvdt-zero", "position-input-lag",
    "zero-drift", "crosstalk", "zero-change", "current-zero", "coil-temperature",
})
"""Every reason that this judgement gives."""
ZERO_RETURN = "zero-return"
"""A zero that was another one after the session's motion than before; the campaign finds that, not a point."""


@dataclass(frozen=True)
class Checked:
    """One point as this judgement sees it.

    Attributes:
        id: the point's.
        time_s: when it began, on a clock common to the campaign's points.
        current_A: the coil's current.
        force, displacement: load cell and LVDT against the controller's inputs.
        tolerances: what the bench allows.
        current_zero: what the ECU reported at rest with its output stage off (A).
        colder_K: by how much the coil seemed colder than the ECU before the first motion; None: unknown.
    """

    id: str
    time_s: float
    current_A: float
    force: Agreement = field(default_factory=Agreement)
    displacement: Agreement = field(default_factory=Agreement)
    tolerances: Tolerances = field(default_factory=Tolerances)
    current_zero: Estimate | None = None
    colder_K: float | None = None


@dataclass(frozen=True)
class Instruments:
    """Two instruments that measure one quantity, and how differences between them are told.

    Attributes:
        quantity: `force` or `displacement`.
        sensor, reference: their names.
        gain_slug, zero_slug, lag_slug: slugs of what can be wrong.
        unit, scale: in which an offset is shown, and how many of it one SI unit is.
    """

    quantity: Literal["force", "displacement"]
    sensor: str
    reference: str
    gain_slug: str
    zero_slug: str
    lag_slug: str
    unit: str
    scale: float

    def of(self, point: Checked) -> Agreement:
        """How the two agree at one point."""
        return point.force if self.quantity == "force" else point.displacement

    @property
    def zero_tolerance(self) -> str:
        """Name of the tolerance of their zeros."""
        return "force_zero_N" if self.quantity == "force" else "displacement_zero_m"

    @property
    def either(self) -> str:
        """Which of the two is wrong, and what to do."""
        return f"{self.sensor} or {self.reference} is wrong; check both calibrations"


FORCE = Instruments(
    "force", "load cell", "controller's force input", "load-cell-gain", "load-cell-zero", "force-input-lag", "N", 1.0,
)
DISPLACEMENT = Instruments(
    "displacement", "LVDT", "controller's position input", "lvdt-gain", "lvdt-zero", "position-input-lag", "mm", 1e3,
)


def judge(points: Sequence[Checked]) -> dict[str, tuple[Reason, ...]]:
    """What is to be said of each point's instruments, by the point's id; nothing (an empty tuple) where they agree.

    Args:
        points: points measured with one set of instruments; one alone is judged by itself.
    """
    points = trusted(points)
    k = deviations(len(points))
    by_point: dict[str, list[Reason]] = {point.id: [] for point in points}
    for instruments in (FORCE, DISPLACEMENT):
        for compared in (_gains, _zeros, _lags):
            for point_id, reason in compared(instruments, points, k).items():
                by_point[point_id].append(reason)
    for point in points:
        by_point[point.id] += [*_current_zero(point, k), *_coil_temperature(point)]
    for reason in _changes(points, k):
        for reasons in by_point.values():
            reasons.append(reason)
    return {point_id: tuple(reasons) for point_id, reasons in by_point.items()}


def trusted(points: Sequence[Checked]) -> list[Checked]:
    """The points without the comparisons that certainly failed.

    Gain and lag belong to the instruments: where one of them is another one's than at most points, the comparison of
    that point failed as a whole.
    """
    force = _failed([(point.id, point.force) for point in points])
    displacement = _failed([(point.id, point.displacement) for point in points])
    return [
        replace(
            point,
            force=Agreement(declared_s=point.force.declared_s) if point.id in force else point.force,
            displacement=(
                Agreement(declared_s=point.displacement.declared_s) if point.id in displacement else point.displacement
            ),
        )
        for point in points
    ]


def _failed(agreements: Sequence[tuple[str, Agreement]]) -> frozenset[str]:
    gains = {name: agreement.gain.widened(GAIN_FLOOR) for name, agreement in agreements if agreement.gain is not None}
    lags = {name: agreement.lag.widened(LAG_FLOOR_S) for name, agreement in agreements if agreement.lag is not None}
    return outlying(gains) | outlying(lags)


def deviations(points: int) -> float:
    """Standard deviations that no difference of a clean campaign of so many points reaches, but for one in 1,000."""
    comparisons = 8 * max(points, 1) + 8
    return NormalDist().inv_cdf(1.0 - 0.5 * FALSE_ALARM / comparisons)


class _Limit(NamedTuple):
    """Nominal value, tolerance, and the standard deviations that make a difference certain."""

    nominal: float
    tolerance: float
    k: float


def _doubts(
    points: Sequence[Checked], estimates: Mapping[str, Estimate], limit: _Limit,
    reason_of: Callable[[Estimate, str], Reason], *, jumps: bool = False,
) -> dict[str, Reason]:
    """The reason for each doubted point, by its id; every point of the campaign where all together are certain.

    One point alone is doubted by itself, and among others only in what `jumps`, a zero; gain and lag do not jump.
    """
    together, count = pooled(estimates.values()), len(estimates)
    if together is not None and together.beyond(*limit) and (count > 1 or not jumps):
        alone = "this point only" if len(points) == 1 else "from the only conclusive point"
        by = f"{count} points combined" if count > 1 else alone
        return dict.fromkeys((point.id for point in points), reason_of(together, by))
    if not jumps:
        return {}
    return {
        name: reason_of(estimate, "this point only") for name, estimate in estimates.items() if estimate.beyond(*limit)
    }


def _kind(excess: float, tolerance: float) -> Kind:
    return Kind.INVALID if abs(excess) > GROSS * tolerance else Kind.SUSPECT


def _gains(instruments: Instruments, points: Sequence[Checked], k: float) -> dict[str, Reason]:
    tolerance = _least(points, f"{instruments.quantity}_gain")

    def reason_of(gain: Estimate, by: str) -> Reason:
        percent = Estimate(gain.value - 1.0, gain.std).times(100.0)
        return Reason(
            instruments.gain_slug, _kind(percent.value, 100.0 * tolerance),
            f"the sensitivity of the {instruments.sensor} differs by {percent.signed} % from that of the "
            f"{instruments.reference} (allowed {100.0 * tolerance:g} %; {by}): {instruments.either}",
            {"gain": gain.value, "gain_std": gain.std, "tolerance": tolerance},
        )

    agreements = {point.id: instruments.of(point).gain for point in points}
    estimates = {name: gain.widened(GAIN_FLOOR) for name, gain in agreements.items() if gain is not None}
    sure = k if len(estimates) > 1 else LONE * k
    return _doubts(points, estimates, _Limit(1.0, tolerance, sure), reason_of)


def _zeros(instruments: Instruments, points: Sequence[Checked], k: float) -> dict[str, Reason]:
    scale, unit = instruments.scale, instruments.unit
    tolerance = _least(points, instruments.zero_tolerance)

    def reason_of(offset: Estimate, by: str) -> Reason:
        return Reason(
            instruments.zero_slug, _kind(offset.value, tolerance),
            f"{instruments.sensor} reads {offset.times(scale).signed} {unit} when the {instruments.reference} reads 0 "
            f"(allowed {scale * tolerance:.3g} {unit}; {by}): {instruments.either}",
            {"offset": offset.value, "offset_std": offset.std, "tolerance": tolerance},
        )

    agreements = {point.id: instruments.of(point).offset for point in points}
    floor = OFFSET_FLOOR * tolerance
    estimates = {
        name: replace(offset, std=(COARSE_ZERO if offset.std > tolerance else 1.0) * offset.std).widened(floor)
        for name, offset in agreements.items() if offset is not None
    }
    return _doubts(points, estimates, _Limit(0.0, tolerance, k), reason_of, jumps=True)


def _lags(instruments: Instruments, points: Sequence[Checked], k: float) -> dict[str, Reason]:
    """A sensor that is later than its input has a delay that can be seen; one that is earlier disproves the input.

    A loop too weak to tell the lag about as well as it is allowed to be may have matched wrongly: it says nothing.
    """
    agreements = {point.id: instruments.of(point) for point in points}
    tolerance_s = _least(points, "time_s") + max(agreement.declared_s for agreement in agreements.values())

    def reason_of(lag: Estimate, by: str) -> Reason:
        return Reason(
            instruments.lag_slug, _kind(lag.value, tolerance_s),
            f"the {instruments.reference} lags the {instruments.sensor} by {lag.times(-1e3).plain} ms, more than its "
            f"declared delay explains (allowed {1e3 * tolerance_s:.2g} ms; {by}): it is not known which of the two is "
            "wrong",
            {"lag_s": lag.value, "lag_std_s": lag.std, "tolerance_s": tolerance_s},
        )

    estimates = {
        name: agreement.lag.widened(LAG_FLOOR_S) for name, agreement in agreements.items()
        if agreement.lag is not None and agreement.lag.std <= WEAK_LAG * tolerance_s
    }
    if len(estimates) == 1:
        estimates = {name: lag for name, lag in estimates.items() if lag.std <= tolerance_s}
    sure = k if len(estimates) > 1 else LONE * k
    doubted = _doubts(points, estimates, _Limit(0.0, tolerance_s, sure), reason_of)
    return {name: reason for name, reason in doubted.items() if reason.numbers["lag_s"] < 0.0}


def zero_change(points: Sequence[Checked], k: float) -> ZeroChange | None:
    """How the load cell's zero moved against the controller's force input; None where two points do not tell it.

    What the points tell of drift and crosstalk together, unless only one of them alone certainly explains something.
    """
    seen = [
        ZeroSeen(point.time_s, point.current_A, point.force.offset)
        for point in points if point.force.offset is not None
    ]
    tolerance_N = _least(points, "force_zero_change_N")
    changes = zero_changes(seen, OFFSET_FLOOR * tolerance_N)
    return next((change for change in changes if any(change.moved(tolerance_N, k))), changes[0] if changes else None)


def _changes(points: Sequence[Checked], k: float) -> list[Reason]:
    """Whether the load cell's zero moved while the campaign ran."""
    change = zero_change(points, k)
    if change is None:
        return []
    tolerance_N, gross_N = _least(points, "force_zero_change_N"), GROSS * _least(points, "force_zero_N")
    drifted, crossed = change.moved(tolerance_N, k)
    by_time = f"{change.drift_N_s.signed} N/s drift, {change.over_time_N.signed} N during the campaign"
    by_current = (
        f"{change.crosstalk_N_A.signed} N/A crosstalk from the coil current, {change.over_current_N.signed} N over "
        "its range"
    )
    ways = [
        *([("zero-drift", by_time, change.over_time_N)] if drifted else []),
        *([("crosstalk", by_current, change.over_current_N)] if crossed else []),
    ]
    if not change.separable and len(ways) > 1:
        both = f"{by_time}, or {by_current} (the order of the points does not allow the two to be distinguished)"
        largest_N = max(change.over_time_N, change.over_current_N, key=lambda moved_N: abs(moved_N.value))
        ways = [("zero-change", both, largest_N)]
    numbers = {"drift_N_s": change.drift_N_s.value, "crosstalk_N_A": change.crosstalk_N_A.value}
    return [
        Reason(
            slug, Kind.INVALID if abs(over_N.value) > gross_N else Kind.SUSPECT,
            f"the load cell's zero drifts relative to the {FORCE.reference}: {text} (allowed "
            f"{tolerance_N:.3g} N): {FORCE.either}", numbers,
        )
        for slug, text, over_N in ways
    ]


def _current_zero(point: Checked, k: float) -> list[Reason]:
    zero, tolerance_A = point.current_zero, point.tolerances.current_zero_A
    if zero is None or not zero.beyond(0.0, tolerance_A, k):
        return []
    return [Reason(
        "current-zero", _kind(zero.value, tolerance_A),
        f"the ECU reports {zero.times(1e3).signed} mA while its output stage is off (allowed {1e3 * tolerance_A:g} "
        "mA): the measured and the commanded current disagree, and the true coil current has this error at every "
        "set-point",
        {"current_A": zero.value, "tolerance_A": tolerance_A},
    )]


def _coil_temperature(point: Checked) -> list[Reason]:
    if point.colder_K is None or not point.colder_K > point.tolerances.coil_temperature_K:
        return []
    return [Reason(
        "coil-temperature", Kind.SUSPECT,
        f"the coil's temperature sensor reads {point.colder_K:.1f} K lower than the ECU's own sensor before any motion "
        f"(allowed {point.tolerances.coil_temperature_K:g} K): one of the two is wrong, or the ECU was warm",
        {"colder_K": point.colder_K},
    )]


def _least(points: Sequence[Checked], name: str) -> float:
    """The strictest tolerance among the points: a campaign has one bench file, a resumed one may have two."""
    return min(float(getattr(point.tolerances, name)) for point in points)
