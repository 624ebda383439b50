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
