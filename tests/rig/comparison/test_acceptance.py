from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from rig.cli.comparison_tables import comparison_lines
from rig.cli.main import main
from rig.comparison import Comparison, compare, load_bands
from rig.comparison.acceptance import AcceptanceResult
from rig.errors import EXIT_DONE, EXIT_NOT_ACCEPTED, EXIT_USAGE, FileProblem

Make = Callable[..., Path]
ROOT = Path(__file__).parents[3]
PEAK_M_S = 2 * math.pi * 0.02
REBOUND_N = 1000.0 * PEAK_M_S - 50.0
"""F = c v + F0 with c = 1000 N s/m and F0 = -50 N at the peak of a sine of 20 mm and 1 Hz: 75.66 N."""
ENERGY_J = math.pi * 1000.0 * 2 * math.pi * 0.02**2
"""pi c omega X^2: 7.896 J."""

REBOUND = '[[rebound_force]]\nlow = "{low} N"\nhigh = "{high} N"\n'


def acceptance(compared: Comparison) -> AcceptanceResult:
    assert compared.judgement is not None
    return compared.judgement


def states(compared: Comparison) -> list[str]:
    return [str(result.state) for result in acceptance(compared).results]


def test_a_value_within_its_band_passes_with_the_margin_to_the_nearer_limit(made_run: Make, bands: Make) -> None:
    compared = compare([made_run("a")], bands(REBOUND.format(low=70, high=90)))
    (result,) = acceptance(compared).results
    assert acceptance(compared).passed
    assert result.value == pytest.approx(REBOUND_N, rel=2e-3)
    assert result.margin == pytest.approx(REBOUND_N - 70.0, abs=0.2)
    assert result.margin_percent == pytest.approx(100.0 * (REBOUND_N - 70.0) / 70.0, abs=0.3)
    assert (result.points, result.unit, result.where) == (("p001",), "N", "sine, 20 mm, 1 Hz, 0.5 A")


def test_a_value_outside_fails_with_a_negative_margin(made_run: Make, bands: Make) -> None:
    compared = compare([made_run("a")], bands('[[energy]]\nhigh_J = 7\n[[damping]]\nlow_N_s_m = 900\n'))
    energy, damping = acceptance(compared).results
    assert not acceptance(compared).passed
    assert [str(energy.state), str(damping.state)] == ["fail", "pass"]
    assert energy.margin == pytest.approx(7.0 - ENERGY_J, abs=0.02)
    assert damping.value == pytest.approx(1000.0, rel=2e-3)


def test_forces_in_jounce_are_negative_and_a_positive_band_of_them_is_refused(made_run: Make, bands: Make) -> None:
    compared = compare([made_run("a")], bands('[[jounce_force]]\nlow = "-180 N"\nhigh = "-170 N"\n'))
    assert acceptance(compared).results[0].value == pytest.approx(-1000.0 * PEAK_M_S - 50.0, rel=2e-3)
    assert states(compared) == ["pass"]
    with pytest.raises(FileProblem, match=r'low = "170 N": forces in compression are negative'):
        load_bands(bands('[[jounce_force]]\nlow = "170 N"\nhigh = "180 N"\n'))


def test_a_band_whose_test_was_not_run_or_is_not_valid_is_missing_and_not_passed(
    made_run: Make, made_point: Make, bands: Make
) -> None:
    folder = made_run("a")
    made_point(folder, "p002", 1000.0, frequency_Hz=2.0, verdict="suspect")
    text = '[[rebound_force]]\nfrequency = "{} Hz"\nlow = "0 N"\n'
    for frequency in ("2", "3"):
        compared = compare([folder], bands(text.format(frequency)))
        (result,) = acceptance(compared).results
        assert (str(result.state), acceptance(compared).passed) == ("missing", False)
        assert ("p002" in result.why) == (frequency == "2")  # the reason of the point that was run


