"""The whole benchmark: cases, rates and compensators, each over the same perturbed transfer systems."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rig.hybrid.building import Specimen, computed_part
from rig.hybrid.compensators import OWN
from rig.hybrid.criteria import criteria
from rig.hybrid.delay_margin import critical_delay_s
from rig.hybrid.earthquake import Earthquake
from rig.hybrid.published import CRITERIA, required_percent, sample_controller
from rig.hybrid.transfer_system import TransferSystem, perturbed
from rig.hybrid.virtual_test import Benchmark, VirtualTest

RATES_Hz = (4096, 1024, 250)
Run = Callable[[Benchmark, str, TransferSystem, int], VirtualTest]
"""One test: problem, compensator, transfer system, seed of the noise."""


@dataclass(frozen=True)
class Result:
    """One case, rate and compensator over the perturbed transfer systems.

    Attributes:
        case: 1 to 4.
        rate_Hz: of the computed part, the sensors and the commands.
        compensator: one of `rig.hybrid.compensators.NAMES`.
        plants: transfer systems tried.
        stopped: of these, so many ended early because the actuator's capacity was exceeded.
        first_stop_s: the earliest of these ends, s; None without one.
        criteria: mean J1 to J9 over the tests that went through; empty where none did.
        worst: the largest of each.
        critical_delay_ms: how late the nominal specimen's force may be before the loop is unstable.
    """

    case: int
    rate_Hz: int
    compensator: str
    plants: int
    stopped: int
    first_stop_s: float | None
    criteria: dict[str, float]
    worst: dict[str, float]
    critical_delay_ms: float = math.inf

    @property
    def published(self) -> dict[str, float]:
        """The paper's criteria of the same: of its sample controller at 4,096 Hz; empty for others."""
        same = self.compensator == "sample" and self.rate_Hz == RATES_Hz[0]
        return sample_controller(self.case) if same else {}

    @property
    def required(self) -> dict[str, float]:
        """Limits in % on means, for this project's own compensator; empty for others."""
        return required_percent(self.case, self.rate_Hz) if self.compensator == OWN else {}

    @property
    def verdict(self) -> str:
        """`unstable`: a test ended early; `refused`: a limit is exceeded; `good`: none is; empty: none is set."""
        if self.stopped:
            return "unstable"
        if not self.required:
            return ""
        return "good" if all(self.criteria[name] <= limit for name, limit in self.required.items()) else "refused"

    @property
    def refused(self) -> bool:
        """Whether what is asked of this project's own compensator is not reached."""
        return self.compensator == OWN and self.verdict in {"refused", "unstable"}


def run_benchmark(
    problems: Sequence[tuple[int, int]], compensators: Sequence[str], earthquake: Earthquake, plants: int, seed: int,
    latency_steps: int = 0,
) -> Iterator[Result]:  # fmt: skip
    """Run the benchmark, one result at a time.

    Args:
        problems: case of the building (1 to 4) and steps a second (any of `RATES_Hz`) of each.
        compensators: names.
        earthquake: of all tests.
        plants: number of perturbed transfer systems.
        seed: they are drawn with; test number i has sensor noise of seed + i.
        latency_steps: between measuring and the arrival of the command; compensators are told.
    """
    for case, rate_Hz in problems:
        problem = Benchmark(case, rate_Hz, earthquake, latency_steps)
        for compensator in compensators:
            yield result_over(problem, case, compensator, (perturbed(plants, seed), seed))


def result_over(
    problem: Benchmark, case: int, compensator: str, drawn: tuple[list[TransferSystem], int],
    run: Run = Benchmark.test,
) -> Result:  # fmt: skip
    """One case and compensator over transfer systems.

    Args:
        problem: the case under an earthquake at a rate.
        case: its number.
        compensator: by name.
        drawn: the transfer systems, and the seed of the first one's sensor noise.
        run: runs one test; by default in process.
    """
    rows, stops = [], []
    plants, seed = drawn
    for number, plant in enumerate(plants):
        test = run(problem, compensator, plant, seed + number)
        if test.stopped_s is None:
            values = criteria(test.floors_m, test.measured_m, test.reference_m, test.step_s)
            rows.append([values[name] for name in CRITERIA])
        else:
            stops.append(test.stopped_s)
    mean = np.mean(rows, axis=0).tolist() if rows else []
    worst = np.max(rows, axis=0).tolist() if rows else []
    return Result(
        case, problem.rate_Hz, compensator, len(plants), len(stops), min(stops, default=None),
        dict(zip(CRITERIA, mean, strict=False)), dict(zip(CRITERIA, worst, strict=False)),
        1e3 * critical_delay_s(computed_part(problem.whole, Specimen()), Specimen()),
    )  # fmt: skip
