"""A supply's description read without trust: everything wrong with it at once, each with its place."""

from __future__ import annotations

import difflib
import functools
import math
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from drivers.current_source import SourceFault
from drivers.devices.description_file import read_description, read_text
from drivers.devices.output_file import is_output, read_output
from drivers.devices.supply import (
    PARITIES,
    TERMINATORS,
    Commands,
    SupplyCommands,
    SupplyDescription,
    SupplyLink,
    SupplyWatchdog,
)
from protocols.errors import LocalProtocolError
from protocols.patterns import Pattern, PatternError
from protocols.scpi import Command
from protocols.toml_lines import scan_lines, structure_problem

Place = tuple[str | int, ...]
Problems = list[tuple[Place, str]]

FOLDER = Path(__file__).parent
ENDING = "_supply.toml"
SUFFIX = ".toml"
LARGEST_A, LARGEST_V = 1000.0, 1000.0
LONGEST_MS = 10_000.0

_TOP = (
    "format", "maker", "model", "tried", "settling_ms", "link", "range", "commands", "answers", "faults", "watchdog",
)
_FAULTS = {"over-temperature": SourceFault.OVER_TEMPERATURE, "undervoltage": SourceFault.UNDERVOLTAGE,
           "open": SourceFault.OPEN, "short": SourceFault.SHORT}
HIGHEST_BIT = 31
_LINK = ("terminator", "echo", "acknowledge", "gap_ms", "baudrate", "bytesize", "parity", "stopbits")
_RANGE = ("current_A", "voltage_V")
_ANSWERS = ("identity", "no_error", "current", "voltage", "on")
_WATCHDOG = ("time_s", "start", "stop", "feed")
COMMANDS = tuple(item.name for item in fields(SupplyCommands))
_CARRIES = {"set_current": "current", "set_voltage_limit": "voltage"}
_QUERIES = ("identify", "measure_current", "measure_voltage", "read_output", "error_queue", "read_faults")


def read_supply(given: Mapping[str, Any], name: str) -> tuple[SupplyDescription | None, Problems]:
    """A supply's description, or None and everything that is wrong with it."""
    if is_output(given):
        return read_output(given, name)
    reader = _Reader(given)
    top = reader.table((), given, _TOP)
    link = SupplyLink(**reader.link())
    commands = SupplyCommands(**reader.commands())
    current_A, voltage_V = reader.range("current_A", LARGEST_A), reader.range("voltage_V", LARGEST_V)
    watchdog = reader.watchdog()
    answers = reader.answers()
    faults = reader.faults(commands)
    reader.together(commands, current_A, voltage_V)
    texts = {key: reader.text((key,), top.get(key, "")) for key in ("maker", "model", "tried")}
    settling_s = reader.number(("settling_ms",), top.get("settling_ms", 300), 1.0, LONGEST_MS) * 1e-3
    if top.get("format", 1) != 1:
        reader.problems.append((("format",), "must be 1"))
    if reader.problems or current_A is None:
        return None, reader.problems
    return SupplyDescription(
        name, link, commands, current_A, voltage_V, watchdog, texts["maker"], texts["model"], texts["tried"],
        settling_s, **answers, faults=faults,
    ), []


def supply_names() -> tuple[str, ...]:
    """Every preset."""
    return tuple(sorted(path.name.removesuffix(ENDING) for path in FOLDER.glob(f"*{ENDING}")))


def supply(given: str | Mapping[str, Any]) -> SupplyDescription:
    """The description of a preset, of a user's file (its path ends in .toml), or of a table such as such a file has.

    Raises:
        LocalProtocolError: no such preset, or problems: all of them.
    """
    if isinstance(given, str) and not is_file(given):
        return _preset(given)
    description, problems = _described(given)
    if description is None:
        raise LocalProtocolError("; ".join(f"{dotted(place)}: {text}".removeprefix(": ") for place, text in problems))
    return description


def is_file(given: str) -> bool:
    """Whether this is the path of a user's file."""
    return given.casefold().endswith(SUFFIX)


