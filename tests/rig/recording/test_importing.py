from __future__ import annotations

import math
import os
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from rig.document.moments import local_time
from rig.errors import FileProblem, IdentificationFailed
from rig.identification import identify_run
from rig.recording.importing import import_tests
from rig.recording.run import Run
from rig.recording.tested_on import when_tested
from rig.report.cover import Details, started

COLUMNS = {"time": "t_s", "displacement": "x_mm", "force": "F:kN"}
MEASURED = Path(os.environ.get("RIG_MEASURED_DATA", Path(__file__).parents[4] / "shared/data/utfsm"))


def sine_file(folder: Path, name: str = "a_0.50A.csv", *, header: str = "t_s,x_mm,F", rows: int = 2000) -> Path:
    time_s = np.arange(rows) * 0.005
    motion = 12.0 + 5.0 * np.sin(2 * np.pi * 1.02 * np.clip(time_s - 1.0, 0.0, 8.0))
    force_kN = 0.3 * np.cos(2 * np.pi * 1.02 * (time_s - 1.0))
    lines = [f"{t:.6f},{x:.6f},{f:.6f}" for t, x, f in zip(time_s, motion, force_kN, strict=True)]
    path = folder / name
    path.write_text("\n".join([header, *lines]) + "\n")
    return path


def changed(path: Path, line: int, text: str) -> Path:
    lines = path.read_text().split("\n")
    lines[line - 1] = text
    path.write_text("\n".join(lines))
    return path


def refused(tmp_path: Path, path: Path, **options: object) -> str:
    given = {"columns": COLUMNS, "current_A": 0.5, **options}
    with pytest.raises(FileProblem) as caught:
        import_tests([path], out=tmp_path / "out", **given)  # type: ignore[arg-type]  # options vary by test
    assert not (tmp_path / "out").exists()
    return str(caught.value)


def test_a_imported_test_becomes_a_point_in_si_with_measured_amplitude_and_frequency(tmp_path: Path) -> None:
    run = Run.open(import_tests([sine_file(tmp_path)], columns=COLUMNS, out=tmp_path / "out",
                                current_from_name="_(?P<current>[0-9.]+)A", specimen="D 7"))
    (point,) = run.points
    assert point.id == "a_0.50A"
    assert (point.amplitude_m, point.frequency_Hz) == pytest.approx((0.005, 1.02), rel=1e-3)
    assert (point.current_A, point.current_requested, point.motion_requested) == (0.5, True, False)
    assert point.quality.motion.frequency_Hz == point.frequency_Hz
    assert np.max(point.force_N) == pytest.approx(300.0, rel=1e-6)
    assert point.displacement_m[0] == pytest.approx(0.012)
    assert point.verdict == "valid"
    assert point.imported
    assert len(point.provenance["source_sha256"]) == 64
    assert run.campaign["imported"] is True
    assert "D-7" in run.path.name


def test_the_points_of_an_imported_run_are_in_the_order_of_the_import(tmp_path: Path) -> None:
    second, first = sine_file(tmp_path), tmp_path / "zz.csv"
    first.write_bytes(second.read_bytes())
    folder = import_tests([first, second], columns=COLUMNS, out=tmp_path / "out", current_A=0.5)
    assert [point.id for point in Run.open(folder).points] == ["zz", second.stem]


@pytest.mark.parametrize(("given", "tested"), [
    ("2026-03-05", "2026-03-05"), ("5.3.2026", "2026-03-05"),
    ("2026-03-05T14:30:00+02:00", "2026-03-05T12:30:00+00:00"),
])
def test_an_imported_run_states_the_date_of_its_tests(given: str, tested: str, tmp_path: Path) -> None:
    folder = import_tests([sine_file(tmp_path)], columns=COLUMNS, out=tmp_path / "out", current_A=0.5, date=given)
    run = Run.open(folder)
    assert run.campaign["tested"] == run.points[0].provenance["tested"] == tested
    assert when_tested(run.campaign) == started(run) == tested
    assert local_time("2026-03-05") == "2026-03-05", "a date is the same in every time zone"
    assert not folder.name.startswith("20260305"), "the name has the time of the import, by which `last` is chosen"


