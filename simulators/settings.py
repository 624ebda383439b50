"""Single constants of the simulated rig as options of their own: `--hum "40 N"`, `--servo-stiffness "20 kN/mm"`.

A value is a number with its unit, or a bare number in the unit that the option's help names. What is set here is what
`--option table.key=value` sets, in a user's words. Delays and rates are in simulated time.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import click

from rig import units
from rig.errors import FileProblem
from simulators.options import RigOptions, with_option

_BARE = re.compile(rf"\s*{units.NUMBER}\s*", re.ASCII)


@dataclass(frozen=True)
class Setting:
    """One option of the command line.

    Attributes:
        name: the option without its dashes.
        key: the constant it replaces, `table.key`.
        unit: of a bare number; empty for a pure number.
        low, high: the range, in `unit`.
        text: one line of help.
        per_si: the constant's own unit for one SI unit (1000 for a constant in mm).
    """

    name: str
    key: str
    unit: str
    low: float
    high: float
    text: str
    per_si: float = 1.0

    def value(self, given: str) -> float:
        """The constant for what was written.

        Raises:
            FileProblem: not a number, another quantity's unit, or out of range.
        """
        try:
            number = self._number(given)
        except units.UnitProblem as error:
            raise FileProblem(f"--{self.name}", [f"{given!r}: {error}"]) from None
        if not self.low <= number <= self.high:
            between = f"{self.low:g} to {self.high:g} {self.unit}".strip()
            raise FileProblem(f"--{self.name}", [f"got {given!r}, allowed {between}"])
        return number * self._si_per_unit * self.per_si

    @property
    def _si_per_unit(self) -> float:
        return units.UNITS[self.unit].scale if self.unit else 1.0

    def _number(self, given: str) -> float:
        """The number in `unit`.

        Raises:
            rig.units.UnitProblem: not this quantity.
        """
        if _BARE.fullmatch(given):
            return float(given)
        if not self.unit:
            raise units.UnitProblem("expected a plain number, such as 1.05")
        if self.unit == "K":
            kelvin = given.strip().removesuffix("K")
            if kelvin == given.strip() or not _BARE.fullmatch(kelvin):
                raise units.UnitProblem('expected a temperature difference, such as "-12 K"')
            return float(kelvin)
        return units.parse(given, units.UNITS[self.unit].dimension) / self._si_per_unit


def _input(table: str, quantity: str, unit: str, largest: float) -> tuple[Setting, ...]:
    """What can be wrong with one of the controller's own inputs."""
    name, whose = f"actuator-{quantity}", f"controller's {quantity} input"
    return (
        Setting(f"{name}-delay", f"{table}.delay_s", "ms", 0.0, 100.0,
                f"Undeclared additional delay of the {whose}."),
        Setting(f"{name}-bandwidth", f"{table}.bandwidth_Hz", "Hz", 1.0, 2000.0,
                f"Low-pass bandwidth of the {whose} (delay: bench file)."),
        Setting(f"{name}-gain", f"{table}.gain", "", 0.1, 10.0, f"Gain of the {whose}; 1 is correct."),
        Setting(f"{name}-zero", f"{table}.zero", unit, -largest, largest, f"Zero offset of the {whose}."),
        Setting(f"{name}-noise", f"{table}.noise", unit, 0.0, largest, f"Noise of the {whose} (rms)."),
        Setting(f"{name}-resolution", f"{table}.resolution", unit, 0.0, largest, f"Resolution of the {whose}."),
    )


def _sensor(name: str, table: str, unit: str, per_si: float, largest: float) -> tuple[Setting, ...]:
    """What can be wrong with a sensor."""
    shown = name.replace("-", " ").replace("lvdt", "LVDT")
    return (
        Setting(f"{name}-gain", f"{table}.gain", "", 0.1, 10.0, f"Gain of the {shown}; 1 is correct."),
        Setting(f"{name}-zero", f"{table}.offset", unit, -largest, largest, f"Zero offset of the {shown}.", per_si),
        Setting(f"{name}-noise", f"{table}.noise", unit, 0.0, largest, f"Noise of the {shown} (rms).", per_si),
        Setting(f"{name}-resolution", f"{table}.resolution", unit, 0.0, largest, f"Resolution of the {shown}.",
                per_si),
        Setting(f"{name}-delay", f"{table}.skew_s", "ms", 0.0, 100.0,
                f"Undeclared additional delay of the {shown}."),
    )


SETTINGS = (
    Setting("servo-stiffness", "servo.stiffness_N_m", "N/mm", 0.0, 1e9,
            "Stiffness of the position loop under load (0: infinite)."),
    Setting("load-train-stiffness", "servo.load_train_stiffness_N_m", "N/mm", 0.0, 1e9,
            "Stiffness between the piston (controller's sensor) and the LVDT (0: rigid)."),
    Setting("actuator-friction", "servo.friction_N", "N", 0.0, 1e4,
            "Friction of the piston, not measured by the load cell."),
    *_input("force_input", "force", "N", 1e4),
    *_input("position_input", "position", "mm", 50.0),
    *_sensor("load-cell", "load_cell", "N", 1.0, 1e4),
    Setting("load-cell-zero-drift", "load_cell.drift_per_s", "N/s", -1e3, 1e3,
            "Zero drift of the load cell from the start of the simulation."),
    Setting("hum", "load_cell.hum", "N", 0.0, 1e4, "Amplitude of 50 Hz interference on the load cell."),
    Setting("crosstalk", "load_cell.crosstalk_per_A", "N/A", -1e3, 1e3,
            "Crosstalk from the coil current into the load cell."),
    *_sensor("lvdt", "lvdt", "mm", 1e3, 50.0),
    Setting("ecu-current-gain", "coil.current_gain", "", 0.1, 10.0,
            "Gain of the ECU's current measurement, which the ECU uses for control."),
    Setting("ecu-current-offset", "coil.current_offset_A", "mA", -2000.0, 2000.0,
            "Offset of the ECU's current measurement, which shifts the true current."),
    Setting("coil-sensor-offset", "coil.temperature_offset_K", "K", -100.0, 100.0,
            "Error of the coil's temperature sensor."),
    Setting("fluid-lag", "damper.fluid_lag_s", "ms", 0.0, 1000.0,
            "Lag of the force behind the coil current (fluid)."),
    Setting("coil-heat-capacity", "damper.coil_heat_capacity_J_K", "J/K", 0.1, 1e5,
            "Heat capacity of the coil (heated by I^2 R)."),
    Setting("body-heat-capacity", "damper.heat_capacity_J_K", "J/K", 1.0, 1e6,
            "Heat capacity of the damper's body (heated by F v)."),
    Setting("coil-to-body", "damper.coil_to_body_W_K", "W/K", 0.0, 1e4, "Thermal conductance from the coil to the "
        "body."),
)  # fmt: skip


def setting_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a click command one option for each of `SETTINGS`, in their order."""
    for setting in reversed(SETTINGS):
        decorate = click.option(
            f"--{setting.name}", setting.name.replace("-", "_"), metavar=setting.unit or "NUMBER", help=setting.text
        )
        command = decorate(command)
    return command


def with_settings(options: RigOptions, given: Mapping[str, Any]) -> RigOptions:
    """The rig with every setting that was given (by its option's name, `-` as `_`; None: not given).

    Raises:
        FileProblem: a value cannot be used.
    """
    for setting in SETTINGS:
        text = given[setting.name.replace("-", "_")]
        if text is not None:
            options = with_option(options, f"{setting.key}={setting.value(text)!r}")
    return options
