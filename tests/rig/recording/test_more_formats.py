"""Excel workbooks, HDF5, MATLAB struct arrays, RPC III: read right; what is not read is named with the way out."""

from __future__ import annotations

import contextlib
import datetime as dt
import io
import string
import struct
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from rig.errors import FileProblem
from rig.recording.external_tests import ImportedTest, ImportSettings, read_tests
from rig.recording.file_formats.rpc3_file import Rpc3Channel, Rpc3File, encoded
from rig.recording.file_formats.table_file import Dialect
from rig.recording.file_formats.workbook_rows import cell_text, number_pattern

ROWS = 500
T = np.arange(ROWS) * 0.005
X_MM, F_N = 20.0 * np.sin(4.0 * np.pi * T), 900.0 * np.cos(4.0 * np.pi * T)
COLUMNS = {"time": "t_s", "displacement": "x_mm", "force": "F_N"}


def read(path: Path, columns: dict[str, str], **options: str) -> list[ImportedTest]:
    settings = ImportSettings(columns, 0.5, dialect=Dialect(**options))  # type: ignore[arg-type]
    return read_tests([path], settings)


def check(test: ImportedTest, rows: int = ROWS) -> None:
    assert test.time_s == pytest.approx(T[:rows], abs=1e-6)
    assert test.displacement_m == pytest.approx(X_MM[:rows] * 1e-3, abs=1e-6)
    assert test.force_N == pytest.approx(F_N[:rows], abs=0.05)


def workbook(path: Path, sheets: dict[str, list[list[object]]]) -> Path:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.remove(book.active)
    for name, rows in sheets.items():
        sheet = book.create_sheet(name)
        for row in rows:
            sheet.append(row)
    book.save(path)
    return path


SHEET = 200
"""Rows of the tables in workbooks, which openpyxl writes slowly."""
NUMBERS = [(float(t), float(x), float(f)) for t, x, f in zip(T[:SHEET], X_MM, F_N, strict=False)]
TABLE: list[list[object]] = [["t_s", "x_mm", "F_N"], *map(list, NUMBERS)]
UNITS: list[list[object]] = [["Damper 7"], [dt.date(2026, 3, 1)], [], ["t", "x", "F", "note"],
                             ["s", "mm", "kN"], *([t, x, f / 1e3, "ok"] for t, x, f in NUMBERS)]  # fmt: skip
START = dt.datetime(2026, 3, 16, 23, 59, 59)  # noqa: DTZ001 - as workbooks have them
STAMPS: list[list[object]] = [["at", "x_mm", "F_N"], *([START + dt.timedelta(seconds=t), x, f] for t, x, f in NUMBERS)]


SUMMARY: list[list[object]] = [[None, "Summary", "value"], [None, "max F", 900.0], [None, "min F", -900.0]]
BESIDE: list[list[object]] = [*([*row, *more] for row, more in zip(TABLE, SUMMARY, strict=False)), *TABLE[3:]]


@pytest.mark.parametrize(("rows", "columns"), [
    (TABLE, COLUMNS), (BESIDE, COLUMNS), (UNITS, {"time": "t", "displacement": "x", "force": "F"}),
    (STAMPS, {**COLUMNS, "time": "at"}),
])
def test_the_table_of_a_workbook_is_read(rows: list[list[object]], columns: dict[str, str], tmp_path: Path) -> None:
    notes: list[list[object]] = [["remarks"], ["none", 1.0]]
    (test,) = read(workbook(tmp_path / "a.xlsx", {"Notes": notes, "Run 1": rows}), columns)
    check(test, SHEET)
    assert "Excel workbook, sheet 'Run 1'" in test.read_as


def test_numbers_in_text_cells_have_the_stated_decimal_separator(tmp_path: Path) -> None:
    text = [TABLE[0], *([one if place == 0 else f"{one:.9f}".replace(".", ",") for place, one in enumerate(row)]
                        for row in TABLE[1:] if isinstance(row[0], (int, float)))]  # fmt: skip
    path = workbook(tmp_path / "a.xlsx", {"Run": text})
    with pytest.raises(FileProblem, match=r"is not a number\. Fix: if the comma is the decimal separator, add"):
        read(path, COLUMNS)
    (test,) = read(path, COLUMNS, decimal=",")
    check(test, len(text) - 1)