def supply_problems(given: str | Mapping[str, Any]) -> Problems:
    """Everything that is wrong with a preset's name, a user's file or a table.

    Returns:
        Place in the table, and what is wrong; of a file the place is empty, its name and line are in the text.
    """
    if isinstance(given, str) and not is_file(given):
        known = ", ".join(supply_names())
        return [] if given in supply_names() else [((), f"is not known; known: {known}, or a file NAME.toml")]
    return _described(given)[1]


def _described(given: str | Mapping[str, Any]) -> tuple[SupplyDescription | None, Problems]:
    """The description in a file or table; what is wrong in a file is told with its name and line."""
    if not isinstance(given, str):
        return read_supply(given, "supply")
    path = Path(given)
    try:
        text = read_text(path)
        if (problem := structure_problem(text)) is not None:
            return None, [((), f"{path.name}: {problem}")]
        data = tomllib.loads(text)
    except LocalProtocolError as error:
        return None, [((), str(error))]
    except ValueError as error:
        return None, [((), f"{path.name}: not TOML: {error}")]
    lines = scan_lines(text)
    description, problems = read_supply(data, path.stem)
    return description, [((), f"{path.name}{_line(lines, place)}: {dotted(place)}: {text}") for place, text in problems]


def _line(lines: Mapping[Place, int], place: Place) -> str:
    """The line of the nearest entry around a place."""
    for length in range(len(place), 0, -1):
        if place[:length] in lines:
            return f", line {lines[place[:length]]}"
    return ""


def dotted(place: Place) -> str:
    """A place as it is written: `range.current_A[2]` (lists count from 1)."""
    text = ""
    for part in place:
        text += f"[{part + 1}]" if isinstance(part, int) else f".{part}" if text else part
    return text


@functools.cache
def _preset(name: str) -> SupplyDescription:
    """The preset of that name.

    Raises:
        LocalProtocolError: there is none, or it cannot be used.
    """
    if name not in supply_names():
        known = ", ".join(supply_names())
        raise LocalProtocolError(f"no supply {name!r}; known: {known}, or a file of your own (NAME.toml)")
    description, problems = read_supply(read_description(FOLDER / f"{name}{ENDING}"), name)
    if description is None:
        raise LocalProtocolError(f"{name}: {problems}")
    return description


