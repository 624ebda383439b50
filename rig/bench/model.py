"""The bench file: `Bench.load("bench.toml")`, the settings of every device and of the rig."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from drivers.catalogue import (
    current_source_commands,
    current_source_period_s,
    current_source_range_A,
    unheld_limits,
)
from drivers.connection import ActuatorAddress, LinkKind, modbus_line
from drivers.sensor_formats import described_format, is_can, registers_of
from protocols.binary_format import Registers
from protocols.can_frame import EXTENDED, decode_requests
from protocols.descriptions import Problem
from protocols.j1939 import parameter_group
from protocols.sensor_format import modbus_framing
from rig import units
from rig.bench import named_files
from rig.bench.controller_limits import controller_limits
from rig.bench.results_table import ResultsTable
from rig.bench.sensor_settings import Auxiliary, LoadCell, Lvdt, Name, SensorConfig
from rig.bench.settings import MOST_AUXILIARY, ActuatorConfig, Clock, EcuConfig, Limits, Margins, Station
from rig.files.display_table import DisplayTable
from rig.files.loader import load_section
from rig.files.quantity import Quantity
from rig.files.section import Section

ZERO_SHARE_OF_RANGE = 0.0025
CHANGE_OF_ZERO = 0.4
SHARE_OF_TEST = 0.02
"""Of the test's largest force: a zero that is wrong by so much is no longer small beside what is measured."""
MIN_SHARE_OF_RANGE = 0.001
"""A controller's coarse force input is not better than that."""


FASTEST_MODBUS_Hz = 1000.0
"""Of a network: each reading is a request and an answer, sent one at a time."""
FRAMING_OF = {LinkKind.MODBUS_TCP: "tcp", LinkKind.MODBUS_RTU: "rtu"}


class Checks(Section):
    """Load cell and LVDT against the controller's own inputs, as far as both classes of instruments allow."""

    force_gain: Annotated[float, Quantity("ratio", "0.1 %", "50 %")] = Field(
        default=0.02, description="permitted difference in sensitivity between the load cell and the controller's "
            "force input"
    )
    displacement_gain: Annotated[float, Quantity("ratio", "0.1 %", "50 %")] = Field(
        default=0.01, description="permitted difference in sensitivity between the LVDT and the controller's "
            "position input"
    )
    force_zero_N: Annotated[float, Quantity("force", "0 N", "20 kN", above=True)] | None = Field(
        default=None, alias="force_zero",
        description="permitted difference in zero between the load cell and the force input; default: 0.25 % of "
            "the load cell's range, less for tests with low forces",
    )
    displacement_zero_m: Annotated[float, Quantity("length", "0 mm", "100 mm", above=True)] = Field(
        default=0.5e-3, alias="displacement_zero", description="permitted difference in zero between the LVDT and the "
            "position input"
    )
    time_s: Annotated[float, Quantity("time", "0.01 ms", "100 ms")] = Field(
        default=0.5e-3, alias="time", description="largest permitted delay of an input beyond the declared delays"
    )
    current_zero_A: Annotated[float, Quantity("current", "1 mA", "5 A")] = Field(
        default=0.02, alias="current_zero", description="largest current that the ECU may report while its output "
            "stage is off"
    )

    def zero_N(self, range_N: float, largest_N: float | None) -> float:
        """What load cell and force input may differ by at zero (N).

        Args:
            range_N: the load cell's range.
            largest_N: the largest force the test is expected to show (N); None: unknown.
        """
        if self.force_zero_N is not None:
            return self.force_zero_N
        usual_N = ZERO_SHARE_OF_RANGE * range_N
        if largest_N is None:
            return usual_N
        return min(usual_N, max(SHARE_OF_TEST * largest_N, MIN_SHARE_OF_RANGE * range_N))


class Fixture(Section):
    """What sits between load cell and damper."""

    moving_mass_kg: Annotated[float, Quantity("mass", "0 kg", "500 kg")] = Field(default=0.0, alias="moving_mass")


