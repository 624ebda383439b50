"""What the simulated controller reports of itself, whatever its registers: measured values, motion, answers."""

from __future__ import annotations

import numpy as np

from drivers.roles import Input, ProgramPhase, State
from simulators.actuator import Actuator
from simulators.options import ServoOptions
from simulators.plant import records

VENDOR, MODEL = "Simulated", "RIG-1"


class ControllerReadings:
    """Reads the controller's inputs; every reading has noise of its own.

    Args:
        actuator: the controller.
        servo: what its inputs show.
        random: of their noise.
    """

    def __init__(self, actuator: Actuator, servo: ServoOptions, random: np.random.Generator) -> None:
        self._actuator = actuator
        self._servo = servo
        self._random = random
        self._frozen_m = 0.0

    def identity(self) -> dict[str, str | int]:
        """Values by the names of a register map."""
        options = self._actuator.options
        return {
            "boot_count": self._actuator.boot_count, "vendor": VENDOR, "model": MODEL,
            "serial_number": options.serial_number, "firmware": options.firmware,
        }

    def status(self) -> dict[str, float]:
        """Values by the names of a register map, as of the plant's present time; codes and bits of `drivers.roles`.

        Times are in us (`clock_us`, `pulse_clock_us`), all else in SI.
        """
        plant, actuator = self._actuator.plant, self._actuator
        device_us = actuator.clock.unwrapped_us(plant.time_s)
        position_m = plant.position_input.read(self._random)
        if actuator.faults.position_frozen:
            position_m = self._frozen_m
        self._frozen_m = position_m
        supplies_Pa = (0.0, self._servo.low_pressure_Pa, self._servo.supply_Pa)
        return {
            "heartbeat": int(device_us // 10_000) & 0xFFFF,
            "state": int(actuator.state),
            "fault_bits": actuator.fault_bits,
            "clock_us": device_us,
            "position": position_m,
            "velocity": 0.0 if actuator.faults.position_frozen else plant.value("velocity_m_s"),
            "setpoint": plant.value("setpoint_m"),
            "cycles_done": int(plant.value("cycles_done")),
            "pulse_count": int(plant.value("pulses")) & 0xFFFF,
            "phase": int(self._phase()),
            "pulse_clock_us": actuator.pulse_clock_us,
            "acked_sequence": actuator.sequence,
            "result": int(actuator.result),
            "acked_command": actuator.acked_command,
            "owner": actuator.owner,
            "watchdog_echo": actuator.watchdog_echo,
            "inputs": self._inputs(),
            "supply_pressure": supplies_Pa[int(plant.command["pressure"][0])],
            "accumulator_pressure": plant.value("accumulator_Pa"),
            "program_id": actuator.program_id if actuator.motion_state in {State.RUNNING, State.FADING} else 0,
            "servo_error": plant.value("setpoint_m") - actuator.seen_m,
            "force": plant.force_input.read(self._random),
        }

    def _phase(self) -> ProgramPhase:
        plant = self._actuator.plant
        mode = int(plant.command["mode"][0])
        if mode == records.MODE_FADE:
            return ProgramPhase.RAMP_OUT
        if mode != records.MODE_PROGRAM:
            return ProgramPhase.IDLE
        phase, command = plant.value("phase_cycles"), plant.command
        ramp_in = float(command["ramp_in_cycles"][0])
        if phase < ramp_in:
            return ProgramPhase.RAMP_IN
        full = phase < ramp_in + float(command["full_cycles"][0])
        return ProgramPhase.FULL_AMPLITUDE if full else ProgramPhase.RAMP_OUT

    def _inputs(self) -> int:
        bits = 0 if self._actuator.faults.e_stop_open else int(Input.E_STOP_CLOSED)
        pressure = int(self._actuator.plant.command["pressure"][0])
        if pressure == 1:
            bits |= Input.HYDRAULICS_LOW
        elif pressure == 2:
            bits |= Input.HYDRAULICS_ON
        if self._actuator.plant.value("saturated"):
            bits |= Input.VALVE_SATURATED
        return bits
