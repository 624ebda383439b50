"""A damaged or hand-edited `fit.json` ends every command that reads one with a message that names key and value."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.cli.main import main
from rig.errors import FileProblem
from rig.fits.fit_file import FIX, fit_of
from rig.fits.fit_record import FitRecord
from rig.identification import Fit, identify_run
from rig.recording.importing import import_tests
from rig.report import fit as fit_part
from rig.vehicle.fitted_damper import fitted_damper

COLUMNS = {"time": "t_s", "displacement": "x_mm", "force": "F_N"}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of four tests with its fit, diagnosis, bootstrap and profiles included."""
    folder, random = tmp_path_factory.mktemp("run"), np.random.default_rng(1)
    for name, amplitude_m, frequency_Hz in (("a", 0.02, 1.0), ("b", 0.02, 2.0), ("c", 0.01, 1.0), ("d", 0.03, 1.5)):
        t = np.arange(0.0, 4.0 / frequency_Hz, 0.004)
        x_m = amplitude_m * np.sin(math.tau * frequency_Hz * t)
        v_m_s = np.gradient(x_m, t)
        force_N = 600.0 * v_m_s + 150.0 * np.tanh(v_m_s / 0.02) + 400.0 * x_m + random.normal(0.0, 2.0, t.size)
        np.savetxt(folder / f"{name}.csv", np.column_stack([t, 1e3 * x_m, force_N]), "%.6f", ",",
                   header="t_s,x_mm,F_N", comments="")  # fmt: skip
    made = import_tests(sorted(folder.glob("*.csv")), columns=COLUMNS, out=folder, current_A=0.0)
    identify_run([made], model="asymmetric", diagnose=True, bootstrap=20, profile=("beta",), holdout="id=d")
    return made