@pytest.mark.parametrize("date", ["5 March", "2026-13-01", "3026-01-01", "1026-01-01", ""])
def test_a_date_that_cannot_be_one_of_a_test_is_refused(date: str, tmp_path: Path) -> None:
    assert "--date: got " in refused(tmp_path, sine_file(tmp_path), date=date)


def test_numbers_of_imported_tests_match_a_filter_within_five_percent(tmp_path: Path) -> None:
    run = Run.open(import_tests([sine_file(tmp_path)], columns=COLUMNS, out=tmp_path / "out", current_A=0.0))
    assert len(run.select("frequency_Hz=1.02,amplitude_m=0.0051")) == 1
    assert run.select("frequency_Hz=1.2") == ()


def test_a_measured_current_column_is_kept_sample_by_sample(tmp_path: Path) -> None:
    path = sine_file(tmp_path)
    lines = path.read_text().split()
    path.write_text("\n".join([lines[0] + ",i_mA", *(line + ",750" for line in lines[1:])]))
    run = Run.open(import_tests([path], columns={**COLUMNS, "current": "i_mA"}, out=tmp_path / "out"))
    assert run.points[0].current_A == 0.75
    assert np.allclose(run.points[0].current_measured_A, 0.75)


def test_missing_rows_and_empty_values_are_flagged_and_stay_missing(tmp_path: Path) -> None:
    path = sine_file(tmp_path)
    lines = path.read_text().split("\n")
    lines[500] = lines[500].rsplit(",", 1)[0] + ","
    del lines[800:803]
    path.write_text("\n".join(lines))
    (point,) = Run.open(import_tests([path], columns=COLUMNS, out=tmp_path / "out", current_A=0.5)).points
    assert np.isnan(point.force_N[499])
    assert point.channel("flags")[499] == 8
    assert point.channel("flags")[799] == 4
    assert point.lost_samples == 3
    assert point.samples == 1997
    assert point.verdict == "invalid"
    assert point.reasons[0].startswith("sample-gap: 3 of 2000")


def test_a_word_among_the_numbers_is_named_with_line_column_and_value(tmp_path: Path) -> None:
    message = refused(tmp_path, changed(sine_file(tmp_path), 42, "0.2,abc,1.0"))
    assert "line 42, column 'x_mm': 'abc' is not a number" in message


def test_time_that_does_not_increase_is_named_with_its_line(tmp_path: Path) -> None:
    message = refused(tmp_path, changed(sine_file(tmp_path), 42, "0.1,12.0,0.1"))
    assert "line 42: time" in message
    assert "is not after" in message


@pytest.mark.parametrize(("columns", "message"), [
    ({**COLUMNS, "displacement": "stroke_mm"}, "no column 'stroke_mm'; columns: t_s, x_mm, F"),
    ({**COLUMNS, "force": "F"}, "unknown unit"),
    ({**COLUMNS, "force": "F:mm"}, "'mm' is not a unit of force"),
    ({"time": "t_s", "force": "F:kN"}, "displacement: no column given"),
    ({**COLUMNS, "speed": "v_m_s"}, "speed=v_m_s: unknown quantity; known: time"),
])
def test_wrong_columns_say_what_would_fit(tmp_path: Path, columns: dict[str, str], message: str) -> None:
    assert message in refused(tmp_path, sine_file(tmp_path), columns=columns)


@pytest.mark.parametrize(("options", "message"), [
    ({"current_A": None}, "unknown coil current"),
    ({"current_from_name": "_(?P<current>[0-9]+)mA"}, "the file name does not match"),
    ({"current_from_name": "_([0-9.]+)A"}, "no group"),
    ({"current_from_name": "("}, "regular expression"),
])
def test_a_current_that_cannot_be_reported_is_refused(tmp_path: Path, options: dict[str, object], message: str) -> None:
    assert message in refused(tmp_path, sine_file(tmp_path), **options)


