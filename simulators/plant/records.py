"""The plant's memory as numpy records: constants, what the controller asks, and what moves.

The compiled step (`step.py`) reads and writes these by name. Every field carries its unit.
"""

from __future__ import annotations

import numpy as np

MODE_OFF = 0
"""No pressure at the valve: the rod stops and then drifts on what the accumulator still holds."""
MODE_HOLD = 1
MODE_MOVE = 2
MODE_PROGRAM = 3
MODE_FADE = 4
MODE_STOP = 5
"""A closed-loop stop of a MOVE within the halt deceleration."""
MODE_HALT = 6
"""The open-loop halt ramp: valve command to zero, the position sensor not used."""
MODE_LOCKED = 7
"""After a halt: valve closed, rod held by the oil."""
MODE_FOLLOW = 8
"""Set-points come one by one; between them the last one goes on at its speed, for `FOLLOW_S` at most."""
FOLLOW_S = 0.05

SINE = 0
TRIANGLE = 1
TABLE = 2

EVENT_PULSE = 1
"""A cycle began, or a program ended (value: pulse count)."""
EVENT_TRIP = 2
"""A limit was crossed (value: bit number of the fault)."""
EVENT_FULL_AMPLITUDE = 3
"""The program's ramp-in is over (value: cycles done)."""

BIT_POSITION = 1
BIT_SPEED = 2
BIT_FORCE = 3
BIT_FOLLOWING = 4

CONSTANTS = np.dtype(
    [
        ("dt_s", "f8"),
        ("servo_rad_s", "f8"),
        ("servo_damping", "f8"),
        ("rated_speed_m_s", "f8"),
        ("supply_Pa", "f8"),
        ("low_pressure_Pa", "f8"),
        ("piston_area_m2", "f8"),
        ("accumulator_recovery_s", "f8"),
        ("accumulator_bleed_s", "f8"),
        ("accumulator_sag_Pa_m3", "f8"),  # pressure lost for each cubic metre drawn
        ("servo_stiffness_N_m", "f8"),  # 0: infinitely stiff
        ("actuator_friction_N", "f8"),
        ("actuator_friction_speed_m_s", "f8"),
        ("position_gain", "f8"),  # of the position loop's own feedback
        ("position_zero_m", "f8"),
        ("overlap_m", "f8"),  # in HOLD a smaller error moves nothing
        ("load_train_stiffness_N_m", "f8"),  # 0: rigid
        ("fluid_lag_s", "f8"),  # 0: the damper follows the coil's current at once
        ("drift_m_s", "f8"),
        ("valve_closing_s", "f8"),
        ("half_stroke_m", "f8"),
        ("mid_stroke_m", "f8"),
        ("half_specimen_stroke_m", "f8"),
        ("bump_stiffness_N_m", "f8"),
        ("gas_force_N", "f8"),
        ("seal_friction_N", "f8"),
        ("seal_speed_m_s", "f8"),
        ("mount_stiffness_N_m", "f8"),  # 0: rigid
        ("free_play_m", "f8"),
        ("moving_mass_kg", "f8"),
        ("force_scale", "f8"),
        ("heat_capacity_J_K", "f8"),
        ("heat_loss_W_K", "f8"),
        ("coil_heat_capacity_J_K", "f8"),
        ("coil_to_body_W_K", "f8"),
        ("ambient_degC", "f8"),
        ("coil_ohm", "f8"),
        ("coil_ohm_per_K", "f8"),  # relative to 20 degC
        ("coil_eta_1_s", "f8"),
        ("coil_voltage_V", "f8"),
    ]
)

COMMAND = np.dtype(
    [
        ("mode", "i8"),
        ("pressure", "i8"),  # 0 off, 1 low, 2 full
        ("target_m", "f8"),
        ("move_speed_m_s", "f8"),
        ("move_acceleration_m_s2", "f8"),
        ("told_s", "f8"),  # when the set-point that is followed came: `target_m`, going on at `move_speed_m_s`
        ("before_m", "f8"),  # the one before it, which is followed until then
        ("before_m_s", "f8"),
        ("before_s", "f8"),
        ("follow_s", "f8"),  # for how long the last one goes on when no other comes
        ("before_follow_s", "f8"),
        ("waveform", "i8"),
        ("amplitude_m", "f8"),
        ("frequency_Hz", "f8"),
        ("centre_m", "f8"),
        ("full_cycles", "f8"),
        ("ramp_in_cycles", "f8"),
        ("ramp_out_cycles", "f8"),
        ("fade_cycles", "f8"),
        ("halt_deceleration_m_s2", "f8"),
        ("acceleration_max_m_s2", "f8"),
        ("position_min_m", "f8"),
        ("position_max_m", "f8"),
        ("speed_max_m_s", "f8"),
        ("force_max_N", "f8"),
        ("following_error_max_m", "f8"),
        ("coil_A", "f8"),
    ]
)

STATE = np.dtype(
    [
        ("step", "i8"),
        ("program_step", "i8"),
        ("position_m", "f8"),  # of the piston
        ("specimen_m", "f8"),  # behind the load train, where the LVDT sits
        ("specimen_m_s", "f8"),
        ("velocity_m_s", "f8"),
        ("acceleration_m_s2", "f8"),
        ("setpoint_m", "f8"),
        ("setpoint_velocity_m_s", "f8"),
        ("phase_cycles", "f8"),
        ("fade_from_cycles", "f8"),
        ("fade_envelope", "f8"),
        ("pulses", "i8"),
        ("cycles_done", "i8"),
        ("saturated", "i8"),
        ("tripped", "i8"),
        ("fault_bits", "i8"),
        ("accumulator_Pa", "f8"),
        ("damper_u_m", "f8"),
        ("damper_v_m_s", "f8"),
        ("damper_force_N", "f8"),
        ("cell_force_N", "f8"),
        ("current_A", "f8"),
        ("fluid_A", "f8"),
        ("temperature_degC", "f8"),  # of the damper's body
        ("coil_degC", "f8"),
        ("dissipated_J", "f8"),
        ("last_pulse_s", "f8"),
    ]
)

EVENT_CAPACITY = 4096
