"""Tables from a notebook: a time is a time, row numbers are none."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rig.errors import DataWarning, FileProblem
from rig.recording.importing import import_tests
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run
from rig.signals.arrays import FloatArray

TIME_S = np.arange(0.0, 4.0, 0.004) + 10.0
MOTION_M = 0.02 * np.sin(2 * np.pi * 1.5 * TIME_S)
START = pd.Timestamp("2026-03-29 01:30:00")


def table(index: object = None, **columns: object) -> pd.DataFrame:
    made = pd.DataFrame({**columns, "displacement": MOTION_M, "force": 900.0 * MOTION_M}, index=index)
    made.attrs["units"] = {"displacement": "m", "force": "N"}
    return made


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
    "row numbers called time, and time_s": (lambda: table(time=np.arange(len(TIME_S)), time_s=TIME_S), 10.0),
    "two times that agree": (lambda: table(t_ms=TIME_S * 1e3, time_s=TIME_S), 10.0),
    "texts that are not needed": (lambda: table(time_s=TIME_S, remark=["ok"] * len(TIME_S)), 10.0),
    "column beside filtered rows": (lambda: table(time=TIME_S).iloc[5:], 10.02),
}  # fmt: skip


@pytest.mark.filterwarnings("ignore:.* columns without a unit are assumed to be in SI")
@pytest.mark.filterwarnings("ignore:column 'remark' contains text and is left out:rig.errors.DataWarning")
@pytest.mark.parametrize(("make", "first_s"), ACCEPTED.values(), ids=ACCEPTED)
def test_a_time_is_read_in_seconds_wherever_it_stands(make: Callable[[], pd.DataFrame], first_s: float) -> None:
    point = RecordedPoint.from_pandas(make(), id="mine", current_A=0.5)
    assert point.time_s[0] == pytest.approx(first_s, abs=1e-9)
    assert np.median(np.diff(point.time_s)) == pytest.approx(0.004, rel=1e-6)
    assert point.frequency_Hz == pytest.approx(1.5, rel=1e-3)
    assert np.max(np.abs(point.velocity_m_s)) == pytest.approx(2 * np.pi * 1.5 * 0.02, rel=0.01)
    assert set(point.to_pandas()) == {"displacement", "force", "current", "velocity"}


LIKE_A_FILE: dict[str, Callable[[pd.DataFrame], pd.DataFrame]] = {
    "infinite force": lambda test: test.assign(force_N=test["force_N"].where(test.index != 300, np.inf)),
    "n/a": lambda test: test.assign(force_N=test["force_N"].astype(str).where(test.index != 300, "n/a")),
    "time stamps": lambda test: test.assign(
        time=[(START + pd.Timedelta(t, "s")).isoformat(timespec="microseconds") for t in TIME_S]
    ),
    "many missing": lambda test: test.assign(force_N=test["force_N"].where(test.index > 40)),
    "less than a cycle": lambda test: test[:120],
}


@pytest.mark.filterwarnings("ignore::rig.errors.DataWarning")
@pytest.mark.parametrize("name", LIKE_A_FILE)
def test_a_table_is_taken_as_the_same_table_in_a_file(name: str, tmp_path: Path) -> None:
    """Each of these was refused by one of the two and taken by the other, or refused in other words."""
    made = pd.DataFrame({"time": TIME_S - TIME_S[0], "displacement_mm": 1e3 * MOTION_M, "force_N": 900.0 * MOTION_M})
    made = LIKE_A_FILE[name](made)
    made.to_csv(tmp_path / "a.csv", index=False)
    columns = {"displacement": "displacement_mm", "force": "force_N", "time": "time"}
    units = {} if name == "time stamps" else {"time": "s"}
    columns |= {"time": f"time:{units['time']}"} if units else {}
    (of_file,) = Run.open(import_tests([tmp_path / "a.csv"], columns=columns, current_A=0.5, out=tmp_path)).points
    of_table = RecordedPoint.from_pandas(made, id="mine", current_A=0.5, units=units)
    assert (of_table.verdict, of_table.reasons) == (of_file.verdict, of_file.reasons)
    assert of_table.amplitude_m == pytest.approx(of_file.amplitude_m)
    assert of_table.frequency_Hz == pytest.approx(of_file.frequency_Hz)
    assert np.count_nonzero(np.isnan(of_table.force_N)) == np.count_nonzero(np.isnan(of_file.force_N))


REFUSED: dict[str, tuple[Callable[[], pd.DataFrame], str]] = {
    "row numbers": (lambda: table(), "only numbers the rows. Fix: add a column `time_s`"),
    "filtered row numbers": (lambda: table().iloc[7:], "only numbers the rows"),
    "row numbers as floats": (lambda: table(np.arange(len(TIME_S), dtype=float)), "only numbers the rows"),
    "index named sample": (lambda: table(pd.Index(TIME_S, name="sample")), "its index (sample) only numbers the rows"),
    "texts": (lambda: table([f"{t:.4f}" for t in TIME_S]), "only numbers the rows"),
    "two levels": (
        lambda: table(pd.MultiIndex.from_arrays([TIME_S, TIME_S], names=["time_s", "t"])), "only numbers the rows",
    ),
    "column of texts": (lambda: table(time=["x"] * len(TIME_S)), "the time in 'time' is not a number"),
    "column of row numbers": (lambda: table(time=np.arange(len(TIME_S))).set_axis(range(len(TIME_S))), "only numbers"),
    "different time columns": (lambda: table(time_s=TIME_S, t_ms=TIME_S), "time columns: 'time_s', 't_ms'"),
    "backwards": (lambda: table(pd.Index(TIME_S[::-1], name="time_s")), "must increase from row to row"),
    "a date missing": (
        lambda: table(pd.DatetimeIndex([pd.NaT, *(START + pd.to_timedelta(TIME_S[1:], "s"))])), "increase from row",
    ),
    "not finite": (lambda: table(pd.Index([*TIME_S[:-1], np.inf], name="time_s")), "increase from row to row"),
    "one row": (lambda: table(pd.Index(TIME_S, name="time_s")).iloc[:1], "two or more rows"),
    "a force of texts": (lambda: table(TIME_S).assign(force=["ok"] * len(TIME_S)), "'force' must contain numbers"),
}  # fmt: skip


@pytest.mark.parametrize(("make", "expected"), REFUSED.values(), ids=REFUSED)
def test_what_is_no_time_is_refused_with_the_way_out(make: Callable[[], pd.DataFrame], expected: str) -> None:
    with pytest.raises(FileProblem) as caught:
        RecordedPoint.from_pandas(make(), id="mine", current_A=0.5)
    assert expected in str(caught.value)


@pytest.mark.parametrize(("names", "factors", "units"), [
    (("time_s", "displacement_m", "force_N"), (1.0, 1.0, 1.0), {}),
    (("time_ms", "displacement_mm", "force_kN"), (1e3, 1e3, 1e-3), {}),
    (("t", "displacement", "force"), (1e3, 1e3, 1e-3), {"t": "ms", "displacement": "mm", "force": "kN"}),
    (("time", "displacement_in", "force"), (1.0, 1 / 0.0254, 0.1), {"time": "s", "force": "daN"}),
])  # fmt: skip
def test_units_come_from_names_or_are_stated(
    names: tuple[str, ...], factors: tuple[float, ...], units: dict[str, str]
) -> None:
    si = (TIME_S, MOTION_M, 900.0 * MOTION_M)
    made = pd.DataFrame({name: factor * values for name, factor, values in zip(names, factors, si, strict=True)})
    made["current_measured_A"] = 0.4
    by_argument = RecordedPoint.from_pandas(made, id="mine", current_A=0.5, units=units)
    made.attrs["units"] = units
    for point in (by_argument, RecordedPoint.from_pandas(made, id="mine", current_A=0.5)):
        assert point.time_s == pytest.approx(TIME_S)
        assert point.displacement_m == pytest.approx(MOTION_M)
        assert point.force_N == pytest.approx(900.0 * MOTION_M)
        assert np.all(point.current_measured_A == 0.4)


@pytest.mark.parametrize(("factors", "says"), [
    ((1.0, 1e3, 1.0), "as displacement, spans 40 m"), ((1.0, 1.0, 1e-3), "units-force: .*probably in kN"),
    ((1e3, 1.0, 1.0), "units-time: .*probably in ms"),
])  # fmt: skip
def test_numbers_that_are_not_si_are_refused_as_the_command_does(factors: tuple[float, ...], says: str) -> None:
    made = table(pd.Index(factors[0] * TIME_S, name="time"))
    made["displacement"] *= factors[1]
    made["force"] *= factors[2]
    with pytest.raises(FileProblem, match=says):
        RecordedPoint.from_pandas(made, id="mine", current_A=0.5)


def test_bare_numbers_are_taken_in_si_with_a_warning_and_wrong_units_are_refused() -> None:
    made = table(pd.Index(TIME_S, name="time"))
    made.attrs.clear()
    with pytest.warns(UserWarning, match="the index in s, displacement in m, force in N"):
        point = RecordedPoint.from_pandas(made, id="mine", current_A=0.5)
    RecordedPoint.from_pandas(point.to_pandas(), id="again", current_A=0.5)  # its units are in the table
    for units, says in (({"force": "mm"}, "not a unit of force"), ({"speed": "m/s"}, "no column 'speed'")):
        with pytest.raises(FileProblem, match=says):
            RecordedPoint.from_pandas(made, id="mine", current_A=0.5, units=units)
    made = made.rename(columns={"force": "force_kN"}).assign(force_N=MOTION_M)
    with pytest.raises(FileProblem, match="'force_kN' and 'force_N' both contain the force"):
        RecordedPoint.from_pandas(made, id="mine", current_A=0.5)


@pytest.mark.parametrize("current_A", [float("nan"), float("inf"), None, "0.5 A", 500.0, np.array([0.5, 0.5])])
def test_a_current_that_is_no_number_is_refused(current_A: object) -> None:
    with pytest.raises(FileProblem, match=r"current_A = .*, expected a number"):
        RecordedPoint.from_pandas(table(pd.Index(TIME_S, name="time_s")), id="a", current_A=current_A)


def rounded_sine(current_A: FloatArray | None = None) -> pd.DataFrame:
    """Five cycles of 2 Hz at 1024 Hz, stamps printed to a millisecond: every 42nd is there twice."""
    t = np.arange(2560) / 1024.0
    x_mm, v_m_s = 20.0 * np.sin(4.0 * np.pi * t), 0.08 * np.pi * np.cos(4.0 * np.pi * t)
    made = pd.DataFrame({"time_s": np.round(t, 3), "displacement_mm": x_mm, "force_N": 400.0 * v_m_s})
    return made if current_A is None else made.assign(current_A=current_A)


def test_equal_stamps_of_few_digits_are_the_rate_behind_them_as_in_files() -> None:
    made = rounded_sine()
    assert np.any(np.diff(made["time_s"]) == 0.0)
    point = RecordedPoint.from_pandas(made, id="rounded", current_A=0.0)
    assert point.verdict == "valid"
    assert np.mean(np.diff(point.time_s)) == pytest.approx(1.0 / 1024.0, rel=1e-5)
    backwards = made.assign(time_s=made["time_s"].where(made.index != 1000, 0.1))
    with pytest.raises(FileProblem, match=r"time .* s is not after"):
        RecordedPoint.from_pandas(backwards, id="back", current_A=0.0)


@pytest.mark.parametrize(("sag_A", "verdict"), [(0.0, "valid"), (0.1, "invalid")])
def test_a_current_that_sags_makes_a_tables_test_invalid_as_a_files(
    sag_A: float, verdict: str, tmp_path: Path
) -> None:
    made = rounded_sine(np.where(np.arange(2560) % 512 > 400, 0.5 - sag_A, 0.5))
    point = RecordedPoint.from_pandas(made, id="sag", current_A=0.5)
    made.to_csv(tmp_path / "sag.csv", index=False)
    columns = {"time": "time_s", "displacement": "displacement_mm", "force": "force_N", "current": "current_A"}
    (read,) = Run.open(import_tests([tmp_path / "sag.csv"], columns=columns, out=tmp_path)).points
    assert (point.verdict, point.reasons) == (read.verdict, read.reasons)
    assert point.verdict == verdict
    assert all("current-tracking" in reason for reason in point.reasons)


def test_a_number_for_no_value_in_a_table_is_none_as_in_a_file() -> None:
    made = rounded_sine()
    made.loc[700, "force_N"] = -9999.0
    with pytest.warns(DataWarning, match="'force_N': 1 .*-9999"):
        point = RecordedPoint.from_pandas(made, id="gap", current_A=0.0)
    assert np.isnan(point.force_N[700])
