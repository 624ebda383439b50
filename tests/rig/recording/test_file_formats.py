"""Tests of other programs in their files: dialects of CSV written out by hand, MAT, TDMS, MF4 by their own writers."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rig.errors import FileProblem
from rig.recording.external_tests import ImportedTest, ImportSettings, column_lists, current_hint, read_tests
from rig.recording.file_formats.columns import choose, split_heading
from rig.recording.file_formats.csv_file import CsvFile
from rig.recording.file_formats.table_file import Dialect, TableColumn
from rig.signals.plausibility import TestSize, doubts

ROWS = 1000
T = np.arange(ROWS) * 0.004
X_MM = 12.0 + 20.0 * np.sin(2.0 * np.pi * T)
F_N = 800.0 * np.cos(2.0 * np.pi * T)


def rows(separator: str, decimal: str, *, time: Callable[[float], str] = "{:.3f}".format, quote: str = "") -> str:
    lines = []
    for t, x, force in zip(T, X_MM, F_N, strict=True):
        numbers = [time(t), f"{x:.5f}", f"{force / 1e3:.6f}"]
        lines.append(separator.join(quote + number.replace(".", decimal) + quote for number in numbers))
    return "\n".join(lines) + "\n"


def read(path: Path, *, dialect: Dialect | None = None, rate_Hz: float | None = None, accept: tuple[str, ...] = (),
         **columns: str) -> ImportedTest:
    (test,) = read_tests([path], ImportSettings(columns, 0.5, None, rate_Hz, dialect or Dialect(), accept))
    return test


def check(test: ImportedTest) -> None:
    assert test.time_s == pytest.approx(T, abs=1e-9)
    assert test.displacement_m == pytest.approx(X_MM * 1e-3, abs=1e-8)
    assert test.force_N == pytest.approx(F_N, abs=1e-3)


DIALECTS = {
    "German machine: preamble, units row, cp1252": (
        "Prüfmaschine;Dämpfer 7\nDatum;01.03.2024\n\nZeit;Weg;Kraft\ns;mm;kN\n" + rows(";", ","), "cp1252",
        {"time": "Zeit", "displacement": "Weg", "force": "Kraft"},
        "CSV, separator ';', decimal ',', cp1252, names in line 4, units in line 5, numbers from line 6",
    ),
    "units in brackets": (
        "Time (sec),Axial Displacement (mm),Axial Force (kN)\n" + rows(",", "."), "utf-8",
        {"time": "Time", "displacement": "Axial Displacement (mm)", "force": "Axial Force"},
        "CSV, separator ',', decimal '.', utf-8, names in line 1, numbers from line 2",
    ),
    "tabs, CRLF, UTF-16": (
        ("Time\tStroke\tLoad\n[s]\t[mm]\t[kN]\n" + rows("\t", ",")).replace("\n", "\r\n"), "utf-16",
        {"time": "Time", "displacement": "Stroke", "force": "Load"},
        "CSV, separator tab, decimal ',', utf-16, names in line 1, units in line 2, numbers from line 3",
    ),
    "columns of white space without names": (
        rows("   ", "."), "utf-8", {"time": "#1:s", "displacement": "#2:mm", "force": "#3:kN"},
        "CSV, separator white space, decimal '.', utf-8, no names, numbers from line 1",
    ),
    "decimal commas in quotes between commas": (
        '"t_s","x_mm","F_kN"\n' + rows(",", ",", quote='"'), "utf-8",
        {"time": "t_s", "displacement": "x_mm", "force": "F_kN"},
        "CSV, separator ',', decimal ',', utf-8, names in line 1, numbers from line 2",
    ),
    "a word in every row, a separator at its end": (
        "t_s;x_mm;F_kN;state;\n" + rows(";", ".").replace("\n", ";ok;\n"), "utf-8",
        {"time": "t_s", "displacement": "x_mm", "force": "F_kN"},
        "CSV, separator ';', decimal '.', utf-8, names in line 1, numbers from line 2",
    ),
    "ISO time stamps across midnight": (
        "stamp,x_mm,F_kN\n" + rows(",", ".", time=lambda t: (
            f"2024-02-2{('8T23:59:58', '8T23:59:59', '9T00:00:00', '9T00:00:01')[round(t * 1e3) // 1000]}"
            f".{round(t * 1e3) % 1000:03d}Z")), "utf-8",
        {"time": "stamp", "displacement": "x_mm", "force": "F_kN"},
        "CSV, separator ',', decimal '.', utf-8, names in line 1, numbers from line 2",
    ),
    "German time stamps": (
        "Zeit;Weg / mm;Kraft in kN\n" + rows(";", ",", time=lambda t: (
            f"31/12/2023 23:59:{50 + round(t * 1e3) // 1000}.{round(t * 1e3) % 1000:03d}")).replace("/", "."), "utf-8",
        {"time": "Zeit", "displacement": "Weg", "force": "Kraft"},
        "CSV, separator ';', decimal ',', utf-8, names in line 1, numbers from line 2",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", DIALECTS)
def test_common_dialects_are_read_and_the_guess_is_reported(name: str, tmp_path: Path) -> None:
    text, encoding, columns, description = DIALECTS[name]
    (tmp_path / "a.csv").write_bytes(text.encode(encoding))
    test = read(tmp_path / "a.csv", **columns)
    check(test)
    assert test.read_as.startswith(description + "; ")


@pytest.mark.parametrize(("before", "after"), [
    ("03/02/2024 23:59:{:06.3f}", "04/02/2024 00:00:{:06.3f}"),
    ("02/03/24 11:59:{:06.3f} PM", "02/04/24 12:00:{:06.3f} AM"),
    ("1/31/2024 11:59:{:06.3f} pm", "2/1/2024 12:00:{:06.3f} am"),
    ("29-Feb-2024 23:59:{:06.3f}", "01-Mar-2024 00:00:{:06.3f}"),
    ("31-12-2023 23:59:{:06.3f}", "01-01-2024 00:00:{:06.3f}"),
    ("2024/02/03 23:59:{:06.3f}", "2024/02/04 00:00:{:06.3f}"),
])  # fmt: skip
def test_day_and_month_in_either_order_are_elapsed_seconds_over_midnight(
    before: str, after: str, tmp_path: Path
) -> None:
    def stamp(t: float) -> str:
        return before.format(58.0 + t) if t < 1.999 else after.format(t - 2.0 + 1e-9)

    path = tmp_path / "a.csv"
    path.write_text("at,x_mm,F_kN\n" + rows(",", ".", time=stamp))
    check(read(path, time="at", displacement="x_mm", force="F_kN"))


def test_what_the_user_says_goes_before_the_guess(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("1;2;3\n10;20;30\nA;B;C\n" + rows(";", "."))
    assert CsvFile(path, path.read_bytes(), Dialect()).layout.first_line == 4
    dialect = Dialect(separator=";", decimal=".", encoding="ascii", header_line=1, units_line=0)
    test = read(path, dialect=dialect, time="1:s", displacement="2:mm", force="3:kN")
    assert len(test.time_s) == ROWS + 1 - 1
    assert "names in line 1" in test.read_as


def test_thousands_are_distinguished_from_decimals_where_a_number_has_both(tmp_path: Path) -> None:
    text = "\n".join(f"{t:.3f};{x:.4f};{1e3 * f:,.2f}" for t, x, f in zip(T, X_MM, F_N / 1e3 * 5.0, strict=True))
    swapped = text.replace(".", "#").replace(",", ".").replace("#", ",")
    for name, content in (("us.csv", text), ("de.csv", swapped)):
        (tmp_path / name).write_text("t_s;x_mm;F_N\n" + content)
        test = read(tmp_path / name, time="t_s", displacement="x_mm", force="F_N")
        assert np.max(test.force_N) == pytest.approx(4000.0)


@pytest.mark.parametrize(("text", "columns", "problem"), [
    ("t_s;x;F_N\ns;mm;N\n", {"displacement": "x:N"}, "displacement=x:N: 'N' is not a unit of length"),
    ("t_s;x_mm;F\ns;m;N\n", {"displacement": "x_mm"}, "the column name states mm, but the file states m"),
    ("t_s;x;F\ns;mm;N\n", {"displacement": "F"}, "the file states the unit 'N', which is not a unit of length"),
    ("t_s;x_mm;x_mm\n", {"displacement": "x_mm"}, "2 columns have the name 'x_mm'"),
    ("t_s;x_mm;F_N\n", {"displacement": "y_mm"}, "no column 'y_mm'; columns: t_s, x_mm, F_N"),
])
def test_units_and_names_that_do_not_fit_are_all_reported(
    text: str, columns: dict[str, str], problem: str, tmp_path: Path
) -> None:
    (tmp_path / "a.csv").write_text(text + rows(";", "."))
    with pytest.raises(FileProblem) as caught:
        read(tmp_path / "a.csv", time="t_s", force="nowhere:kN", **columns)
    assert problem in str(caught.value)
    assert "no column 'nowhere'" in str(caught.value)


def test_quantities_that_are_not_specified_are_read_by_their_standard_names(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t_s;displacement_mm;F;F2_kN\n" + rows(";", ".").replace("\n", ";1\n"))
    test = read(tmp_path / "a.csv", force="F:kN")
    check(test)
    assert list(test.choices) == ["time", "displacement", "force"]
    check(read(tmp_path / "a.csv", force="F:kN", displacement="displacement_mm"))
    with pytest.raises(FileProblem, match=r"force: no column given"):
        read(tmp_path / "a.csv", displacement="displacement_mm")


def test_the_list_of_columns_states_each_unit_and_the_option_for_the_current(tmp_path: Path) -> None:
    (tmp_path / "a_0.5A.csv").write_text("t_s;x;v_m_s;F [kN]\n" + rows(";", ".").replace("\n", ";1\n"))
    ((_, columns, _, _),) = column_lists(tmp_path / "a_0.5A.csv", Dialect())
    assert [unit for _, unit in columns] == ["s, from the column name", "", "m/s, from the column name", "kN"]
    assert current_hint([tmp_path / "a_0.5A.csv"]) == "--current-from-name '_(?P<current>[0-9.]+)A'"
    assert current_hint([tmp_path / "a_0.5A.csv", tmp_path / "b_2015A.csv"]) == "--current '... A'"


def test_without_columns_the_file_is_shown_with_what_may_be_meant(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("Zeit;Weg;Kraft\ns;mm;kN\n" + rows(";", "."))
    with pytest.raises(FileProblem) as caught:
        read(tmp_path / "a.csv")
    assert "its columns: Zeit (s), Weg (mm), Kraft (kN)" in str(caught.value)
    assert "perhaps --column displacement=Weg --column force=Kraft --column time=Zeit" in str(caught.value)


@pytest.mark.parametrize(("columns", "slug"), [
    ({"force": "F_kN:N"}, "units-force"), ({"time": "t_s:h"}, "units-time"),
    ({"displacement": "x_mm:um"}, "units-displacement"), ({"displacement": "x_mm:cm", "time": "t_s:ms"}, "units-time"),
])
def test_sizes_no_damper_test_has_are_refused_unless_they_are_accepted(
    columns: dict[str, str], slug: str, tmp_path: Path
) -> None:
    (tmp_path / "a.csv").write_text("t_s;x_mm;F_kN\n" + rows(";", "."))
    named = {"time": "t_s", "displacement": "x_mm", "force": "F_kN", **columns}
    with pytest.raises(FileProblem, match=f"{slug}: .*--accept {slug}"):
        read(tmp_path / "a.csv", **named)
    assert len(read(tmp_path / "a.csv", accept=(slug, "sample-rate", "units-displacement"), **named).time_s) == ROWS


def test_a_small_stroke_is_one_where_it_is_quick_and_a_slow_motion_where_it_is_long() -> None:
    for span_m, speed_m_s in ((4e-4, 1.3e-3), (6e-4, 0.9e-3), (1e-4, 0.02), (0.1, 1e-4)):
        assert doubts(TestSize(span_m=span_m, speed_m_s=speed_m_s)) == []
    (doubt,) = doubts(TestSize(span_m=8e-5, speed_m_s=7.5e-4))  # 40 mm at 3 Hz, in metres, called mm
    assert (doubt.slug, doubt.factor) == ("units-displacement", 1e3)


def test_a_rate_replaces_a_time_that_no_column_has(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("n;x_mm;F_kN\n" + rows(";", "."))
    check(read(tmp_path / "a.csv", rate_Hz=250.0, displacement="x_mm", force="F_kN"))
    with pytest.raises(FileProblem, match=r"time: no column specified\. Fix: write --column time=NAME, or --rate"):
        read(tmp_path / "a.csv", displacement="x_mm", force="F_kN")


@pytest.mark.parametrize("count", [6, 24])
def test_a_table_of_peak_values_is_named_as_such_and_a_file_without_time_is_shown_the_rate(
    tmp_path: Path, count: int
) -> None:
    rows_text = "".join(f"{speed},{3 * speed},{-2 * speed}\n" for speed in range(50, 50 + 50 * count, 50))
    (tmp_path / "p.csv").write_text("Speed (mm/s),Rebound (N),Compression (N)\n" + rows_text)
    ((_, _, _, doubt),) = column_lists(tmp_path / "p.csv", Dialect())
    assert doubt.startswith(f"{count} rows without a time column look like a table of peak values")
    with pytest.raises(FileProblem, match="look like a table of peak values"):
        read(tmp_path / "p.csv", displacement="#1", force="#2")
    with pytest.raises(FileProblem, match="look like a table of peak values"):
        read(tmp_path / "p.csv", displacement="#1:mm", force="#2")
    (tmp_path / "a.csv").write_text("n;x_mm;F_kN\n" + rows(";", "."))
    ((_, _, _, doubt),) = column_lists(tmp_path / "a.csv", Dialect())
    assert "--rate '1 kHz'" in doubt


@pytest.mark.parametrize(("heading", "unit"), [("Temp (F)", "degF"), ("Temp [C]", "degC")])
def test_a_letter_in_brackets_is_the_unit_of_a_temperature_only(heading: str, unit: str) -> None:
    columns = [TableColumn(heading), TableColumn("Force (F)")]
    assert choose(columns, {"temperature": heading}, lambda _: False)["temperature"].unit_name == unit
    assert split_heading("Force (F)") == ("Force (F)", "")


def matlab(path: Path) -> None:
    from scipy.io import savemat

    savemat(path, {"t": T, "test": {"F": F_N / 1e3, "note": "a"}, "M": np.column_stack([X_MM, X_MM * 0.0])})


def matlab_73(path: Path) -> None:
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        file["t"] = T.reshape(1, -1)
        file["M"] = np.vstack([X_MM, X_MM * 0.0])
        file["test/F"] = F_N.reshape(1, -1) / 1e3
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64")


def tdms(path: Path) -> None:
    from nptdms import ChannelObject, TdmsWriter

    wave = {"wf_increment": 0.004, "wf_start_offset": 0.0}
    with TdmsWriter(path) as writer:
        writer.write_segment([
            ChannelObject("DAQ", "Stroke", X_MM, {**wave, "unit_string": "mm"}),
            ChannelObject("DAQ", "Load", F_N / 1e3, {**wave, "unit_string": "kN"}),
            ChannelObject("Other", "Load", np.arange(3.0)),
        ])  # fmt: skip


def mf4(path: Path) -> None:
    from asammdf import MDF, Signal

    with MDF(version="4.10") as mdf:
        mdf.append([Signal(X_MM, T, unit="mm", name="Stroke"), Signal(F_N / 1e3, T, unit="kN", name="Load")])
        mdf.append([Signal(np.arange(9.0), np.arange(9.0), unit="kN", name="Slow")])
        mdf.save(path)


BINARY: dict[str, tuple[Callable[[Path], None], dict[str, str]]] = {
    "a.mat": (matlab, {"time": "t:s", "displacement": "M(1):mm", "force": "test.F:kN"}),
    "b.mat": (matlab_73, {"time": "t:s", "displacement": "M(1):mm", "force": "test.F:kN"}),
    "a.tdms": (tdms, {"displacement": "Stroke", "force": "DAQ/Load"}),
    "a.mf4": (mf4, {"displacement": "Stroke", "force": "0/Load"}),
}


@pytest.mark.parametrize("name", BINARY)
def test_channels_of_other_formats_come_with_their_units_and_times(name: str, tmp_path: Path) -> None:
    write, columns = BINARY[name]
    write(tmp_path / name)
    check(read(tmp_path / name, **columns))


@pytest.mark.few(2)
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # of asammdf's destructor
@pytest.mark.parametrize("name", BINARY)
def test_damaged_files_of_other_formats_are_refused_or_read(name: str, tmp_path: Path) -> None:
    write, columns = BINARY[name]
    write(tmp_path / name)
    whole, source = (tmp_path / name).read_bytes(), np.random.default_rng(5)
    for _ in range(6):  # the fuzzer of tests/fuzz tries many
        damaged = bytearray(whole[: source.integers(140, len(whole))] if source.random() < 0.4 else whole)
        for place in source.integers(128, min(len(damaged), 4096), 6):
            damaged[place] = source.integers(256)
        (tmp_path / name).write_bytes(damaged)
        with contextlib.suppress(FileProblem):  # and nothing else is raised
            assert len(read(tmp_path / name, **columns).time_s) > 15


def test_channels_that_were_not_sampled_together_are_refused(tmp_path: Path) -> None:
    mf4(tmp_path / "a.mf4")
    tdms(tmp_path / "a.tdms")
    with pytest.raises(FileProblem, match="not sampled together: 0/Stroke 1000 samples, 1/Slow 9 samples"):
        read(tmp_path / "a.mf4", displacement="Stroke", force="Slow")
    with pytest.raises(FileProblem, match="different numbers of rows: Stroke 1000, Load 3"):
        read(tmp_path / "a.tdms", displacement="Stroke", force="Other/Load:kN")


def test_wave_forms_that_began_at_another_time_were_not_sampled_together(tmp_path: Path) -> None:
    from nptdms import ChannelObject, TdmsWriter

    for second, problem in (("00", ""), ("01", "not sampled together")):
        stroke = {"wf_increment": 0.004, "unit_string": "mm", "wf_start_time": np.datetime64("2024-01-01T00:00:00")}
        load = {**stroke, "unit_string": "kN", "wf_start_time": np.datetime64(f"2024-01-01T00:00:{second}")}
        with TdmsWriter(tmp_path / "a.tdms") as writer:
            writer.write_segment([ChannelObject("g", "x", X_MM, stroke), ChannelObject("g", "F", F_N / 1e3, load)])
        if problem:
            with pytest.raises(FileProblem, match=problem):
                read(tmp_path / "a.tdms", displacement="x", force="F")
        else:
            check(read(tmp_path / "a.tdms", displacement="x", force="F"))


def test_columns_of_one_name_in_one_group_are_named_by_their_place(tmp_path: Path) -> None:
    from asammdf import MDF, Signal

    with MDF(version="4.10") as mdf:
        mdf.append([Signal(X_MM, T, unit="mm", name="x"), Signal(0.0 * F_N, T, unit="kN", name="F"),
                    Signal(F_N / 1e3, T, unit="kN", name="F")])  # fmt: skip
        mdf.save(tmp_path / "a.mf4")
    with pytest.raises(FileProblem, match=r"2 columns have the name 'F'.*#2, #3"):
        read(tmp_path / "a.mf4", displacement="x", force="F")
    check(read(tmp_path / "a.mf4", displacement="x", force="#3"))


def test_a_small_file_that_inflates_beyond_measure_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from scipy.io import savemat

    monkeypatch.setattr("rig.recording.file_formats.table_file.MOST_NUMBERS", 10_000)
    savemat(tmp_path / "a.mat", {"x": np.zeros(1 << 20)}, do_compression=True)
    with pytest.raises(FileProblem, match=r"declares 10485\d\d numbers"):
        read(tmp_path / "a.mat", displacement="x:m", force="x:N", rate_Hz=1e3)


@pytest.mark.parametrize(("unit", "scale", "sync", "problem"), [
    ("ms", 1e3, 1, ""), ("us", 1e6, 1, ""), ("s", 1.0, 1, ""), ("", 1.0, 1, ""),
    ("deg", 360.0, 2, "contains an angle instead of a time"), ("deg", 360.0, 1, "numbers in 'deg' instead of a time"),
])  # fmt: skip
def test_master_channels_of_mdf_count_in_their_unit(
    unit: str, scale: float, sync: int, problem: str, tmp_path: Path
) -> None:
    from asammdf import MDF, Signal

    with MDF(version="4.10") as mdf:
        mdf.append([Signal(X_MM, T * scale, unit="mm", name="x"), Signal(F_N / 1e3, T * scale, unit="kN", name="F")])
        master = mdf.groups[0].channels[mdf.masters_db[0]]
        master.unit, master.sync_type = unit, sync
        mdf.save(tmp_path / "a.mf4")
    if problem:
        with pytest.raises(FileProblem, match=problem):
            read(tmp_path / "a.mf4", displacement="x", force="F")
        check(read(tmp_path / "a.mf4", displacement="x", force="F", rate_Hz=250.0))
    else:
        check(read(tmp_path / "a.mf4", displacement="x", force="F"))
        check(read(tmp_path / "a.mf4", time=f"time:{unit or 's'}", displacement="x", force="F"))


@pytest.mark.parametrize(("sentinel", "given", "missing"), [
    (-9999.0, None, True), (-999.25, None, True), (9.9e37, None, True), (-8888.0, None, False),
    (-8888.0, (-8888.0,), True), (-9999.0, (), False),
])
def test_numbers_that_mean_no_value_are_taken_out_and_counted(
    sentinel: float, given: tuple[float, ...] | None, missing: bool, tmp_path: Path
) -> None:
    force = F_N.copy()
    force[[5, 50, 500]] = sentinel
    np.savetxt(tmp_path / "a.csv", np.column_stack([T, X_MM, force]), "%.9g", ",", header="t_s,x_mm,F_N", comments="")
    columns = {"time": "t_s", "displacement": "x_mm", "force": "F_N"}
    (test,) = read_tests([tmp_path / "a.csv"], ImportSettings(columns, 0.5, no_value=given))
    assert np.count_nonzero(np.isnan(test.force_N)) == 3 * missing
    assert ("force: 3 values of " in test.read_as) == missing


def test_a_force_that_reaches_such_a_number_has_a_value_there(tmp_path: Path) -> None:
    force = 12.4987 * F_N
    force[125] = -9999.0
    np.savetxt(tmp_path / "a.csv", np.column_stack([T, X_MM, force]), "%.9g", ",", header="t_s,x_mm,F_N", comments="")
    assert np.isfinite(read(tmp_path / "a.csv", time="t_s", displacement="x_mm", force="F_N").force_N).all()


def test_channels_of_a_bus_with_times_of_their_own_are_brought_together(tmp_path: Path) -> None:
    from asammdf import MDF, Signal

    source = np.random.default_rng(3)
    x_s, force_s = (np.sort(T + source.uniform(-5e-4, 5e-4, ROWS)) + late for late in (0.0, 0.0013))
    x_s[500], force_s[500] = x_s[499], force_s[499]  # two messages of one stamp
    motion = 20.0 * np.sin(2.0 * np.pi * x_s)
    force = 0.8 * np.cos(2.0 * np.pi * force_s)
    slow_s = np.arange(-0.5, 5.0, 0.1)
    with MDF(version="4.10") as mdf:
        mdf.append([Signal(motion, x_s, unit="mm", name="x")])
        mdf.append([Signal(force, force_s, unit="kN", name="F")])
        mdf.append([Signal(0.1 * slow_s, slow_s, unit="A", name="I")])
        mdf.save(tmp_path / "a.mf4")
    test = read(tmp_path / "a.mf4", displacement="x", force="F", current="I")
    at = test.time_s + x_s[np.searchsorted(x_s, force_s[0])]
    assert "force, current interpolated to the sample times of displacement" in test.read_as
    assert np.count_nonzero(~np.isfinite(test.force_N)) < 5
    known = np.isfinite(test.force_N)
    assert test.force_N[known] == pytest.approx(800.0 * np.cos(2.0 * np.pi * at[known]), abs=1.5)
    assert test.current_A == pytest.approx(0.1 * at, abs=1e-6)


@pytest.mark.parametrize("version", ["4.10", "3.30"])
def test_a_channel_beyond_its_records_is_refused(version: str, tmp_path: Path) -> None:
    """asammdf read the memory behind them, and the process ended."""
    from asammdf import MDF, Signal

    with MDF(version=version) as mdf:
        mdf.append([Signal(X_MM, T, unit="mm", name="x"), Signal(F_N, T, unit="N", name="F")])
        file = Path(mdf.save(tmp_path / ("a.mf4" if version == "4.10" else "a.mdf")))
    with MDF(file) as mdf:
        channel = mdf.groups[0].channels[1]
        field = 92 if version == "4.10" else 186  # of the channel's block: first byte, first bit
        place = channel.address + field
    data = bytearray(file.read_bytes())
    data[place : place + 2] = b"\xf0\xff"
    file.write_bytes(data)
    with pytest.raises(FileProblem, match=r"ends at byte \d+, but its records have 24 bytes"):
        read(file, displacement="x", force="F")


def test_more_scales_than_a_channel_can_have_are_refused_at_once(tmp_path: Path) -> None:
    """npTDMS counted them, for hours."""
    from nptdms import ChannelObject, TdmsWriter

    wave = {"wf_increment": 0.004, "wf_start_offset": 0.0, "NI_Number_Of_Scales": 2_000_000_000}
    with TdmsWriter(tmp_path / "a.tdms") as writer:
        writer.write_segment([ChannelObject("run", "x", X_MM, wave), ChannelObject("run", "F", F_N, wave)])
    with pytest.raises(FileProblem, match="NI_Number_Of_Scales = 2000000000, expected at most 256"):
        read(tmp_path / "a.tdms", displacement="x:mm", force="F:N")


def test_a_file_of_more_rows_than_pandas_takes_at_a_time_is_read(tmp_path: Path) -> None:
    """Before 3.1, pandas refuses a part without cells after the last column: 2**15 rows of 20 columns."""
    file, count = tmp_path / "many.csv", 2**15 + 2
    row = ",0.5" * 19
    file.write_text("\n".join([",".join(f"c{k}" for k in range(20)), *(f"{k}{row}" for k in range(count))]))
    first, last = CsvFile(file, file.read_bytes(), Dialect()).values([0, 19])
    assert np.array_equal(first, np.arange(count))
    assert np.array_equal(last, np.full(count, 0.5))


@pytest.mark.parametrize("part", [1, 100, 10_000])
def test_parts_of_a_file_end_with_rows_and_not_within_quotes(
    part: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.recording.file_formats.csv_file.PART", part)
    file = tmp_path / "remarks.csv"
    remarks = {7: '"a pause,\nthen on"', 40: '"warm"'}
    lines = [f"2026-01-02 10:00:{k / 10:06.3f},{k}.5,{remarks.get(k, '')}" for k in range(50)]
    file.write_text("\n".join(["time,x,remark", *lines, ""]))
    time_s, x = CsvFile(file, file.read_bytes(), Dialect()).values([0, 1])
    assert time_s == pytest.approx(np.arange(50) * 0.1)
    assert np.array_equal(x, np.arange(50) + 0.5)