@pytest.mark.parametrize(("decimal", "cell", "text"), [
    (",", "1.234,5", "1234.5"), (",", "-0,25e3", "-0.25e3"), (",", "12", "12"), (",", "1.234", "1234"),
    (",", 1.234, "1.234"), (".", "1,234.5", "1234.5"), (",", "1.2", "1.2"), (",", "a,b", "a,b"), ("", "1,5", "1,5"),
])  # fmt: skip
def test_a_text_cell_is_a_number_in_the_stated_notation_only(decimal: str, cell: object, text: str) -> None:
    assert cell_text(cell, number_pattern(decimal)) == text


def test_sheets_are_chosen_by_name_or_are_tests_each(tmp_path: Path) -> None:
    path = workbook(tmp_path / "a.xlsx", {"0.5A": TABLE, "1.0A": TABLE[:101]})
    with pytest.raises(FileProblem, match=r"2 sheets contain tables: '0\.5A', '1\.0A'\. Fix: use --sheet"):
        read(path, COLUMNS)
    with pytest.raises(FileProblem, match=r"no sheet 'x'; its sheets: '0\.5A', '1\.0A'"):
        read(path, COLUMNS, sheet="x")
    (one,) = read(path, COLUMNS, sheet="1.0A")
    check(one, 100)
    settings = ImportSettings(COLUMNS, None, r"(?P<current>[0-9.]+)A", dialect=Dialect(sheet="all"))
    tests = read_tests([path], settings)
    assert [(test.part, test.nominal_current_A) for test in tests] == [("0.5A", 0.5), ("1.0A", 1.0)]


def test_several_sheets_are_named_and_a_sheet_of_peaks_is_left_out(tmp_path: Path) -> None:
    """`--sheet A --sheet B` imported B alone, and a summary among the sheets made `all` fail without naming it."""
    peaks: list[list[object]] = [["Speed (in/s)", "Load (lbs)"], *([float(row), 2.0 * row] for row in range(20))]
    path = workbook(tmp_path / "a.xlsx", {"PVP": peaks, "5 ips": TABLE, "6 ips": TABLE, "old": TABLE})
    for sheet in (("6 ips", "5 ips"), ("* ips",), ("5*", "6 ips")):
        settings = ImportSettings(COLUMNS, 0.5, dialect=Dialect(sheet=sheet))
        assert [test.part for test in read_tests([path], settings)] == ["5 ips", "6 ips"]
    with pytest.raises(FileProblem) as caught:
        read(path, COLUMNS, sheet="all")
    assert any("sheet 'PVP': force=F_N: no column" in text for text in caught.value.problems)
    assert caught.value.problems[-1].endswith("--sheet '5 ips' --sheet '6 ips' --sheet old")
    settings = ImportSettings(COLUMNS, 0.5, dialect=Dialect(sheet=("5 ips", "7 ips")))
    with pytest.raises(FileProblem, match="no sheet '7 ips'"):
        read_tests([path], settings)


def test_tests_below_each_other_in_a_sheet_are_tests_each(tmp_path: Path) -> None:
    for between in ([["Test 2"], TABLE[0]], []):  # the heading again, or only a blank row
        rows = [*TABLE[:151], [], *between, *TABLE[1:102]]
        tests = read(workbook(tmp_path / "a.xlsx", {"Run": rows}), COLUMNS)
        assert [len(test.time_s) for test in tests] == [150, 101]
        check(tests[1], 101)


@pytest.mark.parametrize("name", ["sample.xls", "sample.ods", "sample.xlsb"])
def test_workbooks_of_other_programs_are_read(name: str) -> None:
    """Three columns of 60 rows below row 3, right of column A, written by xlwt, odfpy and pyxlsbwriter."""
    (test,) = read(Path(__file__).parent / "workbooks" / name, COLUMNS)
    check(test, 60)


def test_numbers_stored_as_text_with_a_comma_are_never_thousands(tmp_path: Path) -> None:
    rows = [*TABLE[:50], ["0,245", "12,345", "1,234"], *TABLE[51:]]
    with pytest.raises(FileProblem, match="'12,345' is not a number"):
        read(workbook(tmp_path / "a.xlsx", {"Run": rows}), COLUMNS)


