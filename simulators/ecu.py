"""The coil's current ECU: frames in, frames out, its faults and its own time-out. No sockets.

INIT --first good command--> OFF <--Enable--> ENABLED          time-out, over-temperature, supply, open, short,
^--- ClearFaults --- FAULT  <--- three bad commands in a row: 0 A by itself
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drivers.current_source import SourceFault, SourceState
from protocols.errors import RemoteProtocolError
from simulators.clock import DeviceClock
from simulators.ecu_wire import Frame, Shown
from simulators.emulated_ecu import DEMO_ECU, EmulatedEcu
from simulators.options import CoilOptions
from simulators.plant.plant import Plant
from simulators.plant.step import CURRENT

BAD_COMMANDS_TO_FAULT = 3
CASE_SHARE = 0.25
"""The ECU's own case warms by this share of the coil's rise above ambient."""
HOT_CASE_DEGC = 110.0
"""Of an ECU that says it is too hot; the coil it drives need not be."""
UNDERVOLTAGE_V = 9.0
OPEN_ETA_1_S = 400.0
SHORT_A = 8.0


@dataclass
class EcuFaults:
    """What is broken in or around the ECU."""

    over_temperature: bool = False
    coil_open: bool = False
    coil_short: bool = False
    stuck_current: bool = False
    full_current: bool = False
    least_A: float = 0.0
    gain: float = 1.0
    silent: bool = False
    late: bool = False
    wrong_crc: bool = False


class Ecu:
    """The ECU's logic over the plant's coil.

    Attributes:
        wire: how its frames look.
        faults: switches of the fault injectors.
        log: called with (what, value) when the commanded current or a fault changes, for the truth file.
        command_timeout_s: wall seconds without a good command until it drives 0 A by itself.
    """

    def __init__(
        self,
        plant: Plant,
        options: CoilOptions,
        ambient_degC: float,
        clock: DeviceClock,
        random: np.random.Generator,
        log: Callable[[str, str], None],
        wire: EmulatedEcu | None = None,
    ) -> None:
        self.plant = plant
        self.clock = clock
        self.faults = EcuFaults()
        self.log = log
        self.options = options
        self.boot_count = options.boot_count
        self.supply_V = options.supply_V
        self._ambient_degC = ambient_degC
        self._random = random
        self._served_s = 0.0
        self._held: list[Frame] = []
        self._repeats = False
        self._eta_1_s = float(plant.constants["coil_eta_1_s"][0])
        self.wire = wire or DEMO_ECU.load()
        stated_s, own_s = self.wire.command_timeout_s, options.command_timeout_s
        self.command_timeout_s = stated_s if math.isnan(own_s) else own_s
        now_us = clock.unwrapped_us(plant.time_s)
        self._answers = dict.fromkeys(self.wire.requested, 0)
        self._clocked = False
        self._next_us = {name: math.ceil(now_us / period) * period for name, period in self.wire.periods_us.items()}
        self.boot()

    def boot(self) -> None:
        """Start: no command seen, no current."""
        self.state = SourceState.INIT
        self.fault_bits = 0
        self.setpoint_A = 0.0
        self.wire.reset()
        self._last_counter = -1
        self._bad_commands = 0
        self._heard_s = math.nan
        self._drive()

    def request(self, identifier: int, data: bytes, *, remote: bool, answers: int = 1) -> None:
        """A frame from the bus that may request a message.

        Args:
            identifier: with the flag `EXTENDED` if it is extended.
            data: of the frame.
            remote: whether it is a remote frame.
            answers: number of frames that answer it: one, at once; more, at the message's period, from a rig that runs
                faster than its host and is therefore requested too rarely.
        """
        if name := self.wire.requested_by(identifier, data, remote=remote):
            self._clocked = answers > 1
            self._answers[name] = answers if self._clocked else self._answers[name] + 1

    def restart(self) -> None:
        """A reset in operation: counters start over and the fault bit says so."""
        self.boot_count += 1
        self.boot()
        self.fault_bits |= SourceFault.RESTARTED
        self.state = SourceState.FAULT

    def receive(self, identifier: int, data: bytes) -> None:
        """A frame from the bus; only the host's commands matter here."""
        if not self.wire.is_command(identifier):
            return
        try:
            command = self.wire.command(identifier, data)
        except RemoteProtocolError:
            self._bad_command()
            return
        if command is None:
            return
        repeated = self._last_counter >= 0 and self._last_counter == command.counter
        self._last_counter = command.counter
        if repeated:
            self._bad_command()
            return
        self._bad_commands = 0
        self.obey(command.setpoint_A, enable=command.enable, clear_faults=command.clear_faults)

    def obey(self, setpoint_A: float, *, enable: bool, clear_faults: bool) -> None:
        """Drive a current, as far as no fault is latched."""
        self._heard_s = self._served_s
        if clear_faults:
            self.fault_bits = 0
        if self.fault_bits == 0:
            self.state = SourceState.ENABLED if enable else SourceState.OFF
        limit_A = self.options.limit_A
        self._set(max(-limit_A, min(limit_A, setpoint_A)) if enable else 0.0)

    def _bad_command(self) -> None:
        """Count a frame with a wrong CRC, counter or length; the third in a row is a fault."""
        self._bad_commands += 1
        if self._bad_commands >= BAD_COMMANDS_TO_FAULT:
            self._fail(SourceFault.COMMAND_CHECK)

    def tick(self, served_s: float) -> None:
        """Judge the command time-out (wall time, s) and the ECU's own sensors."""
        self._served_s = served_s
        waited_s = served_s - self._heard_s
        if self.state is SourceState.ENABLED and waited_s > self.command_timeout_s:
            self._fail(SourceFault.COMMAND_TIMEOUT)
        if self.faults.over_temperature or self._coil_degC > self.options.over_temperature_degC:
            self._fail(SourceFault.OVER_TEMPERATURE)
        if self.supply_V < UNDERVOLTAGE_V:
            self._fail(SourceFault.UNDERVOLTAGE)
        if self.faults.coil_open and self.setpoint_A != 0.0:
            self._fail(SourceFault.OPEN)
        if self.faults.coil_short and self.setpoint_A != 0.0:
            self._fail(SourceFault.SHORT)
        self._drive()

    def _fail(self, fault: SourceFault) -> None:
        """Latch a fault and drive 0 A."""
        if not self.fault_bits & fault:
            self.log("ECU_FAULT", fault.name or str(fault))
        self.fault_bits |= fault
        self.state = SourceState.FAULT
        self._set(0.0)

    def _set(self, current_A: float) -> None:
        if self.state is not SourceState.ENABLED:
            current_A = 0.0
        if current_A != self.setpoint_A:
            self.setpoint_A = current_A
            self.log("SET_CURRENT", f"{current_A:.3f} A")
        self._drive()

    def _drive(self) -> None:
        """What the output stage makes of the set-point, faults included; one that has a least current never gives 0."""
        target_A = self._regulated_A() * self.faults.gain
        eta_1_s = self._eta_1_s
        if self.faults.stuck_current:
            target_A = self.plant.value("current_A")
        if abs(target_A) < self.faults.least_A:
            target_A = self.faults.least_A
        if self.faults.full_current:
            target_A = self.options.limit_A
        if self.faults.coil_open:
            target_A, eta_1_s = 0.0, OPEN_ETA_1_S
        self.plant.order(coil_A=target_A)
        self.plant.constants["coil_eta_1_s"] = eta_1_s

    def _regulated_A(self) -> float:
        """The coil's current at which the ECU's own measurement shows the set-point; none from a stage that is off."""
        if self.setpoint_A == 0.0:
            return 0.0
        true_A = (self.setpoint_A - self.options.current_offset_A) / self.options.current_gain
        return true_A if true_A * self.setpoint_A > 0.0 else 0.0

    @property
    def _coil_degC(self) -> float:
        """The coil's temperature as its sensor shows it (degC)."""
        return self.plant.value("coil_degC") + self.options.temperature_offset_K

    def frames(self) -> list[Frame]:
        """The frames that the ECU's own clock has made due since the last call, in order.

        Each message has its period of device time; a message that is sent on request also waits for a request. The
        current in each status is the plant's at that instant.
        """
        due: list[Frame] = []
        now_us = self.clock.unwrapped_us(self.plant.time_s)
        sends_temperatures = self.plant.time_s < self.options.temperatures_until_s
        while (at_us := min(self._next_us.values())) <= now_us:
            shown = self._shown(at_us)
            for name, period_us in self.wire.periods_us.items():
                if self._next_us[name] != at_us:
                    continue
                self._next_us[name] += period_us
                if name in self._answers:
                    if not (self._clocked and self._answers[name]):
                        continue
                    self._answers[name] -= 1
                if sends_temperatures or name not in self.wire.temperatures:
                    due.append(self.wire.frame(name, shown))
        for name, count in self._answers.items() if not self._clocked else ():
            self._answers[name] = 0
            if sends_temperatures or name not in self.wire.temperatures:
                due += [self.wire.frame(name, self._shown(int(now_us))) for _ in range(count)]
        return self._damaged(due)

    def _damaged(self, due: list[Frame]) -> list[Frame]:
        """What the bus carries of the frames when the ECU or its line is at fault."""
        faults = self.faults
        if faults.silent:
            return []
        if faults.wrong_crc:
            due = [self.wire.damaged(frame) for frame in due]
        return [self._delayed(frame) for frame in due] if faults.late else due

    def _delayed(self, frame: Frame) -> Frame:
        """In place of a frame that is due, every frame twice: the bus stays as busy, what it says gets older."""
        self._held.append(frame)
        self._repeats = not self._repeats
        return self._held[0] if self._repeats else self._held.pop(0)

    def measured_A(self, current_A: float) -> float:
        """What the source's own measurement shows of a current (A)."""
        if self.faults.coil_short and self.setpoint_A != 0.0:
            current_A = SHORT_A
        measured_A = self.options.current_gain * current_A + self.options.current_offset_A
        return measured_A + self.options.current_noise_A * float(self._random.standard_normal())

    def _shown(self, device_us: int) -> Shown:
        """What it says of itself at that instant of its clock (us)."""
        time_s = (device_us - self.clock.offset_us) / (1e6 + self.clock.ppm)
        row = round(time_s / self.plant.dt_s) - self.plant.first_step
        out = self.plant.out
        current_A = self.plant.value("current_A")
        if len(out):
            current_A = float(out[min(max(row - 1, 0), len(out) - 1), CURRENT])
        measured_A = self.measured_A(current_A)
        case_degC = self._ambient_degC + CASE_SHARE * (self.plant.value("coil_degC") - self._ambient_degC)
        if self.faults.over_temperature:
            case_degC = max(case_degC, HOT_CASE_DEGC)
        return Shown(
            int(self.state), measured_A, self.fault_bits, device_us, self._coil_degC, case_degC, self.supply_V,
            self.boot_count, self.options.serial_number,
        )
