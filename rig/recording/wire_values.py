"""How values got from the wire into SI and onto the common time base, in words and numbers that the file carries."""

from __future__ import annotations

from collections.abc import Mapping

from rig.recording.context import SensorContext
from rig.recording.layout import Attribute

REGISTER = 1.0, "float32 register, SI"
COUNT = 1.0, "whole number, as sent"
STAMP = 1.0, "no quantity: sequence counts the pulses, device_us is the device's clock at the pulse"

ON_WIRE: dict[str, tuple[float, str]] = {
    "coil_current": (0.001, "CAN signal CoilStatus.Current, int16"),
    "commanded_current": (0.001, "CAN signal CoilCommand.CurrentSetpoint, int16"),
    "coil_temperature": (0.1, "CAN signal CoilTemperature.CoilTemperature, int16"),
    "ecu_temperature": (0.1, "CAN signal CoilTemperature.EcuTemperature, int16"),
    "ecu_supply": (0.01, "CAN signal CoilTemperature.Supply, uint16"),
    **dict.fromkeys(("ecu_state", "ecu_faults", "state", "cycles_done", "fault_bits", "phase", "inputs"), COUNT),
    **dict.fromkeys(("position", "velocity", "setpoint", "supply_pressure", "accumulator_pressure", "servo_error",
                     "controller_force"), REGISTER),
    "pulse": (1.0, "uint16 register, pulses counted by the controller"),
    "trip": (1.0, "not from a wire: the station's code of the interlock"),
    "loop_late": (1.0, "not from a wire: measured by the station, s"),
}
"""Channel -> SI (or the file's unit) per unit on the wire, and what was on the wire."""


def wire_attributes(name: str, sensor: SensorContext | None) -> Mapping[str, Attribute]:
    """What stands beside `raw/<name>/value`: what was on the wire, the factor, the offset and the formula with them.

    Args:
        name: the channel.
        sensor: its declaration where it is a sensor's.
    """
    if sensor is not None:
        return {
            "on_wire": f"number sent by {sensor.sensor}{f', format {sensor.format}' if sensor.format else ''}",
            "sensitivity": sensor.sensitivity, "offset": sensor.offset,
            "formula": "value = sensitivity * on_wire - offset",
        }
    if name.endswith("_edge"):
        factor, what = STAMP
    elif name in ON_WIRE:
        factor, what = ON_WIRE[name]
    else:
        return {}
    return {"on_wire": what, "sensitivity": factor, "offset": 0.0, "formula": "value = sensitivity * on_wire - offset"}
