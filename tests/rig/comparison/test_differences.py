from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from pathlib import Path

import pypdf
import pytest

from rig.cli.main import main
from rig.comparison import Comparison, compare
from rig.comparison.changes import change
from rig.comparison.readings import Reading
from rig.document.blocks import Cards, Figures
from rig.document.figure import Figure, Style
from rig.errors import RigError
from rig.report.comparison import comparison_document, comparison_page

Make = Callable[..., Path]


def test_the_change_against_the_first_run_is_shown_for_every_motion_both_have(made_run: Make, made_point: Make) -> None:
    before, after = made_run("before"), made_run("after", 900.0)
    made_point(after, "p002", 900.0, frequency_Hz=2.0)
    answer = compare([before, after]).to_json()
    first, second = answer["loops"]
    assert (first["frequency_Hz"], first["points"]) == (1.0, [["p001"], ["p001"]])
    assert first["damping"][1]["change"]["percent"] == pytest.approx(-10.0, abs=0.05)
    assert first["damping"][1]["change"]["differs"] is True
    assert first["damping"][0]["change"]["value"] == 0.0
    # jounce: -1000 v - 50 = -175.66 N before, -900 v - 50 = -163.10 N after, v = 2 pi 0.02 m/s
    assert first["jounce_force"][1]["change"]["value"] == pytest.approx(12.57, abs=0.3)
    assert first["jounce_force"][1]["change"]["percent"] == pytest.approx(-7.15, abs=0.2)
    assert (second["points"], second["energy"][0]) == ([None, ["p002"]], None)
    assert second["energy"][1]["change"] is None


def test_repeats_are_averaged_and_what_they_differ_by_is_the_uncertainty(made_run: Make, made_point: Make) -> None:
    folder = made_run("a", 990.0)
    made_point(folder, "p001-2", 1010.0)
    (loop,) = compare([folder, folder]).runs[0].loops
    reading = loop.values["damping"]
    assert loop.ids == ("p001", "p001-2")
    assert reading.value == pytest.approx(1000.0, rel=2e-3)
    assert reading.std == pytest.approx(10.0, rel=0.02)  # std of 990 and 1010 is 14.14; of their mean 10


def test_a_load_cell_that_measured_both_takes_its_calibration_out_of_the_difference() -> None:
    before, after = Reading(100.0, 0.3, 2.0), Reading(104.0, 0.4, 2.1)
    same, other = (change(before, after, same_gauge=same) for same in (True, False))
    assert (same.value, same.std, same.differs) == (pytest.approx(4.0), pytest.approx(0.5), True)
    assert other.std == pytest.approx(math.sqrt(0.25 + 4.0 + 4.41))
    assert other.differs is False
    assert change(before, Reading(104.0, math.nan), same_gauge=True).differs is None
    # three cycles each: four degrees of freedom (Welch and Satterthwaite), t = 2.776 in place of 1.960
    few = change(Reading(100.0, 1.0, freedom=2.0), Reading(103.0, 1.0, freedom=2.0), same_gauge=True)
    assert few.std == pytest.approx(math.sqrt(2.0) * 2.776 / 1.960, rel=5e-3)
    assert few.differs is False


def test_parameters_of_different_models_are_not_compared(made_run: Make, made_fit: Make) -> None:
    first, second = made_run("a"), made_run("b")
    made_fit(first)
    made_fit(second, value=550.0)
    both = compare([first, second])
    assert both.to_json()["parameters"]["Fy"][1]["change"]["percent"] == pytest.approx(10.0)
    made_fit(second, model="dahl")
    assert compare([first, second]).parameter_change(1, "Fy") is None
    assert "different models" in compare([first, second]).remarks[0]


