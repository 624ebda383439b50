"""How values got from the wire into SI and onto the common time base, in words and numbers that the file carries."""

from __future__ import annotations

from collections.abc import Mapping

from rig.recording.context import SensorContext
from rig.recording.layout import Attribute

REGISTER = "value = float32 register, SI"
COUNT = "value = number sent"

FROM_WIRE: dict[str, str] = {
    "coil_current": "value = 0.001 * int16 CoilStatus.Current",
    "commanded_current": "value = 0.001 * int16 CoilCommand.CurrentSetpoint",
    "coil_temperature": "value = 0.1 * int16 CoilTemperature.CoilTemperature",
    "ecu_temperature": "value = 0.1 * int16 CoilTemperature.EcuTemperature",
    "ecu_supply": "value = 0.01 * uint16 CoilTemperature.Supply",
    **dict.fromkeys(("ecu_state", "ecu_faults", "state", "cycles_done", "fault_bits", "phase", "inputs"), COUNT),
    **dict.fromkeys(("position", "velocity", "setpoint", "supply_pressure", "accumulator_pressure", "servo_error",
                     "controller_force"), REGISTER),
    "pulse": "value = uint16 register pulse_count",
    "trip": "value = the station's code of the interlock",
    "loop_late": "value = measured by the station",
}
"""Channel -> how its SI values were made of what was on the wire."""


def wire_attributes(name: str, sensor: SensorContext | None) -> Mapping[str, Attribute]:
    """What stands beside `raw/<name>/value`: how it was made of what was on the wire.

    Args:
        name: the channel.
        sensor: its declaration where it is a sensor's; then factor and offset stand there as numbers too.
    """
    if sensor is None:
        return {"from_wire": FROM_WIRE.get(name)}
    sent = f"number sent by {sensor.sensor}{f', format {sensor.format}' if sensor.format else ''}"
    return {
        "from_wire": f"value = sensitivity * wire - offset; wire = {sent}; wire = (value + offset) / sensitivity",
        "sensitivity": sensor.sensitivity, "offset": sensor.offset,
    }
