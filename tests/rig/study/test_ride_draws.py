"""Where a fit is not adequate, a ride's dampers come from its tests drawn again."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from rig import dampers
from rig.identification import identify_run
from rig.recording.importing import import_tests
from rig.study.ride_draws import drawn_again
from rig.vehicle.fitted_damper import fitted_damper

COLUMNS = {"time": "t:s", "displacement": "x:m", "force": "F:N", "current": "I:A"}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six sines of the damper `demo`, whose hysteresis no Bingham damper has, fitted by that model."""
    folder, files = tmp_path_factory.mktemp("tests"), []
    known = dampers.parameter_set("demo")
    model = dampers.model(known.model)
    random = np.random.default_rng(3)
    for frequency_Hz in (0.5, 1.0, 2.0):
        for current_A in (0.5, 1.5):
            step_s = 1.0 / (200.0 * frequency_Hz)
            time_s = np.arange(0.0, 6.0 / frequency_Hz, step_s)
            angle = 2.0 * np.pi * frequency_Hz
            x = 0.02 * np.sin(angle * time_s)
            v, a = 0.02 * angle * np.cos(angle * time_s), -(angle**2) * x
            force_N = model.force(known.values, x, v, a, current_A, step_s) + random.normal(0.0, 3.0, len(x))
            file = folder / f"sine{frequency_Hz:g}_{current_A:g}.csv"
            table = np.column_stack([time_s, x, force_N, np.full_like(x, current_A)])
            np.savetxt(file, table, "%.7g", ",", header="t,x,F,I", comments="")
            files.append(file)
    made = import_tests(files, columns=COLUMNS, out=folder)
    identify_run([made], model="bingham")
    return made


def test_the_draws_of_an_inadequate_fit_are_those_of_its_tests(run: Path) -> None:
    fitted = fitted_damper(str(run), 8)
    assert fitted.adequate is False
    again = drawn_again(fitted, 8, seed=1)
    assert len(again.draws) == 20, "fewer say nothing of an interval"
    assert again.damper == fitted.damper
    assert "fits to the 6 tests" in again.remark
    spread = np.std([draw.values["c0"] for draw in again.draws])
    reported = np.std([draw.values["c0"] for draw in fitted_damper(str(run), 200).draws])
    assert spread > 0.5 * reported
    drawn = [draw.values["c0"] for draw in again.draws]
    assert np.mean(drawn) == pytest.approx(fitted.damper.values["c0"], abs=3.0 * spread)
    assert drawn_again(fitted, 8, seed=1).draws == again.draws


def test_held_out_tests_are_not_drawn(run: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(run, tmp_path / "run")
    identify_run([copy], model="bingham", holdout="frequency_Hz=2")
    assert "fits to the 4 tests" in drawn_again(fitted_damper(str(copy), 8), 8, seed=1).remark


def test_whatever_has_no_tests_beside_it_is_left_as_it_is(run: Path, tmp_path: Path) -> None:
    alone = tmp_path / "fit.json"
    alone.write_bytes((run / "fit.json").read_bytes())
    fitted = fitted_damper(str(alone), 8)
    assert drawn_again(fitted, 8, seed=1) is fitted
    none = fitted_damper(str(run), 0)
    assert drawn_again(none, 0, seed=1) is none
    by_name = fitted_damper("demo", 8)
    assert drawn_again(by_name, 8, seed=1) is by_name
