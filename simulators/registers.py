"""The controller's register bank: what Modbus reads and writes, as words. No sockets.

Blocks and types come from `simulators/demo_registers.toml`; registers between blocks are not there (illegal
address).
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence

import numpy as np

from simulators import controller_firmware as wire
from simulators.actuator import Actuator
from simulators.controller_firmware import Input, ProgramPhase, State
from simulators.options import ServoOptions
from simulators.plant import records
from simulators.register_blocks import Block, Value

HOLDING = "holding"


class RegisterBank:
    """Registers of one controller.

    Attributes:
        map: its blocks, by whether the controller has a function generator.
        word_order_swapped: a fault: numbers of two registers come low word first.
        writes_lost: a fault: writes are acknowledged and forgotten.
        polled_s: served time (s) at which the status block was last read; NaN before.
    """

    def __init__(self, actuator: Actuator, servo: ServoOptions, random: np.random.Generator) -> None:
        self.actuator = actuator
        self.word_order_swapped = False
        self.writes_lost = False
        self.polled_s = math.nan
        self._servo = servo
        self._random = random
        self._frozen_m = 0.0
        self.map = wire.MAP if actuator.options.generator else wire.MAP_WITHOUT_GENERATOR
        self._words = {block.name: [0] * block.count for block in (wire.COMMAND, wire.TABLE, wire.SETPOINT)}

    def blocks(self) -> dict[str, list[tuple[int, int]]]:
        """First address and count of each run of registers, by space."""
        return {HOLDING: [(block.address, block.count) for block in self.map.blocks.values()]}

    def bits(self, space: str) -> dict[int, int]:
        """All coils or discrete inputs by address: none."""
        del space
        return {}

    def tick(self) -> None:
        """What the registers do by themselves: nothing."""

    def read(self, address: int, count: int, space: str = HOLDING) -> list[int] | None:
        """Words of `count` registers from `address`; None when one of them is not there."""
        if space != HOLDING:
            return None
        words: list[int] = []
        while len(words) < count:
            block = self._block_at(address + len(words))
            if block is None:
                return None
            content = self._block_words(block)
            words += content[address + len(words) - block.address :]
        return words[:count]

    def write(self, address: int, words: Sequence[int], space: str = HOLDING) -> bool | None:
        """Take a write within one block; False when its values are refused, None when it cannot be written there."""
        block = self._block_at(address) if space == HOLDING else None
        if block is None or address + len(words) > block.address + block.count or not block.registers[0].writable:
            return None
        if self.writes_lost:
            return True
        content = self._block_words(block)
        at = address - block.address
        content[at : at + len(words)] = words
        if block is wire.CONFIG:
            return self.actuator.configure(content)
        if block is wire.WATCHDOG:
            self.actuator.feed(content[0])
            return True
        self._words[block.name] = content
        if block is wire.SETPOINT:
            self._follow(block.decode(content))
            return True
        if block is wire.TABLE:
            return self.actuator.write_table(block.decode(content))
        self.actuator.execute(block.decode(content))
        return True

    def _follow(self, values: dict[str, Value]) -> None:
        """A set-point, and the watchdog's counter beside it: a living host feeds, whether the rod may move or not."""
        self.actuator.feed(int(values["watchdog_counter"]))
        self.actuator.follow(float(values["setpoint_position"]), float(values["setpoint_velocity"]))

    def _block_words(self, block: Block) -> list[int]:
        if block is wire.STATUS:
            self.polled_s = self.actuator.served_s
            return self._ordered(block, self.status())
        if block is wire.IDENTITY:
            return self._ordered(block, self.identity())
        if block is wire.CONFIG:
            return list(self.actuator.config_words)
        if block is wire.WATCHDOG:
            return [self.actuator.watchdog_echo]
        return list(self._words[block.name])

    def _ordered(self, block: Block, values: dict[str, Value]) -> list[int]:
        """Words in the map's order, or in the wrong one when that is the fault."""
        if self.word_order_swapped:
            block = Block(block.name, block.registers, "little")
        return block.encode(values)

    def identity(self) -> dict[str, Value]:
        """Values of the identity block."""
        raw = b"".join(word.to_bytes(2, "big") for word in self.actuator.config_words)
        return {
            "signature_u32": wire.SIGNATURE_U32,
            "signature_f32": wire.SIGNATURE_F32,
            "layout_version": wire.LAYOUT_VERSION,
            "boot_count": self.actuator.boot_count,
            "config_hash": zlib.crc32(raw),
            "vendor": "Simulated",
            "model": "RIG-1",
            "serial_number": self.actuator.options.serial_number,
            "firmware": self.actuator.options.firmware,
        }

    def status(self) -> dict[str, Value]:
        """Values of the status block, as of the plant's present time."""
        plant, actuator = self.actuator.plant, self.actuator
        device_us = actuator.clock.unwrapped_us(plant.time_s)
        position_m = plant.position_input.read(self._random)
        if self.actuator.faults.position_frozen:
            position_m = self._frozen_m
        self._frozen_m = position_m
        supplies_Pa = (0.0, self._servo.low_pressure_Pa, self._servo.supply_Pa)
        return {
            "heartbeat": int(device_us // 10_000) & 0xFFFF,
            "state": int(actuator.state),
            "fault_bits": actuator.fault_bits,
            "clock_us": math.floor(device_us) & 0xFFFFFFFF,
            "position": position_m,
            "velocity": 0.0 if self.actuator.faults.position_frozen else plant.value("velocity_m_s"),
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
        mode = int(self.actuator.plant.command["mode"][0])
        if mode == records.MODE_FADE:
            return ProgramPhase.RAMP_OUT
        if mode != records.MODE_PROGRAM:
            return ProgramPhase.IDLE
        phase, command = self.actuator.plant.value("phase_cycles"), self.actuator.plant.command
        ramp_in = float(command["ramp_in_cycles"][0])
        if phase < ramp_in:
            return ProgramPhase.RAMP_IN
        full = phase < ramp_in + float(command["full_cycles"][0])
        return ProgramPhase.FULL_AMPLITUDE if full else ProgramPhase.RAMP_OUT

    def _inputs(self) -> int:
        bits = 0 if self.actuator.faults.e_stop_open else int(Input.E_STOP_CLOSED)
        pressure = int(self.actuator.plant.command["pressure"][0])
        if pressure == 1:
            bits |= Input.HYDRAULICS_LOW
        elif pressure == 2:
            bits |= Input.HYDRAULICS_ON
        if self.actuator.plant.value("saturated"):
            bits |= Input.VALVE_SATURATED
        return bits

    def _block_at(self, address: int) -> Block | None:
        """The block that holds a register, None when there is none."""
        for block in self.map.blocks.values():
            if block.address <= address < block.address + block.count:
                return block
        return None
