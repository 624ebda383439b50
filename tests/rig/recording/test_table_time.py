"""Tables from a notebook: a time is a time, row numbers are none."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest

from rig.errors import FileProblem
from rig.recording.recorded_point import RecordedPoint

TIME_S = np.arange(0.0, 4.0, 0.004) + 10.0
MOTION_M = 0.02 * np.sin(2 * np.pi * 1.5 * TIME_S)
START = pd.Timestamp("2026-03-29 01:30:00")


def table(index: object = None, **columns: object) -> pd.DataFrame:
    return pd.DataFrame({**columns, "displacement": MOTION_M, "force": 900.0 * MOTION_M}, index=index)


ACCEPTED: dict[str, tuple[Callable[[], pd.DataFrame], float]] = {
    "index named time_s": (lambda: table(pd.Index(TIME_S, name="time_s")), 10.0),
    "index named Time": (lambda: table(pd.Index(TIME_S, name="Time")), 10.0),
    "index of milliseconds": (lambda: table(pd.Index(TIME_S * 1e3, name="t_ms")), 10.0),
    "index of whole microseconds": (lambda: table(pd.Index(np.round(TIME_S * 1e6).astype(int), name="time_us")), 10.0),
    "index without a name, fractions": (lambda: table(TIME_S), 10.0),
    "dates": (lambda: table(START + pd.to_timedelta(TIME_S, "s")), 0.0),
    "dates with a zone, clock change": (
        lambda: table((START.tz_localize("UTC") + pd.to_timedelta(TIME_S, "s")).tz_convert("Europe/Berlin")), 0.0,
    ),
    "durations": (lambda: table(pd.to_timedelta(TIME_S, "s")), 0.0),
    "column time_s": (lambda: table(time_s=TIME_S), 10.0),
    "column time in ms": (lambda: table(time_ms=TIME_S * 1e3), 10.0),
    "column of dates": (lambda: table(time=START + pd.to_timedelta(TIME_S, "s")), 0.0),
    "column beside filtered rows": (lambda: table(time=TIME_S).iloc[5:], 10.02),
}  # fmt: skip


@pytest.mark.parametrize(("make", "first_s"), ACCEPTED.values(), ids=ACCEPTED)
def test_a_time_is_read_in_seconds_wherever_it_stands(make: Callable[[], pd.DataFrame], first_s: float) -> None:
    point = RecordedPoint.from_pandas(make(), id="mine", current_A=0.5)
    assert point.time_s[0] == pytest.approx(first_s, abs=1e-9)
    assert np.median(np.diff(point.time_s)) == pytest.approx(0.004, rel=1e-6)
    assert point.frequency_Hz == pytest.approx(1.5, rel=1e-3)
    assert np.max(np.abs(point.velocity_m_s)) == pytest.approx(2 * np.pi * 1.5 * 0.02, rel=0.01)
    assert set(point.to_pandas()) == {"displacement", "force", "current", "velocity"}


REFUSED: dict[str, tuple[Callable[[], pd.DataFrame], str]] = {
    "row numbers": (lambda: table(), "counts rows; give a column `time_s`"),
    "filtered row numbers": (lambda: table().iloc[7:], "counts rows"),
    "row numbers as floats": (lambda: table(np.arange(len(TIME_S), dtype=float)), "counts rows"),
    "index named sample": (lambda: table(pd.Index(TIME_S, name="sample")), "its index (sample) counts rows"),
    "texts": (lambda: table([f"{t:.4f}" for t in TIME_S]), "counts rows"),
    "two levels": (
        lambda: table(pd.MultiIndex.from_arrays([TIME_S, TIME_S], names=["time_s", "t"])), "counts rows",
    ),
    "column of texts": (lambda: table(time=["x"] * len(TIME_S)), "the time in 'time' is not a number"),
    "backwards": (lambda: table(pd.Index(TIME_S[::-1], name="time_s")), "must increase from row to row"),
    "a date missing": (
        lambda: table(pd.DatetimeIndex([pd.NaT, *(START + pd.to_timedelta(TIME_S[1:], "s"))])), "must increase",
    ),
    "not finite": (lambda: table(pd.Index([*TIME_S[:-1], np.inf], name="time_s")), "must increase"),
    "one row": (lambda: table(pd.Index(TIME_S, name="time_s")).iloc[:1], "two rows or more"),
    "remarks beside numbers": (lambda: table(pd.Index(TIME_S, name="t"), remark=["ok"] * len(TIME_S)), "hold numbers"),
}  # fmt: skip


@pytest.mark.parametrize(("make", "expected"), REFUSED.values(), ids=REFUSED)
def test_what_is_no_time_is_refused_with_the_way_out(make: Callable[[], pd.DataFrame], expected: str) -> None:
    with pytest.raises(FileProblem) as caught:
        RecordedPoint.from_pandas(make(), id="mine", current_A=0.5)
    assert expected in str(caught.value)
