"""Controllers of others in front of the simulated plant, each from its own document and by its own bytes.

They share nothing with the register maps and their reader: registers are words here, packed by `struct`.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

from drivers.roles import Command, FaultBit
from simulators.actuator import Actuator
from simulators.rig import SimulatedRig

OWNER = 1
HALTED, ENABLE_OUTPUT = 1 << 15, 1 << 8
"""Bits of the RMC's Status Bits (RMC151 User Manual, page 864 and after)."""


class OtherController:
    """What they have in common: words in and out, a plant behind, one owner, a watchdog.

    Attributes:
        words: what was written, by address on the wire.
        polled_s: when the status was read last (served s).
    """

    ranges: tuple[tuple[int, int], ...]

    def __init__(self, rig: SimulatedRig) -> None:
        self.actuator: Actuator = rig.actuator
        self.words: dict[int, int] = {}
        self.polled_s = math.nan
        self._sequence = 0
        self._last = (0.0, 0.0)
        self.order(Command.ACQUIRE)
        rig.every_tick.append(self.watch)

    def blocks(self) -> dict[str, list[tuple[int, int]]]:
        return {"holding": list(self.ranges)}

    def bits(self, space: str) -> dict[int, int]:
        del space
        return {}

    def tick(self) -> None:
        """Nothing by itself."""

    def read(self, address: int, count: int, space: str) -> list[int] | None:
        assert space == "holding"
        self.polled_s = self.actuator.served_s
        shown = self.words | self.shown()
        return [shown.get(address + i, 0) for i in range(count)]

    def write(self, address: int, words: Sequence[int], space: str) -> bool | None:
        assert space == "holding"
        self.words |= {address + i: word for i, word in enumerate(words)}
        self.written(address, len(words))
        return True

    def order(self, command: Command) -> None:
        """Have the plant's controller do something, as its one owner."""
        self._sequence += 1
        self.actuator.execute({"sequence": self._sequence, "command": int(command), "owner_id": OWNER})

    def follow(self, position_m: float, velocity_m_s: float | None = None) -> None:
        """Follow a target; a speed that nobody tells is that of the last two."""
        now_s = self.actuator.plant.time_s
        before_s, before_m = self._last
        if velocity_m_s is None:
            velocity_m_s = (position_m - before_m) / (now_s - before_s) if 0.0 < now_s - before_s < 0.05 else 0.0
        self._last = (now_s, position_m)
        self.actuator.follow(position_m, velocity_m_s)

    @property
    def pressure(self) -> int:
        return int(self.actuator.plant.command["pressure"][0])

    def shown(self) -> dict[int, int]:
        raise NotImplementedError

    def written(self, address: int, count: int) -> None:
        raise NotImplementedError

    def watch(self) -> None:
        """Judge the watchdog's trip."""


def low_first(value: float) -> tuple[int, int]:
    """A REAL as two words, the low one first."""
    low, high = struct.unpack("<HH", struct.pack("<f", value))
    return low, high


class DeltaRmc(OtherController):
    """RMC75 or RMC150 with the three user programs that the preset asks for, low word first."""

    ranges = ((1024, 10), (1536, 12), (4096, 24))

    def __init__(self, rig: SimulatedRig) -> None:
        super().__init__(rig)
        self.program = 0.0

    def real(self, address: int) -> float:
        return struct.unpack("<f", struct.pack("<HH", self.words.get(address, 0), self.words.get(address + 1, 0)))[0]

    def shown(self) -> dict[int, int]:
        actuator, plant = self.actuator, self.actuator.plant
        bits = ENABLE_OUTPUT if self.pressure == 2 else 0
        bits |= HALTED if actuator.tripped and self.program != 2.0 else 0
        errors = (1 << 0) * bool(actuator.fault_bits & FaultBit.FOLLOWING_ERROR)
        errors |= (1 << 4) * bool(actuator.fault_bits & FaultBit.POSITION_LIMIT)
        pairs = {
            1540: low_first(1234.5), 1542: low_first(self.program), 4096: (bits & 0xFFFF, bits >> 16),
            4098: (errors & 0xFFFF, errors >> 16),
            4112: low_first(1e3 * actuator.seen_m), 4114: low_first(1e3 * plant.value("velocity_m_s")),
        }
        return {at + i: word for at, pair in pairs.items() for i, word in enumerate(pair)}

    def written(self, address: int, count: int) -> None:
        if address <= 1024 < address + count:
            self.command(self.real(1024), self.real(1026), self.real(1028))
        if address <= 1538 < address + count:
            self.actuator.feed(int(self.real(1538)))
        if address <= 1536 < address + count and self.program == 1.0:
            self.follow(1e-3 * self.real(1536))

    def command(self, number: float, first: float, second: float) -> None:
        if (number, first, second) == (90.0, 0.0, 1.0):
            self.order(Command.HYDRAULICS_LOW)
            self.order(Command.HYDRAULICS_ON)
            self.program = 1.0 if self.pressure == 2 else 0.0
        elif (number, first, second) == (90.0, 0.0, 2.0):
            self.order(Command.HYDRAULICS_OFF)
            self.program = 0.0
        elif number == 2.0:
            self.order(Command.HALT)
        elif number == 4.0:
            self.order(Command.RESET)
        else:
            raise AssertionError(f"command {number} ({first}, {second}) is none that the preset may send")

    def watch(self) -> None:
        if self.actuator.fault_bits & FaultBit.WATCHDOG and self.program != 2.0:
            self.order(Command.HYDRAULICS_OFF)
            self.program = 2.0


