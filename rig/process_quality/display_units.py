"""Values of the results database in the units and signs of `[display]`: for terminal and page; JSON stays SI."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from rig.comparison.readings import QUANTITIES as COMPARED
from rig.comparison.readings import plain
from rig.display import Display, Shown
from rig.process_quality.golden import Cause
from rig.results.quantities import QUANTITIES
from rig.results.reader import ResultRow

DIRECTED = frozenset({
    "peak_force_rebound", "peak_force_compression", "force_at_rest", "force_difference_at_rest", "force_offset",
    "displacement_offset",
})  # fmt: skip
"""Quantities with a direction, in addition to those of `rig compare`."""


def shown_of(quantity: str, unit: str, display: Display) -> Shown:
    """How values of a quantity are shown; parameters of fits have their SI unit.

    Args:
        quantity: name of the quantity or parameter.
        unit: its SI unit.
        display: units and signs.
    """
    if quantity in COMPARED:
        return COMPARED[quantity].shown(display)
    by_unit = {"N": display.force, "m": display.displacement, "degC": display.temperature}
    if quantity not in QUANTITIES or unit not in by_unit:
        return plain(unit)
    return by_unit[unit] if quantity in DIRECTED else replace(by_unit[unit], positive="rebound")


def in_display(rows: Iterable[ResultRow], display: Display) -> list[ResultRow]:
    """The rows with values, uncertainties, units and motions as they are shown."""
    return [_row(row, shown_of(row.quantity, row.unit, display), display) for row in rows]


def _row(row: ResultRow, shown: Shown, display: Display) -> ResultRow:
    amplitude_m = row.amplitude_m
    return row._replace(
        value=shown.signed(row.value), unit=shown.unit,
        motion=row.motion if amplitude_m is None else display.described(row.motion, amplitude_m),
        std=_scaled(row.std, shown), repeatability_std=_scaled(row.repeatability_std, shown),
        calibration_std=_scaled(row.calibration_std, shown),
    )  # fmt: skip


def _scaled(std: float | None, shown: Shown) -> float | None:
    return None if std is None else std / shown.scale


def size_of(cause: Cause, display: Display) -> Shown:
    """How the size of a possible cause of drift, which is a difference, is shown."""
    if cause is Cause.FORCE_ZERO:
        return display.force
    if cause is Cause.TEMPERATURE and display.temperature_unit != "degC":
        return replace(display.temperature, offset=0.0)
    return plain(cause.unit)