def test_signals_are_reported_as_not_compared(made_run: Make, made_point: Make) -> None:
    first, second = made_run("a"), made_run("b")
    made_point(second, "p002", 1000.0, kind="signal")
    remark, unfitted = compare([first, second]).remarks
    assert unfitted.startswith("model parameters are not compared: none of the runs has a fit")
    assert remark.startswith("b: signals (sweep, road, file)")
    assert remark.endswith(": p002")


def test_text_says_what_differs_within_eighty_columns(made_run: Make, capsys: pytest.CaptureFixture[str]) -> None:
    before, after = made_run("before"), made_run("after", 900.0)
    assert main(["compare", str(before), str(after)]) == 0
    message = capsys.readouterr().out
    assert "first: before, specimen S-before" in message
    assert any(line.split()[:4] == ["damping", "1", "1", "-10"] for line in message.splitlines())
    from rig.cli.comparison_tables import comparison_lines

    narrow = [text for text, _ in comparison_lines(compare([before, after]), 80, everything=True)]
    assert max(map(len, narrow)) <= 80
    assert main(["compare", str(before), str(after), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["bands"] is None


def imported(made_run: Make, made_point: Make, name: str, amplitude_m: float, damping_N_s_m: float = 1000.0) -> Path:
    folder = made_run(name)
    made_point(folder, "p001", damping_N_s_m, amplitude_m=amplitude_m, imported=True)
    return folder


def test_measured_motions_that_differ_a_little_are_corrected(made_run: Make, made_point: Make) -> None:
    """12.45 and 12.55 mm had no motion in common: they were paired by numbers rounded to two digits."""
    runs = [imported(made_run, made_point, f"{mm} mm", 1e-3 * mm) for mm in (12.45, 12.55)]
    compared = compare(runs)
    (row,) = compared.to_json()["loops"]
    assert row["amplitude_m"] == 0.01245
    energy, damping = row["energy"][1]["change"], row["damping"][1]["change"]
    # as measured the energy, which a viscous damper makes with A^2, is 1.61 % larger; corrected with A^1.5
    assert energy["correction_percent"] == pytest.approx(-1.2, abs=0.02)
    assert energy["percent"] == pytest.approx(0.4, abs=0.05)
    assert damping["percent"] == pytest.approx(0.4, abs=0.05)
    assert [change["differs"] for change in (energy, damping)] == [False, False]
    assert any("corrected" in remark for remark in compared.remarks)


def test_a_change_beyond_the_correction_is_seen(made_run: Make, made_point: Make) -> None:
    runs = [imported(made_run, made_point, "a", 0.01245), imported(made_run, made_point, "b", 0.01255, 1050.0)]
    (row,) = compare(runs).to_json()["loops"]
    assert row["energy"][1]["change"]["percent"] == pytest.approx(5.4, abs=0.2)
    assert row["energy"][1]["change"]["differs"] is True


def test_measured_motions_too_far_for_a_correction_are_not_compared(made_run: Make, made_point: Make) -> None:
    """12.55 and 13.45 mm were one motion of 13 mm whose energy had changed by 8.8 +- 0.02 %."""
    runs = [imported(made_run, made_point, f"{mm} mm", 1e-3 * mm) for mm in (12.55, 13.45)]
    compared = compare(runs)
    assert [row["points"] for row in compared.to_json()["loops"]] == [[["p001"], None], [None, ["p001"]]]
    assert any("13.45 mm" in remark and "is not compared" in remark for remark in compared.remarks)


def test_two_motions_closer_than_the_tolerance_are_paired_one_to_one(made_run: Make, made_point: Make) -> None:
    """1.028 Hz had vanished: 1.012 Hz was compared with both 1.000 and 1.016 Hz."""
    runs = []
    for name, frequencies_Hz in (("a", (1.0, 1.016)), ("b", (1.012, 1.028)), ("c", (1.016, 1.032))):
        runs.append(made_run(name))
        for number in range(4):  # at two currents each: a frequency that is repeated exactly is a tested one
            made_point(runs[-1], f"p{number + 1:03}", 1000.0, frequency_Hz=frequencies_Hz[number // 2],
                       current_A=0.5 + number % 2, imported=True)  # fmt: skip
    pairs = [row["points"] for row in compare(runs[:2]).to_json()["loops"]]
    assert pairs == [[[point], [point]] for point in ("p001", "p003", "p002", "p004")]
    compared = compare([runs[0], runs[2]])  # an exact pair is not given up for two pairs at the end of the tolerance
    assert [row["points"] for row in compared.to_json()["loops"][:3]] == [
        [["p001"], None], [["p003"], ["p001"]], [None, ["p003"]],
    ]  # fmt: skip
    assert any("1.032 Hz" in remark and "compared with another motion" in remark for remark in compared.remarks)
    bands = runs[0].parent / "bands.toml"
    bands.write_text('format = 1\nname = "b"\n[[energy]]\nmost_change = "50 %"\n')
    judgement = compare([runs[0], runs[2]], bands).judgement
    assert judgement is not None
    # p003, p004 have their partners; the tests of the run at 1.032 Hz and those of the first one at 1.000 Hz have none
    assert sorted(str(result.state) for result in judgement.results).count("missing") == 4




def test_terminal_page_and_json_state_one_median(
    made_run: Make, made_point: Make, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of an even number of tests the terminal took the upper one of the middle two, the page their mean."""
    before, after = made_run("before"), made_run("after", 900.0)
    for folder, damping_N_s_m in ((before, 1000.0), (after, 960.0)):
        made_point(folder, "p002", damping_N_s_m, frequency_Hz=2.0)
    compared = compare([before, after])
    assert compared.to_json()["summary"][0]["damping"]["median_percent"] == pytest.approx(-7.0, abs=0.05)
    assert main(["compare", str(before), str(after)]) == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("damping"))
    energy = compared.to_json()["summary"][0]["energy"]["median_percent"]
    assert line.split()[3] == "-7"
    page = comparison_page(compared)
    assert f"\N{MINUS SIGN}{-energy:.3g} %" in page
    assert page.index("Force at peak velocity for all runs") < page.index("Loops of all runs")
    (figure,) = _peak_velocity_figures(compared)
    curves = [trace for trace in figure.traces if trace.style is Style.MEASURED]
    assert [len(curve.x) for curve in curves] == [2] * 4, "rebound and compression of two runs at two velocities"
    spans = [rebound.y - compression.y for rebound, compression in (curves[:2], curves[2:])]
    assert spans[1] / spans[0] == pytest.approx([0.9, 0.96], rel=2e-3), "as the dampings of the motions"


def _peak_velocity_figures(compared: Comparison) -> list[Figure]:
    cards = [one for block in comparison_document(compared).blocks if isinstance(block, Cards) for one in block.cards]
    figures = [figure for card in cards for block in card.blocks if isinstance(block, Figures)
               for figure in block.figures if isinstance(figure, Figure)]  # fmt: skip
    return [figure for figure in figures if figure.title.startswith("Force at peak velocity")]


def test_a_force_near_zero_has_no_relative_change(made_run: Make, made_point: Make) -> None:
    """Viscous force 125.66 N: with an offset of 124 N the force in jounce is near zero, -1.66 N."""
    before, after = made_run("before"), made_run("after")
    for folder, offset_N in ((before, 124.0), (after, 123.0)):
        made_point(folder, "p001", 1000.0, offset_N=offset_N)
    compared = compare([before, after])
    change = compared.change(1, "jounce_force", compared.rows[0])
    assert change is not None
    assert (change.value, change.differs) == (pytest.approx(-1.0, abs=0.01), True)
    assert math.isnan(change.percent)
    from rig.cli.comparison_tables import comparison_lines

    lines = [text for text, _ in comparison_lines(compared, 120, everything=False)]
    assert any(re.search(r"^compression force[^%]*-(1|0\.99)[.0-9]* N[^%]*$", line) for line in lines)
    assert re.search("\N{MINUS SIGN}(1|0.99)[.0-9]* N", comparison_page(compared))
    (before / "matrix.toml").write_text('[display]\nforce = "lbf"\ndisplacement = "in"\npositive = "compression"\n')
    compared = compare([before, after])
    lines = [text for text, _ in comparison_lines(compared, 120, everything=False)]
    assert any(re.search(r"^sine, 0.7874 in, .* compression force +lbf +0\.37.* \+0\.22", line) for line in lines)
    page = comparison_page(compared)
    assert re.search(r"compression, compression positive, lbf", page)
    assert "0.7874 in, 1 Hz" in page


@pytest.mark.parametrize(("offsets_N", "changed_N"), [((-110.0, -140.0), -30.0), ((-124.0, -100.0), 24.0)])
def test_a_force_that_changes_its_sign_or_comes_near_zero_is_stated_in_newtons_in_all_tests(
    offsets_N: tuple[float, float], changed_N: float, made_run: Make, made_point: Make, bands: Make
) -> None:
    """Viscous force 125.66 N at 1 Hz, 251.3 N at 2 Hz; the gas force turns or nearly cancels the first in rebound."""
    runs = [made_run("before"), made_run("after")]
    for folder, offset_N in zip(runs, offsets_N, strict=True):
        made_point(folder, "p001", 1000.0, offset_N=offset_N)
        made_point(folder, "p002", 1000.0, offset_N=-50.0, frequency_Hz=2.0)
    compared = compare(runs)
    one = compared.change(1, "rebound_force", compared.rows[0])
    assert one is not None
    assert (one.value, one.differs, math.isnan(one.percent)) == (pytest.approx(changed_N, abs=0.3), True, True)
    summary = compared.to_json()["summary"][0]["rebound_force"]
    assert (summary["tests"], summary["absolute"], summary["median_percent"]) == (2, 2, None)
    assert summary["median"] == pytest.approx(changed_N / 2, abs=0.3)
    assert compared.to_json()["summary"][0]["jounce_force"]["absolute"] == 2, "both directions have one unit"
    assert sum(" are stated in N, " in remark for remark in compared.remarks) == 1
    judgement = compare(runs, bands('[[rebound_force]]\nmost_change = "15 %"\n')).judgement
    assert judgement is not None
    wide = next(result for result in judgement.results if "p001" in result.points and result.run == "after")
    assert str(wide.state) == ("fail" if offsets_N[0] == -110.0 else "missing"), "a band in % is evaluated"


def test_an_unmeasured_gas_force_that_leaves_8_percent_of_a_force_gives_no_percentage(
    made_run: Make, made_point: Make
) -> None:
    """Viscous force 125.66 N less a gas force of 107 N, then of 50 N: 18.66 N in rebound becomes 75.66 N."""
    runs = [made_run("before"), made_run("after")]
    for folder, offset_N in zip(runs, (-107.0, -50.0), strict=True):
        made_point(folder, "p001", 1000.0, offset_N=offset_N)
    compared = compare(runs)
    (row,) = compared.rows
    rebound, jounce = (compared.change(1, key, row) for key in ("rebound_force", "jounce_force"))
    assert rebound is not None
    assert jounce is not None
    assert (math.isnan(rebound.percent), rebound.value) == (True, pytest.approx(57.0, abs=0.3))
    assert (math.isnan(jounce.percent), jounce.value) == (True, pytest.approx(57.0, abs=0.3))
    assert "57 N" in comparison_page(compared)


def test_a_force_below_the_gas_force_has_no_relative_change() -> None:
    before, after = (Reading(force_N, 1.0, gas_force=300.0) for force_N in (200.0, 240.0))
    assert math.isnan(change(before, after, same_gauge=True).percent)
    assert change(before, after, same_gauge=True, of_band=True).percent == pytest.approx(20.0)
    before, after = (Reading(force_N, 1.0, gas_force=300.0) for force_N in (-800.0, -840.0))
    assert change(before, after, same_gauge=True).percent == pytest.approx(5.0)


def test_too_few_or_too_many_runs_are_refused(made_run: Make) -> None:
    folder = made_run("a")
    with pytest.raises(RigError, match="specify two runs"):
        compare([folder])
    with pytest.raises(RigError, match=r"at most 12; with acceptance bands .* at most 1000"):
        compare([folder] * 13)


def test_the_page_begins_with_the_verdict_and_shows_loops_over_each_other_and_every_change(
    made_run: Make, made_fit: Make, bands: Make
) -> None:
    before, after = made_run("before"), made_run("after<script>", 900.0)
    made_fit(before)
    path = bands('[[damping]]\nlow = "950 N s/m"\nnote = "<script>alert(1)</script>"\n')
    page = comparison_page(compare([before, after], path))
    assert "<script" not in page
    assert not re.search(r"<link|<img|@import|url\(|src=|href=\"[^#]", page)
    order = ["FAIL", "Acceptance bands: drawing 4711", "Loops of all runs", "Values and changes", "Fitted"]
    body = page[page.index("</nav>"):]
    places = [body.index(words) for words in order]
    assert places == sorted(places)
    (u, v) = re.findall(r"<svg.*?</svg>", page)
    assert [one.count('<path class="m"') for one in (u, v)] == [2, 2]
    assert page.count("after&lt;script&gt;") > 3
    table = page[page.index("Equivalent viscous damping, N s/m"):page.index("Fitted parameters</h2>")]
    assert "<b>\N{MINUS SIGN}10.0000 %</b>" in table
    assert '<span class="chip poor">fail</span>' in page
    assert '<span class="chip good">pass</span>' in page


def test_the_page_is_put_on_paper_too(
    made_run: Make, bands: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = [str(made_run("before")), str(made_run("after", 900.0))]
    band = str(bands('[[damping]]\nlow = "950 N s/m"\n'))
    page = tmp_path / "comparison.html"
    assert main(["compare", *runs, "--bands", band, "--out", str(page), "--pdf", "--json"]) == 8
    reported = json.loads(capsys.readouterr().out)
    assert (reported["report"], reported["pdf"]) == (str(page), str(page.with_suffix(".pdf")))
    sheets = pypdf.PdfReader(reported["pdf"]).pages
    text = "\n".join(sheet.extract_text() for sheet in sheets)
    assert all(words in text for words in ("FAIL", "drawing 4711", "sine, 20 mm, 1 Hz, 0.5 A", "page 1 of"))
    assert main(["compare", *runs, "--pdf", "--out", "page.pdf"]) == 2
    assert "--out FILE.html" in capsys.readouterr().err
    assert main(["compare", *runs, "--pdf"]) == 0
    assert (tmp_path / "before-comparison.pdf").is_file()
    capsys.readouterr()
    assert main(["compare", *runs, "--json"]) == 0
    reported = json.loads(capsys.readouterr().out)
    assert (reported["report"], reported["pdf"]) == (None, None)


def test_motions_of_one_run_alone_are_named(made_run: Make, made_point: Make) -> None:
    """They were left out without a word where others had a counterpart."""
    first, second = made_run("a"), made_run("b")
    made_point(first, "p002", 1000.0, current_A=1.0)
    made_point(second, "p002", 1000.0, current_A=1.5)
    reported = [remark for remark in compare([first, second]).remarks if "therefore not compared" in remark]
    assert [remark.partition(":")[0] for remark in reported] == ["b", "b"]
    assert "1 motion(s) not in the first run" in reported[0]
    assert "1.5 A" in reported[0]
    assert "1 motion(s) only in the first run" in reported[1]
    assert compare([first, first]).remarks[0].startswith("the same run is specified more than once")