def test_workbooks_that_unpack_beyond_measure_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = workbook(tmp_path / "a.xlsx", {"Run": TABLE})
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("xl/media/image.png", bytes(65 << 20))
    with pytest.raises(FileProblem, match="unpacks to 68157440 bytes"):
        read(path, COLUMNS)
    far = workbook(tmp_path / "b.xlsx", {"Run": TABLE[:60]})
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.load_workbook(far)
    book["Run"]["XFD1048576"] = 1.0  # calamine would allocate 512 GiB, and end the process
    book.save(far)
    with pytest.raises(FileProblem, match="more than 2 GiB of memory"):
        read(far, COLUMNS)
    monkeypatch.setattr("rig.recording.file_formats.table_file.MOST_NUMBERS", 2000)
    with pytest.raises(FileProblem, match="contains 603 cells or more; at most 500 are allowed"):
        read(workbook(tmp_path / "c.xlsx", {"Run": TABLE}), COLUMNS)


def test_columns_below_a_merged_cell_are_found_by_it_and_hidden_sheets_only_by_name(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    heading: list[list[object]] = [["Two dampers"], ["Time", "Damper 1", None, "Damper 2", None],
                                   [None, "Stroke", "Force", "Stroke", "Force"], ["s", "mm", "kN", "mm", "kN"]]
    numbers: list[list[object]] = [[t, 0.0, 1.0, x, f / 1e3] for t, x, f in NUMBERS]
    path = workbook(tmp_path / "a.xlsx", {"old": TABLE, "new": [*heading, *numbers]})
    book = openpyxl.load_workbook(path)
    book["old"].sheet_state = "hidden"
    for area in ("A2:A3", "B2:C2", "D2:E2"):
        book["new"].merge_cells(area)
    book.save(path)
    (test,) = read(path, {"time": "Time", "displacement": "Damper 2/Stroke", "force": "Damper 2/Force"})
    check(test, SHEET)
    assert "force Damper 2/Force (kN, from the file)" in test.read_as
    with pytest.raises(FileProblem, match="select one of them with Damper 1/Force, Damper 2/Force"):
        read(path, {"time": "Time", "displacement": "#4", "force": "Force"})
    assert "hidden sheet 'old'" in read(path, COLUMNS, sheet="old")[0].read_as


def test_formulas_are_not_evaluated(tmp_path: Path) -> None:
    rows = [TABLE[0], *([t, x, f"=B{k}*45"] for k, (t, x, _) in enumerate(TABLE[1:], 2))]
    with pytest.raises(FileProblem, match="formulas without a stored value in the workbook: 200"):
        read(workbook(tmp_path / "a.xlsx", {"Run": rows}), COLUMNS)


def hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        for name, values, unit in (("t", T, "s"), ("x", X_MM, b"mm")):
            file[f"run1/{name}"] = values
            file[f"run1/{name}"].attrs["units"] = unit
        file["run1/F"] = np.round(F_N * 20.0).astype(np.int16)
        file["run1/F"].attrs.update({"units": "N", "scale_factor": 0.05, "_FillValue": np.int16(-32768)})
        file["M"] = np.column_stack([T, X_MM, F_N])
        file["table"] = np.rec.fromarrays([T, X_MM, F_N], names="t_s,x_mm,F_N")  # type: ignore[call-overload]
        file["link"] = h5py.ExternalLink("other.h5", "/x")
        inner = np.dtype([("x", "f4"), ("F", "f8", (2,))])
        nested = np.zeros(ROWS, [("cycle", "i4"), ("front", inner)])
        nested["front"]["x"], nested["front"]["F"][:, 1] = X_MM, F_N
        file["daq/nested"] = nested
        file["daq/nested"].attrs.update({"x_units": "mm", "units": [b"-", b"?", b"N"]})
        file["daq"].attrs["Sample Rate (Hz)"] = b"200.0"
        file["labelled"] = np.stack([X_MM, F_N])
        file["labelled"].attrs.update({"columns": [b"x", b"F"], "units": "mm, N", "dt": np.float32(0.005)})
        file["old/block0_values"], file["old/block0_items"] = np.stack([X_MM, F_N], 1), [b"x_mm", b"F_N"]
        file["old"].attrs["fs"] = 100


def struct_array(path: Path) -> None:
    one, cells = {"t": T, "x_mm": X_MM, "F_N": F_N}, np.empty((2, 1), object)
    cells[:, 0] = [T, X_MM]
    savemat(path, {"data": np.array([{**one, "x_mm": 0.0 * X_MM}, one], dtype=object)[:, None],
                   "mixed": cells})  # fmt: skip


def struct_array_73(path: Path) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        kind = h5py.special_dtype(ref=h5py.Reference)
        for name, values in (("t", T), ("x_mm", X_MM), ("F_N", F_N)):
            references = []
            for k in range(2):
                file[f"#refs#/{name}{k}"] = (k * values).reshape(1, -1)
                references.append(file[f"#refs#/{name}{k}"].ref)
            file.create_dataset(f"data/{name}", (2, 1), kind)[:, 0] = references
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64")


def rpc3(path: Path, *, kind: str = "SHORT_INTEGER", frame: int = 64, group: int = 128, padded: bool = True,
         form: str = "BINARY_IEEE_LITTLE_END", drop: str = "", **changed: str) -> None:  # fmt: skip
    frames = -(-ROWS // frame)
    scales = (0.001, 0.05)
    keys = {
        "FORMAT": form, "NUM_HEADER_BLOCKS": "6", "NUM_PARAMS": "22", "FILE_TYPE": "TIME_HISTORY",
        "DATA_TYPE": kind, "CHANNELS": "2", "DELTA_T": "5.0E-03", "PTS_PER_FRAME": str(frame),
        "PTS_PER_GROUP": str(group), "FRAMES": str(frames), "INT_FULL_SCALE": "32752",
        "DESC.CHAN_1": "Stroke", "UNITS.CHAN_1": "mm", "SCALE.CHAN_1": str(scales[0]),
        "DESC.CHAN_2": "Load", "UNITS.CHAN_2": "N", "SCALE.CHAN_2": str(scales[1]),
    }  # fmt: skip
    keys |= changed
    keys.pop(drop, None)
    head = b"".join(key.encode().ljust(32, b"\0") + value.encode().ljust(96, b"\0") for key, value in keys.items())
    whole = np.zeros((2, frames * frame))
    whole[:, :ROWS] = X_MM, F_N
    if kind == "SHORT_INTEGER":
        whole = np.round(whole / np.array(scales)[:, None])
    dtype = (">" if "BIG" in form else "<") + ("i2" if kind == "SHORT_INTEGER" else "f4")
    body = b""
    for start in range(0, frames * frame, group):
        part = whole[:, start : start + group]
        if padded:
            part = np.pad(part, ((0, 0), (0, group - part.shape[1])))
        body += part.astype(dtype).tobytes()
    path.write_bytes(head.ljust(6 * 512, b"\0") + body)


READ: dict[str, tuple[str, Callable[[Path], None], dict[str, str]]] = {
    "hdf5 by path": ("a.h5", hdf5, {"time": "run1/t", "displacement": "run1/x", "force": "/run1/F"}),
    "hdf5 matrix": ("a.h5", hdf5, {"time": "M(1):s", "displacement": "M(2):mm", "force": "M(3):N"}),
    "hdf5 table": ("a.h5", hdf5, {"time": "table/t_s", "displacement": "table/x_mm", "force": "table/F_N"}),
    "hdf5 nested table": ("a.h5", hdf5, {"displacement": "daq/nested/front/x", "force": "daq/nested/front/F(2)"}),
    "hdf5 named columns": ("a.h5", hdf5, {"displacement": "labelled/x", "force": "labelled(2)"}),
    "hdf5 of pandas": ("a.h5", hdf5, {"time": "run1/t", "displacement": "old/x_mm", "force": "old/F_N"}),
    "struct array": ("a.mat", struct_array,
                     {"time": "data(2).t:s", "displacement": "data(2).x_mm", "force": "data(2).F_N"}),
    "cell array": ("a.mat", struct_array, {"time": "mixed{1}:s", "displacement": "mixed{2}:mm",
                                           "force": "data(2).F_N"}),
    "struct array 7.3": ("a.mat", struct_array_73,
                         {"time": "data(2).t:s", "displacement": "data(2).x_mm", "force": "data(2).F_N"}),
    "rpc3": ("a.rsp", rpc3, {"displacement": "Stroke", "force": "Load"}),
    "rpc3 unpadded": ("a.rsp", lambda path: rpc3(path, padded=False), {"displacement": "Stroke", "force": "#2"}),
    "rpc3 big end floats": ("a.rsp", lambda path: rpc3(path, kind="FLOATING_POINT", form="BINARY_IEEE_BIG_END"),
                            {"displacement": "Stroke", "force": "Load"}),
}  # fmt: skip


@pytest.mark.parametrize("name", READ)
def test_formats_of_this_field_are_read(name: str, tmp_path: Path) -> None:
    file, write, columns = READ[name]
    write(tmp_path / file)
    (test,) = read(tmp_path / file, columns)
    assert test.time_s[:ROWS] == pytest.approx(T, abs=1e-6)
    assert test.displacement_m[:ROWS] == pytest.approx(X_MM * 1e-3, abs=1e-6)
    assert test.force_N[:ROWS] == pytest.approx(F_N, abs=0.05)


def test_hdf5_data_sets_of_different_rates_are_refused(tmp_path: Path) -> None:
    hdf5(tmp_path / "a.h5")
    assert "time from the attribute 'Sample Rate (Hz)' = 200 (Hz)" in read(
        tmp_path / "a.h5", READ["hdf5 nested table"][2])[0].read_as  # fmt: skip
    with pytest.raises(FileProblem, match=r"old/x_mm: 'fs' = 100 \(Hz\), labelled/F: 'dt' = 0\.005 \(s\)"):
        read(tmp_path / "a.h5", {"displacement": "old/x_mm", "force": "labelled/F"})


def test_hdf5_integers_with_an_unknown_factor_are_refused(tmp_path: Path) -> None:
    hdf5(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        file["run1/F"].attrs["gain"] = 0.05
    with pytest.raises(FileProblem, match=r"its property 'gain' = 0\.05"):
        read(tmp_path / "a.h5", READ["hdf5 by path"][2])


def lvm(path: Path, x_columns: str, step: str = "0.005;0.1;0.005") -> None:
    """Channels Stroke, Note and Load; with `Multi`, each has an x column, and the header leaves its cells blank."""
    apart, blank = ("\t\t", "\t") if x_columns == "Multi" else ("\t", "")
    names = {"One": "X_Value\tStroke\tNote\tLoad", "No": "X_Value\tStroke\tNote\tLoad",
             "Multi": "X_Value\tStroke\tX_Value\tNote\tX_Value\tLoad"}[x_columns]  # fmt: skip
    head = ("LabVIEW Measurement\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t,\nMulti_Headings\tYes\n"
            f"X_Columns\t{x_columns}\n***End_of_Header***\n\nChannels\t3\n")  # fmt: skip
    stated = {"Y_Unit_Label": "mm;;N", "X_Dimension": "Time;Time;Time", "X0": "0;0;0", "Delta_X": step}
    for key, cells in stated.items():
        head += f"{key}\t{apart.join(cells.split(';'))}{blank}\n"
    rows = [{"One": (t, x, 1.0, f), "No": ("", x, 1.0, f), "Multi": (t, x, t, 1.0, t, f)}[x_columns]
            for t, x, f in zip(T, X_MM, F_N, strict=True)]  # fmt: skip
    body = "\n".join("\t".join(one if isinstance(one, str) else f"{one:.6f}" for one in row) for row in rows)
    path.write_text((head + f"***End_of_Header***\n{names}\tComment\n" + body).replace(".", ","))


@pytest.mark.parametrize("x_columns", ["One", "No", "Multi"])
def test_channels_of_lvm_have_their_own_units_and_steps(x_columns: str, tmp_path: Path) -> None:
    lvm(tmp_path / "a.lvm", x_columns)
    columns = {"displacement": "Stroke", "force": "Load"}
    (test,) = read(tmp_path / "a.lvm", columns)
    check(test)
    assert "force Load (N, from the file)" in test.read_as  # the channel before it has no unit
    lvm(tmp_path / "a.lvm", x_columns, "0.005;0.1;0.006")
    with pytest.raises(FileProblem, match=r"together: Stroke: .*Delta_X 0\.005 s.*Load: .*Delta_X 0\.006 s"):
        read(tmp_path / "a.lvm", columns)
    lvm(tmp_path / "a.lvm", x_columns, "0.1;0.1;0.005")
    with pytest.raises(FileProblem, match="not sampled together"):
        read(tmp_path / "a.lvm", columns)


def element(kind: int, content: bytes) -> bytes:
    return struct.pack("<II", kind, len(content)) + content + b"\0" * (-len(content) % 8)


def matlab_table(path: Path) -> None:
    """A variable T of class table, as MATLAB writes the head of one: flags, name, type system, class, its numbers."""
    inner = element(14, element(6, struct.pack("<II", 13, 0)) + element(5, struct.pack("<ii", 2, 1)) + element(1, b"")
                    + element(6, struct.pack("<2I", 0xDD000000, 2)))  # fmt: skip
    body = element(6, struct.pack("<II", 17, 0)) + element(1, b"T") + element(1, b"MCOS") + element(1, b"table") + inner
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + element(14, body))


def archive(names: str) -> bytes:
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as packed:
        packed.writestr(names, "x")
    return made.getvalue()


NAMED = {
    "doc": (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(500), "as Excel workbook (.xls); the file is damaged"),
    "odt": (archive("content.xml"), "cannot be read as OpenDocument spreadsheet"),
    "locked": (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + "EncryptedPackage".encode("utf-16-le"), "a password"),
    "zip": (archive("a.csv"), "a ZIP archive"),
    "parquet": (b"PAR1" + bytes(200), "cannot be read as Parquet"),
    "uff": (b"    -1\n    58\nx\n" + b"0.1 0.2 0.3\n" * 99, "a universal file"),
    "html": (b"<html><table><tr><td>1</td></tr></table></html>", "a web page"),
    "tdm": (b'<?xml version="1.0"?>\n<usi:tdm xmlns:usi="x">', "DIAdem TDM file"),
    "spss": (b"$FL2@(#) SPSS DATA FILE" + bytes(200), "an SPSS file"),
    "ods model": (b'<?xml version="1.0"?>\n<atfx_file version="1">', "an ASAM ODS file (ATFX)"),
    "daq": (b"MATLAB Data Acquisition File.\0" + bytes(200), "daqread"),
    "catman": (b"\x93\x13" + bytes(200), "an HBM catman file"),
    "wav": (b"RIFF\0\0\0\0WAVEfmt " + bytes(200), "an audio file"),
    "json": (b'{"t": [0, 1, 2], "x": [1, 2, 3]}', "pandas.read_json"),
    "pickle": (b"\x80\x04\x95" + bytes(200), "can execute code"),
    "unknown": (bytes(range(256)) * 4, "a binary file of an unknown format"),
    "utf-16 without mark": ("t_s,x_mm,F_N\n1,2,3\n".encode("utf-16-le"), "--encoding utf-16-le"),
}


@pytest.mark.parametrize("name", NAMED)
def test_what_is_not_read_is_named_with_the_way_out(name: str, tmp_path: Path) -> None:
    data, says = NAMED[name]
    (tmp_path / "a.dat").write_bytes(data)
    with pytest.raises(FileProblem) as caught:
        read(tmp_path / "a.dat", COLUMNS)
    assert says in str(caught.value)


@pytest.mark.parametrize("version", ["v7", "v7.3"])
@pytest.mark.filterwarnings("ignore")  # of mat-io's writer, on units of durations
def test_tables_and_timetables_of_matlab_are_read_with_their_own_times(version: str, tmp_path: Path) -> None:
    import pandas as pd
    from matio import save_to_mat

    table = pd.DataFrame({"t_s": T, "x_mm": X_MM, "F_N": F_N, "remark": ["ok"] * ROWS})
    times = table[["x_mm", "F_N"]].set_index(pd.to_timedelta(np.round(T * 1e6), unit="us").rename("Time"))
    save_to_mat(tmp_path / "a.mat", {"T": table, "TT": times, "t": T[:9]}, version=version)
    for columns in ({"time": "T.t_s", "displacement": "T.x_mm", "force": "T.F_N"},
                    {"time": "TT.Time", "displacement": "TT.x_mm", "force": "TT.F_N"}):  # fmt: skip
        check(read(tmp_path / "a.mat", columns)[0])


def test_tables_of_matlab_are_named_where_they_cannot_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    matlab_table(tmp_path / "a.mat")
    monkeypatch.setitem(sys.modules, "matio", None)
    with pytest.raises(FileProblem, match=r"'T' is a MATLAB table, which requires mat-io: \S*pip(.|\n)*table2struct"):
        read(tmp_path / "a.mat", COLUMNS)


RPC_COLUMNS = {"displacement": "Stroke", "force": "Load"}


def test_damaged_rpc3_files_are_named(tmp_path: Path) -> None:
    for options, says in (
        ({"drop": "DELTA_T"}, "keyword 'DELTA_T' is missing"), ({"form": "ASCII"}, "expected"),
        ({"drop": "SCALE.CHAN_2"}, "the file states the unit 'counts', which is not a unit of force"),
        ({"FRAMES": "0"}, "FRAMES = 0: the recording was not finished"),
        ({"SCALE.CHAN_1": "0.0"}, r"SCALE\.CHAN_1 = '0\.0', expected a finite number other than 0"),
        ({"CHANNELS": "-1"}, "impossible sizes"), ({"PTS_PER_GROUP": "9" * 12}, "at most"),
        ({"DELTA_T": "nan"}, "impossible sizes"), ({"NUM_HEADER_BLOCKS": "7"}, "truncated"),
    ):  # fmt: skip
        rpc3(tmp_path / "a.rsp", **options)
        with pytest.raises(FileProblem, match=says):
            read(tmp_path / "a.rsp", RPC_COLUMNS)
    rpc3(tmp_path / "a.rsp")
    whole = (tmp_path / "a.rsp").read_bytes()
    for end in range(512, len(whole), 256):  # recordings that were cut off
        (tmp_path / "a.rsp").write_bytes(whole[:end])
        with pytest.raises(FileProblem, match=r"truncated|missing"):
            read(tmp_path / "a.rsp", RPC_COLUMNS)
    (tmp_path / "a.rsp").write_bytes(whole + b"12345")
    assert "force Load (N, from the file, SCALE 0.05 applied)" in read(tmp_path / "a.rsp", RPC_COLUMNS)[0].read_as
    assert "12 samples at the end left out" in (read_as := read(tmp_path / "a.rsp", RPC_COLUMNS)[0].read_as)
    assert "5 bytes after the last sample ignored" in read_as


@given(
    st.integers(1, 4), st.integers(3, 600), st.booleans(), st.text("ä %.mkN" + string.ascii_letters, max_size=60),
    st.floats(1e-6, 1e6), st.floats(1e-5, 1.0), st.integers(0, 2**32 - 1),
)
@settings(max_examples=15, deadline=None)
def test_what_is_written_as_rpc3_is_read_again(
    count: int, rows: int, integers: bool, name: str, size: float, step_s: float, seed: int
) -> None:
    values = size * np.random.default_rng(seed).normal(size=(count, rows)) + size
    channels = [Rpc3Channel(f"{k}{name}", "kN", one) for k, one in enumerate(values)]
    written = encoded(channels, step_s, {"RIG.ID": "p001"}, integers=integers)
    file = Rpc3File(Path("a.rsp"), written)
    assert [(one.name, one.unit) for one in file.columns] == [(f"{k}{name}".strip(), "kN") for k in range(count)]
    within = np.max(np.abs(values), axis=1) * (0.5 / 32752 if integers else 6e-8)
    for k, one in enumerate(file.values(range(count))):
        assert one.shape == (rows,)
        assert np.max(np.abs(one - values[k])) <= within[k]
    assert file.own_time([0])[1] == pytest.approx(step_s, rel=1e-14)
    assert (len(written) % 512, written[:6], written[32:40]) == (0, b"FORMAT", b"BINARY_I")


@pytest.mark.few(3)
@pytest.mark.parametrize("name", ["hdf5 by path", "struct array", "rpc3", "workbook"])
def test_damaged_files_of_these_formats_are_refused_or_read(name: str, tmp_path: Path) -> None:
    if name == "workbook":
        path, columns = workbook(tmp_path / "a.xlsx", {"Run": TABLE[:100]}), COLUMNS
    else:
        file, write, columns = READ[name]
        path = tmp_path / file
        write(path)
    whole, source = path.read_bytes(), np.random.default_rng(5)
    for _ in range(6):
        damaged = bytearray(whole[: source.integers(140, len(whole))] if source.random() < 0.4 else whole)
        for place in source.integers(0, len(damaged) if source.random() < 0.5 else min(len(damaged), 2048), 6):
            damaged[place] = source.integers(256)
        path.write_bytes(damaged)
        with contextlib.suppress(FileProblem):  # and nothing else is raised
            assert len(read(path, columns)[0].time_s) > 15
