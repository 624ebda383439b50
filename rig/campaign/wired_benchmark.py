"""The hybrid benchmark over the simulated rig's wires: the structure here, the transfer system behind Modbus TCP.

The plant is the one of the in-process tests, in a separate process (`simulators.plant.transfer`). Each step is one
request of the driver that is used for real controllers (FC23: the set-point computed from the previous answer is
written, position and force are read): so a command arrives one step after the measurement it follows from, plus the
latency of wires, host and devices. The controller's lease, limits and watchdog are as in a campaign; station, load cell
and coil are not used.
"""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from drivers.catalogue import make_actuator
from drivers.connection import ActuatorConnection
from drivers.errors import DriverError
from drivers.roles import Actuator, ActuatorLimits, ActuatorStatus, Command, State, WatchdogAction
from drivers.setpoint_generator import Setpoint
from drivers.streamed_actuator import StreamedActuator
from rig.bench.model import Bench
from rig.campaign.results import CampaignOptions
from rig.campaign.simulated_rig import STREAMED, SimulatedRig
from rig.clock import monotonic_ns
from rig.errors import Refused
from rig.hybrid.benchmark import Result, result_over
from rig.hybrid.earthquake import Earthquake
from rig.hybrid.transfer_system import ACTUATOR_CAPACITY_N, TransferSystem, perturbed
from rig.hybrid.virtual_test import Benchmark, StepwiseTest, VirtualTest
from rig.matrix.sections import Specimen

RATE_Hz = 250
LATENCY_STEPS = 1
LATE_S = 0.002
OWNER = 1
READY_S = 5.0
LOOK_S = 0.01
WATCHDOG_MS = 1000
PATIENCE_S = 0.5
"""An answer may take so long; one that takes longer than a step makes those after it late, which are counted."""
LIMITS = ActuatorLimits(-0.05, 0.05, 0.8, 60.0, 2.0 * ACTUATOR_CAPACITY_N, 1.0, 20.0, WATCHDOG_MS,
                        WatchdogAction.FADE_AND_HOLD)  # fmt: skip
QUIET = ("position_input.noise=0.0", "position_input.resolution=0.0", "position_input.bandwidth_Hz=2000.0",
         "force_input.noise=0.0", "force_input.resolution=0.0", "force_input.bandwidth_Hz=2000.0",
         "load_cell.range=40000.0", "limits.force_N=20000.0")  # fmt: skip
"""Of the controller's inputs: the benchmark brings its own noise."""


@dataclass
class WireCount:
    """How the steps of all tests went.

    Attributes:
        steps: requests that were due.
        late_steps: sent more than 2 ms after their time, or left out.
        lateness_s: of those sent, s.
    """

    steps: int = 0
    late_steps: int = 0
    lateness_s: list[float] = field(default_factory=list, repr=False)

    def sent(self, late_s: float, left_out: int) -> None:
        """One was sent so much after its time, and so many before it were left out."""
        self.steps += 1 + left_out
        self.late_steps += left_out + (late_s > LATE_S)
        self.lateness_s.append(late_s)

    def to_json(self) -> dict[str, Any]:
        """For `wires` of `rig benchmark --wires --json`."""
        ordered = sorted(self.lateness_s)
        return {
            "steps": self.steps, "late_steps": self.late_steps,
            "p99_step_ms": 1e3 * ordered[int(0.99 * (len(ordered) - 1))] if ordered else None,
            "worst_step_ms": 1e3 * ordered[-1] if ordered else None,
        }


class Replies:
    """The motion that is streamed: the last command, until the test is over."""

    fastest_m_s = math.inf

    def __init__(self) -> None:
        self.command_m = 0.0
        self.over = False

    def at(self, elapsed_s: float) -> Setpoint | None:
        """The set-point now; a held command, as the benchmark's converter holds it."""
        del elapsed_s
        return None if self.over else Setpoint(self.command_m, 0.0)


def through(driver: StreamedActuator, test: StepwiseTest, count: WireCount) -> None:
    """Run a test on a controller that holds under pressure; it holds again in the end.

    A step that was missed is computed with what is measured at the next one.

    Raises:
        DriverError: the controller cannot be reached, or refuses.
    """
    replies, step_ns, fed = Replies(), round(1e9 / RATE_Hz), 0
    driver.compute(replies)
    due_ns = monotonic_ns() + step_ns
    while not test.over:
        left_s = 1e-9 * (due_ns - monotonic_ns())
        if left_s > 0.0:
            time.sleep(left_s)
        late_ns = max(0, monotonic_ns() - due_ns)
        left_out = late_ns // step_ns
        count.sent(1e-9 * (late_ns - left_out * step_ns), left_out)
        fed += 1
        status = driver.exchange(fed % 0x10000)
        for _ in range(left_out + 1):
            replies.command_m = test.step(status.position_m, status.force_N)
        due_ns += (left_out + 1) * step_ns
    replies.command_m, replies.over = 0.0, True
    driver.exchange(fed % 0x10000 + 1)


