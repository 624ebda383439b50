"""What people type first: `rig.load`, `rig.identify`, `print(fit)`, save, load, predict, plot."""

from __future__ import annotations

import inspect
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest

import rig
from rig.dampers import model
from rig.errors import DataWarning, FileProblem, IdentificationFailed, NoSuchEntry, RigError
from rig.export import export
from rig.fits.entries import Cause, Estimate, ModelScore, Profile, TestedRange
from rig.fits.scores import Scores
from rig.identification import identify_run
from rig.recording.importing import import_tests
from rig.recording.load_options import LoadOptions

TRUTH = dict(model("asymmetric").demonstration)
MOTIONS = ((0.5, 0.0), (0.5, 2.0), (2.0, 0.0), (2.0, 2.0))


def frame(frequency_Hz: float, current_A: float) -> pd.DataFrame:
    """Four cycles of a sine of 20 mm with 5 N of noise, in mm, kN and A."""
    t = np.arange(0.0, 4.5 / frequency_Hz, 0.004)
    omega = 2.0 * np.pi * frequency_Hz
    u, v = 0.02 * np.sin(omega * t), 0.02 * omega * np.cos(omega * t)
    force = model("asymmetric").force(TRUTH, u, v, -(omega**2) * u, np.full(t.size, current_A), 0.004)
    force += np.random.default_rng(int(10 * frequency_Hz + current_A)).normal(0.0, 5.0, t.size)
    return pd.DataFrame({"time_s": t, "displacement_mm": 1e3 * u, "force_kN": 1e-3 * force, "current_A": current_A})


@pytest.fixture(scope="module")
def frames() -> dict[str, pd.DataFrame]:
    return {f"f{frequency_Hz:g}_i{current_A:g}": frame(frequency_Hz, current_A) for frequency_Hz, current_A in MOTIONS}


