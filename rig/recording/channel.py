"""The channels of a recording: what each number in the ring is called in the file, its unit and its meaning."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Description:
    """Name of a channel's group under `/entry/raw`, SI unit of its values, one line for people."""

    name: str
    unit: str
    long_name: str


#: Channel number in the ring (`drivers.ring.Channel`) -> description.
RING_CHANNELS: dict[int, Description] = {
    1: Description("force", "N", "Force at the load cell"),
    2: Description("displacement", "m", "Damper extension"),
    **{3 + n: Description(f"auxiliary_{n + 1}", "1", f"Auxiliary channel {n + 1}") for n in range(7)},
    10: Description("coil_current", "A", "Coil current measured by the ECU"),
    11: Description("coil_temperature", "degC", "Coil temperature reported by the ECU"),
    12: Description("ecu_temperature", "degC", "Temperature of the ECU itself"),
    13: Description("ecu_supply", "V", "Supply voltage of the ECU"),
    14: Description("ecu_state", "1", "State of the ECU"),
    15: Description("ecu_faults", "1", "Fault bits of the ECU"),
    16: Description("commanded_current", "A", "Coil current asked for"),
    20: Description("position", "m", "Position by the actuator controller's own sensor"),
    21: Description("velocity", "m/s", "Velocity by the actuator controller"),
    22: Description("setpoint", "m", "Position asked for by the actuator controller"),
    23: Description("state", "1", "State of the actuator controller"),
    24: Description("cycles_done", "1", "Whole cycles of the running program"),
    25: Description("fault_bits", "1", "Fault bits of the actuator controller"),
    26: Description("supply_pressure", "Pa", "Hydraulic supply pressure"),
    27: Description("accumulator_pressure", "Pa", "Accumulator pressure"),
    28: Description("pulse", "1", "Cycle pulses: count and the controller's clock at the pulse"),
    29: Description("phase", "1", "Phase of the running program"),
    30: Description("inputs", "1", "Digital inputs of the actuator controller"),
    31: Description("servo_error", "m", "Following error of the servo loop"),
    32: Description("controller_force", "N", "Coarse force input of the actuator controller"),
    40: Description("force_edge", "1", "Cycle pulses latched in the load cell's clock"),
    41: Description("displacement_edge", "1", "Cycle pulses latched in the displacement sensor's clock"),
    **{42 + n: Description(f"auxiliary_{n + 1}_edge", "1", f"Cycle pulses latched by auxiliary channel {n + 1}")
       for n in range(7)},
    50: Description("trip", "1", "Interlock trips"),
    51: Description("loop_late", "s", "Lateness of the station's loop"),
}

#: Channel name -> number in the ring.
NUMBER: dict[str, int] = {description.name: number for number, description in RING_CHANNELS.items()}