def test_bands_choose_loops_by_every_key_that_is_given(made_run: Make, made_point: Make, bands: Make) -> None:
    folder = made_run("a")
    made_point(folder, "p002", 1000.0, frequency_Hz=2.0)
    made_point(folder, "p003", 1000.0, current_A=1.0)
    for choice, points in (
        ('speed = "0.125 m/s"', ["p001", "p003"]), ('point = "p002"', ["p002"]),
        ('current = "0.5 A"', ["p001", "p002"]),
        ('waveform = "sine"\namplitude = "20 mm"\nfrequency_Hz = 1\ncurrent_A = 1.0', ["p003"]),
        ("", ["p001", "p002", "p003"]),
    ):
        compared = compare([folder], bands(f'[[rebound_force]]\n{choice}\nlow = "0 N"\n'))
        assert sorted(name for result in acceptance(compared).results for name in result.points) == points


def test_dynamic_range_is_the_force_over_that_at_0_A_without_the_gas_force(
    made_run: Make, made_point: Make, bands: Make
) -> None:
    folder = made_run("a", 2500.0)
    made_point(folder, "p000", 1000.0, current_A=0.0)
    compared = compare([folder], bands("[[dynamic_range]]\nlow = 2.4\nhigh = 2.6\n"))
    (result,) = acceptance(compared).results
    assert (result.points, str(result.state)) == (("p001",), "pass")
    assert result.value == pytest.approx(2.5, rel=3e-3)


def test_a_guarded_decision_asks_for_more_margin_than_the_expanded_uncertainty(made_run: Make, bands: Make) -> None:
    stated = made_run("a", percent=2.0)
    for low, state in ((70, "pass"), (74, "unsure"), (76, "fail")):
        compared = compare([stated], bands(REBOUND.format(low=low, high=900), "guarded"))
        assert states(compared) == [state]
    assert acceptance(compared).results[0].expanded == pytest.approx(2 * 0.02 * REBOUND_N, rel=0.02)
    unstated = compare([made_run("b")], bands(REBOUND.format(low=10, high=900), "guarded"))
    assert states(unstated) == ["unsure"]
    assert "calibration" in acceptance(unstated).results[0].why


def test_parameters_are_held_against_bands_where_the_fit_can_determine_them(
    made_run: Make, made_fit: Make, bands: Make
) -> None:
    folder, band = made_run("a"), '[[parameter]]\nname = "Fy"\nunit = "N"\nlow = 495\nhigh = 520\n'
    assert states(compare([folder], bands(band))) == ["missing"]
    for changes, state in (
        ({}, "pass"), ({"value": 530.0}, "fail"), ({"adequate": False}, "missing"),
        ({"identifiable": False, "reason": "held constant"}, "missing"),
    ):
        made_fit(folder, **changes)
        assert states(compare([folder], bands(band))) == [state]
    made_fit(folder)
    with pytest.raises(FileProblem, match=r'parameter\[1\]\.unit = "kN": Fy is fitted in "N"'):
        compare([folder], bands(band.replace('"N"', '"kN"')))


def test_a_change_is_evaluated_of_every_later_run_against_the_first(made_run: Make, bands: Make) -> None:
    before, after = made_run("before"), made_run("after", 1120.0)
    text = '[[energy]]\nmost_change = "{} %"\n'
    (result,) = acceptance(compare([before, after], bands(text.format(15)))).results
    assert (result.change, result.unit, result.run, str(result.state)) == (True, "%", "after", "pass")
    assert result.value == pytest.approx(12.0, abs=0.05)
    assert states(compare([before, after], bands(text.format(10)))) == ["fail"]
    with pytest.raises(FileProblem, match="specify two runs"):
        compare([before], bands(text.format(10)))


