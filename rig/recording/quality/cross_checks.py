"""Comparison of the bench's instruments: reasons for a point and a campaign, and a table for the report.

`/entry/quality` contains the comparison of load cell and LVDT with the controller's own inputs, the values at rest
before the first motion, and the tolerances of the bench file; `rig.recording.quality.instrument_checks` decides. Two
instruments that agree may still have the same error: agreement is no calibration; if the bench has no second
instrument, the table states it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from rig.recording.quality.instrument_checks import (
    DISPLACEMENT,
    FORCE,
    SLUGS,
    ZERO_RETURN,
    Checked,
    Instruments,
    deviations,
    judge,
    trusted,
    zero_change,
)
from rig.recording.quality.point_quality import PointQuality, Tolerances
from rig.recording.quality.verdict import Reason, Verdict
from rig.recording.recorded_point import RecordedPoint
from rig.signals.estimate import Estimate, pooled

Attributes = Mapping[str, Any]
PROVES = 2.0
"""Standard deviations that must fit into the tolerance before two instruments are said to agree."""


def checked(name: str, test: Attributes, quality: PointQuality) -> Checked:
    """A point as the judgement sees it.

    Args:
        name: its id.
        test: attributes of `/entry/test`.
        quality: what its file says of it.
    """
    rest = quality.rest
    return Checked(
        id=name, time_s=_number(test, "controller_clock_at_zero_s") or 0.0, current_A=_number(test, "current_A") or 0.0,
        force=quality.force.agreement, displacement=quality.displacement.agreement,
        tolerances=quality.tolerances or Tolerances(), current_zero=rest.current,
        colder_K=None if rest.coil_degC is None or rest.ecu_degC is None else rest.ecu_degC - rest.coil_degC,
    )


def point_reasons(name: str, test: Attributes, quality: PointQuality) -> tuple[Reason, ...]:
    """What a point alone says of its instruments."""
    return judge([checked(name, test, quality)])[name]


def campaign_verdicts(points: Sequence[RecordedPoint]) -> dict[str, Verdict]:
    """The verdicts of those points of a campaign that change once all of them are judged together, by id.

    A point that is invalid for another reason neither says anything of the instruments nor is judged again.

    Args:
        points: all points of a campaign; their arrays are not needed.
    """
    changed: dict[str, Verdict] = {}
    for group in instruments_of(points).values():
        for point_id, reasons in judge([checked(point.id, point.test, point.quality) for point in group]).items():
            before = next(point.quality.verdict for point in group if point.id == point_id)
            after = before.replaced(SLUGS, reasons)
            if after != before:
                changed[point_id] = after
    return changed


def instruments_of(points: Sequence[RecordedPoint]) -> dict[object, list[RecordedPoint]]:
    """The recorded points that can be judged, together with all others of the same bench."""
    groups: dict[object, list[RecordedPoint]] = {}
    for point in points:
        others = point.quality.verdict.replaced(SLUGS, ())
        if not point.imported and others.verdict != "invalid":
            groups.setdefault(point.provenance.get("bench_hash"), []).append(point)
    return groups


def doubts(points: Iterable[RecordedPoint]) -> tuple[str, ...]:
    """One line for each doubt about the bench's calibration that the points' files hold: a fit's intervals cannot."""
    texts: dict[str, str] = {}
    for point in points:
        for reason in point.quality.verdict.entries:
            if reason.slug in SLUGS or reason.slug == ZERO_RETURN:
                texts.setdefault(reason.slug, str(reason))
    return tuple(texts.values())


def _number(attributes: Attributes, name: str) -> float | None:
    value = attributes.get(name)
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else None


class CheckState(StrEnum):
    """How a comparison ended; the value is shown."""

    AGREES = "agrees"
    DISAGREES = "disagrees"
    UNCHECKED = "not cross-checked"


@dataclass(frozen=True)
class CrossCheck:
    """One property of one instrument.

    Attributes:
        instrument: the one that is checked.
        what: the property.
        against: what it was compared with; where it was not, what is missing.
        difference: the numbers; empty where it was not compared.
        allowed: the tolerance; empty where there is none.
        state: `agrees`, `disagrees` or `not cross-checked`.
    """

    instrument: str
    what: str
    against: str
    difference: str = ""
    allowed: str = ""
    state: CheckState = CheckState.UNCHECKED


def cross_checks(points: Sequence[Checked], auxiliaries: Sequence[str] = ()) -> tuple[CrossCheck, ...]:
    """Every instrument of the bench, in a fixed order.

    Args:
        points: the campaign's points that can be judged.
        auxiliaries: names of the auxiliary channels.
    """
    if not points:
        return ()
    doubted = {reason.slug for reasons in judge(points).values() for reason in reasons}
    points = trusted(points)
    return (
        *_against_input(FORCE, points, doubted), *_zero_over_campaign(points, doubted),
        *_against_input(DISPLACEMENT, points, doubted), *_ecu(points, doubted),
        *(CrossCheck(name, "everything", "the bench has no second instrument for comparison") for name in auxiliaries),
    )