class Bench(Section):
    """One rig: its devices, calibration and limits."""

    format: Literal[1]
    name: Name
    limits: Limits
    actuator: ActuatorConfig
    ecu: EcuConfig
    load_cell: LoadCell
    lvdt: Lvdt
    auxiliary: tuple[Auxiliary, ...] = Field(default=(), max_length=MOST_AUXILIARY)
    fixture: Fixture = Field(default_factory=Fixture)
    clock: Clock = Field(default_factory=Clock)
    station: Station = Field(default_factory=Station)
    checks: Checks = Field(default_factory=Checks)
    display: DisplayTable = Field(default_factory=DisplayTable)
    results: ResultsTable | None = None
    require_valid_calibration: bool = Field(
        default=False, description="require that no sensor's calibration is overdue"
    )

    @classmethod
    def load(cls, path: str | Path) -> Bench:
        """Read and check a bench file.

        Raises:
            FileProblem: with every wrong entry of the file.
        """
        return load_section(Path(path), cls, "bench", named_files.with_paths)[0]

    @property
    def digest(self) -> str:
        """SHA-256 (hex) of physics, limits, calibration and identities; addresses and time limits do not count.

        A new key counts unless it is in the list below or in `not_physics` of its table: runs with different digests
        are not taken for runs on the same rig, so leave out only what no measured value and no limit depends on.

        A device's description in a file of its own counts by its content, not by its path.
        """
        text = self.model_dump_json(
            exclude={
                "name": True,
                "actuator": self.actuator.not_physics,
                "ecu": self.ecu.not_physics,
                "load_cell": self.load_cell.not_physics,
                "lvdt": self.lvdt.not_physics,
                "auxiliary": {index: item.not_physics for index, item in enumerate(self.auxiliary)},
                "clock": True,
                "station": True,
                "checks": True,
                "display": True,
                "results": True,
            }
        )
        tables = {
            "actuator": {"register_map": self.actuator.register_map},
            "ecu": {"dbc": self.ecu.dbc, "roles": self.ecu.roles, "supply": self.ecu.supply},
            "load_cell": {"format": self.load_cell.format},
            "lvdt": {"format": self.lvdt.format},
            "auxiliary": [{"format": sensor.format} for sensor in self.auxiliary],
        }
        return hashlib.sha256(named_files.with_contents(text, tables).encode()).hexdigest()

    def overdue(self, today: date) -> tuple[str, ...]:
        """Names of the sensors whose calibration is past its due date."""
        sensors = {"load_cell": self.load_cell, "lvdt": self.lvdt, **{item.name: item for item in self.auxiliary}}
        return tuple(
            name for name, item in sensors.items() if item.calibration.due is not None and item.calibration.due < today
        )

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`."""
        for check in (
            self._shared_ports, self._requests_on_can, self._shared_names, self._ranges, self._held_limits,
            self._current, self._periods,
        ):
            yield from check()

    def _sensors(self) -> dict[tuple[str | int, ...], SensorConfig]:
        sensors: dict[tuple[str | int, ...], SensorConfig] = {("load_cell",): self.load_cell, ("lvdt",): self.lvdt}
        for index, item in enumerate(self.auxiliary):
            sensors["auxiliary", index] = item
        return sensors

    def _shared_ports(self) -> list[Problem]:
        problems: list[Problem] = []
        owners: dict[tuple[str, object], str] = {}
        lines: dict[str, tuple[str, object]] = {}
        if self.ecu.url is None and not self.ecu.by_hand and self.ecu.interface is not None:
            lines[modbus_line(self.ecu.port)] = "ecu", (self.ecu.bitrate, self.ecu.interface_options)
        for place, sensor in self._sensors().items():
            name, key = str(place[0]), "interface" if sensor.bus is not None else "url"
            # A CAN bus, Modbus server or Modbus RTU line may have several sensors, each with its own reading.
            reading, same = sensor.reading, modbus_line(sensor.port)
            if (owner := owners.get((same, reading))) is not None:
                text = f"is already used by {owner}; every sensor requires its own port"
                if reading is not None:
                    text = f"and format describe the same reading as {owner}; every sensor requires its own reading"
                problems.append(((*place, key), text))
            elif reading is not None and None in (reads for port, reads in owners if port == same):
                problems.append(((*place, key), f"is already used by {owners[same, None]}; every sensor requires its "
                    "own port"))
            owners.setdefault((same, reading), name)
            if self.actuator.url.startswith("modbus-rtu:") and same == modbus_line(self.actuator.url):
                text = "is the serial line of [actuator], which cannot be shared. Fix: use a separate serial line"
                problems.append(((*place, key), text))
            settings = (sensor.bitrate, sensor.interface_options) if sensor.bus is not None else sensor.line
            owner, owners_settings = lines.setdefault(same, (name, settings))
            if reading is not None and owners_settings != settings:
                what = "bitrate and interface_options" if sensor.bus is not None else "baudrate, parity and stop bits"
                problems.append(((*place, key), f"is shared with [{owner}], but {what} differ"))
        problems += self._shared_modbus()
        rtu = "modbus-rtu:"
        both = (self.ecu.url or "").startswith(rtu) and self.actuator.url.startswith(rtu)
        if both and modbus_line(self.ecu.url or "") == modbus_line(self.actuator.url):
            text = "is the serial line of [actuator], which cannot be shared. Fix: use a separate serial line"
            problems.append((("ecu", "url"), text))
        return problems

    def _shared_modbus(self) -> Iterator[Problem]:
        """Sensors and an output on one Modbus connection: one framing, one line, no register of two readings."""
        framings: dict[str, tuple[str, str]] = {}
        values: dict[tuple[str, int, int], list[tuple[str, int, int]]] = {}
        url = self.ecu.url or ""
        if (framing := FRAMING_OF.get(ActuatorAddress.parse(url).kind)) is not None:
            framings[modbus_line(url)] = "ecu", framing
        for place, sensor in self._sensors().items():
            name, framing, same = str(place[0]), modbus_framing(sensor.described), modbus_line(sensor.port)
            if not framing:
                continue
            owner, owners = framings.setdefault(same, (name, framing))
            if owners != framing:
                yield (*place, "format"), (
                    f"has framing {framing}, but [{owner}] uses framing {owners} on the same connection. Fix: specify "
                    "the framing of the device (tcp or rtu) in both"
                )
            elif owner == "ecu" and framing == "rtu" and not sensor.port.startswith("socket://"):
                yield from self._same_line(place, sensor)
            registers = registers_of(sensor.described)
            if registers is None:
                continue
            (first, count), base = registers.value, registers.first_address
            others = values.setdefault((same, registers.unit, registers.function), [])
            for owner, other, size in others:
                if size == count and 0 < abs(first - other) < count:
                    yield (*place, "format"), (
                        f"reads registers {base + first} to {base + first + count - 1}, but some of them belong to the "
                        f"reading of [{owner}]. Fix: check address and type"
                    )
            others.append((name, first, count))

    def _same_line(self, place: tuple[str | int, ...], sensor: SensorConfig) -> Iterator[Problem]:
        """A serial line has one baud rate and one parity, for the output on it, too."""
        described = self.ecu.described_supply
        if described is None:
            return
        baudrate = self.ecu.baudrate or described.link.baudrate
        if (baudrate, described.link.parity) != (sensor.baudrate, sensor.parity):
            yield (*place, "url"), (
                f"is shared with [ecu], but the settings of the line differ: {sensor.baudrate} Bd and parity "
                f"{sensor.parity} here, {baudrate} Bd and parity {described.link.parity} for [ecu]. Fix: specify the "
                "same baudrate in both, and the same parity here and in the supply's file"
            )

    def _requests_on_can(self) -> Iterator[Problem]:
        """A request to a sensor must never be a command to the current controller on the same bus."""
        if self.ecu.url is not None or self.ecu.by_hand:
            return
        commands = current_source_commands(*self.ecu.described_source)
        groups = {parameter_group(identifier) for identifier, extended in commands if extended}
        for place, sensor in self._sensors().items():
            if sensor.bus is None or sensor.port != self.ecu.port or not is_can(sensor.described):
                continue
            made = described_format(sensor.described)
            for key, _, _ in decode_requests(made.exchange.request):
                identifier, extended = key & ~EXTENDED, bool(key & EXTENDED)
                if (identifier, extended) in commands or (extended and parameter_group(identifier) in groups):
                    yield (*place, "format"), (
                        f"sends requests with identifier 0x{identifier:X}, which is the identifier of a command to "
                        "[ecu] on the same bus: a request could set the current. Fix: check request and id"
                    )

    def _shared_names(self) -> list[Problem]:
        names = [item.name for item in self.auxiliary]
        return [
            (("auxiliary", index, "name"), "is already the name of another auxiliary channel; names must be unique")
            for index, name in enumerate(names)
            if name in names[:index]
        ]

    def _ranges(self) -> list[Problem]:
        problems: list[Problem] = []
        if self.limits.force_N > self.load_cell.range_N:
            cell = units.show(self.load_cell.range_N, "kN")
            problems.append((("limits", "force"), f"exceeds the load cell's range; allowed: at most {cell}"))
        if max(map(abs, self.limits.position_m)) > self.lvdt.range_m:
            lvdt = units.show(self.lvdt.range_m, "mm")
            problems.append((("limits", "position"), f"exceeds the LVDT's range; allowed: within +-{lvdt}"))
        return problems

    def _held_limits(self) -> list[Problem]:
        """The limits that are written to the controller, against the registers that hold them."""
        limits = controller_limits(self.limits, Margins().speed, self.actuator)
        unheld = unheld_limits(self.actuator.described, limits)
        return [(("actuator", "register_map"), f"cannot represent a limit of this bench: {text}") for text in unheld]

    def _current(self) -> list[Problem]:
        """The limit against what the current source gives."""
        described = self.ecu.described_supply
        if self.ecu.by_hand:
            return self._hands()
        if described is not None:
            low_A, high_A = described.current_A
        else:
            low_A, high_A = current_source_range_A(*self.ecu.described_source)
        if self.limits.current_A <= high_A and (-self.limits.current_A >= low_A or low_A >= 0.0):
            return []
        held = f"{units.show(low_A, 'A')} to {units.show(high_A, 'A')}"
        return [(("limits", "current"), f"exceeds the set-point range of the current source; allowed: within {held}")]

    def _hands(self) -> list[Problem]:
        """The pressure while the operator is at the supply."""
        if self.ecu.pressure_while_asked == "on" or self.actuator.takes_pressure_away:
            return []
        message = (
            'the controller has no command to switch the pressure off. Fix: write pressure_while_asked = "on" if a '
            "person at the supply cannot reach the rod, or use a register map with commands for the hydraulics"
        )
        return [(("ecu", "pressure_while_asked"), message)]

    def _periods(self) -> list[Problem]:
        problems: list[Problem] = []
        for place, sensor in self._sensors().items():
            if (registers := registers_of(sensor.described)) is not None:
                highest_Hz = _highest_rate_Hz(sensor, registers)
                if sensor.rate_Hz > highest_Hz:
                    message = f"is too high for one Modbus request per reading; allowed: at most {highest_Hz:.0f} Hz"
                    problems.append(((*place, "rate"), message))
            shortest = 2.0 / (sensor.rate_Hz * self.clock.device_rate)
            if sensor.stale_after_s < shortest:
                message = f"is shorter than two samples; allowed: at least {units.show(shortest, 'ms')}"
                problems.append(((*place, "stale_after"), message))
        shortest = 2.0 * max(self.actuator.poll_s, self.actuator.timeout_s)
        if self.actuator.watchdog_s < shortest:
            message = f"is shorter than two poll periods or time-outs; allowed: at least {units.show(shortest, 'ms')}"
            problems.append((("actuator", "watchdog"), message))
        on_CAN = self.ecu.url is None and not self.ecu.by_hand
        return [*problems, *self._ecu_periods()] if on_CAN else problems

    def _ecu_periods(self) -> list[Problem]:
        """Of a current controller on CAN; those of a supply are its own entries'."""
        status_s = 2.0 * current_source_period_s(*self.ecu.described_source) / self.clock.device_rate
        command_s = 2.0 * self.ecu.command_period_s
        for shortest, what in ((command_s, "status frames"), (status_s, "update periods of the measured current")):
            if self.ecu.stale_after_s < shortest:
                message = f"is shorter than two {what}; allowed: at least {units.show(shortest, 'ms')}"
                return [(("ecu", "stale_after"), message)]
        own_s = self.ecu.own_timeout_s
        if own_s is not None and 2.0 * self.ecu.command_period_s > own_s:
            waits, longest = units.show(own_s, "ms"), units.show(0.5 * own_s, "ms")
            message = f"is too long for an ECU with a time-out of {waits}; allowed: at most {longest}"
            return [(("ecu", "command_period"), message)]
        return []


def _highest_rate_Hz(sensor: SensorConfig, registers: Registers) -> float:
    """Largest number of Modbus requests and answers per second that the sensor's line can carry, Hz.

    MODBUS over Serial Line V1.02, 2.5.1: a request of 8 and an answer of 5 bytes in addition to the registers, and a
    pause of 3.5 characters after each.
    """
    if not registers.rtu or sensor.port.startswith("socket://"):
        return FASTEST_MODBUS_Hz
    character_bits = 1 + sensor.data_bits + (sensor.parity != "N") + sensor.stop_bits
    characters = 8 + 5 + 2 * registers.count + 2 * 3.5
    return min(FASTEST_MODBUS_Hz, sensor.baudrate / (character_bits * characters))