def test_a_band_is_not_passed_by_what_was_left_of_a_run(made_run: Make, made_point: Make, bands: Make) -> None:
    """A motion without a valid point, and points that were planned and not recorded, are missing."""
    folder, band = made_run("a"), '[[rebound_force]]\nlow = "0 N"\n'
    assert acceptance(compare([folder], bands(band))).passed
    invalid = made_point(folder, "p002", 1000.0, frequency_Hz=2.0, verdict="invalid")
    compared = compare([folder], bands(band))
    assert states(compared) == ["pass", "missing"]
    assert acceptance(compared).results[1].why == "no point with this motion is valid"
    assert compared.remarks == ("a: 1 item(s) not evaluated; first: p002 left out: invalid (estop: stopped)",)
    assert states(compare([folder], bands(f'{band}frequency = "1 Hz"\n'))) == ["pass"]
    invalid.unlink()
    (folder / "campaign.json").write_text(json.dumps({"id": "a", "points": ["p001", "p002", "p003"]}))
    compared = compare([folder], bands(band))
    assert states(compared) == ["pass", "missing"]
    assert acceptance(compared).results[1].why.endswith("the campaign ended early: 2")
    assert compared.remarks == ("a: planned points not recorded: 2",)


MATRIX = """
format = 1
[specimen]
serial_number = "S-a"
stroke = "170 mm"
prior = "demo"
[matrix]
amplitude = ["20 mm"]
frequency = ["1 Hz", "2 Hz"]
current = ["0.5 A"]
"""


def test_a_band_is_not_passed_without_the_points_that_were_planned_for_it(made_run: Make, bands: Make) -> None:
    """The matrix that is kept with the run states which motions are missing; without it, every band may need them."""
    folder, band = made_run("a"), '[[rebound_force]]\nlow = "0 N"\n'
    (folder / "campaign.json").write_text(json.dumps({"id": "a", "points": ["p001", "p002"]}))
    (folder / "matrix.toml").write_text(MATRIX)
    assert states(compare([folder], bands(f'{band}frequency = "1 Hz"\n'))) == ["pass"]
    compared = compare([folder], bands(f'{band}waveform = "sine"\n'))
    assert states(compared) == ["pass", "missing"]
    assert acceptance(compared).results[1].points == ("p002",)
    assert acceptance(compared).results[1].why.startswith("this planned point was not recorded")
    (folder / "matrix.toml").unlink()
    assert states(compare([folder], bands(f'{band}waveform = "sine"\n'))) == ["pass", "missing"]


def test_a_repeat_makes_up_for_an_invalid_point(made_run: Make, made_point: Make, bands: Make) -> None:
    folder = made_run("a")
    made_point(folder, "p002", 1000.0, verdict="invalid")
    assert states(compare([folder], bands('[[rebound_force]]\nlow = "0 N"\n'))) == ["pass"]


def test_nothing_is_accepted_with_fewer_repeats_than_were_planned(
    made_run: Make, made_point: Make, bands: Make
) -> None:
    """A lost repeat leaves a value that passes undecided; one that fails has failed."""
    folder = made_run("a")
    (folder / "campaign.json").write_text(json.dumps({"id": "a", "points": ["p001", "p002", "p003"]}))
    (folder / "matrix.toml").write_text(MATRIX.replace('"1 Hz", "2 Hz"', '"1 Hz"') + "repeats = 3\n")
    made_point(folder, "p002", 1000.0)
    for band in ('frequency = "1 Hz"\n', 'point = "p001"\n'):
        compared = compare([folder], bands(f'[[rebound_force]]\nlow = "0 N"\n{band}'))
        assert states(compared) == ["missing"]
        assert acceptance(compared).results[0].why.endswith("not recorded or are not valid: p003")
    failing = bands('[[rebound_force]]\nlow = "900 N"\nfrequency = "1 Hz"\n')
    assert states(compare([folder], failing)) == ["fail"]
    invalid = made_point(folder, "p003", 1000.0, verdict="invalid")
    passing = bands('[[rebound_force]]\nlow = "0 N"\nfrequency = "1 Hz"\n')
    assert states(compare([folder], passing)) == ["missing"]
    invalid.unlink()
    made_point(folder, "p003", 1000.0)
    assert states(compare([folder], passing)) == ["pass"]