def _against_input(
    instruments: Instruments, points: Sequence[Checked], doubted: set[str],
) -> list[CrossCheck]:
    tolerances, sensor, reference = points[0].tolerances, instruments.sensor, instruments.reference
    agreements = [instruments.of(point) for point in points]
    gain, offset, lag = (
        pooled(value for agreement in agreements if (value := getattr(agreement, name)) is not None)
        for name in ("gain", "offset", "lag")
    )
    force = instruments is FORCE
    allowed_gain = tolerances.force_gain if force else tolerances.displacement_gain
    allowed_zero = tolerances.force_zero_N if force else tolerances.displacement_zero_m
    allowed_s = tolerances.time_s + max(agreement.declared_s for agreement in agreements)
    unit, scale = instruments.unit, instruments.scale
    percent = None if gain is None else Estimate(gain.value - 1.0, gain.std).times(100.0)
    zero = None if offset is None else offset.times(scale)
    late = None if lag is None else lag.times(1e3)
    return [
        _row(sensor, "sensitivity", reference, percent, "%",
             _Limit(100.0 * allowed_gain, f"{100.0 * allowed_gain:g} %", instruments.gain_slug in doubted)),
        _row(sensor, "zero", reference, zero, unit,
             _Limit(scale * allowed_zero, f"{scale * allowed_zero:.3g} {unit}", instruments.zero_slug in doubted)),
        _row(sensor, "delay in addition to the declared delays", reference, late, "ms",
             _Limit(1e3 * allowed_s, f"up to {1000.0 * allowed_s:.2g} ms later", instruments.lag_slug in doubted)),
    ]


@dataclass(frozen=True)
class _Limit:
    """What is allowed, in the unit that is shown and in words, and whether it certainly is exceeded."""

    tolerance: float
    text: str
    exceeded: bool


def _row(
    instrument: str, what: str, reference: str, difference: Estimate | None, unit: str, limit: _Limit,
) -> CrossCheck:
    if difference is None:
        few = "no point has enough motion and enough samples for a comparison"
        return CrossCheck(instrument, what, f"{few} with the {reference}")
    shown = f"{difference.signed} {unit}"
    if not limit.exceeded and PROVES * difference.std > limit.tolerance:
        return CrossCheck(instrument, what, f"{reference}: the value is too uncertain for a "
            "conclusion", shown, limit.text)
    state = CheckState.DISAGREES if limit.exceeded else CheckState.AGREES
    return CrossCheck(instrument, what, reference, shown, limit.text, state)


def _zero_over_campaign(points: Sequence[Checked], doubted: set[str]) -> list[CrossCheck]:
    allowed = f"{points[0].tolerances.force_zero_change_N:.3g} N during the campaign"
    change = zero_change(points, deviations(len(points)))
    if change is None:
        few = "the zero was determined at fewer than two points"
        return [CrossCheck("load cell", "zero drift and crosstalk", few)]
    moved = "zero-change" in doubted
    rows = []
    for what, slug, slope, unit, missing in (
        ("zero drift", "zero-drift", change.drift_N_s, "N/s", "all points were measured at the same time"),
        ("crosstalk from the coil's current", "crosstalk", change.crosstalk_N_A, "N/A", "all points have the same "
            "current"),
    ):
        if slope.known:
            state = CheckState.DISAGREES if moved or slug in doubted else CheckState.AGREES
            rows.append(CrossCheck("load cell", what, FORCE.reference, f"{slope.signed} {unit}", allowed, state))
        else:
            rows.append(CrossCheck("load cell", what, missing))
    return rows


def _ecu(points: Sequence[Checked], doubted: set[str]) -> list[CrossCheck]:
    tolerances = points[0].tolerances
    zero = pooled(point.current_zero for point in points if point.current_zero is not None)
    colder = [point.colder_K for point in points if point.colder_K is not None]
    rows = [
        CrossCheck("ECU's current measurement", "zero", "the ECU reported no current value while the output stage "
            "was off")
        if zero is None else CrossCheck(
            "ECU's current measurement", "zero", "output stage off, before the first motion",
            f"{zero.times(1e3).signed} mA", f"{1e3 * tolerances.current_zero_A:g} mA",
            CheckState.DISAGREES if "current-zero" in doubted else CheckState.AGREES,
        ),
        CrossCheck("ECU's current measurement", "sensitivity", "the bench has no second current sensor"),
    ]
    if not colder:
        rows.append(CrossCheck("coil temperature", "offset", "neither coil nor ECU temperature was reported at rest"))
    else:
        rows.append(CrossCheck(
            "coil temperature", "offset; detected only if it makes the coil appear colder than its "
                "surroundings", "ECU's own temperature at rest",
            f"{round(-max(colder), 1) + 0.0:+.1f} K", f"{-tolerances.coil_temperature_K:g} K",
            CheckState.DISAGREES if "coil-temperature" in doubted else CheckState.AGREES,
        ))
    rows.append(CrossCheck(
        "coil temperature", "sensitivity", "the bench has no second temperature sensor on the coil",
    ))
    return rows
