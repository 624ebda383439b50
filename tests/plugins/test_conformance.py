"""The conformance suite as an author runs it: what is good passes, what is bad fails by the test that is about it."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from conftest import Install

BAD = '''
"""A method that looks beyond the bounds and draws by a chance of its own; a model that gives energy."""
from dataclasses import dataclass
import numpy as np
from rig.dampers.plastic import BinghamModel

@dataclass(frozen=True)
class Method:
    step: float = 50.0

    def run(self, search):
        while True:
            shape = (search.population, search.n_parameters)
            search.evaluate(self.step * np.random.default_rng().standard_normal(shape))

class Model(BinghamModel):
    name = "bad_model"
    demonstration = {**BinghamModel.demonstration, "c0": -900.0}
'''
BAD_DRIVER = '''
"""A sensor's driver that repeats what came last when nothing comes, and swallows what its port says."""
from drivers.catalogue import make_sensor
from drivers.errors import DriverError
from dataclasses import replace

class Driver:
    simulated_as = "frame16"

    def __init__(self, connection):
        self.inner = make_sensor(replace(connection, format="frame16"))
        self.last = None

    def __getattr__(self, name):
        return getattr(self.inner, name)

    def read_batch(self, timeout_s):
        try:
            batch = self.inner.read_batch(timeout_s)
        except DriverError:
            return self.last
        if batch.records:
            self.last = batch
        return self.last or batch
'''


def tried(folder: Path, *arguments: str) -> tuple[int, set[str], str]:
    """Exit code, names of the tests that failed, and what was said."""
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--pyargs", "rig.conformance"]
    done = subprocess.run(
        [*command, *arguments], cwd=folder, capture_output=True, text=True, check=False, timeout=300,
        env={"PYTHONPATH": str(folder), "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    message = done.stdout + done.stderr
    return done.returncode, set(re.findall(r"^FAILED \S+::(\w+)", message, re.MULTILINE)), message


def test_a_good_method_and_a_good_model_pass(my_lab: Path) -> None:
    code, failed, message = tried(my_lab, "--method", "my_lab_shrinking", "--model", "kwok")
    assert (code, failed) == (0, set()), message
    assert "29 passed" in message


@pytest.mark.nightly
def test_a_bad_method_and_a_bad_model_fail_by_name(install: Install) -> None:
    methods, models = {"bad_method": "bad_lab:Method"}, {"bad_model": "bad_lab:Model"}
    folder = install("bad-lab", {"mr_rig.methods": methods, "mr_rig.damper_models": models}, BAD)
    code, failed, message = tried(folder, "--method", "bad_method", "--model", "bad_model")
    assert code == 1, message
    assert {
        "test_no_candidate_leaves_the_bounds", "test_a_settled_cycle_takes_energy_out",
        "test_the_same_seed_gives_the_same_result_and_another_seed_another",
        "test_it_improves_on_a_bowl_whose_bottom_is_known",
    } == failed, message


def test_what_is_not_named_or_not_known_is_a_usage_error(tmp_path: Path) -> None:
    code, _, message = tried(tmp_path)
    assert code == 4
    assert "specify what to test: --driver NAME, --model NAME or --method NAME" in message
    code, _, message = tried(tmp_path, "--driver", "mine")
    assert code == 4
    assert "--driver mine: unknown driver; known drivers: " in message
    assert " actuator:demo, " in message
    assert {"current source:demo", "frame16"} <= set(message.strip().partition("known drivers: ")[2].split(", "))


@pytest.mark.nightly
@pytest.mark.wire
def test_a_driver_that_repeats_old_values_and_swallows_errors_fails_by_name(install: Install) -> None:
    folder = install("bad-lab", {"mr_rig.sensors": {"bad_cell": "bad_lab:Driver"}}, BAD_DRIVER)
    code, failed, message = tried(folder, "--driver", "bad_cell", "-k", "silence or pulled or calibration")
    assert code == 1, message
    assert failed >= {
        "test_silence_is_an_empty_batch_in_time_and_never_an_old_value", "test_a_pulled_cable_raises",
    }, message
    assert "1 passed" in message
