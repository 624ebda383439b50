"""An analogue output that commands the coil's current, as data: the registers of an output module on Modbus.

The module's output drives a current amplifier; where its own file, or that of the actuator's controller, names a
register that shows what flows, the current is measured, otherwise it is what was written.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.register_maps.access_plan import Read, Rules, reads
from drivers.register_maps.meanings import Bits
from drivers.register_maps.quantity import Quantity, Value
from drivers.register_maps.recipe import Recipe

CURRENT, MEASURED, ENABLE, FAULT_BITS = "current", "measured_current", "enable", "fault_bits"
IDENTITY = ("vendor", "model", "serial_number", "firmware")


@dataclass(frozen=True)
class OutputWatchdog:
    """The module's own time-out: its output goes to 0 A when nothing is asked of it for `time_s` (s).

    `start` sets it up, `stop` ends it, `feed` keeps it quiet; without a `feed` every request does.
    """

    time_s: float
    start: Recipe = ()
    stop: Recipe = ()
    feed: Recipe = ()


@dataclass(frozen=True)
class AnalogueOutput:
    """The registers of one kind of module.

    Attributes:
        quantities: by name; `current` is the set-point (A).
        rules: what may be read together.
        expected: what proves that it is this module: quantity and what it must show.
        faults: bits or conditions that mean faults of the source (`drivers.current_source.SourceFault`).
        prepare: written once before the current is set for the first time.
        watchdog: None: it has no time-out of its own.
    """

    quantities: Mapping[str, Quantity]
    rules: Rules
    expected: Mapping[str, Value]
    faults: Bits
    prepare: Recipe = ()
    watchdog: OutputWatchdog | None = None

    @property
    def current(self) -> Quantity:
        """The set-point."""
        return self.quantities[CURRENT]

    @property
    def steps_A(self) -> tuple[float, float]:
        """Resolution (A) of the set-point and of the measured current; 0 for one that is not measured."""
        return self.current.step, self.quantities[MEASURED].step if self.measures else 0.0

    @property
    def measures(self) -> bool:
        """It tells what flows, not only what was written."""
        return MEASURED in self.quantities

    @property
    def known(self) -> tuple[Read, ...]:
        """What is read once: who it is."""
        names = {*IDENTITY, *self.expected} & self.quantities.keys()
        return reads([self.quantities[name] for name in names], self.rules)

    @property
    def status(self) -> tuple[Read, ...]:
        """What is read at every poll; something at least, by which it is heard at all."""
        names = [name for name in (CURRENT, MEASURED, ENABLE, FAULT_BITS) if name in self.quantities]
        quantities = {self.quantities[name] for name in names if self.quantities[name].read} | self.faults.quantities
        if not quantities:
            quantities = {one for one in self.quantities.values() if one.read and one.type != "string"}
        return reads(quantities or self.quantities.values(), self.rules)


def output_missing(output: AnalogueOutput) -> tuple[tuple[str, bool, str], ...]:
    """What an output can do: a name, whether it can, and what is left without it, in words."""
    return (
        ("timeout", output.watchdog is not None,
         "no output watchdog is specified ([watchdog]): if this host or the link fails, the output keeps its "
         "value and the current flows until the amplifier is switched off; the actuator's own watchdog still stops "
         "the motion"),
        ("measurement", output.measures,
         "the coil current is not measured: the recorded current is the set-point that the module accepted; a "
         "different current (due to the amplifier, the scale or a broken coil) is not detected, and overcurrent and "
         "current-stuck cannot stop the rig"),
        ("read-back", output.current.read,
         "the set-point cannot be read back: the only confirmation, even of 0 A after a stop, is the module's "
         "answer to the write"),
        ("enable", ENABLE in output.quantities,
         "a stop does not switch the output off: it commands 0 A, and any offset current of the amplifier continues "
         "to flow"),
        ("coil-temperature", False,
         "the coil's temperature is not measured: its limit is not monitored, and temperature windows are rejected"),
        ("faults", bool(output.faults.quantities), "the module's own faults are not detected"),
        ("identity", bool(output.expected) or "serial_number" in output.quantities,
         "the module's identity cannot be checked against the bench file"),
    )  # fmt: skip