@dataclass
class _Reader:
    """Takes a description apart and collects what is wrong with it."""

    data: Mapping[str, Any]
    problems: Problems = field(default_factory=list)

    def wrong(self, place: Place, text: str) -> None:
        self.problems.append((place, text))

    def table(self, place: Place, given: object, known: tuple[str, ...]) -> Mapping[str, Any]:
        """The table as it is, what is unknown in it named."""
        if not isinstance(given, Mapping):
            self.wrong(place, f"must be a table, with the heading [{'.'.join(map(str, place))}]")
            return {}
        for key in given:
            if key not in known:
                near = difflib.get_close_matches(str(key), known, n=1)
                hint = f"did you mean {near[0]}?" if near else f"known here: {', '.join(known)}"
                self.wrong((*place, key), f"unknown key; {hint}")
        return given

    def inner(self, name: str, known: tuple[str, ...]) -> Mapping[str, Any]:
        return self.table((name,), self.data.get(name, {}), known)

    def text(self, place: Place, given: object) -> str:
        if isinstance(given, str):
            return given
        self.wrong(place, "must be a text in quotes")
        return ""

    def number(self, place: Place, given: object, low: float, high: float) -> float:
        if isinstance(given, bool) or not isinstance(given, (int, float)) or not low <= given <= high:
            self.wrong(place, f"must be a number from {low:g} to {high:g}")
            return low
        return float(given)

    def choice(self, place: Place, given: object, known: tuple[Any, ...]) -> Any:  # noqa: ANN401 - of those in `known`
        if given not in known or isinstance(given, bool):
            self.wrong(place, f"must be one of {', '.join(map(repr, known))}")
            return known[0]
        return given

    def link(self) -> dict[str, Any]:
        given = self.inner("link", _LINK)
        echo = given.get("echo", False)
        if not isinstance(echo, bool):
            self.wrong(("link", "echo"), "must be true or false")
        baudrate = self.number(("link", "baudrate"), given.get("baudrate", 9600), 300, 12_000_000)
        return {
            "terminator": self.choice(("link", "terminator"), given.get("terminator", "\n"), TERMINATORS),
            "echo": echo is True,
            "acknowledge": self.pattern(("link", "acknowledge"), given.get("acknowledge", "")),
            "gap_s": self.number(("link", "gap_ms"), given.get("gap_ms", 0), 0.0, 1000.0) * 1e-3,
            "baudrate": int(baudrate),
            "bytesize": self.choice(("link", "bytesize"), given.get("bytesize", 8), (8, 7)),
            "parity": self.choice(("link", "parity"), given.get("parity", "N"), PARITIES),
            "stopbits": self.choice(("link", "stopbits"), given.get("stopbits", 1), (1, 2, 1.5)),
        }

    def pattern(self, place: Place, given: object, *, value: bool = False) -> Pattern | None:
        """A regular expression, None where the text is empty or not one; with `value` it must have a group so named."""
        text = self.text(place, given)
        if not text:
            return None
        try:
            pattern = Pattern(text)
        except PatternError as error:
            self.wrong(place, f"is not a valid regular expression: {error}")
            return None
        if value and "value" not in pattern.groups:
            self.wrong(place, "must have the number in a group named value, such as '(?P<value>[-+0-9.]+)A'")
        return pattern

    def some(self, place: Place, given: object) -> Commands:
        """A command, or a list of them."""
        texts = [given] if isinstance(given, str) else given
        if not isinstance(texts, (list, tuple)) or not all(isinstance(text, str) for text in texts):
            self.wrong(place, "must be a command in quotes, or a list of commands")
            return ()
        commands = []
        for text in texts:
            try:
                commands.append(Command.of(text))
            except LocalProtocolError as error:
                self.wrong(place, str(error))
        return tuple(commands)

    def commands(self) -> dict[str, Commands]:
        if "commands" not in self.data:
            self.wrong(("commands",), "is missing; write a table [commands] with set_current and measure_current")
            return {}
        given = self.inner("commands", COMMANDS)
        commands = {name: self.some(("commands", name), given[name]) for name in COMMANDS if name in given}
        for name, sent in commands.items():
            self._fits(name, sent)
        return commands

    def _fits(self, name: str, sent: Commands) -> None:
        """Whether commands carry the number they are for, and no other, and answer where they must."""
        place = ("commands", name)
        wanted = _CARRIES.get(name)
        carried = frozenset[str]().union(*(command.quantities for command in sent))
        if wanted and sent and wanted not in carried:
            unit = "current_A" if wanted == "current" else "voltage_V"
            self.wrong(place, f'does not carry the {wanted}; write for example "... {{{unit}:.3f}}"')
        if extra := carried - {wanted}:
            self.wrong(place, f"carries {' and '.join(sorted(extra))}, which is not known here")
        if name in _QUERIES and len(sent) != 1:
            self.wrong(place, "must be one command: its answer is read")
        if name not in _QUERIES and any(command.is_query for command in sent):
            self.wrong(place, "is a query (?); what is set here is not answered with a value")

    def range(self, name: str, largest: float) -> tuple[float, float] | None:
        given = self.inner("range", _RANGE).get(name) if isinstance(self.data.get("range", {}), Mapping) else None
        if given is None:
            if name == "current_A":
                self.wrong(("range", name), f"is missing; write the lowest and highest set-point: {name} = [0, 5]")
            return None
        if not isinstance(given, (list, tuple)) or len(given) != 2:
            self.wrong(("range", name), f"must be a list of lowest and highest, such as {name} = [0, 5]")
            return None
        before = len(self.problems)
        low, high = (self.number(("range", name, index), end, -largest, largest) for index, end in enumerate(given))
        if len(self.problems) == before and not low < high:
            self.wrong(("range", name), "the first must be below the second")
        return low, high

    def watchdog(self) -> SupplyWatchdog | None:
        if "watchdog" not in self.data:
            return None
        given = self.inner("watchdog", _WATCHDOG)
        time_s = self.number(("watchdog", "time_s"), given.get("time_s"), 0.1, 60.0)
        if "start" not in given:
            self.wrong(("watchdog", "start"), "is missing; write the commands that set the time-out and switch it on")
        sent = {name: self.some(("watchdog", name), given.get(name, ())) for name in ("start", "stop", "feed")}
        for name, commands in sent.items():
            if any(command.quantities - {"time"} for command in commands):
                self.wrong(("watchdog", name), "may carry {time_s} or {time_ms} only")
        return SupplyWatchdog(time_s, **sent)

    def answers(self) -> dict[str, Any]:
        given = self.inner("answers", _ANSWERS)
        read: dict[str, Any] = {}
        for name in ("identity", "no_error", "current", "voltage"):
            if name in given:
                pattern = self.pattern(("answers", name), given[name], value=name in {"current", "voltage"})
                read |= {} if pattern is None else {name: pattern}
        if "on" in given:
            on = [given["on"]] if isinstance(given["on"], str) else given["on"]
            if isinstance(on, (list, tuple)) and on and all(isinstance(text, str) for text in on):
                read["on"] = tuple(on)
            else:
                self.wrong(("answers", "on"), 'must be a list of texts, such as ["1", "ON"]')
        return read

    def faults(self, commands: SupplyCommands) -> tuple[tuple[int, int], ...]:
        """Bits by what they mean."""
        given = self.inner("faults", tuple(_FAULTS))
        if given and not commands.read_faults:
            self.wrong(("faults",), 'means bits of an answer: write the question as read_faults under [commands]')
        if commands.read_faults and not given:
            self.wrong(("commands", "read_faults"), "is answered with bits: say under [faults] what they mean")
        bits = {
            name: self.number(("faults", name), bit, 0, HIGHEST_BIT) for name, bit in given.items() if name in _FAULTS
        }
        for name, bit in bits.items():
            if bit != int(bit):
                self.wrong(("faults", name), f"{bit:g} is no bit: must be a whole number from 0 to {HIGHEST_BIT}")
        return tuple((1 << int(bit), int(_FAULTS[name])) for name, bit in bits.items())

    def together(
        self, commands: SupplyCommands, current_A: tuple[float, float] | None, voltage_V: tuple[float, float] | None
    ) -> None:
        """What entries that are right by themselves say wrong together."""
        for problem in _lacking(commands, current_A, voltage_V):
            if isinstance(self.data.get("commands"), Mapping):
                self.problems.append(problem)


