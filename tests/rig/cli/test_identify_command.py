"""`rig identify` on imported tests: honest numbers on good ones, a named refusal or warning on every bad one."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from in_process import rig

from rig.dampers import model, parameter_set
from rig.identification import Fit, FitOptions, identify_run

DEMO = dict(parameter_set("demo").values)
OTHER = {**DEMO, "Fyb": 130.0, "Ca_plus": 1800.0}
COLUMNS = ("time=t_s", "displacement=x_mm", "force=F_N")


def make_run(
    folder: Path,
    *,
    values: Mapping[str, float] = DEMO,
    frequencies_Hz: Sequence[float] = (1.0, 2.0),
    currents_A: Sequence[float] = (0.0, 1.0),
    interval_s: float = 0.004,
    specimen: str = "imported",
    seed: int = 0,
    exit_code: int = 0,
) -> Path:
    """CSV files of sines of 30 mm with 5 N and 5 um of noise, imported by the command; the run's directory."""
    rng = np.random.default_rng(seed)
    folder.mkdir()
    for frequency in frequencies_Hz:
        for current in currents_A:
            t = np.arange(0.0, 8.0 / frequency + 1.0, interval_s)
            moving = (t > 0.5) & (t < 0.5 + 8.0 / frequency)
            phase, omega = 2.0 * np.pi * frequency * np.clip(t - 0.5, 0.0, 8.0 / frequency), 2.0 * np.pi * frequency
            u, v = 0.03 * np.sin(phase), 0.03 * omega * np.cos(phase) * moving
            force = model("asymmetric").force(values, u, v, -(omega**2) * u, current, interval_s)
            rows = np.column_stack((t, 1e3 * u + rng.normal(0, 0.005, t.size), force + rng.normal(0, 5.0, t.size)))
            name = folder / f"f{frequency:g}_{current:g}A.csv"
            np.savetxt(name, rows, delimiter=",", header="t_s,x_mm,F_N", comments="", fmt="%.5f")
    expected = [option for column in COLUMNS for option in ("--column", column)]
    files = sorted(folder.glob("*.csv"))
    name = ("--current-from-name", "_(?P<current>[0-9.]+)A", "--specimen", specimen, "--out", folder / "runs")
    made = rig("import", *files, *expected, *name, "--json")
    assert made.returncode == exit_code, made.stderr
    return Path(json.loads(made.stdout)["campaign"])


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_run(tmp_path_factory.mktemp("good") / "tests")


def test_numbers_profile_energy_and_the_next_test_are_in_one_object(good: Path) -> None:
    answer = rig(
        "identify", good, "--profile", "--profile-of", "Fyb", "--holdout", "frequency_Hz=2,current_A=1", "--json"
    )
    assert answer.returncode == 0, answer.stderr
    fit: dict[str, Any] = json.loads(answer.stdout)
    for name, entry in fit["parameters"].items():
        assert not entry["identifiable"] or entry["simultaneous_low"] < DEMO[name] < entry["simultaneous_high"], name
    assert set(fit["profiles"]) == {"beta", "delta", "Fyb"}
    assert fit["passivity"]["share"] == 1.0
    assert fit["next_tests"][0]["toml"].startswith("[[point]]")
    assert {"condition", "correlation"} <= set(fit)
    assert json.loads((good / "fit.json").read_text()).keys() == fit.keys()


def test_the_fit_after_a_run_compares_models_where_the_quick_one_is_not_adequate(
    good: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fit, requested = identify_run([good], model="auto"), []
    assert (fit.model, fit.adequate) == ("asymmetric", True)  # what made the tests, fitted alone
    assert len(fit.selection) == 1

    def misfits(_tests: object, options: FitOptions) -> Fit:
        requested.append(options.model)
        return replace(fit, evaluation=replace(fit.evaluation, adequate=False))

    monkeypatch.setattr("rig.identification.runs.fit_tests", misfits)
    identify_run([good], model="auto")
    identify_run([good], model="asymmetric")
    assert requested == ["asymmetric", "few", "asymmetric"]
    requested.clear()
    identify_run([good], model="auto", series_spring=True)
    identify_run([good], model="auto", current="per-current-affine")
    identify_run([good], model="auto", method="c_foa")
    assert requested == ["asymmetric"] * 3  # none of these goes with several models


def test_held_out_equal_to_training_or_to_nothing_is_refused(good: Path) -> None:
    same, none = rig("identify", good, "--holdout", good), rig("identify", good, "--holdout", "waveform=triangle")
    assert (same.returncode, none.returncode) == (6, 6)
    assert "tests used both for the fit and for validation: 4" in same.stderr
    assert "holdout: 'waveform=triangle' matches none of the 4 points" in none.stderr


def test_two_dampers_are_refused_by_their_names_or_named_by_their_forces(good: Path, tmp_path: Path) -> None:
    other = make_run(tmp_path / "b", values=OTHER, specimen="MR-2")
    named = rig("identify", good, other)
    assert named.returncode == 6
    assert "these runs have different specimens (MR-2, imported)" in named.stderr
    held_out = rig("identify", good, "--holdout", other)
    assert held_out.returncode == 6
    assert "these runs have different specimens (MR-2, imported)" in held_out.stderr
    unnamed = rig("identify", good, make_run(tmp_path / "c", values=OTHER, seed=1), "--json")
    fit = json.loads(unnamed.stdout)
    assert not fit["adequate"]
    assert any("two specimens" in text for text in fit["warnings"])


def test_too_few_samples_and_reversed_signs_are_refused(tmp_path: Path) -> None:
    few = rig("identify", make_run(tmp_path / "few", interval_s=0.15, frequencies_Hz=(1.0,)))
    assert few.returncode == 6
    assert "samples in the evaluated cycles, expected 50 or more" in few.stderr
    turned = rig("identify", make_run(tmp_path / "turned", values={name: -value for name, value in DEMO.items()} | {
        "beta": DEMO["beta"], "delta": DEMO["delta"], "eta": DEMO["eta"]
    }, exit_code=5))  # fmt: skip
    assert turned.returncode == 6
    assert "the measured force acts with the motion" in turned.stderr


def test_one_frequency_and_one_current_name_what_they_cannot_determine(tmp_path: Path) -> None:
    answer = rig("identify", make_run(tmp_path / "one", frequencies_Hz=(1.0,), currents_A=(1.0,)), "--json")
    parameters = json.loads(answer.stdout)["parameters"]
    for name, message in (("m", "one frequency"), ("Fyb", "every test ran at 1.00 A"), ("eta", "add a current step")):
        assert not parameters[name]["identifiable"]
        assert parameters[name]["low"] is None
        assert message in parameters[name]["reason"]