def test_files_that_are_no_text_or_not_there_are_refused(tmp_path: Path) -> None:
    (tmp_path / "b.csv").write_bytes(b"t_s,x_mm,F\n\0\0")
    (tmp_path / "c.csv").write_bytes(b"t_s,x_mm,F\n1,2,\xff\n")
    assert "zero bytes" in refused(tmp_path, tmp_path / "b.csv")
    assert "line 2: not valid UTF-8" in refused(tmp_path, tmp_path / "c.csv")
    assert "no such file" in refused(tmp_path, tmp_path / "d.csv")


def test_one_bad_file_among_good_ones_imports_nothing(tmp_path: Path) -> None:
    good, bad = sine_file(tmp_path), changed(sine_file(tmp_path, "b_0.50A.csv"), 9, "x,x,x")
    with pytest.raises(FileProblem, match=r"b_0\.50A\.csv: line 9"):
        import_tests([good, bad], columns=COLUMNS, out=tmp_path / "out", current_A=0.0)
    assert not (tmp_path / "out").exists()


def test_two_files_of_one_name_become_two_points(tmp_path: Path) -> None:
    (tmp_path / "x").mkdir()
    files = [sine_file(tmp_path), sine_file(tmp_path / "x")]
    run = Run.open(import_tests(files, columns=COLUMNS, out=tmp_path / "out", current_A=0.0))
    assert [point.id for point in run.points] == ["a_0.50A", "a_0.50A-2"]


@pytest.mark.measured
@pytest.mark.skipif(not MEASURED.is_dir(), reason="the measured UTFSM tests are not on this machine")
def test_every_measured_test_is_imported_with_its_droop_and_true_frequency(tmp_path: Path) -> None:
    files = sorted(MEASURED.glob("*.csv"))
    folder = import_tests(
        files, columns={"time": "t_s", "displacement": "x_m", "force": "force_N"}, out=tmp_path,
        current_from_name="_(?P<current>[0-9.]+)A",
    )
    run = Run.open(folder)
    assert len(run.points) == len(files) > 0
    assert all(point.verdict == "valid" for point in run.points)
    fast = [point for point in run.points if point.id.startswith("5mm3Hz")]
    assert all(point.quality.motion.frequency_Hz == pytest.approx(3.05, rel=0.01) for point in fast)
    assert all(0.0043 < point.quality.motion.amplitude_m < 0.0048 for point in fast)
    assert {point.current_A for point in run.points} == {0.0, 0.25, 0.5, 0.75, 1.0}


def test_values_no_damper_test_has_are_refused_with_their_column(tmp_path: Path) -> None:
    path = sine_file(tmp_path)
    message = refused(tmp_path, path, columns={**COLUMNS, "displacement": "x_mm:m"})
    assert "column 'x_mm:m', as displacement, spans 10 m; expected at most 2 m: check the unit" in message
    assert "column 'F:kN', as force, reaches 9e+05 N" in refused(tmp_path, changed(path, 500, "2.490,12.0,900"))


def test_a_force_that_stalls_while_the_rod_moves_is_not_valid(tmp_path: Path) -> None:
    path = sine_file(tmp_path)
    lines = [line.rsplit(",", 1)[0] + ",0.007" for line in path.read_text().splitlines()[1:]]
    path.write_text("\n".join(["t_s,x_mm,F", *lines]) + "\n")
    (point,) = Run.open(import_tests([path], columns=COLUMNS, out=tmp_path / "out", current_A=0.5)).points
    assert point.verdict == "invalid"
    assert point.reasons[0].startswith("sensor-stuck: ")