class DeltaRmcHighFirst(DeltaRmc):
    """The same with the words the other way round."""

    def read(self, address: int, count: int, space: str) -> list[int] | None:
        words = super().read(address, count, space) or []
        return [words[i ^ 1] for i in range(count)]


class FloatDrive(OtherController):
    """Floats, high word first; a control word of its own."""

    ranges = ((0, 12), (20, 7))

    def shown(self) -> dict[int, int]:
        actuator, plant = self.actuator, self.actuator.plant
        state = 3 if actuator.tripped else 1 if self.pressure == 2 else 0
        faults = int(actuator.fault_bits) & 0x3F
        floats = {
            0: 1234.5, 4: 1e3 * actuator.seen_m, 6: 1e3 * plant.value("velocity_m_s"), 8: plant.value("cell_force_N"),
            10: 1e3 * plant.value("setpoint_m"),
        }
        shown = {2: state, 3: faults}
        for at, value in floats.items():
            shown[at], shown[at + 1] = struct.unpack(">HH", struct.pack(">f", value))
        return shown

    def written(self, address: int, count: int) -> None:
        if address <= 20 < address + count:
            for command in {
                0: (Command.HYDRAULICS_OFF,), 1: (Command.HYDRAULICS_LOW, Command.HYDRAULICS_ON),
                2: (Command.HALT,), 3: (Command.RESET,),
            }[self.words[20]]:
                self.order(command)
        if address <= 26 < address + count:
            self.actuator.feed(self.words[26])
        if address <= 22 < address + count:
            raw = struct.pack(">4H", *(self.words[22 + i] for i in range(4)))
            position_mm, speed_mm_s = struct.unpack(">ff", raw)
            self.follow(1e-3 * position_mm, 1e-3 * speed_mm_s)


STAGE_OF = {0x06: 1, 0x07: 2, 0x0F: 3}
STATUS_OF = {0: 0x240, 1: 0x221, 2: 0x233, 3: 0x237}
"""Switch-on disabled, ready to switch on, switched on, operation enabled (IEC 61800-7-201)."""


class Cia402Drive(OtherController):
    """The state machine and the set-point handshake of IEC 61800-7-201, registers numbered by object index.

    Attributes:
        handed_over: set-points that were taken with an edge of "new set-point".
        ignored: set-points written while the power stage was off.
    """

    ranges = ((0x1000, 1), (0x603F, 3), (0x6060, 1), (0x6064, 2), (0x606C, 2), (0x607A, 2))
    def __init__(self, rig: SimulatedRig) -> None:
        super().__init__(rig)
        self.stage = 0
        self.control = 0
        self.acknowledged = False
        self.handed_over = self.ignored = 0

    def shown(self) -> dict[int, int]:
        fault = self.actuator.tripped
        status = 0x08 | (0x07 if self.pressure == 2 else 0) if fault else STATUS_OF[self.stage]
        status |= 0x1000 * self.acknowledged
        error = 0x8611 if self.actuator.fault_bits & FaultBit.FOLLOWING_ERROR else 0xFF01 if fault else 0
        shown = {0x1000: 402, 0x603F: error, 0x6041: status}
        for at, value in ((0x6064, self.actuator.seen_m), (0x606C, self.actuator.plant.value("velocity_m_s"))):
            shown[at], shown[at + 1] = struct.unpack(">HH", struct.pack(">i", round(1e6 * value)))
        return shown

    def written(self, address: int, count: int) -> None:
        if address <= 0x607A < address + count and self.stage < 3:
            self.ignored += 1
        if address == 0x6040:
            before, self.control = self.control, self.words[0x6040]
            self.take_control(before, self.control)

    def take_control(self, before: int, word: int) -> None:
        if word & 0x80 and not before & 0x80:
            self.order(Command.RESET)
            self.stage = 0
        elif not word & 0x02:
            self.order(Command.HYDRAULICS_OFF)
            self.stage = 0
        elif word & 0x100:
            self.order(Command.HALT)
        elif not self.actuator.tripped:
            wanted = STAGE_OF[word & 0x0F]
            assert wanted <= self.stage + 1, "a state is left out"
            self.enable(wanted)
        if self.stage == 3 and word & 0x10 and not before & 0x10:
            self.hand_over()
        self.acknowledged = self.stage == 3 and bool(word & 0x10)

    def enable(self, wanted: int) -> None:
        if wanted == 3 and self.stage < 3:
            self.order(Command.HYDRAULICS_LOW)
            self.order(Command.HYDRAULICS_ON)
        self.stage = wanted

    def hand_over(self) -> None:
        self.handed_over += 1
        target_um = struct.unpack(">i", struct.pack(">HH", self.words[0x607A], self.words[0x607B]))[0]
        self.follow(1e-6 * target_um)

    def watch(self) -> None:
        if self.actuator.tripped and self.pressure == 0:
            self.stage = 0
