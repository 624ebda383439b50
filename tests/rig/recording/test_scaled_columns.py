"""Factors, signs, sensitivities and units of the columns of other programs' files."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pytest

from rig.errors import FileProblem
from rig.recording.external_tests import ImportedTest, ImportSettings, read_tests
from rig.recording.file_formats.file_units import named_unit, scaling_of

T = np.arange(1000) * 0.004
X_M, F_N = 0.02 * np.sin(2.0 * np.pi * T), 800.0 * np.cos(2.0 * np.pi * T)


def read(path: Path, scales: dict[str, str | float], **columns: str) -> ImportedTest:
    (test,) = read_tests([path], ImportSettings(columns, 0.5, scales=scales))
    return test


def csv(path: Path, head: str, x: float, force: float) -> Path:
    """A CSV file of the test whose displacement and force are multiplied."""
    np.savetxt(path, np.column_stack([T, X_M * x, F_N * force]), "%.9g", ",", header=head, comments="")
    return path


@pytest.mark.parametrize(("head", "x", "force", "columns", "scales"), [
    ("t_s,x_mm,F [daN]", 1e3, 0.1, ("x_mm", "F"), {}),
    ("t_s,x_in,F_lbf", 1 / 0.0254, 1 / 4.4482216152605, ("x_in", "F_lbf"), {}),
    ("t_s,x [mil],F (ozf)", 1e3 / 0.0254, 16.0 / 4.4482216152605, ("x", "F"), {}),
    ("t_s,x [µm],F (kp)", 1e6, 1 / 9.80665, ("x", "F"), {}),
    ("t_s,x,F", 1e6, 1e3 / 9.80665, ("x:microns", "F:gf"), {}),
    ("t_s,x,F", 1e3, 1e-3 / 9.80665, ("x:MM", "F:tf"), {}),
    ("t_s,x_m,F_N", -1.0, -1.0, ("x_m", "F_N"), {"force": -1, "displacement": "-1"}),
    ("t_s,x,F", 1e3, 4.0, ("x:mm", "F"), {"force": "0.25 N/count"}),
    ("t_s,x [V],F [mV]", 100.0, 2.0, ("x", "F"), {"displacement": "10 mm/V", "force": "500 N/V"}),
    ("t_s,x,F", 1e3 * 0.5, 2.0, ("x:V", "F:mV"), {"displacement": "500 mV/mm", "force": "2 mV/N"}),
    ("t_s,x_m,F_mA", 1.0, 1 / 500.0, ("x_m", "F_mA"), {"force": "0.5 kN/mA"}),
])  # fmt: skip
def test_units_factors_and_sensitivities_of_any_column(
    head: str, x: float, force: float, columns: tuple[str, str], scales: dict[str, str | float], tmp_path: Path
) -> None:
    """The true displacement and force, whatever the file has them in."""
    if "mV" in columns[1] and scales["displacement"] == "500 mV/mm":
        x = 500.0  # V: 1 m is 1000 mm, each 500 mV
    path = csv(tmp_path / "a.csv", head, x, force)
    test = read(path, scales, time="t_s", displacement=columns[0], force=columns[1])
    assert test.displacement_m == pytest.approx(X_M, abs=1e-9)
    assert test.force_N == pytest.approx(F_N, rel=1e-7, abs=1e-5)
    assert all(str(scale) in test.read_as for scale in scales.values())


@pytest.mark.parametrize(("scales", "columns", "says"), [
    ({"force": "0"}, ("x_m", "F_N"), "other than 0"),
    ({"force": "nan"}, ("x_m", "F_N"), "finite"),
    ({"force": "500"}, ("x_m", "F"), "unknown unit"),
    ({"force": "500 mm/V"}, ("x_m", "F"), "expected a unit of force"),
    ({"force": "500 N/V"}, ("x_m", "F_N"), "requires V"),
    ({"force": "500 N/V"}, ("x_m", "F:kN"), "requires V"),
    ({"force": "0.25 N/count"}, ("x_m", "F_N"), "requires counts"),
    ({"temperature": "2"}, ("x_m", "F_N"), "no temperature column is specified"),
])
def test_scales_that_do_not_fit_are_refused(
    scales: dict[str, str | float], columns: tuple[str, str], says: str, tmp_path: Path
) -> None:
    path = csv(tmp_path / "a.csv", f"t_s,x_m,{columns[1].partition(':')[0]}", 1.0, 1.0)
    with pytest.raises(FileProblem, match=says):
        read(path, scales, time="t_s", displacement=columns[0], force=columns[1])


def test_a_torque_and_a_mass_are_no_length_and_no_force() -> None:
    assert named_unit("Nm", "length") is None
    assert named_unit("kg", "force") is None
    assert named_unit("mn", "force") is None  # mN or MN
    assert named_unit("KN", "force") == ("kN", named_unit("kN", "force")[1])  # type: ignore[index]
    assert scaling_of("displacement", "2 mV/mm").factor == pytest.approx(0.5)


SCALES = {
    "linear": {"NI_Number_Of_Scales": 1, "NI_Scale[0]_Scale_Type": "Linear", "NI_Scale[0]_Linear_Slope": 0.05,
               "NI_Scale[0]_Linear_Y_Intercept": 0.0, "NI_Scale[0]_Linear_Input_Source": 0xFFFFFFFF},
    "polynomial": {"NI_Number_Of_Scales": 1, "NI_Scale[0]_Scale_Type": "Polynomial",
                   "NI_Scale[0]_Polynomial_Coefficients_Size": 2, "NI_Scale[0]_Polynomial_Coefficients[0]": 0.0,
                   "NI_Scale[0]_Polynomial_Coefficients[1]": 0.05,
                   "NI_Scale[0]_Polynomial_Input_Source": 0xFFFFFFFF},
    "table": {"NI_Number_Of_Scales": 1, "NI_Scale[0]_Scale_Type": "Table", "NI_Scale[0]_Table_Input_Source": 0xFFFFFFFF,
              "NI_Scale[0]_Table_Scaled_Values_Size": 2, "NI_Scale[0]_Table_Pre_Scaled_Values_Size": 2,
              "NI_Scale[0]_Table_Pre_Scaled_Values[0]": -2e4, "NI_Scale[0]_Table_Pre_Scaled_Values[1]": 2e4,
              "NI_Scale[0]_Table_Scaled_Values[0]": -1000.0, "NI_Scale[0]_Table_Scaled_Values[1]": 1000.0},
}  # fmt: skip


def tdms(path: Path, properties: dict[str, object]) -> Path:
    from nptdms import ChannelObject, TdmsWriter

    wave = {"wf_increment": 0.004}
    with TdmsWriter(path) as writer:
        writer.write_segment([
            ChannelObject("g", "x", X_M * 1e3, {**wave, "unit_string": "mm"}),
            ChannelObject("g", "F", np.round(F_N * 20.0).astype(np.int16), {**wave, "unit_string": "N", **properties}),
        ])
    return path


@pytest.mark.parametrize("kind", SCALES)
def test_integers_of_tdms_come_by_the_scales_of_the_format(kind: str, tmp_path: Path) -> None:
    test = read(tdms(tmp_path / "a.tdms", SCALES[kind]), {}, displacement="x", force="F")
    assert test.force_N == pytest.approx(F_N, abs=0.03)


@pytest.mark.parametrize("properties", [
    {"Scale": 0.05}, {"gain": 0.05}, {"Sensitivity": "0.05"},
    {"NI_Number_Of_Scales": 1, "NI_Scale[0]_Scale_Type": "New"},
])  # fmt: skip
def test_integers_with_a_factor_of_no_known_format_are_refused_until_it_is_given(
    properties: dict[str, object], tmp_path: Path
) -> None:
    path = tdms(tmp_path / "a.tdms", properties)
    with pytest.raises(FileProblem, match=r"\(possibly a factor\) is not applied\. Fix: use --scale force=FACTOR"):
        read(path, {}, displacement="x", force="F")
    assert read(path, {"force": 0.05}, displacement="x", force="F").force_N == pytest.approx(F_N, abs=0.03)


@pytest.mark.parametrize(("head", "expected"), [
    ("Time (sec);Force Command (N);Axial Force (N);Max Disp (mm);Axial Displacement (mm)",
     ["displacement='Axial Displacement'", "force='Axial Force'", "time=Time"]),
    ("counter;Load cell temperature [degC];Load position [mm];Ch4 [kN];t_ms",
     ["'displacement=Load position'", "'force=Ch4'", "time=t_ms"]),
    ("Zeit;Weg;Kraft", ["displacement=Weg:m", "force=Kraft:N", "time=Zeit:s"]),
])  # fmt: skip
def test_hints_name_columns_that_fit_quoted_for_a_shell(head: str, expected: list[str], tmp_path: Path) -> None:
    count = head.count(";") + 1
    np.savetxt(tmp_path / "a.csv", np.random.default_rng(1).normal(size=(50, count)), "%.6f", ";", header=head,
               comments="")  # fmt: skip
    with pytest.raises(FileProblem) as caught:
        read_tests([tmp_path / "a.csv"], ImportSettings({}))
    (hint,) = (line for line in str(caught.value).split("\n") if "perhaps" in line)
    options = shlex.split(hint.partition("perhaps ")[2])[1::2]
    assert options == [shlex.split(one)[0] for one in expected]
