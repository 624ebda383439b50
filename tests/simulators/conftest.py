from __future__ import annotations

from collections.abc import Callable

import demo_registers as wire
import numpy as np
import pytest

from drivers.roles import ActuatorStatus, Command, Result
from simulators.actuator import Actuator
from simulators.clock import DeviceClock
from simulators.options import RigOptions, with_option
from simulators.plant.plant import MAXIMUM_STEPS, Plant
from simulators.registers import registers_of

OWNER = 7


class Bench:
    """A controller on its plant without transports: commands in, registers and recorded motion out."""

    def __init__(self, *assignments: str) -> None:
        options = RigOptions()
        for assignment in assignments:
            options = with_option(options, assignment)
        self.options = options
        self.plant = Plant(options)
        self.log: list[tuple[str, str]] = []
        clock = DeviceClock(0.0, 0.0)
        self.actuator = Actuator(self.plant, options.controller, clock, self._note)
        self.bank = registers_of(self.actuator, options, np.random.default_rng(0))
        self.sequence = 0
        self.events: list[tuple[float, int, float]] = []

    def _note(self, code: str, text: str) -> None:
        self.log.append((code, text))

    def command(self, command: Command, owner: int = OWNER, **values: float) -> Result:
        self.sequence += 1
        fields: dict[str, float] = {"command": command, "sequence": self.sequence, "owner_id": owner, **values}
        assert self.bank.write(wire.COMMAND.address, wire.COMMAND.encode(fields)) is True
        status = self.status()
        assert status.acked_sequence == self.sequence
        return Result(status.result)

    def status(self) -> ActuatorStatus:
        words = self.bank.read(wire.STATUS.address, wire.STATUS.count)
        assert words is not None
        return wire.decode_status(words, 0)

    def run(self, seconds: float) -> np.ndarray:
        """Advance; returns time (s) and the plant's output columns behind it, one row a step."""
        left = round(seconds / self.plant.dt_s)
        rows = []
        while left:
            steps = min(left, MAXIMUM_STEPS)
            self.events += self.plant.advance(steps)
            time_s = (self.plant.first_step + 1 + np.arange(steps)) * self.plant.dt_s
            rows.append(np.column_stack([time_s, self.plant.out]))
            left -= steps
        return np.concatenate(rows)

    def ready(self) -> Bench:
        for command in (Command.ACQUIRE, Command.HYDRAULICS_LOW, Command.HYDRAULICS_ON):
            assert self.command(command) is Result.DONE
        self.run(3.0)
        return self

    def start(self, amplitude: float, frequency: float, cycles: float, waveform: int = 0, **values: float) -> Result:
        program: dict[str, float] = {
            "waveform": waveform, "amplitude": amplitude, "frequency": frequency, "centre": 0.0, "cycles": cycles,
            "ramp_in_cycles": 1.0, "ramp_out_cycles": 1.0,
        }
        return self.command(Command.START, **{**program, **values})


@pytest.fixture
def make_bench() -> Callable[..., Bench]:
    return Bench


@pytest.fixture
def bench() -> Bench:
    return Bench().ready()
