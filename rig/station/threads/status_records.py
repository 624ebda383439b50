"""The controller's status as ring records, with its clock unwrapped; no I/O."""

from __future__ import annotations

from drivers.ring import NO_DEVICE_TIME, Channel, Record
from drivers.roles import ActuatorStatus

CLOCK_MODULUS = 1 << 32


class StatusRecords:
    """Turns status answers into records, one after the other; a cycle pulse becomes a record when it is new."""

    def __init__(self) -> None:
        self._pulse_count: int | None = None
        self._device_us = NO_DEVICE_TIME
        self._clock_us = 0

    def of(self, status: ActuatorStatus, sequence: int) -> tuple[int, list[Record]]:
        """Take one status.

        Args:
            status: the answer.
            sequence: its number among the polls.

        Returns:
            Its time on the controller's unwrapped clock (us), and its records.
        """
        host_ns, device_us = status.received_ns, self._unwrap(status.clock_us)
        records: list[Record] = [
            (host_ns, device_us, float(value), sequence, channel, 0)
            for channel, value in (
                (Channel.POSITION, status.position_m),
                (Channel.VELOCITY, status.velocity_m_s),
                (Channel.SETPOINT, status.setpoint_m),
                (Channel.STATE, status.state),
                (Channel.CYCLES_DONE, status.cycles_done),
                (Channel.FAULT_BITS, status.fault_bits),
                (Channel.SUPPLY_PRESSURE, status.supply_pressure_Pa),
                (Channel.ACCUMULATOR_PRESSURE, status.accumulator_pressure_Pa),
                (Channel.PHASE, status.phase),
                (Channel.INPUTS, status.inputs),
                (Channel.SERVO_ERROR, status.servo_error_m),
                (Channel.CONTROLLER_FORCE, status.force_N),
            )
        ]
        if self._pulse_count is not None and status.pulse_count != self._pulse_count:
            behind_us = (status.clock_us - status.pulse_clock_us) % CLOCK_MODULUS
            count = status.pulse_count
            records.append((host_ns, device_us - behind_us, float(count), count, Channel.PULSE, 0))
        self._pulse_count = status.pulse_count
        return device_us, records

    def _unwrap(self, clock_us: int) -> int:
        if self._device_us == NO_DEVICE_TIME:
            self._device_us = clock_us
        else:
            forward_us = (clock_us - self._clock_us) % CLOCK_MODULUS
            self._device_us += forward_us - CLOCK_MODULUS if forward_us >= CLOCK_MODULUS // 2 else forward_us
        self._clock_us = clock_us
        return self._device_us
