"""The hybrid benchmark through Modbus in virtual time: 250 requests a second, the transfer system behind them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scenario_campaign import simulated_rig

from rig.bench.model import Bench
from rig.campaign.wired_benchmark import LATENCY_STEPS, RATE_Hz, WireCount, run_at, simulator_arguments
from rig.hybrid.criteria import criteria
from rig.hybrid.earthquake import Earthquake, synthesised
from rig.hybrid.transfer_system import perturbed
from rig.hybrid.virtual_test import Benchmark, StepwiseTest, VirtualTest
from simulators.scenarios.stage import Stage

SECONDS = 3.0


def strong() -> Earthquake:
    """The strongest seconds of the synthesised one."""
    whole = synthesised()
    first = round(3.0 / whole.step_s)
    taken = slice(first, first + round(SECONDS / whole.step_s))
    return Earthquake("strong seconds", whole.step_s, whole.acceleration_m_s2[taken])


def wired(folder: Path, problem: Benchmark, number: int) -> tuple[VirtualTest, WireCount]:
    """A test in a world whose devices hand over every millisecond."""
    plant = perturbed(3, 2020)[number]
    with Stage(1, folder, tick_s=0.001) as stage:
        test, count = StepwiseTest(problem, "adaptive-model", plant, 2020 + number), WireCount()
        bench = stage.serve(simulated_rig(*simulator_arguments(plant), truth=None))
        url = Bench.load(bench).actuator.url
        process = stage.machine.start("application", lambda: run_at(url, test, count))
        stage.kernel.run(lambda: not process.alive)
        assert not process.errors, process.errors
        assert not stage.rig.plant.command["pressure"][0]
    return test.result(test.steps), count


@pytest.mark.nightly
@pytest.mark.apart
def test_the_structure_answers_through_the_wires_as_in_process(tmp_path: Path) -> None:
    problem = Benchmark(1, RATE_Hz, strong(), LATENCY_STEPS)
    test, count = wired(tmp_path, problem, 1)
    assert test.stopped_s is None
    assert count.steps == pytest.approx(SECONDS * RATE_Hz, abs=10)
    assert count.late_steps == 0
    here = problem.test("adaptive-model", perturbed(3, 2020)[1], 2021)
    on_wires, in_process = (
        criteria(each.floors_m, each.measured_m, each.reference_m, each.step_s) for each in (test, here)
    )
    assert in_process["J2"] < 5.0
    assert on_wires["J2"] <= 5.0
    assert on_wires["J4"] <= 20.0
    assert np.max(np.abs(test.floors_m[:, 0])) == pytest.approx(np.max(np.abs(here.floors_m[:, 0])), rel=0.1)
