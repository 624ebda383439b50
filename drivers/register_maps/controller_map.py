"""A register map in use: what is read at a poll, what it means in the rig's words, what a command writes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property

from drivers.capabilities import Capabilities
from drivers.register_maps.access_plan import Read, Rules, reads
from drivers.register_maps.condition import Values
from drivers.register_maps.indirect import Indirect
from drivers.register_maps.meanings import Bits, Codes, PressureRules, States
from drivers.register_maps.quantity import Quantity, Value, same
from drivers.register_maps.read_quantities import IDENTITY, LIMITS, ROLES
from drivers.register_maps.recipe import Recipe, Write
from drivers.roles import ActuatorIdentity, ActuatorLimits, ActuatorStatus, Command, Input, Pressure, State
from protocols.errors import LocalProtocolError, RemoteProtocolError

IDENTITY_FIELDS = tuple(ActuatorIdentity.__dataclass_fields__)
_BARE = ("_m_s2", "_m_s", "_Pa", "_m", "_N")


def _bare(name: str) -> str:
    return next((name.removesuffix(suffix) for suffix in _BARE if name.endswith(suffix)), name)


STATUS = tuple(_bare(name) for name in ActuatorStatus._fields[1:])
MEASURED = frozenset(_bare(name) for name in ActuatorStatus._fields if name != _bare(name))
CLOCKS = {"clock": "clock_us", "pulse_clock": "pulse_clock_us"}
LIMIT_FIELDS: Mapping[str, str] = {_bare(name): name for name in ActuatorLimits.__dataclass_fields__} | {
    "watchdog_time": "watchdog_ms"
}
CLOCK_MODULUS = 1 << 32
LESS_PRESSURE = frozenset({State.OFF, State.LOW})
PRESSURES = int(Input.HYDRAULICS_LOW | Input.HYDRAULICS_ON)


@dataclass(frozen=True)
class Words:
    """The tables of codes and bits of one map."""

    states: States
    faults: Bits
    inputs: Bits
    commands: Codes
    results: Codes
    waveforms: Codes
    phases: Codes
    watchdog_actions: Codes
    pressure: PressureRules = field(default_factory=lambda: PressureRules({}))


@dataclass(frozen=True)
class Recipes:
    """Sequences of writes for each purpose.

    Attributes:
        commands: the steps of each supported command.
        setpoint: steps for each set-point; empty if the device has a function generator.
        while_off: whether set-points may be sent without pressure.
        feed: writes that feed the watchdog.
        table: loads `table_values` samples of a table waveform.
        watchdog_s: time after which the watchdog trips (s); 0: not stated.
        watchdog_tested: the pressure at which it works: "off", "low" or "on".
    """

    commands: Mapping[Command, Recipe]
    setpoint: Recipe = ()
    feed: Recipe = ()
    table: Recipe = ()
    table_values: int = 0
    watchdog_s: float = 0.0
    watchdog_tested: str = "off"
    while_off: bool = True


@dataclass(frozen=True)
class ControllerMap:
    """One kind of controller.

    Attributes:
        name: for people.
        quantities: of the file, by name.
        expected: what identity quantities must show (SI or text).
        read_while_writing: function 23 may be used.
    """

    name: str
    quantities: Mapping[str, Quantity]
    capabilities: Capabilities
    words: Words
    recipes: Recipes
    rules: Rules
    expected: Mapping[str, Value] = field(default_factory=dict)
    indirect: Indirect | None = None
    read_while_writing: bool = False

    @property
    def fixed_watchdog_s(self) -> float:
        """After how long its watchdog trips, where that is fixed in the device and stated (s); else 0."""
        return 0.0 if "watchdog_time" in self.quantities else self.recipes.watchdog_s

    @cached_property
    def setpoint_feeds(self) -> bool:
        """A set-point's write carries the watchdog's counter, too."""
        steps = (step for step in self.recipes.setpoint if isinstance(step, Write))
        return any("$counter" in step.values.values() for step in steps)

    @cached_property
    def setpoint_waits(self) -> bool:
        """Whether a set-point is transferred in steps, with an acknowledgement by the device."""
        return not all(isinstance(step, Write) for step in self.recipes.setpoint)

    @cached_property
    def setpoint_has_speed(self) -> bool:
        """A set-point tells the device how fast to go on."""
        steps = (step for step in self.recipes.setpoint if isinstance(step, Write))
        return any("$velocity" in step.values.values() for step in steps)

    def state_of(self, values: Values) -> int:
        """The rig's state for what the quantities of `polled` show."""
        return self._state(values, self.words.faults.meaning(values))

    def differs(self, values: Values, before: Values) -> bool:
        """State, faults or inputs are others than before."""
        words = self.words
        return bool(before) and any(
            of.meaning(values) != of.meaning(before) for of in (words.states, words.faults, words.inputs)
        )

    @staticmethod
    def with_low_pressure(status: ActuatorStatus) -> ActuatorStatus:
        """The status of a device without pressure whose host is to see low pressure, of which it has none."""
        return status._replace(
            state=int(State.LOW), inputs=status.inputs | Input.HYDRAULICS_LOW, stated_pressure=Pressure.LOW
        )

    @cached_property
    def polled(self) -> frozenset[Quantity]:
        """What is read at every poll: the status, and what its words are made of."""
        own = {self.quantities[name] for name in ROLES if name in self.quantities}
        words = self.words
        stated = words.states.quantities | words.pressure.quantities
        return frozenset(own | stated | words.faults.quantities | words.inputs.quantities)

    @cached_property
    def status_reads(self) -> tuple[Read, ...]:
        """The requests of a poll."""
        shown = {} if self.indirect is None else self.indirect.shown()
        return reads((shown.get(quantity.name, quantity) for quantity in self.polled), self.rules)

    @cached_property
    def identity_reads(self) -> tuple[Read, ...]:
        """The requests that read who it is."""
        names = {name for name in (*IDENTITY, *self.expected) if name in self.quantities}
        return reads((self.quantities[name] for name in names), self.rules)

    @cached_property
    def limits(self) -> tuple[Quantity, ...]:
        """The limits that it holds, in the order of the roles."""
        return tuple(self.quantities[name] for name in LIMITS if name in self.quantities)

    @cached_property
    def limit_reads(self) -> tuple[Read, ...]:
        """The requests that read its limits."""
        return reads(self.limits, self.rules)

    def recipe(self, command: Command) -> Recipe | None:
        """The steps of a command; None where the device has none.

        A device that stops in one way only is stopped in that way, whichever was meant.
        """
        given = self.recipes.commands
        other = {Command.FADE_STOP: Command.HALT, Command.HALT: Command.FADE_STOP}.get(command, command)
        return given.get(command, given.get(other))

    def carrier(self, command: Command, *, low: bool) -> Command | None:
        """The command whose recipe carries this one out, and whose code the device shows; None: nothing is written.

        Args:
            command: what is asked for.
            low: of a device with one pressure only, low pressure is shown while it is off.
        """
        if command in self.recipes.commands:
            return command
        if command is Command.HYDRAULICS_LOW:
            return None if low else Command.HYDRAULICS_OFF
        return {Command.FADE_STOP: Command.HALT, Command.HALT: Command.FADE_STOP}.get(command, command)

    def identity(self, values: Values) -> ActuatorIdentity:
        """Who it is, by what its identity quantities show."""
        held: dict[str, Value] = {name: values[name] for name in IDENTITY_FIELDS if name in values}
        texts = {name: _text(held[name]) for name in IDENTITY[2:] if name in held}
        return ActuatorIdentity(**(held | texts))  # type: ignore[arg-type]  # types follow the map

    def status(self, values: Values, received_ns: int, host: Values) -> ActuatorStatus:
        """The status in the rig's words.

        Without a heartbeat or a clock of its own the arrival's time stands for it; without an e-stop input the chain
        counts as closed; what it does not show and the host does not know is 0 or NaN.

        Args:
            values: what the quantities of `polled` show (SI).
            received_ns: when they arrived, host's monotonic clock.
            host: what the host knows itself, by the names of the status; what the device shows comes first.
        """
        words = self.words
        clock_us = received_ns // 1000 % CLOCK_MODULUS
        own: dict[str, Value] = {"heartbeat": received_ns // 10_000_000 & 0xFFFF, "clock_us": clock_us}
        shown = own | dict(host) | dict(values)
        for name, role in CLOCKS.items():
            if name in values:
                shown[role] = self.clock_us(values[name])
        shown["fault_bits"] = words.faults.meaning(values)
        shown["state"] = self._state(values, int(shown["fault_bits"]))
        shown["stated_pressure"] = pressure = self.pressure_of(values)
        shown["inputs"] = self._inputs(values, int(shown["state"]), pressure)
        for name, codes in (("result", words.results), ("phase", words.phases), ("acked_command", words.commands)):
            if name in values:
                shown[name] = codes.meaning(int(values[name]))
        fields = [shown.get(name, math.nan if name in MEASURED else 0) for name in STATUS]
        return ActuatorStatus(received_ns, *fields)  # type: ignore[arg-type]  # types follow the map

    @staticmethod
    def clock_us(shown: Value) -> int:
        """A clock's reading (s) in microseconds modulo 2^32.

        Raises:
            RemoteProtocolError: it is no finite number.
        """
        shown_us = float(shown) * 1e6
        if not math.isfinite(shown_us):
            raise RemoteProtocolError(f"the clock shows {shown}")
        return round(shown_us) % CLOCK_MODULUS

    def _state(self, values: Values, fault_bits: int) -> int:
        """By the rules; where they know no trip, any fault is one, and no off, no pressure is, unless it is tripped."""
        words, known = self.words, self.words.states.known
        if fault_bits & words.faults.members and State.TRIPPED not in known:
            return State.TRIPPED
        state = words.states.meaning(values)
        shown = bool(words.pressure.rules) or bool(words.inputs.members & PRESSURES)
        if state != State.TRIPPED and shown and State.OFF not in known and self.pressure_of(values) is Pressure.OFF:
            return State.OFF
        return state

    def pressure_of(self, values: Values) -> Pressure:
        """The pressure for what the quantities of `polled` show: by [pressure], by the inputs, or by the state's rules.

        An input for full pressure alone shows by its absence that there is none; one for low pressure alone does not.
        What is not a number shows nothing: a broken transducer does not prove that the pressure is gone.
        """
        words = self.words
        if any(values[quantity.name] != values[quantity.name] for quantity in self._shows_pressure):
            return Pressure.UNKNOWN
        if words.pressure.rules:
            return words.pressure.meaning(values)
        by_state = words.states.pressure(values)
        inputs, members = words.inputs.meaning(values), words.inputs.members
        if inputs & Input.HYDRAULICS_ON:
            return Pressure.ON
        if inputs & Input.HYDRAULICS_LOW:
            return Pressure.LOW
        if not members & Input.HYDRAULICS_ON:
            return by_state
        return Pressure.LOW if by_state is Pressure.LOW and not members & Input.HYDRAULICS_LOW else Pressure.OFF

    @cached_property
    def _shows_pressure(self) -> frozenset[Quantity]:
        """What conditions on the pressure look at."""
        words = self.words
        if words.pressure.rules:
            return words.pressure.quantities
        conditions = [condition for member, condition in words.inputs.conditions if member & PRESSURES]
        conditions += [rule.condition for rule in words.states.rules if rule.state in LESS_PRESSURE and rule.condition]
        return frozenset[Quantity]().union(*(condition.quantities for condition in conditions))

    def _inputs(self, values: Values, state: int, pressure: Pressure) -> int:
        inputs = self.words.inputs.meaning(values)
        if not self.capabilities.e_stop_input:
            inputs |= Input.E_STOP_CLOSED
        if self.capabilities.hydraulics and not self.words.inputs.members & PRESSURES and state in set(State):
            bits = {Pressure.OFF: 0, Pressure.LOW: int(Input.HYDRAULICS_LOW)}
            inputs |= bits.get(pressure, int(Input.HYDRAULICS_ON))
        return inputs

    def limit_values(self, limits: ActuatorLimits) -> dict[Quantity, Value]:
        """What is written for the rig's limits (SI), for those that the device holds.

        Raises:
            LocalProtocolError: a limit that the device does not know.
        """
        result: dict[Quantity, Value] = {}
        for quantity in self.limits:
            value = getattr(limits, LIMIT_FIELDS[quantity.name])
            if quantity.name == "watchdog_time":
                value = value * 1e-3
            if quantity.name == "watchdog_action":
                value = self.words.watchdog_actions.code(value)
            result[quantity] = value
        return result

    def unheld_limits(self, limits: ActuatorLimits) -> list[str]:
        """Why the device's registers cannot hold limits of the rig; empty where they can."""
        try:
            values = self.limit_values(limits)
        except LocalProtocolError as error:
            return [f"watchdog_action: {error}"]
        problems: list[str] = []
        for quantity, value in values.items():
            try:
                quantity.encode(value)
            except LocalProtocolError as error:
                problems.append(str(error))
        return problems

    def held_limits(self, values: Values, limits: ActuatorLimits | None) -> ActuatorLimits:
        """The limits that the device shows; those that it shows as well as it can are as wanted.

        Args:
            values: what the limits' quantities show (SI).
            limits: what was written; None: nothing yet, what the device does not hold is NaN.
        """
        held: dict[str, float] = dict.fromkeys(ActuatorLimits.__dataclass_fields__, math.nan)
        written: dict[Quantity, Value] = {}
        if limits is not None:
            held, written = asdict(limits), self.limit_values(limits)
        for quantity in self.limits:
            shown = values[quantity.name]
            if quantity not in written or not same(shown, written[quantity], quantity.step):
                held[LIMIT_FIELDS[quantity.name]] = self._limit(quantity.name, shown)
        return ActuatorLimits(**held)  # type: ignore[arg-type]  # milliseconds and codes are whole numbers

    def _limit(self, name: str, shown: Value) -> float:
        """A limit that the device shows, as the rig has it."""
        if name == "watchdog_time":
            shown_ms = float(shown) * 1e3
            return round(shown_ms) if math.isfinite(shown_ms) else shown_ms
        return self.words.watchdog_actions.meaning(int(shown)) if name == "watchdog_action" else float(shown)


def _text(value: Value) -> str:
    return value if isinstance(value, str) else f"{value:g}" if isinstance(value, float) else str(value)