def _lacking(
    commands: SupplyCommands, current_A: tuple[float, float] | None, voltage_V: tuple[float, float] | None
) -> Iterator[tuple[Place, str]]:
    """What nothing can be run without."""
    if not commands.set_current:
        yield ("commands", "set_current"), 'is missing; write for example set_current = "CURR {current_A:.3f}"'
    if not commands.measure_current:
        yield ("commands", "measure_current"), (
            'is missing; write for example measure_current = "MEAS:CURR?". Without a measured current 0 A could not be '
            "proved"
        )
    if bool(commands.output_on) != bool(commands.output_off):
        absent = "output_off" if commands.output_on else "output_on"
        yield ("commands", absent), "is missing; a supply that has one of the two has both"
    reaches_zero = current_A is not None and current_A[0] <= 0.0 <= current_A[1]
    if current_A is not None and not (reaches_zero or commands.output_off):
        yield ("range", "current_A"), (
            "does not hold 0 A, and there is no output_off: this supply cannot give 0 A, and nothing would take the "
            "coil's current away. Refused"
        )
    if current_A is not None and math.isclose(max(map(abs, current_A)), 0.0):
        yield ("range", "current_A"), "gives no current at all"
    if voltage_V is not None and not commands.set_voltage_limit:
        yield ("range", "voltage_V"), "is stated, but there is no set_voltage_limit among the commands"