@pytest.fixture(scope="module")
def files(frames: dict[str, pd.DataFrame], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tests")
    for name, table in frames.items():
        table.to_csv(folder / f"{name}.csv", index=False)
    return folder


@pytest.fixture(scope="module")
def run(files: Path) -> rig.Run:
    return rig.load(files)


@pytest.fixture(scope="module")
def fit(run: rig.Run) -> rig.Fit:
    return rig.identify(run)


@pytest.fixture(autouse=True)
def _no_window() -> Iterator[None]:
    mpl.use("Agg")
    yield
    sys.modules["matplotlib.pyplot"].close("all") if "matplotlib.pyplot" in sys.modules else None


def test_the_package_offers_its_names_and_loads_none_of_them_before_they_are_used() -> None:
    program = (
        "import sys, rig\n"
        "print(sorted(name for name in sys.modules if name.startswith(('rig.', 'numpy', 'pandas'))))\n"
        "print(' '.join(dir(rig)))\n"
        "assert all(getattr(rig, name) is not None for name in dir(rig))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    loaded, offered = done.stdout.splitlines()
    assert loaded == "[]"
    assert {"identify", "load", "load_fit", "Run", "Fit"} <= set(offered.split())
    stub = Path(inspect.getfile(rig)).with_suffix(".pyi").read_text(encoding="utf-8")
    assert all(f"{name} as {name}" in stub for name in offered.split() if name != "__version__")


def sources(frames: dict[str, pd.DataFrame], files: Path) -> dict[str, Any]:
    apart = sorted(files.glob("*.csv"))
    first, *others = frames.values()
    return {
        "folder": files, "text": str(files), "pattern": str(files / "*.csv"), "files": apart,
        "tables by name": frames, "list of tables": [*frames.values()],
        "run and files": [rig.load(apart[:2]), *apart[2:]], "points": [*rig.load(files)],
        "one table": pd.concat([table.assign(test=name) for name, table in frames.items()], ignore_index=True),
        "arrays and tables": [{name: first[name].to_numpy() for name in first}, *others], "headings": [
            table.set_axis(["Time [s]", "Displacement [mm]", "Force (kN)", "Current [A]"], axis=1)
            for table in frames.values()
        ], "xarray": rig.load(frames).to_xarray(),
    }


def test_every_source_of_the_same_tests_gives_the_same_run(
    frames: dict[str, pd.DataFrame], files: Path, run: rig.Run
) -> None:
    for kind, source in sources(frames, files).items():
        again = rig.load(source, **({"by": "test"} if kind == "one table" else {}))
        for one, other in zip(again, run, strict=True):
            assert (one.current_A, one.verdict) == (other.current_A, other.verdict), kind
            assert one.force_N == pytest.approx(other.force_N, rel=1e-9), kind


def test_a_table_is_identified_at_once_as_its_files_are(frames: dict[str, pd.DataFrame], fit: rig.Fit) -> None:
    again = rig.identify(frames)
    assert again.params.value == pytest.approx(fit.params.value, rel=1e-6, nan_ok=True)


def test_tests_in_memory_are_those_of_an_imported_run_and_of_the_command(
    files: Path, fit: rig.Fit, tmp_path: Path
) -> None:
    columns = {"time": "time_s", "displacement": "displacement_mm", "force": "force_kN", "current": "current_A"}
    folder = import_tests(sorted(files.glob("*.csv")), columns=columns, out=tmp_path)
    imported, written = rig.load(folder), identify_run([folder])
    assert np.array_equal(rig.identify(folder).params.interval, written.params.interval, equal_nan=True)
    assert written.params.interval == pytest.approx(fit.params.interval, rel=1e-3, nan_ok=True)  # the file is float32
    for one, other in zip(imported, rig.load(files), strict=True):
        assert (one.id, one.verdict, one.current_A, one.amplitude_m) == (
            other.id, other.verdict, other.current_A, other.amplitude_m)  # fmt: skip
        assert one.force_N == pytest.approx(other.force_N, rel=1e-6)


def test_a_tested_range_that_ends_in_the_noise_of_the_current_ends_at_0() -> None:
    tested = TestedRange(current_A=(-4.83e-5, 1.5), velocity_m_s=(-0.3, 0.3), displacement_m=(-0.02, 0.03))
    assert tested.describe() == "displacement_m -0.02 to 0.03, velocity_m_s -0.3 to 0.3, current_A 0 to 1.5"


def test_compared_models_print_as_a_table() -> None:
    scores = Scores((ModelScore("kwok", 1.5, -1234.5, 5.01, 8), ModelScore("lugre", reason="no convergence")))
    lines = repr(scores).splitlines()
    assert max(map(len, lines)) <= 80
    assert ("kwok" in lines[-2], "5.01" in lines[-2], "no convergence" in lines[-1]) == (True, True, True)
    assert scores.to_pandas().loc["kwok", "bic"] == -1234.5


def test_a_problem_of_many_files_is_one_line_in_words_of_python(tmp_path: Path) -> None:
    for name in ("a", "b", "c", "d"):
        (tmp_path / f"{name}.csv").write_text("t_s,Kraft,x_m\n" + "0.1,2,3\n" * 20)
    with pytest.raises(rig.RigError) as caught:
        rig.load(tmp_path, columns={"displacement": "x_m"})
    lines = str(caught.value).splitlines()
    assert len(lines) == 4
    assert lines[0].endswith("c.csv and 1 more: force: no column given. Fix: write columns={'force': 'NAME'}")
    assert lines[2].endswith("perhaps columns={'force': 'Kraft:N'}")


@pytest.mark.parametrize("form", ["csv", "parquet", "netcdf", "mat", "mf4"])
def test_our_own_exports_are_read_back_with_the_same_fit(form: str, run: rig.Run, fit: rig.Fit, tmp_path: Path) -> None:
    spoiled = replace(run[3], verdict="invalid", reasons=("by hand",))
    export(replace(run, points=(*run.points[:3], spoiled)), form, tmp_path)
    again = rig.load(tmp_path)
    assert [point.id for point in again] == [point.id for point in run]
    assert [point.current_A for point in again] == pytest.approx([point.current_A for point in run])
    if form in {"csv", "parquet", "netcdf"}:  # these state the verdict
        assert again[3].verdict == "invalid"
    found = rig.identify([replace(point, verdict="valid") for point in again])
    assert found.params.value == pytest.approx(fit.params.value, rel=1e-6, nan_ok=True)


def test_a_recording_whose_sensors_begin_apart_is_read_back_as_it_was_judged(run: rig.Run, tmp_path: Path) -> None:
    late = {name: values.copy() for name, values in (run[2].arrays or {}).items()}
    late["force"][:20], late["force"][300:303] = np.nan, np.nan
    recorded = replace(run[2], arrays=late, imported=False)
    export(replace(run, points=(recorded,)), "csv", tmp_path / "listed")
    again = rig.load(tmp_path / "listed")[0]
    assert (again.verdict, again.samples) == ("valid", run[2].samples - 20)
    late["force"][300:303] = 0.0
    assert rig.load(replace(run[2], arrays=late).to_pandas())[0].verdict == "valid"


def test_a_triangle_stays_one_through_an_export(tmp_path: Path) -> None:
    t = np.arange(0.0, 11.0, 0.004)
    u = 0.02 * (2.0 / np.pi) * np.arcsin(np.sin(np.pi * t))
    table = pd.DataFrame({"time_s": t, "displacement_m": u, "force_N": 1000.0 * np.gradient(u, t), "current_A": 1.0})
    export(rig.load({"ramp": table}, waveform="triangle"), "csv", tmp_path)
    assert rig.load(tmp_path)["ramp"].waveform == "triangle"


def test_a_print_is_a_report_of_forty_lines_at_most(fit: rig.Fit) -> None:
    long = replace(
        fit, warnings=tuple(f"warning {k} " + "that goes on and on " * 40 for k in range(30)),
        parameters={**fit.parameters, **{f"x{k}": Estimate(1.0, "N", reason="unknown " * 30, identifiable=False)
                                         for k in range(40)}},
        diagnosis=tuple(Cause(f"c{k}", "<script>alert(1)</script> " * 9, 0.5, "nothing") for k in range(9)),
    )  # fmt: skip
    for one in (fit, long):
        lines = str(one).splitlines()
        assert len(lines) <= 40
        assert max(map(len, lines)) <= 80
        assert len(repr(one)) < 200
    assert any(line.startswith("beta") and "s/m" in line for line in str(fit).splitlines())
    assert "<script>" not in long._repr_html_()
    assert "&lt;script&gt;" in long._repr_html_()
    assert "<table" in fit._repr_html_()


def test_causes_and_profiles_are_printed_in_one_line() -> None:
    cause = Cause("spring", "a spring of 2 kN/mm fits better", 0.42, "stiffen the fixture")
    assert repr(cause) == (
        "<spring, explains 42 % of the misfit: a spring of 2 kN/mm fits better. Next: stiffen the fixture>"
    )
    profile = Profile(tuple(float(k) for k in range(500)), (0.0,) * 500, 1.25, None)
    assert repr(profile) == "<profile likelihood at 500 values; 95 % interval: 1.25 to open>"


def test_parameters_are_indexed_iterated_and_tabulated(fit: rig.Fit) -> None:
    beta = fit["beta"]
    assert (beta, beta.unit) == (fit.params["beta"], "s/m")
    assert beta.low is not None
    assert beta.low < TRUTH["beta"] < (beta.high or 0.0)
    assert float(beta) == beta.value
    assert f"{beta:.3g}" == f"{beta.value:.3g}"
    assert list(fit) == list(fit.params) == list(fit.params.names)
    assert fit.params.value[list(fit).index("beta")] == beta.value
    assert fit.params.interval.shape == (len(fit.params), 2)
    assert fit.params.to_pandas().loc["beta", "standard_error"] == beta.standard_error
    covariance = fit.covariance
    assert np.sqrt(covariance.loc["beta", "beta"]) == pytest.approx(beta.standard_error)
    assert np.allclose(covariance, covariance.T)
    with pytest.raises(NoSuchEntry, match="did you mean beta"):
        fit["betta"]


def test_residuals_are_the_measured_minus_the_modelled_force(fit: rig.Fit, run: rig.Run) -> None:
    shown, whole = fit.residuals, fit.residuals_of(run)
    assert set(shown["test"]) == {point.id for point in run}
    assert len(shown) < len(whole) < sum(map(len, run))
    assert np.allclose(whole["residual_N"], whole["force_N"] - whole["model_N"], equal_nan=True)
    assert whole["residual_N"].std() == pytest.approx(5.0, rel=0.1)


def test_a_saved_fit_is_loaded_and_an_older_one_is_kept(fit: rig.Fit, tmp_path: Path) -> None:
    path = fit.save(tmp_path / "here" / "mine.json")
    again = rig.load_fit(path)
    assert again.params.to_pandas().equals(fit.params.to_pandas())
    assert fit.save(path) == path
    assert [one.name for one in path.parent.iterdir()] == ["mine.json"]
    replace(fit, warnings=("another",)).save(path)
    assert len(list(path.parent.glob("mine-*.json"))) == 1
    (tmp_path / "notes.json").write_text("{}")
    with pytest.raises(FileProblem, match="does not contain a fit"):
        fit.save(tmp_path / "notes.json")
    assert (tmp_path / "notes.json").read_text() == "{}"
    assert fit.save(tmp_path) == tmp_path / "fit.json"
    with pytest.raises(FileProblem, match=r"rig\.load_fit"):
        rig.load(path)


@pytest.mark.parametrize("form", ["json", "table", "inverse", "c", "matlab", "python"])
def test_a_fit_that_was_never_written_is_exported(form: str, fit: rig.Fit, tmp_path: Path) -> None:
    (first, *_) = fit.export(form, tmp_path / "out")
    saved = export(fit.save(tmp_path / "fit.json"), form, tmp_path / "saved")
    assert first.read_bytes() == saved[0].read_bytes()
    with pytest.raises(RigError, match="did you mean fmi"):
        fit.export("fmu", tmp_path)


def test_predict_takes_tables_arrays_and_keywords_of_the_same_motion(fit: rig.Fit, run: rig.Run) -> None:
    u, v, i = np.zeros(3), np.array([-0.1, 0.02, 0.1]), np.array([0.0, 1.0, 2.0])
    wanted = fit.predict(pd.DataFrame({"displacement_m": u, "velocity_m_s": v, "current_A": i}))["force_N"].tolist()
    others: list[Callable[[], pd.DataFrame]] = [
        lambda: fit.predict(u, v, i), lambda: fit.predict(np.column_stack([u, v, i])),
        lambda: fit.predict(displacement_m=0.0, velocity_m_s=v, current_A=i),
        lambda: fit.predict({"displacement_mm": 1e3 * u, "velocity_mm_s": 1e3 * v, "current_measured_A": i}),
        lambda: fit.predict(np.array(list(zip(u, v, i, strict=True)), dtype=[
            ("displacement_m", float), ("velocity_m_s", float), ("current_A", float)])),
    ]  # fmt: skip
    table = pd.DataFrame({"displacement": u, "velocity": 1e3 * v, "current": i})
    table.attrs["units"] = {"velocity": "mm/s"}
    for predicted in (*others, lambda: fit.predict(table)):
        assert predicted()["force_N"].tolist() == pytest.approx(wanted)
    at_point = fit.predict(run[3])
    assert np.sqrt(np.mean((at_point["force_N"].to_numpy() - run[3].force_N) ** 2)) < 6.0
    gaps = run[3].current_measured_A.copy()
    gaps[:2], gaps[-40:] = np.nan, np.nan  # the current's samples begin later and end earlier than the motion's
    recorded = rig.RecordedPoint.from_arrays(
        id="p", time_s=run[3].time_s, displacement_m=run[3].displacement_m, force_N=run[3].force_N,
        velocity_m_s=run[3].velocity_m_s, current_measured_A=gaps, current_A=2.0, waveform="sine", amplitude_m=0.02,
        frequency_Hz=2.0,
    )
    assert fit.predict(recorded)["force_N"].tolist() == pytest.approx(at_point["force_N"].tolist(), abs=1e-6)
    for wrong, says in (
        (fit.predict, "`displacement_m`: missing"), (lambda: fit.predict(np.zeros((2, 2))), r"shape \(n, 3\)"),
        (lambda: fit.predict(table, current_A=1.0), "expected only one of these"), (lambda: fit.predict("x"), "shape"),
        (lambda: fit.predict({"displacement_mm": 0.0, "displacement_m": 0.0, "current_A": 1.0}), "Fix: remove one"),
    ):  # fmt: skip
        with pytest.raises(FileProblem, match=says):
            wrong()


def test_a_run_is_a_sequence_of_points(run: rig.Run, tmp_path: Path) -> None:
    assert len(run) == len(MOTIONS)
    assert run[0] is run["f0.5_i0"]
    assert run[-1] is [*run][-1]
    assert (len(run[1:3]), run[1:3][0].id) == (2, run[1].id)
    assert run[0] in run
    assert "nothing" not in run
    assert str(len(run)) in repr(run)
    assert len(run[0]) == run[0].samples
    data = run.to_xarray()
    assert data.force_N.attrs["units"] == "N"
    one = data.sel(point="f2_i2")
    assert np.array_equal(one.force_N.to_numpy()[: run[3].samples], run[3].force_N)
    assert np.isnan(one.time_s.to_numpy()[run[3].samples :]).all()
    assert float(one.current_A) == 2.0
    assert np.array_equal(run[3].to_xarray().force_N, run[3].force_N)
    for place, says in (("f2_i3", "did you mean f2_i"), (7, "expected -4 to 3"), (1.5, "expected a point ID")):
        with pytest.raises(NoSuchEntry, match=says):
            run[place]  # type: ignore[index]  # as people do


def test_plots_are_drawn_on_the_axes_that_are_given_or_on_new_ones(run: rig.Run, fit: rig.Fit) -> None:
    import matplotlib.pyplot as plt

    _, ax = plt.subplots()
    assert run.plot_loops(ax) is ax
    assert np.array_equal(ax.lines[0].get_ydata(), run[0].force_N)
    assert ax.get_xlabel() == "Velocity (m/s)"
    loops = fit.plot_loops(over="displacement")
    assert loops.get_xlabel().endswith("(mm)")
    assert len(loops.lines) == 2 * len(run)
    ends = np.array([line.get_xydata()[[0, -1]] for line in loops.lines])  # type: ignore[index]
    assert np.array_equal(ends[:, 0], ends[:, 1])  # the loops are closed
    assert len(fit.plot_loops(tests=run[:1]).lines) == 2
    assert fit.plot_residuals(tests=run).get_ylabel().endswith("(N)")
    assert run[0].plot_time("current").get_ylabel() == "Coil current (A)"
    for wrong in (lambda: run.plot_loops(over="time"), lambda: run[0].plot_time("nothing"),
                  lambda: run.plot_loops(ax=3)):  # type: ignore[arg-type]  # as people do
        with pytest.raises(RigError):
            wrong()


def test_a_library_that_is_missing_is_named_with_its_command(run: rig.Run, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, use in (("matplotlib.pyplot", run.plot_loops), ("xarray", run.to_xarray)):
        monkeypatch.setitem(sys.modules, name, None)
        with pytest.raises(RigError, match=r"pip install 'mr-damper-rig\[notebook\]'"):
            use()


T = np.arange(0.0, 5.0, 0.004)
X, F = np.sin(2 * np.pi * T), 500.0 * np.cos(2 * np.pi * T)
REFUSED: dict[str, tuple[object, dict[str, Any], str]] = {
    "number": (5, {}, "got int, expected a folder"),
    "nothing": ([], {}, "empty list"),
    "no file": ("nowhere.csv", {}, "no such file"),
    "no match": ("nowhere/*.csv", {}, "no file matches"),
    "no rows": (pd.DataFrame({"time_s": []}), {}, "no rows"),
    "an option that is not used": (rig.Run(rig.Run.NOWHERE, ()), {"units": {"force": "N"}}, "got units"),
    "no current": (pd.DataFrame({"time_s": T, "displacement_mm": X, "force_N": F}), {}, "current_A=0.5"),
    "other names": (pd.DataFrame({"t_s": T, "x": X, "F": F}), {}, "no column 'displacement'"),
    "no such column": (pd.DataFrame({"t_s": T}), {"columns": {"force": "F"}}, "no column 'F'"),
    "column without a unit": (pd.DataFrame({"F": T}), {"columns": {"force": "F", "displacement": "F"}}, "unknown unit"),
    "millimetres as metres": (
        pd.DataFrame({"time_s": T, "displacement_m": 20 * X, "force_N": F, "current_A": 1.0}), {}, "probably in mm"),
    "several tests": (
        pd.concat([pd.DataFrame({"time_s": T, "displacement_mm": X, "force_N": F, "current_A": 1.0})] * 2), {},
        "by=COLUMN"),
    "two currents": (pd.DataFrame({"time_s": T}), {"current_A": [1.0, 2.0]}, "got 2 currents for 1"),
    "waveform": (pd.DataFrame({"time_s": T}), {"waveform": "square"}, "got 'square', expected"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_read_is_refused_in_words_with_the_way_out(name: str) -> None:
    source, options, says = REFUSED[name]
    for use in (rig.load, rig.identify):
        with pytest.raises(FileProblem, match=says):
            use(source, **options)  # type: ignore[operator]  # a function of two


def test_columns_of_any_name_are_named_by_the_user(
    tmp_path: Path, fit: rig.Fit, frames: dict[str, pd.DataFrame]
) -> None:
    names = {"time_s": "t", "displacement_mm": "Weg", "force_kN": "F_kN"}
    tables = {name: one.drop(columns="current_A").rename(columns=names) for name, one in frames.items()}
    stated = {"columns": {"time": "t:s", "displacement": "Weg:mm", "force": "F_kN"}, "current_A": [0.0, 2.0, 0.0, 2.0]}
    for name, table in tables.items():
        table.to_csv(tmp_path / f"{name}.csv", index=False)
    of_tables, of_files = rig.identify(tables, **stated), rig.identify(tmp_path, **stated)
    assert of_tables.params.value == pytest.approx(fit.params.value, rel=1e-6, nan_ok=True)
    assert of_files.params.value == pytest.approx(fit.params.value, rel=1e-6, nan_ok=True)
    with pytest.raises(FileProblem, match=r"columns=\{'displacement'"):
        rig.load(tmp_path)


def test_an_option_that_there_is_not_is_named() -> None:
    with pytest.raises(TypeError, match="did you mean current_A"):
        rig.load("nowhere", curent_A=1.0)  # type: ignore[call-arg]  # as people do
    with pytest.raises(TypeError, match="did you mean model"):
        rig.identify("nowhere", mode="few")
    assert "units" in (inspect.getdoc(LoadOptions) or "")


def test_a_text_column_is_left_out_by_its_name(frames: dict[str, pd.DataFrame]) -> None:
    table = frames["f2_i2"].assign(operator="Ada")
    with pytest.warns(DataWarning, match="column 'operator' contains text"):
        assert len(rig.load(table)) == 1


def test_a_loaded_fit_draws_the_cycles_of_tests_that_have_no_files(
    fit: rig.Fit, run: rig.Run, tmp_path: Path
) -> None:
    path = fit.save(tmp_path)
    again = rig.load_fit(path)
    assert rig.load_fit(again.save(tmp_path / "copy.json")).cycles == again.cycles
    for one, other in zip(fit.plot_loops().lines, again.plot_loops().lines, strict=True):
        assert other.get_ydata() == pytest.approx(one.get_ydata(), rel=1e-5, abs=1e-3)
    assert again.residuals["residual_N"].std() == pytest.approx(fit.residuals["residual_N"].std(), rel=1e-4)
    content = json.loads(path.read_text())
    content["cycles"][0]["force_N"].pop()
    path.write_text(json.dumps(content))
    with pytest.raises(FileProblem, match=r"cycles\[0\]: .*force_N"):
        rig.load_fit(path).plot_loops()
    with pytest.raises(IdentificationFailed, match="tests="):
        replace(again, cycles=()).plot_loops()
    assert len(replace(again, cycles=()).plot_loops(tests=run).lines) == 2 * len(run)