def test_a_change_is_not_passed_by_motions_that_only_the_first_run_has(
    made_run: Make, made_point: Make, bands: Make
) -> None:
    before, after = made_run("before"), made_run("after")
    made_point(before, "p002", 1000.0, frequency_Hz=2.0)
    band = '[[energy]]\nmost_change = "15 %"\n'
    compared = compare([before, after], bands(band))
    results = {result.where: (str(result.state), result.why) for result in acceptance(compared).results}
    assert results == {
        "sine, 20 mm, 1 Hz, 0.5 A": ("pass", ""),
        "sine, 20 mm, 2 Hz, 0.5 A": ("missing", "after does not contain this test"),
    }
    assert states(compare([before, after], bands(f'{band}frequency = "1 Hz"\n'))) == ["pass"]


def test_a_run_and_itself_or_its_copy_have_no_change_that_could_pass(made_run: Make, bands: Make) -> None:
    first, copy = made_run("a"), made_run("b")
    for folder in (first, copy):
        (folder / "campaign.json").write_text(json.dumps({"id": "20260102T030405Z-S-ab12cd"}))
    for later in (first, copy):
        compared = compare([first, later], bands('[[energy]]\nmost_change = "15 %"\n'))
        (result,) = acceptance(compared).results
        assert str(result.state) == "missing"
        assert result.why == "this is the first run: identical data cannot show a change"
        assert any("specified more than once" in remark for remark in compared.remarks)


def test_every_wrong_entry_of_a_bands_file_is_reported_at_once_with_its_line(bands: Make) -> None:
    with pytest.raises(FileProblem) as caught:
        load_bands(bands(
            '[[energy]]\nhigh = "5 N"\n[[rebound_force]]\nlow = "9 N"\nhigh = "3 N"\n[[damping]]\n'
            '[[parameter]]\nname = "Fy"\nlow = 1\n[[rebound]]\nlow = "1 N"\n', "strict",
        ))
    problems = "\n".join(caught.value.problems)
    for piece in (
        "line 3: decision", 'energy[1].high = "5 N": 5 N is a force', "rebound_force[1].low", "must be below high",
        "damping[1]: a band requires low, high or most_change", "parameter[1].unit", "did you mean rebound_force?",
    ):
        assert piece in problems
    assert caught.value.slug == "config-absurd"


def test_the_command_answers_with_its_exit_code_and_one_object(
    made_run: Make, bands: Make, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = str(made_run("a"))
    for low, code in ((70, EXIT_DONE), (80, EXIT_NOT_ACCEPTED)):
        path = str(bands(REBOUND.format(low=low, high=90)))
        assert main(["compare", folder, "--bands", path, "--json"]) == code
        answer = json.loads(capsys.readouterr().out)
        assert answer["bands"]["passed"] is (code == EXIT_DONE)
        assert answer["bands"]["results"][0]["margin"] == pytest.approx(REBOUND_N - low, abs=0.2)
        assert main(["compare", folder, "--bands", path]) == code
        message = capsys.readouterr().out
        assert message.startswith("PASS" if code == EXIT_DONE else "FAIL")
    assert EXIT_NOT_ACCEPTED == 8
    assert main(["compare", folder]) == EXIT_USAGE
    assert "--bands" in capsys.readouterr().err


def test_the_example_is_a_bands_file_and_its_keys_are_documented() -> None:
    known = load_bands(ROOT / "examples" / "acceptance-bands.toml")
    assert {key for key, _ in known.all} >= {"rebound_force", "jounce_force", "energy", "dynamic_range", "parameter"}
    assert known.all[3][1].low is None
    assert known.energy[0].high == 75.0


def test_more_than_twelve_runs_are_listed_with_their_verdicts(made_run: Make, bands: Make) -> None:
    good, bad = made_run("good"), made_run("bad", 1200.0)
    runs = [bad, *(shutil.copytree(good, good.with_name(f"good{number:02}")) for number in range(12))]
    compared = compare(runs, bands(REBOUND.format(low=70, high=90)))
    lines = [text for text, _ in comparison_lines(compared, 80, everything=False)]
    verdicts = {line.split()[0]: line.split()[2] for line in lines if line.startswith(("good", "bad"))}
    assert verdicts == {"bad": "FAIL", **{f"good{number:02}": "PASS" for number in range(12)}}
    assert "12 of 13 runs passed" in lines
    assert not any("relative to the first run" in line for line in lines)