def hold_under_pressure(driver: Actuator) -> None:
    """Take the controller, give it its limits, and bring it to hold under pressure.

    Raises:
        Refused: it does not come to that.
        DriverError: it cannot be reached, or refuses.
    """
    driver.read_status()
    driver.send(Command.ACQUIRE)
    _await(driver, "the lease", lambda status: status.owner == OWNER)
    driver.write_limits(LIMITS)
    driver.send(Command.HYDRAULICS_LOW)
    _await(driver, "low pressure", lambda status: status.state == State.LOW)
    driver.send(Command.HYDRAULICS_ON)
    _await(driver, "the pressure", lambda status: status.state == State.HOLD)


def _await(driver: Actuator, what: str, true: Callable[[ActuatorStatus], bool]) -> None:
    """Feed the controller until its status says so.

    Raises:
        Refused: it does not.
    """
    last_ns, fed = monotonic_ns() + int(READY_S * 1e9), 0
    while True:
        fed += 1
        if true(driver.exchange(fed)):
            return
        if monotonic_ns() > last_ns:
            raise Refused("controller-refused", f"{what} not received within {READY_S:g} s")
        time.sleep(LOOK_S)


def simulator_arguments(plant: TransferSystem) -> tuple[str, ...]:
    """Arguments with which `python -m simulators` is this transfer system behind a controller that follows."""
    options = [*QUIET, *(f"transfer.{name}={value!r}" for name, value in asdict(plant).items())]
    words = (word for option in options for word in ("--option", option))
    return ("--actuator", STREAMED, "--real-time", "--drop-unread", *words)


def run_at(url: str, test: StepwiseTest, count: WireCount) -> None:
    """Run a test on the controller at an address; the pressure is off in the end.

    Raises:
        Refused: the controller does not come to hold.
        DriverError: it cannot be reached, or refuses.
    """
    driver = make_actuator("demo-streamed", ActuatorConnection(url, timeout_s=PATIENCE_S, owner_id=OWNER))
    if not isinstance(driver, StreamedActuator):
        raise Refused("controller-refused", "the controller generates the motion itself and does not accept set-points")
    driver.open()
    try:
        hold_under_pressure(driver)
        through(driver, test, count)
        driver.send(Command.HYDRAULICS_OFF)
        driver.send(Command.RELEASE)
    finally:
        driver.close()


class Wires:
    """Runs the benchmark's tests, each on a simulated rig of its own.

    Attributes:
        count: how the steps went, all tests together.
    """

    def __init__(self) -> None:
        self.count = WireCount()

    def results(
        self, cases: Sequence[int], compensators: Sequence[str], earthquake: Earthquake, plants: int, seed: int
    ) -> Iterator[Result]:
        """Run these cases, one result at a time; arguments as of `rig.hybrid.benchmark.run_benchmark`.

        Raises:
            Refused: the simulated rig does not start, does not come to hold, or does not answer any more.
        """
        for case in cases:
            problem = Benchmark(case, RATE_Hz, earthquake, LATENCY_STEPS)
            for compensator in compensators:
                yield result_over(problem, case, compensator, (perturbed(plants, seed), seed), self._run)

    def _run(self, problem: Benchmark, compensator: str, plant: TransferSystem, seed: int) -> VirtualTest:
        test = StepwiseTest(problem, compensator, plant, seed)
        with tempfile.TemporaryDirectory(prefix="hybrid-benchmark-") as name:
            folder = Path(name)
            options = CampaignOptions(
                folder, folder, simulate=True, seed=seed, simulator_args=simulator_arguments(plant)
            )
            specimen = Specimen.model_validate({"serial_number": "benchmark", "stroke": "170 mm"})
            simulated = SimulatedRig.start(folder, options, specimen, lambda _: None)
            try:
                run_at(Bench.load(simulated.bench_path).actuator.url, test, self.count)
            except DriverError as error:
                raise Refused("no-answer", f"the simulated rig failed after {test.steps} steps: {error}") from error
            finally:
                simulated.stop()
        return test.result(test.steps)
