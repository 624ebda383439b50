"""Rows of the results database as series of values in the order of time, one for each quantity, motion and current."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from statistics import fmean

import numpy as np

from rig.comparison.bands import Band, Bands, LoopBand
from rig.comparison.readings import LoopReading, Motion
from rig.errors import some
from rig.process_quality.control_chart import RESOLUTION
from rig.results.quantities import QUANTITIES, SPECIMEN
from rig.results.reader import ResultRow
from rig.signals.arrays import FloatArray
from rig.signals.test_set import CurrentReading, MotionReading
from rig.signals.waveform import SINE, WAVEFORMS

VALID = "valid"
SAME_CURRENT_PLACES = 6
EARLIEST = datetime.min.replace(tzinfo=UTC)


@dataclass(frozen=True)
class Series:
    """Values of one quantity at one motion and current, one per campaign: repeats in a campaign are averaged.

    Attributes:
        quantity: key of the quantity, or name of a parameter.
        unit: SI unit.
        motion: in one phrase.
        current_A: current level; None where there is none.
        rows: first row of each campaign.
        values: (n,), in the order of time.
        stds: combined standard uncertainties (n,), NaN where unknown.
        repeatability: standard uncertainties by the variation between cycles (n,), NaN where unknown.
        trials: number of averaged repeats of each campaign.
    """

    quantity: str
    unit: str
    motion: str
    current_A: float | None
    rows: tuple[ResultRow, ...]
    values: FloatArray
    stds: FloatArray
    repeatability: FloatArray
    trials: tuple[tuple[float, ...], ...] = field(default=(), repr=False)

    @property
    def title(self) -> str:
        """Title of the quantity."""
        known = QUANTITIES.get(self.quantity)
        return self.quantity if known is None else known.title

    @property
    def location(self) -> str:
        """Motion and current in one phrase."""
        current = "" if self.current_A is None else f"{self.current_A:.4g} A"
        return ", ".join(part for part in (self.motion, current) if part)

    @property
    def label(self) -> str:
        """Title, motion and current in one phrase."""
        return ", ".join(part for part in (self.title, self.location) if part)

    @property
    def specimens(self) -> tuple[str, ...]:
        """Serial number of each value."""
        return tuple(row.specimen for row in self.rows)

    @property
    def uncertainty(self) -> float:
        """Median standard uncertainty of a value; NaN if none is known."""
        return _median(self.stds)

    @property
    def resolution(self) -> float:
        """Smallest difference that is known: the median repeatability, at least `RESOLUTION` of the largest value."""
        least = RESOLUTION * float(np.max(np.abs(self.values)))
        known = _median(self.repeatability)
        return max(least, known) if math.isfinite(known) else least


def _median(values: FloatArray) -> float:
    """Median of the finite values; NaN without any."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else math.nan


def when(row: ResultRow) -> datetime:
    """Time by which rows are ordered; unknown times come first."""
    return row.started or row.recorded or EARLIEST


def series_of(rows: Iterable[ResultRow]) -> list[Series]:
    """Series of the valid rows, in the order of quantity, motion and current."""
    groups: dict[tuple[str, str, float | None], dict[str, list[ResultRow]]] = {}
    for row in rows:
        if row.verdict != VALID:
            continue
        current = None if row.current_A is None else round(row.current_A, SAME_CURRENT_PLACES) + 0.0
        groups.setdefault((row.quantity, row.motion, current), {}).setdefault(row.campaign, []).append(row)
    ordered = sorted(groups, key=lambda key: (_order(key[0]), key[1], -1.0 if key[2] is None else key[2]))
    return [_series(key, groups[key]) for key in ordered]


def _order(quantity: str) -> tuple[int, str]:
    """Quantities in the order of the catalogue, parameters last."""
    names = list(QUANTITIES)
    return (names.index(quantity) if quantity in QUANTITIES else len(names), quantity)


def _series(key: tuple[str, str, float | None], campaigns: dict[str, list[ResultRow]]) -> Series:
    ordered = sorted(campaigns.values(), key=lambda rows: when(rows[0]))
    values = np.array([fmean([row.value for row in rows]) if len(rows) > 1 else rows[0].value for rows in ordered])
    stds = np.array([_largest(row.std for row in rows) for rows in ordered], np.float64)
    repeatability = np.array([_largest(row.repeatability_std for row in rows) for rows in ordered], np.float64)
    trials = tuple(tuple(row.value for row in rows) for rows in ordered)
    quantity, motion, current_A = key
    return Series(quantity, ordered[0][0].unit, motion, current_A, tuple(rows[0] for rows in ordered), values, stds,
                  repeatability, trials)  # fmt: skip


def _largest(values: Iterable[float | None]) -> float:
    """The largest known value; NaN without any."""
    return max((value for value in values if value is not None), default=math.nan)


def usual(rows: Iterable[ResultRow]) -> list[ResultRow]:
    """Rows on the damper without a model: what is charted if no quantity is requested."""
    return [row for row in rows if row.quantity in QUANTITIES and row.subject == SPECIMEN]


def remarks_on(rows: Sequence[ResultRow]) -> list[str]:
    """What rows have in them that must not be overlooked."""
    remarks = []
    points = {(row.campaign, row.point): row.verdict for row in rows}
    bad = sum(verdict != VALID for verdict in points.values())
    if bad:
        remarks.append(f"points not used, because they are not valid: {bad} of {len(points)}")
    simulated = {row.campaign: row.simulated for row in rows}
    count = sum(simulated.values())
    if 0 < count < len(simulated):
        remarks.append(f"campaigns from a simulated rig: {count} of {len(simulated)}. Fix: use --in or a filter to "
            "separate them from measured ones")
    without = sum(row.started is None for row in {row.campaign: row for row in rows}.values())
    if without:
        remarks.append(f"campaigns without a start time, placed first: {without}")
    for name, values in (("matrices", [row.matrix for row in rows]), ("stations", [row.station for row in rows])):
        known = Counter(value for value in values if value)
        if len(known) > 1:
            option = {"matrices": "--matrix", "stations": "--station"}[name]
            remarks.append(f"values come from {len(known)} {name} ({some([*known])}); {option} selects one")
    return remarks


def limits_of(series: Series, bands: Bands | None) -> tuple[float | None, float | None]:
    """Lower and upper limit of a series by the first band that applies to it; None: open."""
    if bands is None:
        return None, None
    for quantity, band in bands.all:
        if _applies(quantity, band, series) and (band.low is not None or band.high is not None):
            return band.low, band.high
    return None, None


def _applies(quantity: str, band: Band, series: Series) -> bool:
    if quantity == "parameter":
        return band.where == series.quantity
    if quantity != series.quantity:
        return False
    if not isinstance(band, LoopBand):
        return True
    row = series.rows[0]
    if row.amplitude_m is None or row.frequency_Hz is None or series.current_A is None:
        return False
    waveform = series.motion.partition(" ")[0]
    nominal = (row.amplitude_m, row.frequency_Hz)
    motion = Motion.of(
        MotionReading(waveform, *nominal, requested=nominal), CurrentReading(series.current_A,
        requested_A=series.current_A), series.current_A,
    )
    speed_m_s = WAVEFORMS.get(waveform, SINE).peak_velocity * row.amplitude_m * row.frequency_Hz
    return band.holds(LoopReading(motion, (row.point,), speed_m_s, {}))
