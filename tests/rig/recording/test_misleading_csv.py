"""CSV files that could be read with numbers that are not theirs: right, flagged, or refused with the way out."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from rig.errors import FileProblem
from rig.recording.external_tests import ImportedTest, ImportSettings, read_tests
from rig.recording.file_formats.table_file import Dialect
from rig.recording.importing import import_tests
from rig.recording.run import Run

ROWS = 1000
T = np.arange(ROWS) * 0.004
X_MM = 12.0 + 20.0 * np.sin(2.0 * np.pi * T)
F_N = 800.0 * np.cos(2.0 * np.pi * T)
HEAD = "t_s,x_mm,F_N\n"
COLUMNS = {"time": "t_s", "displacement": "x_mm", "force": "F_N"}


def lines(separator: str = ",", force: str = "{:.5f}", times: float = 1.0) -> list[str]:
    rows = zip(T, X_MM, times * F_N, strict=True)
    return [separator.join((f"{t:.6f}", f"{x:.5f}", force.format(f))) for t, x, f in rows]


def read(path: Path, text: str | bytes, dialect: Dialect | None = None, **columns: str) -> ImportedTest:
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    (test,) = read_tests([path], ImportSettings(columns or COLUMNS, 0.5, None, None, dialect or Dialect()))
    return test


def problems(path: Path, text: str | bytes, **columns: str) -> str:
    with pytest.raises(FileProblem) as caught:
        read(path, text, **columns)
    return "\n".join(caught.value.problems)


def check(test: ImportedTest, times: float = 1.0) -> None:
    assert test.time_s == pytest.approx(T, abs=1e-9)
    assert test.displacement_m == pytest.approx(X_MM * 1e-3, abs=1e-8)
    assert test.force_N == pytest.approx(times * F_N, abs=6e-3)


def test_thousands_commas_that_part_a_number_in_two_are_never_read(tmp_path: Path) -> None:
    """-1,234.5 between commas is two cells: a force of 1 N in some rows."""
    wide = lines(force="{:,.3f}", times=3.0)
    assert "no column 'F_N'; columns: #1, #2, #3, #4" in problems(tmp_path / "a.csv", HEAD + "\n".join(wide))
    few = lines()
    few[400] = "1.600000,1.2,1,234.5"
    assert "line 402: 4 values, but only 3 columns" in problems(tmp_path / "b.csv", HEAD + "\n".join(few))


def test_thousands_in_quotes_are_read(tmp_path: Path) -> None:
    rows = [f'{t:.6f},{x:.5f},"{3.0 * f:,.3f}"' for t, x, f in zip(T, X_MM, F_N, strict=True)]
    test = read(tmp_path / "a.csv", HEAD + "\n".join(rows) + "\n")
    check(test, times=3.0)
    assert "thousands ','" in test.read_as


@pytest.mark.parametrize("sign", [",", "."])
def test_whole_numbers_that_may_be_decimals_are_not_guessed(tmp_path: Path, sign: str) -> None:
    force = 12_000.0 + 10_000.0 * np.cos(2.0 * np.pi * T)
    rows = [f"{1e3 * t:.0f};{100.0 + 1e3 * x:.0f};{f:,.0f}".replace(",", sign)
            for t, x, f in zip(T, X_MM, force, strict=True)]  # fmt: skip
    text = "t_ms;x_um;F_N\n" + "\n".join(rows) + "\n"
    columns = {"time": "t_ms", "displacement": "x_um", "force": "F_N"}
    reported = problems(tmp_path / "a.csv", text, **columns)
    assert f"'22{sign}000' may be 22000 or a number with three decimals" in reported
    thousands = read(tmp_path / "a.csv", text, Dialect(decimal="." if sign == "," else ","), **columns)
    assert thousands.force_N == pytest.approx(force, abs=0.6)
    decimals = read(tmp_path / "a.csv", text, Dialect(decimal=sign), **columns)
    assert np.max(decimals.force_N) == pytest.approx(22.0)


def test_a_number_that_is_not_grouped_by_thousands_is_none_where_others_are(tmp_path: Path) -> None:
    rows = [f"{t:.6f};{x:.5f};{3.0 * f:,.3f}".replace(",", "#").replace(".", ",").replace("#", ".")
            for t, x, f in zip(T, X_MM, F_N, strict=True)]  # fmt: skip
    rows[700] = "2,800000;12.5;1,0"
    assert "line 702, column 'x_mm': '12.5' is not a number" in problems(
        tmp_path / "a.csv", HEAD.replace(",", ";") + "\n".join(rows) + "\n")  # fmt: skip


@pytest.mark.parametrize("head", ["t_s x_mm F_N\n", "Time Axial Disp Axial Force\n"])
def test_names_that_cannot_be_matched_to_columns_name_none(tmp_path: Path, head: str) -> None:
    """Row names as R writes them have no name, and names of two words look like two."""
    rows = lines(" ") if "Axial" in head else [f'"{k}" {row}' for k, row in enumerate(lines(" "))]
    text = head + "\n".join(rows) + "\n"
    reported = problems(tmp_path / "a.csv", text, time="t_s", displacement="Disp:mm", force="F_N")
    assert "no column 'Disp'; columns: #1, #2, #3" in reported
    first = 1 if "Axial" in head else 2
    expected = {name: f"#{first + k}:{unit}" for k, (name, unit) in enumerate(
        (("time", "s"), ("displacement", "mm"), ("force", "N")))}  # fmt: skip
    check(read(tmp_path / "a.csv", text, **expected))


@pytest.mark.parametrize("head", ["Time (S)   Disp (MM)   Force (N)\n", "Time [s] Disp [mm] Force [N]\n"])
def test_units_in_brackets_between_white_space_belong_to_their_names(tmp_path: Path, head: str) -> None:
    text = head + "\n".join(lines("  ")) + "\n"
    check(read(tmp_path / "a.csv", text, time="Time", displacement="Disp", force="Force"))


@pytest.mark.parametrize("cut", [3, 8, 14])
def test_the_last_number_of_a_file_that_was_cut_off_is_not_believed(tmp_path: Path, cut: int) -> None:
    text = HEAD + "\n".join(lines())
    test = read(tmp_path / "a.csv", text[:-cut])
    assert len(test.force_N) == ROWS
    assert np.isnan(test.force_N[-1])
    assert np.isnan(test.displacement_m[-1]) == (cut == 14)
    assert test.force_N[:-1] == pytest.approx(F_N[:-1], abs=1e-5)
    check(read(tmp_path / "a.csv", text))


def test_binary_and_endless_quotes_are_refused_in_words(tmp_path: Path) -> None:
    assert "a PDF document" in problems(tmp_path / "b.csv", b"%PDF-1.4\n" + bytes(range(256)))
    assert "not valid UTF-8 text" in problems(tmp_path / "a.csv", b'%pdf-1.4\n"' + bytes(range(1, 256)) * 10)
    endless = HEAD + "\n".join(lines()) + '\n"' + "x" * 200_000 + "\n"
    assert "line 1002, column 't_s'" in problems(tmp_path / "a.csv", endless)
    check(read(tmp_path / "a.csv", (HEAD + "\n".join(lines())).encode("utf-32")))


def test_a_long_recording_is_looked_at_within_seconds(tmp_path: Path) -> None:
    t = np.arange(300_000) * 1e-3
    rows = "".join(f"{a:.3f},{20.0 * b:.4f},{b:.2f}\n" for a, b in zip(t, np.sin(6.28 * t), strict=True))
    started = time.process_time()
    test = read(tmp_path / "a.csv", HEAD.replace("F_N", "F_kN") + rows, time="t_s", displacement="x_mm", force="F_kN")
    assert time.process_time() - started < 5.0
    assert len(test.time_s) == 300_000


def test_what_is_reported_in_two_ways_is_not_chosen_from_in_silence(tmp_path: Path) -> None:
    path = tmp_path / "a_1.0A.csv"
    path.write_text(HEAD + "\n".join(lines()))
    (tmp_path / "sub").mkdir()
    with pytest.raises(FileProblem) as caught:
        read_tests([path, tmp_path / "sub" / ".." / path.name],
                   ImportSettings(COLUMNS, 0.5, None, 250.0))  # fmt: skip
    reported = "\n".join(caught.value.problems)
    assert "--rate and --column time=t_s both" in reported
    assert f"{path} is given 2 times" in reported


def test_exponents_of_fortran_are_named_with_the_way_out(tmp_path: Path) -> None:
    reported = "line 2: '-1.200000D+01' has a Fortran exponent with D: write exponents with E"
    fortran = [f"{-12.0 + k:.6E},{k:.6E},{2 * k:.6E}".replace("E", "D") for k in range(ROWS)]
    assert reported in problems(tmp_path / "a.csv", HEAD + "\n".join(fortran))
    some = [f"{0.1 * k:.3f},{k:.3f},{2 * k:.3f}" for k in range(ROWS)]
    some[300] = "30.0,300.0,6.0d2"
    assert "line 302, column 'F_N': '6.0d2' is not a number; it has a Fortran exponent with D" in problems(
        tmp_path / "b.csv", HEAD + "\n".join(some)
    )


def test_ends_of_lines_and_minus_signs_of_other_programs_are_read(tmp_path: Path) -> None:
    check(read(tmp_path / "windows.csv", (HEAD + "\n".join(lines()) + "\n").replace("\n", "\r\r\n")))
    check(read(tmp_path / "dos.csv", HEAD + "\n".join(lines()) + "\n\x1a"))
    check(read(tmp_path / "minus.csv", HEAD + "\n".join(lines()).replace("-", "\u2212") + "\n"))


def test_zero_bytes_are_named_with_their_line(tmp_path: Path) -> None:
    text = (HEAD + "\n".join(lines()) + "\n").encode()
    reported = problems(tmp_path / "a.csv", text + b"\0" * 5000)
    assert "line 1002: zero bytes up to the end of the file (possibly a loss of power during recording)" in reported
    assert "line 1002: zero bytes; utf-8 text contains no" in problems(tmp_path / "b.csv", text + b"\0\n" + text)


def test_any_name_of_a_file_gives_a_run_that_opens(tmp_path: Path) -> None:
    """One that begins with a dot, or a long one, made a run that no command could open."""
    files = [tmp_path / name for name in (".hidden.csv", "..csv", "x" * 200 + ".csv", "x" * 201 + ".csv")]
    for file in files:
        file.write_text(HEAD + "\n".join(lines()) + "\n")
    run = Run.open(import_tests(files, columns=COLUMNS, out=tmp_path, current_A=0.5))
    assert {point.id for point in run.points} >= {"hidden", "x" * 100, "x" * 100 + "-2"}
    assert len(run.points) == len(files)
