"""What is said of the papers is true of the numbers: verdicts and sentences from results made up for the purpose."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import pytest

from rig.study.claim import Claim, rank_test
from rig.study.findings import findings
from rig.study.paper2_findings import paper2_findings
from rig.study.parallel_timing import parallel_key
from rig.study.printed_values import FITS
from rig.study.provenance import CITE_SOFTWARE
from rig.study.search_cell import all_cells, current_cells
from rig.study.settings import best_lines
from rig.study.study_file import Parallel, StudyFile, load_study

ROOT = Path(__file__).parents[3]


Results = dict[str, dict[str, Any]]


def line(value: float, **more: object) -> dict[str, Any]:
    """A result of a search that ended at a value."""
    return {"value": value, "parameters": {}, "history": [[1, value]], **more}


def claims_of(study: StudyFile, results: Results, minima: dict[str, float] | None = None) -> dict[str, Claim]:
    """Findings about paper 1 by slug."""
    of_paper_1 = study.model_copy(update={"current": None})
    return {claim.slug: claim for claim in findings(of_paper_1, results, minima or {}, {})}


@pytest.mark.parametrize(
    ("seconds", "verdict", "gains"), [((1.0, 0.5), "holds", True), ((0.1, 0.2), "does not hold", False)]
)
def test_parallel_computing_is_reported_to_gain_nothing_only_where_it_gains_nothing(
    small_study: Path, seconds: tuple[float, float], verdict: str, gains: bool
) -> None:
    timing = Parallel(models=("asymmetric", "bouc_wen"), processes=(1, 2), evaluations=1000)
    study = load_study(small_study).model_copy(update={"parallel": timing})
    results = {
        parallel_key(timing, model, count): {"seconds": factor * seconds[count - 1]}
        for model, factor in (("asymmetric", 1.0), ("bouc_wen", 10.0)) for count in (1, 2)
    }  # fmt: skip
    claim = claims_of(study, results)["parallel"]
    assert claim.verdict == verdict
    assert f"asymmetric {seconds[0]:g} s on 1, {seconds[1]:g} s on 2" in claim.text
    assert f"takes {1e3 * seconds[0]:,.0f} microseconds" in claim.text
    assert ("For asymmetric, sending candidates takes longer" not in claim.text) == gains
    assert ("For bouc_wen, evaluating candidates takes longer than sending them" not in claim.text) == gains


def test_a_resolution_that_does_not_differ_by_rank_is_not_reported_to_be_worse(small_study: Path) -> None:
    text = small_study.read_text().replace("resolutions = [100, 10]", "resolutions = [100, 10, 1000]")
    small_study.write_text(text.replace("repeats = 2", "repeats = 9"))
    study = load_study(small_study)

    def results(of_coarse: float) -> Results:
        worse = {cell.key: of_coarse * (cell.settings.get("resolution") == 10) for cell in all_cells(study)}
        return {key: line(100.0 + more + number % 7) for number, (key, more) in enumerate(worse.items())}

    assert claims_of(study, results(0.0))["sensitivity-Nres"].verdict == "cannot be told"
    assert claims_of(study, results(50.0))["sensitivity-Nres"].verdict == "holds"


def test_foa_that_finds_the_minimum_is_not_reported_to_fail(small_study: Path) -> None:
    small_study.write_text(small_study.read_text().replace('"de", "pso", "c_foa"', '"foa", "c_foa printed"'))
    study = load_study(small_study)
    low = {cell.key: line(1.2) for cell in all_cells(study)}
    high = {cell.key: line(500.0) for cell in all_cells(study)}
    for results, of_foa, of_printed in ((low, "does not hold", "holds"), (high, "holds", "does not hold")):
        claims = claims_of(study, results, {"asymmetric": 1.0})
        assert (claims["foa-fails"].verdict, claims["printed-c-foa"].verdict) == (of_foa, of_printed)
        assert ("never negative" in claims["foa-fails"].text) == (of_foa == "holds")
        assert ("-270 N" in claims["printed-c-foa"].text) == (of_printed == "does not hold")


def test_paper_2s_improvement_counts_the_currents_and_names_its_direction(small_study: Path) -> None:
    small_study.write_text(small_study.read_text().replace('["ga_novel", ', '["ga_standard", "ga_novel", '))
    study = load_study(small_study)
    errors = {"ga_standard": 10.0, "ga_novel": 12.0, "zhu_three_step": 3.0}
    results = {
        cell.key: line(
            1.0, mae_N=errors[cell.method] - 5.0 * (cell.method == "ga_novel" and cell.current_A == 0.5), generations=7,
            stopped_by="statistics", method=cell.method, parameters={"c0": cell.current_A, "k0": cell.current_A**2},
        )
        for cell in current_cells(study)
    }  # fmt: skip
    claims = {claim.slug: claim for claim in paper2_findings(study, results)}
    assert claims["novel-ga"].verdict == "does not hold"
    assert re.search(r"3\.33 % .*\b1 of 3 currents", claims["novel-ga"].text)
    assert claims["novel-ga-speed"].verdict == "cannot be told"  # the same generations
    assert claims["three-steps"].verdict == "does not hold"
    assert "1 of 2 parameters" in claims["linear-in-current"].text
    assert "(c0)" in claims["linear-in-current"].text


def test_the_best_line_of_a_method_is_the_lowest_over_all_its_settings(small_study: Path) -> None:
    study = load_study(small_study)
    cells = [cell for cell in all_cells(study) if cell.method == "pso"]
    results = {cell.key: line(100.0 - number) for number, cell in enumerate(cells)}
    assert best_lines(study, results)["pso"]["value"] == 101.0 - len(cells)


def test_generations_of_searches_that_the_budget_ended_show_no_convergence(small_study: Path) -> None:
    both = small_study.read_text().replace('["ga_novel", ', '["ga_standard", "ga_novel", ')
    small_study.write_text(both.replace("repeats = 1", "repeats = 3"))
    study = load_study(small_study)

    def claim(stopped_by: str) -> Claim:
        results = {
            cell.key: line(
                1.0, mae_N=1.0, generations=7 if cell.method == "ga_novel" else 9, stopped_by=stopped_by,
                method=cell.method, parameters={"c0": cell.current_A},
            )
            for cell in current_cells(study)
        }  # fmt: skip
        return {one.slug: one for one in paper2_findings(study, results)}["novel-ga-speed"]

    assert claim("statistics").verdict == "holds"
    assert claim("budget").verdict == "cannot be told"
    assert "does not show convergence" in claim("budget").text


def test_the_rank_test_of_two_groups_is_kruskal_wallis() -> None:
    # mean ranks 4 and 11: H = 12 / 210 * 7 * (16 + 121) - 45
    statistic = 12.0 / 210.0 * 7.0 * (16.0 + 121.0) - 45.0
    low, high = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0], [8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0]
    assert rank_test(low, high) == pytest.approx(math.erfc(math.sqrt(statistic / 2.0)))
    assert rank_test(low[:3], high[:3]) == pytest.approx(2.0 / 20.0)  # no order of 3 and 3 is rarer
    assert rank_test([1.0, 1.0], [1.0, 1.0]) == rank_test([1.0], [2.0, 3.0]) == 1.0


def test_printed_objectives_are_those_above_each_tables_own_fits() -> None:
    assert {method: value for method, (_, value) in FITS[5].items()} == {"c_foa": 3.42e7, "ga": 4.14e7, "pso": 3.96e7}
    assert FITS[4]["c_foa"] == ("cfoa-table4", 3.40e7)


def test_the_citation_is_that_of_the_citation_file() -> None:
    reported = (ROOT / "CITATION.cff").read_text()
    title = next(row for row in reported.splitlines() if row.startswith("title:")).partition('"')[2].strip('"')
    assert title in CITE_SOFTWARE
