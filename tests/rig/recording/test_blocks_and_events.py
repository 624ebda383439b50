"""Text files of machines: blocks with repeated headings, LVM segments, events, thousands signs, midnight."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rig.errors import FileProblem
from rig.recording.external_tests import ImportedTest, ImportSettings, read_tests
from rig.recording.file_formats.table_file import Dialect

ROWS = 600
T = np.arange(ROWS) * 0.005
X_MM, F_N = 20.0 * np.sin(4.0 * np.pi * T), 900.0 * np.cos(4.0 * np.pi * T) + 400.0
HEADING = "Stroke\tLoad\tTime\nmm\tN\tSec"
COLUMNS = {"time": "Time", "displacement": "Stroke", "force": "Load"}


def rows(time_s: np.ndarray = T) -> list[str]:
    return [f"{x:.4f}\t{f:.3f}\t{t:.4f}" for t, x, f in zip(time_s, X_MM, F_N, strict=True)]


def read(path: Path, text: str, columns: dict[str, str] | None = None, **options: str) -> list[ImportedTest]:
    path.write_text(text, encoding="utf-8")
    return read_tests([path], ImportSettings(columns or COLUMNS, 0.5, dialect=Dialect(**options)))  # type: ignore[arg-type]


def blocks(time_s: np.ndarray, heading: str = HEADING, second: str = HEADING) -> str:
    lines = rows(time_s)
    parts = [lines[:250], lines[250:450], lines[450:]]
    heads = [heading, second, heading]
    return "MTS793|MPT|ENU|1|2|.|/|:|1|0|0|A\n\n" + "\n\n".join(
        f"Data Acquisition\t\t\t\t\t\tTime:\t{k}.02\tSec\t3/16/2026 7:48:04 AM\n{head}\n" + "\n".join(part)
        for k, (head, part) in enumerate(zip(heads, parts, strict=True))
    ) + "\n"


def test_blocks_of_one_heading_are_one_test_where_the_time_goes_on(tmp_path: Path) -> None:
    (test,) = read(tmp_path / "a.dat", blocks(T))
    assert test.time_s == pytest.approx(T)
    assert test.force_N == pytest.approx(F_N, abs=1e-3)
    assert "2 repeated heading(s) (lines 256, 460)" in test.read_as


@pytest.mark.parametrize("later", [-0.5, 3.0])
def test_blocks_are_tests_of_their_own_where_it_does_not(later: float, tmp_path: Path) -> None:
    tests = read(tmp_path / "a.dat", blocks(np.where(np.arange(ROWS) >= 450, T + later, T)))
    assert [(test.part, len(test.time_s)) for test in tests] == [("part1", 450), ("part2", 150)]
    assert tests[1].displacement_m == pytest.approx(X_MM[450:] * 1e-3, abs=1e-7)


@pytest.mark.parametrize("second", ["Stroke\tLoad\tTime\nmm\tkN\tSec", "Load\tStroke\tTime\nN\tmm\tSec", "A\tB\tC"])
def test_a_block_of_another_heading_is_never_joined(second: str, tmp_path: Path) -> None:
    for event_rows in ("refuse", "skip", "split"):
        if event_rows == "refuse" or "A" not in second:
            with pytest.raises(FileProblem, match="line 258: another table starts"):
                read(tmp_path / "a.dat", blocks(T, second=second), event_rows=event_rows)
        else:  # it has not the columns of the test: left out, as peaks and valleys beside a record
            tests = read(tmp_path / "a.dat", blocks(T, second=second), event_rows=event_rows)
            assert [len(test.time_s) for test in tests] == [250, 150]
            assert tests[1].displacement_m == pytest.approx(X_MM[450:] * 1e-3, abs=1e-7)
            assert "200 row(s) of other tables left out (after line 256)" in tests[0].read_as


def test_the_decimal_sign_of_mts_is_that_of_its_first_line(tmp_path: Path) -> None:
    head = "MTS793|MPT|DEU|1|2|,|.|:|49|1|1|A\n\nDatenerfassung\tZeit:\t3,02\tSek\n" + HEADING + "\n"
    body = "\n".join(f"{x:.3f}\t{10 * np.ceil(f)}\t{t:.3f}" for t, x, f in zip(T, X_MM, F_N, strict=True))
    body = body.replace(".0\t", ",000\t").replace(".", ",")  # every number may be thousands
    (test,) = read(tmp_path / "a.dat", head + body + "\n")
    assert test.force_N == pytest.approx(10.0 * np.ceil(F_N))
    assert test.displacement_m == pytest.approx(1e-3 * X_MM, abs=1e-6)


LVM_UNITS = "mm\tNewtons"


def lvm(*, x_columns: str = "One", begun: tuple[str, ...] = ("25.94", "26.94"), units: str = LVM_UNITS) -> str:
    text = ("LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n"
            f"Multi_Headings\tYes\nX_Columns\t{x_columns}\nTime_Pref\tRelative\nDate\t2026/03/16\n"
            "Time\t11:32:25.938945770263671875\n***End_of_Header***\t\n\t\n")  # fmt: skip
    for k, second in enumerate(begun):
        part = slice(200 * k, 200 * (k + 1))
        text += ("Channels\t2\t\nSamples\t200\t200\nDate\t2026/03/16\t2026/03/16\n"
                 f"Time\t11:32:{second}\t11:32:{second}\nY_Unit_Label\t{units if k else LVM_UNITS}\n"
                 "X_Dimension\tTime\tTime\nX0\t0.0E+0\t0.0E+0\nDelta_X\t0.005\t0.005\n***End_of_Header***\t\t\n"
                 "X_Value\tStroke\tForce\tComment\n")  # fmt: skip
        text += "".join(f"{f'{t:.6f}' if x_columns == 'One' else ''}\t{x:.6f}\t{f:.6f}\n"
                        for t, x, f in zip(T[part], X_MM[part], F_N[part], strict=True))  # fmt: skip
    return text


LVM = {"displacement": "Stroke", "force": "Force"}


@pytest.mark.parametrize("x_columns", ["One", "No"])
def test_lvm_segments_have_the_units_and_times_of_their_headers(x_columns: str, tmp_path: Path) -> None:
    (test,) = read(tmp_path / "a.lvm", lvm(x_columns=x_columns), LVM)
    assert test.time_s == pytest.approx(T[:400], abs=1e-6)
    assert test.displacement_m == pytest.approx(X_MM[:400] * 1e-3, abs=1e-8)
    assert test.force_N == pytest.approx(F_N[:400], abs=1e-5)
    assert "LVM, 2 segments" in test.read_as


def test_lvm_segments_that_began_later_are_tests_of_their_own_and_other_units_are_refused(tmp_path: Path) -> None:
    tests = read(tmp_path / "a.lvm", lvm(x_columns="No", begun=("25.94", "40.0")), LVM)
    assert [len(test.time_s) for test in tests] == [200, 200]
    with pytest.raises(FileProblem, match="this segment has the units in, lbf; the first segment has mm, Newtons"):
        read(tmp_path / "a.lvm", lvm(units="in\tlbf"), LVM)


def test_events_between_rows_are_named_left_out_or_split_off(tmp_path: Path) -> None:
    lines = rows()
    lines[300:300] = ["1.5\tSwitched from 1 to 2\t", ""]
    text = HEADING + "\n" + "\n".join(lines) + "\n"
    with pytest.raises(FileProblem, match=r"'Switched from 1 to 2' is not a number(.|\n)*--event-rows skip"):
        read(tmp_path / "a.txt", text)
    (test,) = read(tmp_path / "a.txt", text, event_rows="skip")
    assert test.force_N == pytest.approx(F_N, abs=1e-3)
    assert "1 row(s) without numbers skipped (line 303)" in test.read_as
    assert [len(one.time_s) for one in read(tmp_path / "a.txt", text, event_rows="split")] == [300, 300]


def test_many_rows_that_are_no_numbers_are_no_events(tmp_path: Path) -> None:
    lines = [line.replace(".", ",", 1) if k > 20 and k % 3 == 0 else line for k, line in enumerate(rows())]
    with pytest.raises(FileProblem, match="numbers in another format"):
        read(tmp_path / "a.txt", HEADING + "\n" + "\n".join(lines) + "\n", event_rows="skip", decimal=".", thousands="")
    lines = [f"event {k}" if k > 20 and k % 3 == 0 else line for k, line in enumerate(rows())]
    with pytest.raises(FileProblem, match="too many to be events"):
        read(tmp_path / "a.txt", HEADING + "\n" + "\n".join(lines) + "\n", event_rows="skip")


def test_peaks_with_a_thousands_sign_are_never_skipped_as_events(tmp_path: Path) -> None:
    lines = [f"{t:.3f},{x:.3f},{f:,.1f}" for t, x, f in zip(T, X_MM, 1200.0 * T**3 / 27.0, strict=True)]
    assert any(line.count(",") == 3 for line in lines)
    with pytest.raises(FileProblem, match="more numbers than columns"):
        read(tmp_path / "a.csv", "t_s,x_mm,F_N\n" + "\n".join(lines) + "\n",
             {"time": "t_s", "displacement": "x_mm", "force": "F_N"}, event_rows="skip")  # fmt: skip


@pytest.mark.parametrize("remark", ["\n# start", ";note", ";;go"])
@pytest.mark.parametrize("row", [0, 2])
def test_a_remark_in_or_between_the_first_rows_hides_no_heading(remark: str, row: int, tmp_path: Path) -> None:
    lines = [f"{t:.3f};{x:.4f};{f:.3f}" for t, x, f in zip(T, X_MM, F_N, strict=True)]
    lines[row] += remark
    (test,) = read(tmp_path / "a.csv", "t_s;x_mm;F_N;;\n" + "\n".join(lines) + "\n",
                   {"time": "t_s", "displacement": "x_mm", "force": "F_N"}, event_rows="skip")  # fmt: skip
    assert test.force_N == pytest.approx(F_N, abs=1e-3)


@pytest.mark.parametrize("sign", ["'", "\u2019", "\u00a0", "\u202f", " ", ","])
@pytest.mark.parametrize("first_row", [0, 300])
def test_thousands_signs_wherever_they_first_appear(sign: str, first_row: int, tmp_path: Path) -> None:
    force = F_N + np.where(np.arange(ROWS) >= first_row, 1000.0, -900.0)
    lines = [f"{t:.3f};{x:.3f};{f:,.2f}".replace(",", sign) for t, x, f in zip(T, X_MM, force, strict=True)]
    (test,) = read(tmp_path / "a.csv", "t_s;x_mm;F_N\n" + "\n".join(lines) + "\n",
                   {"time": "t_s", "displacement": "x_mm", "force": "F_N"})  # fmt: skip
    assert test.force_N == pytest.approx(force, abs=0.006)
    assert "thousands" in test.read_as


def test_times_of_day_go_on_after_midnight(tmp_path: Path) -> None:
    stamps = [f"23:59:{58 + t:06.3f}" if t < 1.9999 else f"00:00:{t - 2 + 1e-9:06.3f}" for t in T]
    lines = [f"{s};{x:.4f};{f:.3f}" for s, x, f in zip(stamps, X_MM, F_N, strict=True)]
    (test,) = read(tmp_path / "a.csv", "time;x_mm;F_N\n" + "\n".join(lines) + "\n",
                   {"time": "time", "displacement": "x_mm", "force": "F_N"})  # fmt: skip
    assert test.time_s == pytest.approx(T, abs=1e-6)
    assert "midnight" in test.read_as
