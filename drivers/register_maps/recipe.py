"""Recipes: what a command means to a device, step by step.

    write    these quantities get these values, in one request where they are neighbours
    wait     until the device shows something, at most so long
    pause    so long

A value is a number in the quantity's unit, or the name of what the command is about: "$target", "$amplitude" ...
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from drivers.register_maps.access_plan import Written, writes
from drivers.register_maps.condition import Condition, Values
from drivers.register_maps.quantity import Quantity, Value
from drivers.roles import Command, Move, Program

ANY = ("sequence", "owner", "position")
"""What every command has: its number, this host's id, where the rod is (m)."""
MOVE = ("target", "speed")
PROGRAM = (
    "waveform", "amplitude", "peak_to_peak", "peak_speed", "mean_speed", "frequency", "period", "centre", "low", "high",
    "cycles", "ramp_in_cycles", "ramp_out_cycles", "all_cycles", "duration", "table_length", "table_interval",
)  # fmt: skip
SETPOINT = ("position", "velocity", "sequence", "counter", "toggle")
WATCHDOG = ("counter", "toggle")
TABLE = ("index", "count", "values")
PEAK_SPEED = 6.283185307179586
MEAN_SPEED = 4.0


def names_for(command: Command) -> tuple[str, ...]:
    """What a recipe of this command may ask for, without the "$"."""
    more = {Command.MOVE_TO: MOVE, Command.START: PROGRAM}.get(command, ())
    return (*ANY, *more)


@dataclass(frozen=True)
class Write:
    """Write values; see `access_plan.writes`."""

    values: Mapping[Quantity, Value]
    span: tuple[int, int] | None = None

    def requests(self, given: Values, samples: Sequence[float] = ()) -> tuple[Written, ...]:
        """The requests, with a command's values put in.

        Args:
            given: values by name (SI); what is not among them is 0.
            samples: what stands for "$values" (SI).

        Raises:
            LocalProtocolError: a value does not fit its register.
        """
        filled: dict[Quantity, Value] = {}
        for quantity, value in self.values.items():
            if value == "$values":
                filled |= dict(zip(quantity.elements, samples, strict=False))
            else:
                filled[quantity] = given.get(value[1:], 0) if isinstance(value, str) else value
        return writes(filled, self.span)


@dataclass(frozen=True)
class Wait:
    """Wait until a condition holds, at most `within_s`."""

    condition: Condition
    within_s: float


@dataclass(frozen=True)
class Pause:
    """Do nothing for a while."""

    lasts_s: float


Step = Write | Wait | Pause
Recipe = tuple[Step, ...]


def position_for(recipe: Recipe, position_m: float) -> float:
    """The position (m) nearest to where the rod is that the registers of a recipe can hold.

    A stop must go out wherever the rod is, also beyond the range of the register that the stop writes it to.
    """
    for step in recipe:
        if isinstance(step, Write):
            for quantity, value in step.values.items():
                position_m = quantity.nearest(position_m) if value == "$position" else position_m
    return position_m


def values_of(order: Move | Program | None, codes: Mapping[int, int]) -> dict[str, Value]:
    """What a command is about, by the names of `MOVE` and `PROGRAM` (SI).

    Args:
        order: of the command.
        codes: waveform -> the device's code.
    """
    if order is None:
        return {}
    if isinstance(order, Move):
        return {"target": order.target_m, "speed": order.speed_m_s}
    amplitude_m, frequency_Hz = order.amplitude_m, order.frequency_Hz
    length = order.table_length
    return {
        "waveform": codes.get(int(order.waveform), int(order.waveform)),
        "amplitude": amplitude_m,
        "peak_to_peak": 2.0 * amplitude_m,
        "peak_speed": PEAK_SPEED * amplitude_m * frequency_Hz,
        "mean_speed": MEAN_SPEED * amplitude_m * frequency_Hz,
        "frequency": frequency_Hz,
        "period": 1.0 / frequency_Hz,
        "centre": order.centre_m,
        "low": order.centre_m - amplitude_m,
        "high": order.centre_m + amplitude_m,
        "cycles": order.cycles,
        "ramp_in_cycles": order.ramp_in_cycles,
        "ramp_out_cycles": order.ramp_out_cycles,
        "all_cycles": order.all_cycles,
        "duration": order.all_cycles / frequency_Hz,
        "table_length": length,
        "table_interval": 1.0 / (frequency_Hz * length) if length else 0.0,
    }
