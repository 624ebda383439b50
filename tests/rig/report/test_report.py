from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rig.dampers
import rig.identification
from rig.characteristics import characterise
from rig.characteristics.loop import characterise_loop
from rig.cli.analyst import _reported, evaluate
from rig.errors import EXIT_USAGE, FileProblem
from rig.identification.points.preparation import prepare_all
from rig.identification.uncertainty.scoring import cycle_energy_J
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.layout import AlignedChannel, PointFile
from rig.recording.run import Run
from rig.report import write_report
from rig.report.document import views_of
from rig.report.pdf import write_pdf

TRUE = rig.dampers.parameter_set("demo").values
LARGEST_BYTES = 1_500_000


def record(
    folder: Path, name: str, frequency_Hz: float, current_A: float, *, verdict: str = "valid", late_s: float = 0.0,
    **quality: object,
) -> None:
    """A point of the demo damper, 6 cycles between two rests, as the finaliser writes it; its force `late_s` late."""
    time_s = np.arange(round((6 / frequency_Hz + 0.4) * 250)) / 250.0
    phase = 2 * np.pi * frequency_Hz * np.clip(time_s - 0.2, 0.0, 6 / frequency_Hz)
    moving = (phase > 0) & (phase < 12 * np.pi)
    u, w = 0.02 * np.sin(phase), 2 * np.pi * frequency_Hz
    v, a = 0.02 * w * np.cos(phase) * moving, -(w**2) * u
    force = rig.dampers.model("asymmetric").force(TRUE, u, v, a, np.full(len(u), current_A), 0.004)
    force = np.interp(time_s - late_s, time_s, force)
    write_file(folder / "points" / f"{name}.h5", PointFile(
        time_s, 250.0,
        [AlignedChannel("displacement", u, "m", "Damper extension"), AlignedChannel("force", force, "N", "Force"),
         AlignedChannel("current", np.full(len(u), current_A), "A", "Current")],
        test={"id": name, "waveform": "sine", "amplitude_m": 0.02, "frequency_Hz": frequency_Hz,
              "current_A": current_A, "mid_stroke_m": 0.0},
        quality={"verdict": verdict, "reasons": ("estop: <stopped> & held",) if verdict == "invalid" else (),
                 **quality},
        provenance={"bench": "a bench", "specimen": "MR-<001>"},
    ))


def fit_of(**changes: object) -> dict[str, Any]:
    model = rig.dampers.model("asymmetric")
    parameters = {
        name: {"value": value, "unit": model.parameter(name).unit, "low": value - 1.0, "high": value + 1.0,
               "identifiable": name != "eta"} for name, value in TRUE.items()
    }
    parameters["eta"] |= {"low": None, "high": None, "reason": "the current was constant in every test"}
    per_test = [{"id": "p001", "file": "", "rmse_N": 1.0, "nrmse_percent_of_peak": 0.321}]
    return {
        "model": "asymmetric", "method": "separable", "hysteresis": "kwok", "parameters": parameters,
        "error": {"rmse_N": 1.0, "mae_N": 0.8, "nrmse_percent_of_peak": 0.3, "per_test": per_test, "holdout": None},
        "selection": [], "adequate": True, "warnings": [], "evaluations": 10, "wall_s": 0.1, **changes,
    }


