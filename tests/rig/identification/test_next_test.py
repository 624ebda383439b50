"""The proposed test does what it promises, and is one the machine can run."""

import dataclasses
import math
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rig.bench.model import Bench
from rig.dampers import model, parameter_set
from rig.identification import Fit, Measurement, identify
from rig.identification.next_test import bench_of, envelope_of, next_tests
from rig.matrix.model import load_matrix
from rig.matrix.plan import plan

Make = Callable[..., list[Measurement]]
DEMO = dict(parameter_set("demo").values)
EXAMPLES = Path(__file__).parents[3] / "examples"


def proposed(fit: Fit) -> tuple[float, float, float]:
    """Amplitude (m), frequency (Hz) and current (A) of the first proposal, from its matrix lines."""
    (point,) = tomllib.loads(fit.next_tests[0].toml)["point"]
    mm, hertz, amperes = (point[key].split() for key in ("amplitude", "frequency", "current"))
    assert (mm[1], hertz[1], amperes[1]) == ("mm", "Hz", "A")
    return float(mm[0]) / 1e3, float(hertz[0]), float(amperes[0])


def run(amplitude_m: float, frequency_Hz: float, current_A: float) -> Measurement:
    """Eight cycles of a new test of the demo damper with 5 N of noise."""
    t = np.arange(round(8 / frequency_Hz * 250)) / 250.0 + 0.0013
    omega = 2.0 * np.pi * frequency_Hz
    u, v = amplitude_m * np.sin(omega * t), amplitude_m * omega * np.cos(omega * t)
    amps = np.full_like(t, current_A)
    force = model("asymmetric").force(DEMO, u, v, -(omega**2) * u, amps, 0.004)
    force += np.random.default_rng(8).normal(0.0, 5.0, t.size)
    per_cycle = round(250 / frequency_Hz)
    return Measurement("new", u, v, -(omega**2) * u, force, amps, 0.004, noise_N=5.0, samples_per_cycle=per_cycle)


def test_the_interval_shrinks_as_promised(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 1.0), (1.0, 2.0))
    before = identify(tests)
    promised = before.next_tests[0]
    after = identify([*tests, run(*proposed(before))])
    now, expected = after.parameters[promised.parameter].standard_error, promised.expected_error
    assert now == pytest.approx(expected, rel=0.15)
    assert now < 0.9 * promised.standard_error  # type: ignore[operator] - identifiable


@pytest.mark.parametrize("limit", ["speed_m_s", "acceleration_m_s2", "force_N"])
def test_nothing_is_proposed_under_a_limit_that_is_no_number(make_synthetic: Make, limit: str) -> None:
    tests = make_synthetic(DEMO, (0.0, 1.0), (1.0,))
    fit, unlimited = identify(tests), envelope_of(tests)
    assert next_tests(model("asymmetric"), fit, tests, unlimited)
    unknown = dataclasses.replace(unlimited, **{limit: math.nan})
    assert not next_tests(model("asymmetric"), fit, tests, unknown)


def test_the_worst_parameter_is_the_one_nothing_is_known_of(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 1.0), (1.0,))
    before = identify(tests)
    assert before.next_tests[0].parameter == "m"
    after = identify([*tests, run(*proposed(before))])
    assert after.parameters["m"].identifiable
    assert after.parameters["m"].low < DEMO["m"] < after.parameters["m"].high  # type: ignore[operator] - identifiable


def test_without_a_bench_the_proposal_stays_inside_what_was_tested(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 1.0), (1.0, 2.0))
    allowed = envelope_of(tests)
    amplitude_m, frequency_Hz, current_A = proposed(identify(tests))
    assert 2.0 * np.pi * frequency_Hz * amplitude_m <= allowed.speed_m_s
    assert amplitude_m <= 1.005 * allowed.amplitude_m
    assert current_A <= allowed.current_A == pytest.approx(1.0)


def test_with_a_bench_the_lines_are_ready_to_run_on_it(make_synthetic: Make, tmp_path: Path) -> None:
    shutil.copy(EXAMPLES / "paper-bench.toml", tmp_path / "bench.toml")
    shutil.copy(EXAMPLES / "table1.toml", tmp_path / "matrix.toml")
    fit = identify(make_synthetic(DEMO, (0.0, 1.0), (1.0, 2.0)), allowance=bench_of(tmp_path))
    assert {each.parameter for each in fit.next_tests} >= {"eta"}
    head = '[specimen]\nserial_number = "MR-001"\nstroke = "170 mm"\nprior = "demo"\n'
    lines = "".join(each.toml for each in fit.next_tests)
    (tmp_path / "next.toml").write_text(f"format = 1\n{head}{lines}", encoding="utf-8")
    ready = plan(load_matrix(tmp_path / "next.toml"), Bench.load(tmp_path / "bench.toml"))
    assert len(ready.points) == 2
    assert ready.feasible


def test_tests_from_elsewhere_have_no_bench(tmp_path: Path) -> None:
    assert bench_of(tmp_path) is None
