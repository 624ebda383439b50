"""`rig ride`: its keys to the letter, the paper's fits, what an interval is made of, and what is refused."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from rig import dampers
from rig.cli.ride import command
from rig.vehicle.fitted_damper import fitted_damper

PAPER = [f"cfoa-table5-fit{count}" for count in (1, 2, 3)]
ROAD = 'format = 1\nname = "short"\nspeed = "25 m/s"\n[sweep]\nduration = "16 s"\n'


def ride(*arguments: str) -> Result:
    return CliRunner().invoke(command, list(arguments), catch_exceptions=False)


@pytest.fixture(scope="module")
def road(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("road") / "short.toml"
    path.write_text(ROAD)
    return str(path)


def a_fit(path: Path, relative_error: float) -> Path:
    """A `fit.json` of the asymmetric model as it is documented, every parameter that uncertain."""
    values = {**dampers.parameter_set("demo").values, "beta": 20.0, "delta": 0.0}
    entries = {
        name: {
            "value": value, "unit": "", "low": value, "high": value, "identifiable": True, "reason": None,
            "standard_error": relative_error * abs(value),
        }
        for name, value in values.items()
    }  # fmt: skip
    correlation = {a: {b: float(a == b) for b in values} for a in values}
    path.write_text(json.dumps({
        "model": "asymmetric", "hysteresis": "kwok", "parameters": entries, "correlation": correlation,
        "adequate": True, "current": {"dependence": "affine"},
    }))
    return path


@pytest.fixture(scope="module")
def paper(road: str, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    out = tmp_path_factory.mktemp("out") / "ride.html"
    found: dict[str, Any] = json.loads(ride(*PAPER, "--road", road, "--json", "--out", str(out)).stdout)
    return found


def test_the_answer_has_the_documented_keys(paper: dict[str, Any]) -> None:
    assert [fit["name"] for fit in paper["fits"]] == PAPER
    assert list(paper["bands"]) == ["heave", "pitch", "roll"]
    for motion in paper["bands"].values():
        assert list(motion) == ["4-8 Hz", "0-18 Hz"]
        for band in motion.values():
            assert list(band) == ["chosen", "in phase", "antiphase"]
            for entry in band.values():
                assert set(entry) == {"between", "difference_dB", "interval_dB", "pairs"}
                assert len(entry["pairs"]) == 3
    for key in ("weighted_rms_m_s2", "tyre_load_variation", "travel_m", "damper_power_W", "damper_heat_J"):
        assert list(paper[key]) == PAPER
        assert all(0.0 < entry["value"] < 1e5 for entry in paper[key].values()), key
    assert paper["car"] == {"name": "compact SUV", "kind": "full", "estimate": True}
    for phase in ("chosen", "in phase", "antiphase"):
        assert set(paper["responses"][phase]) == set(PAPER)


def test_the_paper_s_fits_differ_by_decibels_where_the_road_excites_the_motion(paper: dict[str, Any]) -> None:
    assert paper["bands"]["heave"]["4-8 Hz"]["chosen"]["difference_dB"] == pytest.approx(3.0, abs=1.5)
    assert paper["bands"]["pitch"]["4-8 Hz"]["chosen"]["difference_dB"] == pytest.approx(4.1, abs=1.5)
    assert paper["bands"]["heave"]["0-18 Hz"]["in phase"]["difference_dB"] > 5.0
    assert paper["bands"]["roll"]["4-8 Hz"]["in phase"]["difference_dB"] is None
    assert paper["bands"]["heave"]["4-8 Hz"]["antiphase"]["difference_dB"] is None
    assert paper["bands"]["heave"]["4-8 Hz"]["chosen"]["interval_dB"] is None
    assert all("no interval" in fit["remark"] for fit in paper["fits"])


def test_the_largest_pair_is_the_one_reported(paper: dict[str, Any]) -> None:
    entry = paper["bands"]["pitch"]["4-8 Hz"]["chosen"]
    largest = max(entry["pairs"], key=lambda pair: pair["difference_dB"])
    assert (entry["between"], entry["difference_dB"]) == (largest["between"], largest["difference_dB"])


def test_the_report_is_one_page_with_the_paper_s_values_beside_ours(paper: dict[str, Any]) -> None:
    page = Path(paper["report"]).read_text(encoding="utf-8")
    for word in ("printed in the paper", "up to 5", "up to 12", "estimate", "Force vs. velocity", *PAPER):
        assert word in page, word
    assert "http" not in page.replace("http://www.w3.org", "")


def test_a_ride_beyond_the_fitted_tests_says_in_what_and_for_how_long(tmp_path: Path, road: str) -> None:
    path = a_fit(tmp_path / "fit.json", 0.0)
    fit = json.loads(path.read_text())
    quiet, narrow = tmp_path / "quiet.json", tmp_path / "narrow.json"
    wide = {"displacement_m": [-1.0, 1.0], "velocity_m_s": [-9.0, 9.0], "current_A": [0.0, 2.0]}
    quiet.write_text(json.dumps(fit | {"tested": wide}))
    narrow.write_text(json.dumps(fit | {"tested": wide | {"velocity_m_s": [-0.05, 0.05], "current_A": [0.5, 1.0]}}))
    out = tmp_path / "ride.html"
    names = (str(path), str(quiet), str(narrow))
    display = '[display]\nforce = "lbf"\ndisplacement = "in"\nspeed = "in/s"\npositive = "compression"\n'
    (tmp_path / "matrix.toml").write_text(display)
    options = ("--road", road, "--members", "0", "--json", "--out", str(out))
    unknown, nowhere, somewhere = (one["beyond"] for one in json.loads(ride(*names, *options).stdout)["fits"])
    assert unknown is None
    assert nowhere == {}
    assert set(somewhere) == {"velocity_m_s", "current_A"}
    assert 0.05 < somewhere["velocity_m_s"] < 0.95
    assert somewhere["current_A"] == 1.0  # 0 A all the time
    page = out.read_text(encoding="utf-8")
    assert f"{narrow}: outside the tested range (velocity " in page
    assert "current 1e+02 %" not in page
    for word in ("largest travel, in", "984.3 in/s", "Velocity, compression positive", "lbf"):
        assert word in page, word
    assert f"{path}: this fit does not contain its tested range" in page
    assert f"{quiet}: " not in page


@pytest.mark.nightly
def test_a_surer_fit_has_a_narrower_band(tmp_path: Path, road: str) -> None:
    widths = []
    for relative_error in (0.10, 0.01):
        fit = str(a_fit(tmp_path / "fit.json", relative_error))
        answer = json.loads(ride(fit, "cfoa-table5-fit1", "--road", road, "--members", "12", "--json").stdout)
        entry = answer["bands"]["heave"]["4-8 Hz"]["chosen"]
        low, high = entry["interval_dB"]
        assert low <= entry["difference_dB"] <= high
        own = answer["weighted_rms_m_s2"][fit]
        assert own["interval"][0] <= own["value"] <= own["interval"][1]
        assert answer["weighted_rms_m_s2"]["cfoa-table5-fit1"]["interval"] is None
        widths.append(own["interval"][1] - own["interval"][0])
    assert all(wide > 4.0 * narrow > 0.0 for wide, narrow in pairwise(widths)), widths


def test_the_name_of_a_parameter_set_is_the_set_and_a_folder_called_so_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert fitted_damper(PAPER[0], 0).remark == "parameter set, so there is no interval"
    (tmp_path / PAPER[0]).mkdir()
    a_fit(tmp_path / PAPER[0] / "fit.json", 0.02)
    named = fitted_damper(PAPER[0], 0)
    note = f"; for the file or folder with this name, write ./{PAPER[0]}"
    assert named.remark == f"parameter set, so there is no interval{note}"
    assert named.damper.values["Ca_plus"] != 900.0
    assert fitted_damper(f"./{PAPER[0]}", 0).damper.values["Ca_plus"] == 900.0


def test_draws_are_as_far_apart_as_the_fit_says_and_the_same_for_a_seed(tmp_path: Path) -> None:
    path = str(a_fit(tmp_path / "fit.json", 0.02))
    drawn = fitted_damper(path, 400, seed=5).draws
    again = fitted_damper(path, 400, seed=5).draws
    assert [damper.values for damper in drawn[:3]] == [damper.values for damper in again[:3]]
    damping = np.array([damper.values["Ca_plus"] for damper in drawn])
    assert np.std(damping) == pytest.approx(0.02 * 900.0, rel=0.12)
    assert np.mean(damping) == pytest.approx(900.0, rel=0.005)


@pytest.mark.nightly
def test_laws_are_compared_under_names_of_their_own(road: str) -> None:
    answer = json.loads(ride(PAPER[0], "--law", "passive", "--law", "skyhook", "--road", road, "--json").stdout)
    assert list(answer["travel_m"]) == ["cfoa-table5-fit1 (passive)", "cfoa-table5-fit1 (skyhook)"]
    assert [fit["law"] for fit in answer["fits"]] == ["passive", "skyhook"]


@pytest.mark.nightly
def test_the_terminal_tells_differences_numbers_and_that_the_car_is_an_estimate(road: str) -> None:
    result = ride(*PAPER[:2], "--road", road)
    for word in ("heave", "4-8 Hz", "antiphase", "estimate", "weighted RMS", "largest travel, mm"):
        assert word in result.stdout, word


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("no-such-damper",), "cfoa-table5-fit1"),
        (("cfoa-table5-fit1", "--car", "no-such-car"), "compact-suv"),
        (("cfoa-table5-fit1", "--road", "no-such-road"), "paper-sweep"),
        (("cfoa-table5-fit1", "cfoa-table5-fit1"), "given twice"),
    ],
)
def test_what_is_not_known_is_refused_with_what_is(arguments: tuple[str, ...], word: str) -> None:
    with pytest.raises(Exception, match=word) as caught:
        ride(*arguments)
    assert getattr(caught.value, "exit_code", None) == 2


def test_a_fit_that_puts_energy_in_is_refused_by_name(tmp_path: Path, road: str) -> None:
    fit = json.loads(a_fit(tmp_path / "fit.json", 0.0).read_text())
    for name in ("Ca_plus", "Ca_minus"):
        fit["parameters"][name]["value"] = -9000.0
    (tmp_path / "fit.json").write_text(json.dumps(fit))
    with pytest.raises(Exception, match="grows without bound") as caught:
        ride(str(tmp_path), "--road", road)
    assert getattr(caught.value, "slug", None) == "ride"
    assert "this damper adds energy (the damper force drives the rod at " in str(caught.value)
    assert "m/s and 0 A). Fix: use tests at" in str(caught.value)


def test_fits_for_each_current_are_refused_with_the_way_out(tmp_path: Path) -> None:
    apart = {"model": "kwok", "parameters": {}, "current": {"dependence": "per-current-affine"}}
    (tmp_path / "fit.json").write_text(json.dumps(apart))
    with pytest.raises(Exception, match="identify the run again with --current affine"):
        ride(str(tmp_path))


def test_currents_beyond_any_coil_and_empty_fits_are_refused(tmp_path: Path) -> None:
    assert ride("cfoa-table5-fit1", "--current", "50 A").exit_code == 2
    (tmp_path / "fit.json").write_text('{"model": "asymmetric", "parameters": {"m": {"value": null}}}')
    with pytest.raises(Exception, match=r"no value for m, F0(.|\n)*Fix: .*`rig identify"):
        ride(str(tmp_path))
    (tmp_path / "fit.json").write_text('{"model": "asymmetric", "parameters": {"sigma_0": {"value": 1.0}}}')
    with pytest.raises(Exception, match=r"got sigma_0, which(.|\n)*another model(.|\n)*Fix: .*`rig identify"):
        ride(str(tmp_path))
    with pytest.raises(Exception, match="this run has no fit"):
        ride(str(tmp_path.parent))