@pytest.mark.parametrize(("column", "verdict"), [(2, "valid"), (1, "invalid")])
def test_a_force_that_ends_at_the_same_value_in_every_cycle_did_not_stand_still(
    column: int, verdict: str, tmp_path: Path
) -> None:
    path = sine_file(tmp_path)
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    rows[:, 1:] += np.random.default_rng(1).normal(0.0, 0.002, (len(rows), 2))
    rows[:, column] = np.minimum(rows[:, column], np.quantile(rows[:, column], 0.8))
    np.savetxt(path, rows, "%.9g", ",", header="t_s,x_mm,F", comments="")
    (point,) = Run.open(import_tests([path], columns=COLUMNS, out=tmp_path / "out", current_A=0.5)).points
    assert point.verdict == verdict, point.reasons


def at_the_rail(force_kN: np.ndarray) -> np.ndarray:
    """A cable that lost contact twice in eight cycles."""
    lost = np.zeros(force_kN.size, bool)
    lost[600:660] = lost[1000:1060] = True
    return np.where(lost, -10.0, force_kN)


def of_two_values(force_kN: np.ndarray) -> np.ndarray:
    """A trigger's column."""
    return np.where(force_kN > 0.0, 0.0, -0.3)


@pytest.mark.parametrize("shown", [at_the_rail, of_two_values])
def test_a_force_that_stands_at_an_extreme_otherwise_than_as_a_clipped_one_is_not_valid(
    shown: Callable[[np.ndarray], np.ndarray], tmp_path: Path
) -> None:
    path = sine_file(tmp_path)
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    rows[:, 2] = shown(rows[:, 2] + np.random.default_rng(1).normal(0.0, 0.002, len(rows)))
    np.savetxt(path, rows, "%.9g", ",", header="t_s,x_mm,F", comments="")
    (point,) = Run.open(import_tests([path], columns=COLUMNS, out=tmp_path / "out", current_A=0.5)).points
    assert point.verdict == "invalid"
    assert point.reasons[0].startswith("sensor-stuck: ")


def test_an_exact_force_of_few_digits_is_not_accused(tmp_path: Path) -> None:
    path = sine_file(tmp_path)
    rows = [line.rsplit(",", 1) for line in path.read_text().splitlines()[1:]]
    lines = [f"{beside},{float(force):.3f}" for beside, force in rows]
    path.write_text("\n".join(["t_s,x_mm,F", *lines]) + "\n")
    (point,) = Run.open(import_tests([path], columns=COLUMNS, out=tmp_path / "out", current_A=0.5)).points
    assert (point.verdict, point.reasons) == ("valid", ())


def test_a_force_of_the_wrong_sign_is_not_valid_and_is_not_fitted_as_suspect(tmp_path: Path) -> None:
    path = sine_file(tmp_path)
    rows = [line.rsplit(",", 1) for line in path.read_text().splitlines()[1:]]
    path.write_text("\n".join(["t_s,x_mm,F", *(f"{beside},{-float(force)}" for beside, force in rows)]) + "\n")
    folder = import_tests([path], columns=COLUMNS, out=tmp_path / "out", current_A=0.5)
    (point,) = Run.open(folder).points
    assert point.verdict == "invalid"
    assert point.reasons[0].startswith("reversed-sign: the measured force acts with the motion")
    with pytest.raises(IdentificationFailed, match=r"no point is valid: .*reversed-sign.*\)$"):
        identify_run([folder])