def leaves(value: object, place: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """The place of every key and the first entry of every list."""
    if isinstance(value, dict):
        for name, one in value.items():
            yield (*place, name)
            yield from leaves(one, (*place, name))
    elif isinstance(value, list) and value:
        yield (*place, 0)
        yield from leaves(value[0], (*place, 0))


def changed(content: dict[str, Any], place: tuple[str | int, ...], value: object) -> dict[str, Any]:
    made = copy.deepcopy(content)
    inside: Any = made
    for name in place[:-1]:
        inside = inside[name]
    if value is KeyError:
        del inside[place[-1]]
    else:
        inside[place[-1]] = value
    return made


def test_a_fit_as_written_has_the_shape_of_a_fit(run: Path) -> None:
    written = json.loads((run / "fit.json").read_text(encoding="utf-8"))
    assert json.loads(json.dumps(FitRecord.load(run).to_json())) == written


def problems_of(content: dict[str, Any]) -> list[str]:
    """What is wrong with an object; what is not wrong is read and can be written."""
    try:
        fit = fit_of(FitRecord, content)
    except FileProblem as problem:
        return [line for line in problem.problems if line != FIX]
    json.dumps(fit.to_json(), allow_nan=False)
    return []


def test_what_passes_the_check_is_read_and_what_does_not_names_its_key(run: Path) -> None:
    content = json.loads((run / "fit.json").read_text(encoding="utf-8"))
    values = (KeyError, None, "text", math.nan, -1e999, [], {}, True, 3)
    refused = 0
    for number, place in enumerate(leaves(content)):
        made = changed(content, place, values[number % len(values)])
        problems = problems_of(made)
        refused += bool(problems)
        assert all(": " in line for line in problems)
    assert refused > 100


EDITS = {
    "missing": (("parameters",), KeyError, "parameters: is missing"),
    "text": (("parameters", "Ca_plus", "value"), "12", "parameters.Ca_plus.value: got '12', expected a number"),
    "NaN": (("parameters", "Ca_plus", "low"), math.nan, "parameters.Ca_plus.low: got nan, expected a finite number"),
    "list": (("error", "per_test"), {"a": 1}, "error.per_test: got dict {'a': 1}, expected a list"),
    "other": (("parameters",), [1, 2], "parameters: got list [1, 2], expected an object"),
}


@pytest.mark.parametrize(("place", "value", "message"), EDITS.values(), ids=EDITS)
def test_the_message_names_file_key_value_and_way_out(
    run: Path, tmp_path: Path, place: tuple[str, ...], value: object, message: str
) -> None:
    content = json.loads((run / "fit.json").read_text(encoding="utf-8"))
    (tmp_path / "fit.json").write_text(json.dumps(changed(content, place, value)), encoding="utf-8")
    for read in (Fit.load, FitRecord.load, lambda path: fitted_damper(str(path), 0)):
        with pytest.raises(FileProblem) as refused:
            read(tmp_path / "fit.json")
        assert f"fit.json: {message}" in str(refused.value)
        assert "Fix: identify the run again" in str(refused.value)


def test_every_command_refuses_it_as_bad_input(
    run: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    good = (run / "fit.json").read_text(encoding="utf-8")
    place, value, message = EDITS["text"]
    try:
        (run / "fit.json").write_text(json.dumps(changed(json.loads(good), place, value)), encoding="utf-8")
        for arguments in (
            ["report", str(run)], ["compare", str(run), str(run)], ["ride", str(run)],
            ["export", str(run), "--to", "json", "--out", str(tmp_path / "a")],
            ["export", str(run), "--to", "inverse", "--out", str(tmp_path / "b")],
        ):
            capfd.readouterr()
            assert main(arguments) == 2, arguments
            reported = capfd.readouterr().err
            assert "fit.json" in reported
            assert message in reported, arguments
            assert "Fix: identify the run again" in reported
    finally:
        (run / "fit.json").write_text(good, encoding="utf-8")


def test_no_json_and_an_unknown_model_name_file_and_way_out(
    run: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    good = (run / "fit.json").read_text(encoding="utf-8")
    for damaged, message in (
        (good[: len(good) // 2], "not valid JSON"),
        (json.dumps({**json.loads(good), "model": "nope"}), "model: unknown damper model 'nope'"),
    ):
        folder = tmp_path / str(len(damaged))
        folder.mkdir()
        (folder / "fit.json").write_text(damaged, encoding="utf-8")
        for arguments in (
            ["ride", str(folder)], ["export", str(folder), "--to", "table", "--out", str(folder / "a")],
        ):
            capfd.readouterr()
            assert main(arguments) == 2, arguments
            reported = capfd.readouterr().err
            assert f"{folder / 'fit.json'}: {message}" in reported
            assert "Fix: identify the run again" in reported


UNSEEN_TEST = {"id": "a", "amplitude_m": 0.01, "frequency_Hz": 1.0, "current_A": 0.0, "nrmse_percent_of_peak": None}
UNSEEN = {
    "split": "leave-one-pair-out", "per_test": [UNSEEN_TEST],
    "per_pair": [{"amplitude_m": 0.01, "frequency_Hz": 1.0, "tests": 1, "nrmse_percent_of_peak": None,
                  "r_squared": None}],
}  # fmt: skip


def test_the_report_of_a_fit_that_passes_the_check_can_be_made(run: Path) -> None:
    content = json.loads((run / "fit.json").read_text(encoding="utf-8"))
    rows = {name: {} for name in content["correlation"]}
    made = fit_of(FitRecord, {**content, "unseen": UNSEEN, "correlation": rows})
    assert fit_part.parameters(made)
    assert fit_part.quality(made)
    for key in ("amplitude_m", "frequency_Hz", "current_A"):
        without = {**UNSEEN, "per_test": [{name: value for name, value in UNSEEN_TEST.items() if name != key}]}
        assert problems_of({**content, "unseen": without}) == [f"unseen.per_test[0].{key}: is missing"]
    open_ended = changed(content, ("profiles", "beta", "high"), KeyError)
    assert problems_of(open_ended) == ["profiles.beta.high: is missing"]
