"""From what a point's file says of its instruments to reasons, for one point and for a campaign.

`/entry/quality` holds how load cell and LVDT lie over the controller's own inputs, what was seen at rest before the
first motion, and the tolerances of the bench file; `rig.recording.reference_judgement` decides.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rig.recording.estimate import Estimate
from rig.recording.reason import Reason
from rig.recording.reference_judgement import SLUGS, Agreement, Checked, judge
from rig.recording.run import RecordedPoint
from rig.recording.tolerances import Tolerances
from rig.recording.verdict import Verdict

Attributes = Mapping[str, Any]


def checked(name: str, test: Attributes, quality: Attributes) -> Checked:
    """A point as the judgement sees it.

    Args:
        name: its id.
        test: attributes of `/entry/test`.
        quality: attributes of `/entry/quality`.
    """
    coil_degC, ecu_degC = _number(quality, "rest_coil_degC"), _number(quality, "rest_ecu_degC")
    return Checked(
        id=name, time_s=_number(test, "controller_clock_at_zero_s") or 0.0, current_A=_number(test, "current_A") or 0.0,
        force=_agreement("force", "N", quality), displacement=_agreement("displacement", "m", quality),
        tolerances=Tolerances.stored(quality),
        current_zero=_estimate(quality, "rest_current_A", "rest_current_std_A"),
        colder_K=None if coil_degC is None or ecu_degC is None else ecu_degC - coil_degC,
    )


def point_reasons(name: str, test: Attributes, quality: Attributes) -> tuple[Reason, ...]:
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
            before = next(Verdict.stored(point.quality) for point in group if point.id == point_id)
            after = before.replaced(SLUGS, reasons)
            if after != before:
                changed[point_id] = after
    return changed


def instruments_of(points: Sequence[RecordedPoint]) -> dict[object, list[RecordedPoint]]:
    """The recorded points that can be judged, together with all others of the same bench."""
    groups: dict[object, list[RecordedPoint]] = {}
    for point in points:
        others = Verdict.stored(point.quality).replaced(SLUGS, ())
        if not point.imported and others.verdict != "invalid":
            groups.setdefault(point.provenance.get("bench_hash"), []).append(point)
    return groups


def doubts(points: Iterable[RecordedPoint]) -> tuple[str, ...]:
    """One line for each doubt about the bench's calibration that the points' files hold: a fit's intervals cannot."""
    told: dict[str, str] = {}
    for point in points:
        for reason in Verdict.stored(point.quality).found:
            if reason.slug in SLUGS:
                told.setdefault(reason.slug, str(reason))
    return tuple(told.values())


def _agreement(name: str, unit: str, quality: Attributes) -> Agreement:
    start = f"{name}_reference"
    return Agreement(
        gain=_estimate(quality, f"{start}_gain", f"{start}_gain_std"),
        offset=_estimate(quality, f"{start}_offset_{unit}", f"{start}_offset_std_{unit}"),
        # As the signals show it, whatever the load train's stiffness: what is usual of that proves nothing here.
        lag=_estimate(quality, f"{name}_matched_lag_s", f"{name}_matched_lag_std_s"),
        declared_s=_number(quality, f"{name}_declared_delay_s") or 0.0,
    )


def _estimate(quality: Attributes, value: str, std: str) -> Estimate | None:
    found, deviation = _number(quality, value), _number(quality, std)
    return None if found is None or deviation is None else Estimate(found, deviation)


def _number(attributes: Attributes, name: str) -> float | None:
    found = attributes.get(name)
    return float(found) if isinstance(found, (int, float)) and not isinstance(found, bool) else None
