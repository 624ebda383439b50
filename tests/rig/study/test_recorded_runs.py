"""A study over recorded runs: which points it takes, what it refuses by name, what its tables then say."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rig.errors import FileProblem
from rig.identification.models.measurement import thinned
from rig.study.comparison import run_study
from rig.study.paper2_tables import current_tables
from rig.study.search_cell import all_cells
from rig.study.study_file import load_study
from rig.study.workbench import Workbench

STUDY = """
format = 1
[data]
runs = ["{run}"]
{select}
[comparison]
methods = ["pso"]
populations = [8]
budgets = [40, 80]
repeats = 2
"""
PER_CURRENT = """
[per_current]
methods = ["ga_novel", "zhu_three_step"]
current = [{currents}]
population = 6
budget = 24
repeats = 1
{more}
[per_current.data]
runs = ["{run}"]
{select}
"""


def study_of(run: Path, select: str = "", currents: str = "", current_select: str = "", more: str = "") -> Path:
    text = STUDY.format(run=run, select=select)
    if currents:
        text += PER_CURRENT.format(run=run, currents=currents, select=current_select, more=more)
    path = run.parent / "study.toml"
    path.write_text(text)
    return path


def test_the_valid_points_of_a_run_are_the_tests_and_the_others_are_named(run_folder: Path) -> None:
    bench = Workbench(load_study(study_of(run_folder)))
    assert [test.id for test in bench.tests] == ["p001", "p002", "p003", "p004"]
    assert bench.left_out == ["p005 not used: invalid (estop: held)"]


def test_friction_tests_are_no_loops_and_enter_no_objective(
    run_folder: Path, friction_point: Callable[[Path, str], None]
) -> None:
    friction_point(run_folder, "p006")
    bench = Workbench(load_study(study_of(run_folder)))
    assert [test.id for test in bench.tests] == ["p001", "p002", "p003", "p004"]
    with pytest.raises(FileProblem, match="none of the 1 points contains loops; expected at least one"):
        Workbench(load_study(study_of(run_folder, 'select = "frequency_Hz=0.5"')))


def test_a_filter_chooses_the_points(run_folder: Path) -> None:
    bench = Workbench(load_study(study_of(run_folder, 'select = "frequency_Hz=2"')))
    assert [test.id for test in bench.tests] == ["p002", "p004"]
    with pytest.raises(FileProblem, match=r"\[data\] select: 'frequency_Hz=7' matches none of the 5 points"):
        Workbench(load_study(study_of(run_folder, 'select = "frequency_Hz=7"')))


def test_points_that_are_all_invalid_are_refused_with_their_reasons(run_folder: Path) -> None:
    with pytest.raises(FileProblem, match=r"no point is valid: p005 not used: invalid \(estop: held\)"):
        Workbench(load_study(study_of(run_folder, 'select = "current_A=2"')))


def test_runs_of_different_specimens_are_refused(run_folder: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    (other / "points").mkdir(parents=True)
    (other / "points" / "p001.h5").write_bytes((run_folder / "points" / "p001.h5").read_bytes())
    (other / "campaign.json").write_text(json.dumps({"specimen": "MR-002"}))
    path = study_of(run_folder)
    path.write_text(path.read_text().replace(f'"{run_folder}"]', f'"{run_folder}", "{other}"]', 1))
    with pytest.raises(FileProblem, match=r"got specimens MR-001, MR-002, expected one"):
        Workbench(load_study(path))


def test_a_current_without_a_test_is_refused_and_not_replaced_by_the_nearest(run_folder: Path) -> None:
    path = study_of(run_folder, currents='"0 A", "0.9 A"', current_select='select = "frequency_Hz=1"')
    with pytest.raises(FileProblem, match=r"0\.9 A: no test at this current; the tested currents are 0 A, 1 A"):
        Workbench(load_study(path))


def test_two_tests_at_a_current_are_refused_with_how_to_choose(run_folder: Path) -> None:
    with pytest.raises(FileProblem, match=r"0 A: 2 tests \(p001 .*, p002 .*\), expected one. Fix: choose a test with"):
        Workbench(load_study(study_of(run_folder, currents='"0 A", "1 A"')))


@pytest.mark.nightly
def test_a_study_of_a_run_fills_table_1_and_says_what_a_method_could_not_do(run_folder: Path, tmp_path: Path) -> None:
    path = study_of(run_folder, currents='"0 A", "1 A"', current_select='select = "frequency_Hz=1"')
    outcome = run_study(path, tmp_path / "out", processes=1)
    tables = {table.name: table for table in outcome.tables}
    assert tables["table-01"].columns == ("I / A", "A / m at f = 1 Hz", "A / m at f = 2 Hz")
    assert tables["table-01"].rows == (("0", "0.02", "0.02"), ("1", "0.02", "0.02"))
    assert tables["paper2-table-01-ga_novel"].columns == ("parameter", "unit", "I = 0 A", "I = 1 A")
    # the demo damper's hysteretic force at 0 A is 5.56 N, its noise 5 N: no loop to find three steps in
    assert "Zhu et al., three steps at 0 A failed (p001: zhu_three_step:" in tables["paper2-figure-13"].note
    again = run_study(path, tmp_path / "out", processes=1)
    assert again.tables == outcome.tables


def test_the_files_box_is_searched_and_a_parameter_at_its_edge_is_named(run_folder: Path) -> None:
    one_loop = {"currents": '"1 A"', "current_select": 'select = "frequency_Hz=1"'}
    study = load_study(study_of(run_folder, **one_loop, more="bounds = { k0 = [1e6, 1.1e6] }"))
    cell = next(cell for cell in all_cells(study) if cell.method == "ga_novel")
    line = Workbench(study).run(cell)
    assert 1e6 <= line["parameters"]["k0"] <= 1.1e6

    def note(k0: float) -> str:
        at_k0 = {**line, "parameters": {**line["parameters"], "k0": k0}}
        tables = {table.name: table for table in current_tables(study, {cell.key: at_k0})}
        return tables["paper2-table-01-ga_novel"].note

    assert "k0 at 1 A" in note(1e6 + 50.0)
    assert "k0 at 1 A" not in note(1e6 + 200.0)


@pytest.mark.parametrize(
    ("bounds", "message"),
    [
        ("bounds = { c9 = [0, 1] }", "bounds: got 'c9', expected one of c0, k0, x0, alpha, gamma, beta, n"),
        ("bounds = { c0 = [2, 1] }", r"c0 = \[2, 1\]: expected the first value to be less"),
    ],
)
def test_a_wrong_box_is_refused(run_folder: Path, bounds: str, message: str) -> None:
    with pytest.raises(FileProblem, match=message):
        load_study(study_of(run_folder, currents='"0 A"', more=bounds))


def test_thinning_keeps_every_channel_of_a_measurement_in_step(run_folder: Path) -> None:
    whole = Workbench(load_study(study_of(run_folder))).tests[0]
    fewer = thinned(whole, 5)
    assert np.array_equal(fewer.force_N, whole.force_N[::5], equal_nan=True)
    assert np.array_equal(fewer.scored, whole.scored[::5])
    assert fewer.dt_s == pytest.approx(5 * whole.dt_s)
    assert fewer.samples_per_cycle == whole.samples_per_cycle // 5