def recorded(parent: Path) -> Path:
    folder = parent / "20260101T000000Z-MR-001-abcd"
    (folder / "points").mkdir(parents=True)
    record(folder, "p001", 1.0, 0.0)
    record(folder, "p002", 2.0, 0.5)
    record(folder, "p003", 1.0, 0.5, verdict="invalid")
    return folder


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return recorded(tmp_path)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The report of the fit that is the truth, with a warning that is markup."""
    return written(recorded(tmp_path_factory.mktemp("once")), fit_of(warnings=["<script>alert(1)</script>"]))


def written(run: Path, fit: Mapping[str, Any] | None) -> str:
    if fit is not None:
        (run / "fit.json").write_text(json.dumps(fit))
    return write_report(run).read_text(encoding="utf-8")


def lines(page: str, style: str) -> list[np.ndarray]:
    """The points (k, 2) of each drawn line of one style."""
    found = re.findall(rf'<path class="{style}"[^>]* d="([^"]*)"', page)
    numbers = [[re.findall(r"-?(?:\d+\.?\d*|\.\d+)", piece) for piece in d.split("M")[1:]] for d in found]
    return [np.vstack([np.array(one, float).reshape(-1, 2).cumsum(axis=0) for one in pieces]) for pieces in numbers]


def test_the_fitted_loops_lie_on_the_measured_ones_when_the_fit_is_the_truth(page: str) -> None:
    cards = page[page.index("Loops for all points</h2>"):page.index("Time traces</h2>")]
    measured, fitted = lines(cards, "m"), lines(cards, "p")
    assert len(measured) == len(fitted) == 4
    for one, other in zip(measured, fitted, strict=True):
        assert np.quantile(np.abs(one - other), 0.98) < 1.0


def test_a_wrong_fit_is_seen_beside_the_measured_loops(run: Path) -> None:
    fit = fit_of()
    fit["parameters"]["Fyb"]["value"] = 900.0
    page = written(run, fit)
    cards = page[page.index("<h3>0.5 A</h3>"):]
    distance = np.max(np.abs(lines(cards, "m")[0] - lines(cards, "p")[0]))
    assert distance > 30.0


def test_verdict_forces_loops_and_conditions_come_first_then_the_model_then_the_appendix(page: str) -> None:
    headings = re.findall(r"<h2[^>]*>([^<]*)</h2>", page)
    order = ["Forces and peak-velocity plot (PVP)", "Force loops", "Specimen and test conditions", "Model", "Appendix",
             "Test points", "Quality of the fit", "Loops for all points", "Time traces", "Standard damper tests",
             "Provenance"]
    assert headings == order
    forces = page[page.index("Forces and peak-velocity plot (PVP)</h2>"):page.index("Force loops</h2>")]
    for name in ("rebound", "compression"):
        (fact,) = re.findall(rf">([^<>]+) N<[^>]*>\s*(?:<[^>]*>\s*)*greatest {name} force at peak velocity", page)
        assert f">{fact}</td>" in forces, "the table shows the same number"
    assert page.index(">Model fits<") < page.index("Forces and peak-velocity plot (PVP)</h2>")
    links = re.findall(r'<a href="#([^"]*)"', page)
    assert re.findall(r'<h2 id="([^"]*)"', page) == links


def test_a_real_fit_shows_quality_profiles_and_the_next_test(run: Path) -> None:
    rig.identification.identify_run([run], profile=["beta"])
    page = write_report(run).read_text(encoding="utf-8")
    quality = page[page.index("Quality of the fit</h2>"):page.index("Loops for all points</h2>")]
    assert quality.count("p002") == 1
    assert "passive</span>" in quality
    assert "Correlation between parameters" in quality
    profiles = page[page.index("Profile likelihoods"):page.index("<h3>Measured and fitted loops")]
    assert len(lines(profiles, "m")) == 1
    assert len(lines(profiles, "e")[0]) == 2
    assert "[[point]]" in page[page.index("Proposed next tests"):]


def test_many_warnings_are_folded_and_none_is_lost(run: Path) -> None:
    page = written(run, fit_of(warnings=[f"warning number {k}" for k in range(9)]))
    assert "Further warnings: 4" in page
    assert all(f"warning number {k}<" in page for k in range(9))


def test_verdicts_reasons_and_errors_of_every_point_are_in_the_table(page: str) -> None:
    assert page.count('class="chip good"') >= 4
    assert '<span class="chip poor">invalid</span>' in page
    assert "estop: &lt;stopped&gt; &amp; held" in page
    assert "0.321" in page
    assert "2 of 3" in page


def test_what_cannot_be_identified_stands_apart_with_its_reason(page: str) -> None:
    apart = page[page.index("Not identifiable"):]
    assert "eta" in apart
    assert "the current was constant in every test" in apart
    assert "the coil" in apart or "lag" in apart


def test_an_inadequate_model_and_warnings_come_first(run: Path) -> None:
    page = written(run, fit_of(adequate=False, warnings=["one frequency only"]))
    assert page.index(">Model does not fit<") < page.index("peak-velocity plot")
    assert page.index("The model does not fit") < page.index("Fitted parameters")
    assert page.index("one frequency only") < page.index("Fitted parameters")


def test_unseen_tests_beyond_the_fitted_data_are_marked_with_what_lay_beyond(run: Path) -> None:
    fit = fit_of()
    apart = {"id": "p002", "file": "", "rmse_N": 5.0, "nrmse_percent_of_peak": 45.6, "energy_J": 1.0,
             "beyond": ["current_A", "velocity_m_s"]}  # fmt: skip
    other = apart | {"id": "p009", "beyond": [], "nrmse_percent_of_peak": 3.21}
    fit["error"]["holdout"] = {"rmse_N": 5.0, "mae_N": 4.0, "nrmse_percent_of_peak": 45.6, "per_test": [apart, other]}
    score = {"bic": 1.0, "reason": "", "beyond": {"p002": ["current_A"]}}
    fit["selection"] = [
        score | {"model": "kwok", "holdout_nrmse_percent_of_peak": 77.7, "within_nrmse_percent_of_peak": 3.21},
        score | {"model": "bingham", "holdout_nrmse_percent_of_peak": 66.6, "within_nrmse_percent_of_peak": 4.32},
    ]
    page = written(run, fit)
    assert "error on validation tests; 3.21 % without the 1 of 2 tests outside the fitted data" in page
    assert "validation, outside the fitted data: current, velocity" in page
    assert "Validation tests outside the fitted data (extrapolated): p002 (current)." in page
    assert "Excluding extrapolated tests" in page
    assert page.index(">3.21<") < page.index(">4.32<")
    fit["error"]["holdout"] |= {"per_test": [apart]}
    assert "all outside the fitted data (extrapolated)" in written(run, fit)


def test_held_out_tests_are_scored_apart(run: Path) -> None:
    fit = fit_of()
    apart = {"id": "p002", "file": "", "rmse_N": 5.0, "nrmse_percent_of_peak": 4.56}
    fit["error"]["holdout"] = {"rmse_N": 5.0, "mae_N": 4.0, "nrmse_percent_of_peak": 4.56, "per_test": [apart]}
    page = written(run, fit)
    assert "error on validation tests" in page
    assert "<td>validation</td>" in page
    assert '<span class="chip plain">validation</span>' in page


def test_a_run_without_a_fit_is_reported_as_measured(run: Path) -> None:
    page = written(run, None)
    assert "This run has no fit" in page
    assert lines(page, "p") == []
    assert len(lines(page, "m")) > 3


def test_a_model_is_unknown_leaves_the_measured_loops(run: Path) -> None:
    page = written(run, fit_of(model="miracle"))
    assert "curves are not drawn" in page
    assert lines(page, "p") == []


def test_the_page_is_one_small_file_that_loads_nothing(page: str) -> None:
    assert len(page) < LARGEST_BYTES
    assert not re.search(r"<script|<link|<img|<iframe|@import|url\(|src=|href=\"[^#]", page)
    assert "http" not in page


def test_the_page_is_well_formed_and_every_chart_has_a_text_alternative(page: str) -> None:
    for svg in re.findall(r"<svg.*?</svg>", page):
        assert ElementTree.fromstring(svg).attrib["aria-label"]

    class Balanced(HTMLParser):
        def __init__(self) -> None:
            super().__init__()
            self.open: list[str] = []

        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            if tag not in {"meta", "br"}:
                self.open.append(tag)

        def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            return

        def handle_endtag(self, tag: str) -> None:
            assert self.open.pop() == tag

    parser = Balanced()
    parser.feed(page)
    assert parser.open == []


def test_text_from_files_cannot_become_markup(page: str) -> None:
    assert "<script>" not in page
    assert "MR-&lt;001&gt;" in page


def test_a_report_stands_beside_its_run_and_what_is_no_run_is_refused(run: Path, tmp_path: Path) -> None:
    assert write_report(run) == run / "report.html"
    with pytest.raises(FileProblem, match="nowhere") as refused:
        write_report(tmp_path / "nowhere")
    assert refused.value.exit_code == EXIT_USAGE


@pytest.mark.parametrize("content", ["{", "[]", '{"model": "asymmetric"}'])
def test_a_damaged_fit_is_refused_by_name(run: Path, content: str) -> None:
    (run / "fit.json").write_text(content)
    with pytest.raises(FileProblem, match=r"fit\.json"):
        write_report(run)


def test_report_and_characteristics_use_the_skew_that_the_campaign_as_a_whole_knows(run: Path) -> None:
    late_s = 0.004
    seen = {"force_matched_lag_s": late_s, "force_matched_lag_std_s": 5e-5, "force_undeclared_delay_s": 0.0,
            "displacement_matched_lag_s": 0.0, "displacement_matched_lag_std_s": 5e-5,
            "displacement_undeclared_delay_s": 0.0, "force_tie_std_s": 1e-6, "displacement_tie_std_s": 1e-6,
            "force_declared_delay_s": 2e-4, "displacement_declared_delay_s": 2e-4}
    for name, frequency_Hz, current_A in (("p001", 1.0, 0.0), ("p002", 2.0, 0.5)):
        (run / "points" / f"{name}.h5").unlink()
        record(run, name, frequency_Hz, current_A, late_s=late_s, **seen)
    points = [point for point in Run.open(run).points if point.verdict == "valid"]
    fitted, _ = prepare_all(points)
    views, _ = views_of(Run.open(run), None)
    drawn = {view.point.id: view.measured for view in views}
    for each in fitted:
        shown = drawn[each.id]
        assert shown is not None
        np.testing.assert_allclose(shown.u_m, each.u_m, atol=1e-12)
    skewless, pooled = characterise_loop(points[0]), characterise(Run.open(run)).loops[0]
    exact_J = cycle_energy_J(fitted[0], fitted[0].force_N)
    assert pooled.energy_J.value == pytest.approx(exact_J, rel=1e-9)
    assert abs(skewless.energy_J.value / exact_J - 1.0) > 1e-5


def test_a_report_that_cannot_be_written_costs_no_fit_and_says_why_under_its_own_key(run: Path) -> None:
    (run / "report.html").mkdir()
    answer = evaluate(run, {"model": "asymmetric"})
    report, report_error = _reported(run)
    assert answer["error"] is None
    assert Path(answer["fit"]) == (run / "fit.json").resolve()
    assert report is None
    assert report_error is not None
    assert "report.html" in report_error


def test_a_quality_that_is_no_number_counts_as_not_measured(run: Path) -> None:
    (run / "points" / "p001.h5").unlink()
    record(run, "p001", 1.0, 0.0, force_span_N="wide")
    assert write_report(run).is_file()


def test_a_campaign_without_a_finished_point_counts_its_planned_points_and_names_the_simulated_rig(
    tmp_path: Path,
) -> None:
    """The terminal reports the same numbers."""
    (tmp_path / "points").mkdir()
    record(tmp_path, "p001-out-of-tolerance1", 1.0, 0.0, verdict="invalid")
    (tmp_path / "campaign.json").write_text(json.dumps({"points": ["p001", "p002"], "simulated": {"speed": 5.0}}))
    text = re.sub(r"<[^>]+>", " ", write_report(tmp_path).read_text(encoding="utf-8"))
    assert re.search(r"0 of 2\s+points valid", text)
    assert "SIMULATED: all values come from the simulated rig" in text


def test_the_pdf_is_written_by_its_earlier_name(run: Path) -> None:
    pytest.importorskip("reportlab", reason="reportlab (extra pdf) is not installed")
    paper = write_pdf(write_report(run))
    assert paper == run / "report.pdf"
    assert paper.read_bytes().startswith(b"%PDF")
