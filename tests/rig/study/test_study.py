"""A whole study: cells, resuming, tables, pages, refusals."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.errors import FileProblem
from rig.study.comparison import run_study
from rig.study.execution import StudyProgress
from rig.study.provenance import SOFTWARE
from rig.study.recordings import BOUC_WEN_TRUTH, bouc_wen, content_hash, table1
from rig.study.results import ResultsFile, shorter_lines
from rig.study.search_cell import SearchCell, all_cells, searches
from rig.study.study_file import CURRENT_BOXES, load_study
from rig.study.workbench import Workbench

EXAMPLE = Path(__file__).parents[3] / "examples" / "paper-tables.toml"


def test_the_synthetic_table_1_has_the_papers_tests_and_only_noise_at_the_truth() -> None:
    tests = table1("demo", 5.0, seed=1)
    assert len(tests) == 20
    assert sum(len(test.u_m) for test in tests) == 41_665
    assert {(test.nominal_current_A, test.frequency_Hz) for test in tests} == {
        (current, frequency) for current in (0.0, 0.5, 1.0, 1.5, 2.0) for frequency in (0.5, 1.0, 1.5, 2.0)
    }
    p = parameter_set("demo").values
    test = next(each for each in tests if (each.nominal_current_A, each.frequency_Hz) == (1.5, 2.0))
    viscous = np.where(test.v_m_s >= 0.0, p["Ca_plus"] + 1.5 * p["Cb_plus"], p["Ca_minus"] + 1.5 * p["Cb_minus"])
    hysteretic = (p["Fya"] + 1.5 * p["Fyb"]) * np.tanh(p["beta"] * test.v_m_s + p["delta"] * np.sign(test.u_m))
    force = p["m"] * test.a_m_s2 + viscous * test.v_m_s + (p["Ka"] + 1.5 * p["Kb"]) * test.u_m + hysteretic + p["F0"]
    noise = test.force_N - force
    assert np.std(noise) == pytest.approx(5.0, rel=0.1)
    assert abs(np.mean(noise)) < 0.6


def test_the_example_study_asks_for_every_table_of_both_papers() -> None:
    study = load_study(EXAMPLE)
    assert study.symmetry is not None
    assert study.sensitivity is not None
    assert study.parallel is not None
    assert study.current is not None
    assert {"ga", "de", "pso", "i_abc", "foa", "c_foa"} <= set(study.comparison.methods)
    assert study.comparison.populations == (50, 100, 150)
    assert study.comparison.budgets == (4000, 8000, 16_000)
    cells = all_cells(study)
    assert len({cell.key for cell in cells}) == len(cells)
    assert [cell.repeat for cell in cells] == sorted(cell.repeat for cell in cells)


def test_every_search_has_a_seed_of_its_own_that_stays() -> None:
    cells = [SearchCell("asymmetric", "pso", 50, 4000, repeat) for repeat in range(30)]
    assert len({cell.seed(1) for cell in cells}) == 30
    assert cells[0].seed(1) == SearchCell("asymmetric", "pso", 50, 4000, 0).seed(1) != cells[0].seed(2)


def test_budgets_share_a_search_unless_the_method_plans_with_its_budget() -> None:
    def planned(method: str) -> list[SearchCell]:
        return searches([SearchCell("asymmetric", method, 50, budget, 0) for budget in (4000, 16_000, 8000)], ())

    assert [(cell.budget, cell.marks) for cell in planned("pso")] == [(16_000, (4000, 8000))]
    assert [(cell.budget, cell.marks) for cell in planned("ga")] == [(16_000, ()), (8000, ()), (4000, ())]
    assert len({cell.seed(1) for cell in planned("ga")}) == 3


def test_a_budget_of_a_shared_search_has_the_value_of_a_search_of_its_own(small_study: Path) -> None:
    bench = Workbench(load_study(small_study))
    whole = bench.run(SearchCell("asymmetric", "c_foa", 8, 120, 0, marks=(60,)))
    alone = bench.run(SearchCell("asymmetric", "c_foa", 8, 60, 0))
    (shorter,) = shorter_lines(whole)
    kept = ("key", "value", "parameters", "budget", "evaluations", "population", "repeat", "settings")
    assert {name: shorter[name] for name in kept} == {name: alone[name] for name in kept}


def test_only_the_missing_budget_is_searched_again() -> None:
    cells = [SearchCell("asymmetric", "pso", 50, budget, 0) for budget in (4000, 8000, 16_000)]
    assert [cell.budget for cell in searches(cells, {cells[0].key, cells[1].key})] == [16_000]
    assert searches(cells, {cell.key for cell in cells}) == []


@pytest.mark.nightly
def test_a_study_writes_every_table_and_a_second_session_runs_nothing(small_study: Path, tmp_path: Path) -> None:
    seen: list[StudyProgress] = []
    outcome = run_study(small_study, tmp_path / "out", processes=2, report=seen.append)
    total = len(searches(all_cells(load_study(small_study)), ()))
    assert (seen[0].done, seen[-1].done, seen[-1].total) == (0, total, total)
    assert [progress.seconds_left for progress in seen if progress.last][-1] == pytest.approx(0.0)
    assert seen[-1].doing == "writing tables and figures"
    names = {table.name for table in outcome.tables}
    assert {f"table-{n:02d}" for n in (1, 2, 3, 4, 5, 7, 8, 9, 11, 12, 14)} <= names
    assert {"paper2-figure-13", "paper2-table-02", "paper2-relations-ga_novel"} <= names

    again: list[StudyProgress] = []
    second = run_study(small_study, tmp_path / "out", processes=2, report=again.append)
    assert [(progress.done, progress.last) for progress in again] == [(total, ""), (total, "")]
    assert second.tables == outcome.tables

    lines = [json.loads(line) for line in (tmp_path / "out" / "results.jsonl").read_text().splitlines()[1:]]
    of_de = [line for line in lines if (line["method"], line["population"], line["budget"]) == ("de", 8, 120)]
    values = {120: [line["value"] for line in of_de], 60: [line["marks"]["60"]["value"] for line in of_de]}
    with (tmp_path / "out" / "tables" / "table-11.csv").open() as file:
        rows = {row["Differential Evolution"]: row for row in csv.DictReader(file)}
    for budget, found in values.items():
        row = rows[f"N=8, fun_evals={budget}"]
        assert float(row["BV"]) == min(found)
        assert float(row["MV"]) == pytest.approx(np.mean(found))
        assert float(row["SD"]) == pytest.approx(np.std(found, ddof=1))

    message = {finding["slug"]: finding for finding in outcome.facts["findings"]}
    assert {"best-methods", "search-error", "asymmetric-model", "sensitivity-N"} <= message.keys()
    assert all(one["verdict"] in {"holds", "does not hold", "cannot be told"} for one in message.values())
    best = next(table for table in outcome.tables if table.name == "table-02")
    (of_pso,) = (row for row in best.rows if "Swarm" in str(row[0]))
    assert of_pso[-3:] == (3.39e7, 5.44e7, 1.40e7)  # as Table 2 prints them
    tuned = next(test for name, test in outcome.kruskal_wallis.items() if name.startswith("best-tuned"))
    assert tuned is not None
    assert len(tuned.pairs) == 3
    page = outcome.page.read_text()
    assert page.index('id="findings"') < page.index('id="table-01"')
    assert all(f'id="figure-{name}"' in page for name in ("04", "05", "08-pair", "10", "11"))
    assert "Kruskal-Wallis" in page
    assert page.count("<svg") == 13
    assert all(f'<h2 id="{section}">' in page for section in ("made", "cite"))
    assert all(f'class="lead">{word}' in page for word in ("Written ", "The recordings are synthetic"))
    assert "doi 10.1177/1687814020950546" in page
    assert "keep_every = 40" in page  # the study file itself
    assert outcome.facts["made"]["seed"] == 3
    assert outcome.facts["made"]["searched_with"] == [SOFTWARE]
    parameters = next(table for table in outcome.tables if table.name == "table-05")
    of_preload = {column: row[2:] for column in ("F0",) for row in parameters.rows if row[1] == column}["F0"]
    assert of_preload[-3:] == (-270.0, -275.0, -201.0)  # truth, then Table 5's fits of c-FOA and PSO
    plain = json.loads((tmp_path / "out" / "study.json").read_text())
    assert plain["kruskal_wallis"]["all settings"]["p"] <= 1.0
    assert len(plain["kruskal_wallis"]["all settings"]["mean_ranks"]) == 3 * 2 * 2
    assert "not independent" in plain["kruskal_wallis"]["all settings"]["note"]  # two repeats for two budgets


@pytest.mark.nightly
def test_a_study_goes_on_after_a_torn_last_line(small_study: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    whole = run_study(small_study, out, processes=1)
    results = out / "results.jsonl"
    lines = results.read_bytes().splitlines(keepends=True)
    results.write_bytes(b"".join(lines[:-2]) + lines[-2][: len(lines[-2]) // 2])
    seen: list[StudyProgress] = []
    again = run_study(small_study, out, processes=1, report=seen.append)
    assert seen[0].total - seen[0].done == 2
    assert again.tables[1].rows == whole.tables[1].rows


def test_results_of_other_recordings_are_not_mixed_in(small_study: Path, tmp_path: Path) -> None:
    study = load_study(small_study)
    with ResultsFile(tmp_path / "results.jsonl", Workbench(study).fingerprint):
        pass
    small_study.write_text(small_study.read_text().replace('noise = "5 N"', 'noise = "6 N"'))
    with pytest.raises(FileProblem, match="belong to other recordings or settings"):
        ResultsFile(tmp_path / "results.jsonl", Workbench(load_study(small_study)).fingerprint)


@pytest.mark.parametrize(
    "changed", [{"a_m_s2": np.zeros(2084)}, {"dt_s": 0.003}, {"samples_per_cycle": 3}, {"usable": np.arange(2084) > 0}]
)
def test_whatever_the_objective_sees_is_in_the_hash_of_the_recordings(changed: dict[str, Any]) -> None:
    tests = table1("demo", 5.0, seed=1)
    number = next(k for k, each in enumerate(tests) if each.u_m.size >= 2084)
    shortened = {name: values[:2084] for name, values in vars(tests[number]).items() if isinstance(values, np.ndarray)}
    one = replace(tests[number], **shortened)
    assert content_hash([one]) != content_hash([replace(one, **changed)])


def test_raising_the_repeats_keeps_what_is_there(small_study: Path) -> None:
    before = load_study(small_study)
    small_study.write_text(small_study.read_text().replace("repeats = 2", "repeats = 5"))
    after = load_study(small_study)
    assert before.fingerprint == after.fingerprint
    assert {cell.key for cell in all_cells(before)} < {cell.key for cell in all_cells(after)}


@pytest.mark.nightly
def test_table_6_holds_time_speed_up_and_efficiency_of_serial_and_parallel_computing(
    small_study: Path, tmp_path: Path
) -> None:
    text = small_study.read_text()
    timing = '[parallel]\nmodels = ["asymmetric"]\npopulation = 8\nevaluations = 40\nprocesses = [1, 2]\n'
    small_study.write_text(text[: text.index("[symmetry]")] + timing)
    outcome = run_study(small_study, tmp_path / "out", processes=1)
    table = next(table for table in outcome.tables if table.name == "table-06")
    assert table.columns[2:] == ("serial computing", "parallel computing with 2 processes")
    seconds, speed_up, efficiency, printed = (row[2:] for row in table.rows)
    assert printed == (201.0, 154.0)
    assert min(seconds) > 0.0
    assert speed_up == (1.0, pytest.approx(seconds[0] / seconds[1]))
    assert efficiency == (1.0, pytest.approx(speed_up[1] / 2.0))
    again = run_study(small_study, tmp_path / "out", processes=1)  # timed once: the table stays
    assert next(table for table in again.tables if table.name == "table-06") == table


def test_what_separable_least_squares_reaches_is_the_noise_and_no_search_is_below_it(small_study: Path) -> None:
    bench = Workbench(load_study(small_study))
    lowest = bench.minimum("asymmetric")
    assert lowest is not None
    v = np.concatenate([test.v_m_s for test in bench.tests])
    expected, deviation = 25.0 * np.sum(v**2), 25.0 * np.sqrt(2.0 * np.sum(v**4))  # of sum((e v)^2), e 5 N of noise
    assert lowest == pytest.approx(expected, abs=4.0 * deviation)
    found = bench.run(SearchCell("asymmetric", "pso", 50, 4000, 0))
    assert found["value"] >= lowest
    assert bench.minimum("bouc_wen") is None


def test_three_steps_find_the_bouc_wen_plant_at_every_current(small_study: Path) -> None:
    study = load_study(small_study)
    bench = Workbench(study)
    z0 = (BOUC_WEN_TRUTH["A"] / (BOUC_WEN_TRUTH["beta"] + BOUC_WEN_TRUTH["gamma"])) ** (1.0 / BOUC_WEN_TRUTH["n"])
    for current_A in (0.0, 0.5, 1.0):
        line = bench.run(SearchCell(f"current:{current_A:g}", "zhu_three_step", 6, 24, 0))
        alpha = BOUC_WEN_TRUTH["alpha"] + BOUC_WEN_TRUTH["alpha_b"] * current_A
        assert line["parameters"]["kw"] == pytest.approx(alpha * z0, rel=0.02)
        assert line["parameters"]["kx"] == pytest.approx(BOUC_WEN_TRUTH["k0"], rel=0.02)
        assert line["parameters"]["f0"] == pytest.approx(-BOUC_WEN_TRUTH["k0"] * BOUC_WEN_TRUTH["x0"], rel=0.05)
        assert line["rmse_N"] < 4.0


def test_paper_2s_fitness_at_the_truth_is_the_noise_over_the_forces_variance(small_study: Path) -> None:
    from rig.study.workbench import current_objective

    study = load_study(small_study)
    assert study.current is not None
    test = bouc_wen([1.0], 5.0, seed=1)[0]
    objective = current_objective(test, study.current)
    truth = {**BOUC_WEN_TRUTH, "c0": 1200.0, "alpha": 80_000.0}
    value = objective.batch(np.array([[truth[name] for name in objective.names]]))[0]
    assert value == pytest.approx(25.0 / np.var(test.force_N), rel=0.1)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"de", "pso"', '"de", "psso"', r"comparison\.methods\[2\]"),
        ("populations = [8, 12]\nbudgets", "populations = [2]\nbudgets", r"comparison\.populations\[1\]"),
        ('noise = "5 N"', "noise = 5", "noise"),
        ('simulate = "table1"\n', "", 'expected either simulate = "table1" or runs'),
        ("[symmetry]", '[comparision]\nx = 1\n[symmetry]', "comparision"),
        ('simulate = "table1"\n', 'simulate = "table1"\ntruth = "dem"\n', "expected one of .*demo"),
        ("[comparison]\n", '[comparison]\nmodels = ["asymetric"]\n', "expected one of .*asymmetric"),
    ],
)  # fmt: skip
def test_a_wrong_study_file_is_refused_with_line_and_key(small_study: Path, old: str, new: str, message: str) -> None:
    small_study.write_text(small_study.read_text().replace(old, new, 1))
    with pytest.raises(FileProblem, match=message) as refusal:
        load_study(small_study)
    assert "line " in str(refusal.value)


def test_results_from_other_boxes_or_ranges_are_not_mixed_in(
    small_study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small_study.write_text(small_study.read_text().replace("[comparison]", '[comparison]\nbounds = "model"'))
    study = load_study(small_study)
    before = study.fingerprint
    wider = {**CURRENT_BOXES, "bouc_wen": {**CURRENT_BOXES["bouc_wen"], "n": (1.0, 9.0)}}
    with monkeypatch.context() as built_in:
        built_in.setattr("rig.study.study_file.CURRENT_BOXES", wider)
        assert study.fingerprint != before
    with monkeypatch.context() as built_in:
        built_in.setattr("rig.study.study_file.MODELS", {"kwok": model("kwok")})
        assert study.fingerprint != before
    assert load_study(small_study).fingerprint == before


def test_a_box_that_does_not_hold_the_start_is_refused_when_the_file_is_read(small_study: Path) -> None:
    more = '[comparison]\nmodels = ["viscoelastic_plastic"]\nbounds = "model"'
    text = small_study.read_text().replace("[comparison]", more)
    small_study.write_text(text)
    with pytest.raises(FileProblem, match=r"comparison\.bounds = .*k2 of viscoelastic_plastic ranges from 100 to"):
        load_study(small_study)
    small_study.write_text(text.replace('bounds = "model"', 'bounds = "model"\nstart = "none"'))
    assert load_study(small_study).comparison.bounds == "model"