@pytest.mark.filterwarnings("ignore::rig.errors.DataWarning")
def test_compression_positive_files_are_inverted_once_and_found_by_their_gas_force(tmp_path: Path) -> None:
    time_s = np.arange(600) * 0.01
    x_mm, force = 5.0 * np.sin(2 * np.pi * time_s), 300.0 * np.cos(2 * np.pi * time_s) + 120.0  # pushing the rod out
    path = tmp_path / "a.csv"
    path.write_text("t_s,x_mm,F_N\n" + "".join(f"{t},{x},{f}\n" for t, x, f in zip(time_s, x_mm, force, strict=True)))
    columns = {"time": "t_s", "displacement": "x_mm", "force": "F_N"}
    stated = {"columns": columns, "current_A": 0.5, "mid_stroke_m": 1e-3}
    with pytest.warns(UserWarning, match=r"12\d N in rebound.*import again with --positive compression"):
        import_tests([path], out=tmp_path, **stated)  # type: ignore[arg-type]  # as the command passes them
    details = tmp_path / "customer.toml"
    details.write_text('[display]\nforce = "lbf"\n[report]\ncustomer = "ACME"\n')
    first = import_tests([path], out=tmp_path, positive="compression", details=details, **stated)  # type: ignore[arg-type]  # the same
    for folder in (first, import_tests([path], out=tmp_path, like=first, current_A=0.5)):
        (point,) = Run.open(folder).points
        assert (point.verdict, point.mid_stroke_m) == ("valid", -1e-3)
        assert (np.min(point.force_N), np.max(point.force_N)) == pytest.approx((-420.0, 180.0), rel=1e-3)
        assert point.displacement_m[25] == pytest.approx(-0.005)
    run = Run.open(first)
    assert run.display.force_unit == "lbf"
    assert Details.of(run).table.customer == "ACME"
    scales = {"force": -1, "displacement": -1.0}
    assert "invert displacement and force twice" in refused(tmp_path, path, scales=scales, positive="compression")


def test_a_column_without_a_number_is_named(tmp_path: Path) -> None:
    path = sine_file(tmp_path)
    rows = [line.rsplit(",", 1)[0] + ",nan,NaN" for line in path.read_text().splitlines()[1:]]
    path.write_text("\n".join(["t_s,x_mm,F,T", *rows]) + "\n")
    with pytest.raises(FileProblem) as caught:
        import_tests([path], columns={**COLUMNS, "temperature": "T:degC"}, out=tmp_path / "out", current_A=0.5)
    force, temperature, _ = caught.value.problems
    assert force.endswith("as force: none of 2000 rows contains a number; specify another column")
    assert temperature.endswith("as temperature: none of 2000 rows contains a number; specify another column, "
        "or omit the column")
    assert not (tmp_path / "out").exists()



@pytest.mark.parametrize("form", [
    "%H:%M:%S:", "%M:%S.", "%Y.%m.%d %H:%M:%S.", "%Y%m%dT%H%M%S.", "%Y-%m-%d-%H.%M.%S.", "0 days %H:%M:%S.",
])  # fmt: skip
def test_further_forms_of_time_stamps_are_read(form: str, tmp_path: Path) -> None:
    begin = datetime(2026, 3, 4, 10, 11, 12, tzinfo=UTC)
    lines = ["when,x_mm,F_N"]
    for number in range(400):
        t = 0.01 * number
        stamp = (begin + timedelta(milliseconds=10 * number)).strftime(form) + f"{10 * number % 1000:03d}"
        lines.append(f"{stamp},{20.0 * math.sin(9.0 * t):.5f},{72.0 * math.cos(9.0 * t):.4f}")
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    columns = {"time": "when", "displacement": "x_mm", "force": "F_N"}
    (point,) = Run.open(import_tests([tmp_path / "a.csv"], columns=columns, out=tmp_path, current_A=0.0)).points
    assert point.frequency_Hz == pytest.approx(9.0 / math.tau, rel=1e-3)


def test_an_unknown_form_of_time_stamps_is_refused_with_the_way_out(tmp_path: Path) -> None:
    rows = [f"00h00m{0.01 * number:06.3f}s,{number % 7},{number % 5}" for number in range(50)]
    (tmp_path / "a.csv").write_text("\n".join(("when,x_mm,F_N", *rows)) + "\n", encoding="utf-8")
    columns = {"time": "when", "displacement": "x_mm", "force": "F_N"}
    with pytest.raises(FileProblem, match=r"their format is unknown.*--rate instead of the column"):
        import_tests([tmp_path / "a.csv"], columns=columns, out=tmp_path, current_A=0.0)
