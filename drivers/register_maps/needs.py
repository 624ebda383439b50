"""What a register map must have so that a rig can be driven by it, and what it can do, by what it has."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.capabilities import Capabilities, WatchdogKind
from drivers.register_maps.controller_map import Recipes, Words
from drivers.register_maps.entries import Kept
from drivers.register_maps.meanings import word
from drivers.register_maps.quantity import Quantity, Value
from drivers.register_maps.read_quantities import LIMITS, ROLES
from drivers.register_maps.recipe import Recipe, Wait, Write
from drivers.roles import Command, FaultBit, Input, Pressure, Result, State, Waveform

Quantities = Mapping[str, Quantity]

MOVING = frozenset({State.MOVING, State.RUNNING})
STOPS = (Command.FADE_STOP, Command.HALT, Command.HYDRAULICS_OFF)
BEGINNINGS = (Command.HYDRAULICS_LOW, Command.HYDRAULICS_ON, Command.MOVE_TO, Command.START)


def capabilities(quantities: Quantities, words: Words, recipes: Recipes, watchdog: WatchdogKind) -> Capabilities:
    """What a controller with these registers and recipes can do."""
    commands = recipes.commands
    return Capabilities(
        watchdog=watchdog,
        hydraulics=Command.HYDRAULICS_ON in commands and Command.HYDRAULICS_OFF in commands,
        low_pressure=Command.HYDRAULICS_LOW in commands,
        lease="owner" in quantities and {Command.ACQUIRE, Command.RELEASE} <= commands.keys(),
        acquires=Command.ACQUIRE in commands,
        releases=Command.RELEASE in commands,
        acknowledge=is_numbered(quantities, commands) or shakes_hands(commands),
        echo=watchdog is WatchdogKind.COUNTER and "watchdog_echo" in quantities,
        limits_read_back={"position_min", "position_max"} <= quantities.keys(),
        settings_written=bool(LIMITS.keys() & quantities.keys()),
        settings_hash=bool({"boot_count", "config_hash"} & quantities.keys()),
        phase="phase" in quantities and {1, 2, 3} <= words.phases.codes.keys(),
        cycle_pulse={"pulse_count", "pulse_clock", "clock"} <= quantities.keys(),
        generator=Command.START in commands,
        table=bool(recipes.table) and int(Waveform.TABLE) in words.waveforms.codes,
        streamed_setpoints=bool(recipes.setpoint) and Command.START not in commands,
        e_stop_input=bool(words.inputs.members & Input.E_STOP_CLOSED),
        force_input="force" in quantities,
        clock="clock" in quantities,
        speed="velocity" in quantities,
        sine=Command.START not in commands or not _only_triangles(words),
        triangle=Command.START not in commands or _only_triangles(words)
        or _plays(commands[Command.START], words, Waveform.TRIANGLE),
        watchdog_tested=recipes.watchdog_tested,
    )


def _plays(start: Recipe, words: Words, waveform: Waveform) -> bool:
    """The function generator is told which waveform, and has a code for this one."""
    return _asks_for(start, "$waveform") and int(waveform) in words.waveforms.codes


def _only_triangles(words: Words) -> bool:
    """Whether the function generator only moves between two points at constant speed."""
    return int(Waveform.TRIANGLE) in words.waveforms.codes and int(Waveform.SINE) not in words.waveforms.codes


def is_numbered(quantities: Quantities, commands: Mapping[Command, Recipe]) -> bool:
    """The status repeats the number of the last command, which every command writes."""
    shown = {"acked_sequence", "acked_command", "result"} <= quantities.keys()
    return shown and bool(commands) and all(_asks_for(recipe, "$sequence") for recipe in commands.values())


def shakes_hands(commands: Mapping[Command, Recipe]) -> bool:
    """Every motion waits for the device's answer after it has been written."""
    motions = [commands[command] for command in (Command.MOVE_TO, Command.START) if command in commands]
    return bool(motions) and all(isinstance(recipe[-1], Wait) for recipe in motions if recipe)


def _asks_for(recipe: Recipe, name: str) -> bool:
    return any(isinstance(step, Write) and name in step.values.values() for step in recipe)


def check(source: Kept, quantities: Quantities, words: Words, recipes: Recipes, watchdog: WatchdogKind) -> None:
    """Hold what a map says against what every rig needs; keeps every problem."""
    commands = recipes.commands
    if "position" not in quantities:
        source.add(("quantities",), 'position is missing; write position = {address = ..., type = ..., unit = "mm"}')
    _motions(source, words, recipes)
    _stops(source, commands)
    if not {Command.FADE_STOP, Command.HALT} & commands.keys() and Command.START in commands:
        source.add(("commands",), "fade-stop or halt is missing: without it, nothing could stop a motion")
    if watchdog is not WatchdogKind.NONE and not words.faults.members & FaultBit.WATCHDOG:
        source.add(
            ("faults",), "watchdog is missing: this entry states how the device shows that its watchdog has tripped, "
                'which is tested before any motion. Fix: add the entry, or write [watchdog] kind = "none"'
        )
    if (watchdog is not WatchdogKind.NONE or words.faults.members) and Command.RESET not in commands:
        source.add(("commands",), "reset is missing: without it, a trip latched by the device could not be cleared")
    _pressure(source, words, commands)
    _tested(source, commands, watchdog, recipes.watchdog_tested)
    _numbers(source, quantities, words)


def _tested(source: Kept, commands: Mapping[Command, Recipe], watchdog: WatchdogKind, tested: str) -> None:
    """Check that this host can switch off the pressure at which the watchdog is tested."""
    if tested == "off":
        return
    place = ("watchdog", "tested")
    if watchdog is WatchdogKind.NONE:
        source.add(place, 'there is no watchdog to test, because kind is "none"')
    elif Command.HYDRAULICS_OFF not in commands:
        source.add(place, "a watchdog can be tested under pressure only if this host can switch the pressure (or "
            "power) off. Fix: add hydraulics-on and hydraulics-off to [commands]")
    elif tested == "low" and Command.HYDRAULICS_LOW not in commands:
        source.add(place, 'there is no low pressure, because hydraulics-low is not in [commands]. Fix: tested = "on"')


def _stops(source: Kept, commands: Mapping[Command, Recipe]) -> None:
    """A stop goes out at once, and does not do what begins a motion."""
    for stop in STOPS:
        recipe = commands.get(stop)
        if not recipe:
            continue
        if not isinstance(recipe[0], Write):
            source.add(("commands", word(stop)), "a stop must start with a write; pauses and waits must follow the "
                "write")
        for other in BEGINNINGS:
            if commands.get(other) == recipe:
                source.add(("commands", word(stop)), f"is identical to {word(other)}, so it would not stop anything")


def _motions(source: Kept, words: Words, recipes: Recipes) -> None:
    commands = recipes.commands
    generator = Command.START in commands
    if not generator and not recipes.setpoint and Command.MOVE_TO in commands:
        source.add(
            ("commands",), "a device with move-to alone only moves from one position to another and stops there; a "
                "damper test requires a periodic motion. Fix: if the device can move back and forth automatically, add "
                "start (with [waveforms] triangle if it does so at constant speed); if it accepts a new position "
                "during a motion, replace move-to by [setpoint]; otherwise this device cannot drive the rig"
        )
    elif not generator and not recipes.setpoint:
        source.add(
            ("commands",), "start is missing, and there is no [setpoint]. Fix: add start to use the device's "
                "function generator, or [setpoint] to stream set-points"
        )
    if generator and Command.MOVE_TO not in commands:
        source.add(("commands",), "move-to is missing: this command moves the rod to the centre of a program before "
            "the start")
    if generator and not MOVING & words.states.known:
        source.add(("state",), "running (or moving) is missing: this entry states how the device shows that a "
            "program is running")
    if recipes.setpoint and generator:
        source.add(("setpoint",), "a device with a function generator does not need set-points. Fix: remove "
            "[setpoint] or start")
    if generator:
        _program(source, commands[Command.START], words)
    if Command.MOVE_TO in commands and not _asks_for(commands[Command.MOVE_TO], "$target"):
        source.add(("commands", "move-to"), "the target of this command is missing: write $target")


def _program(source: Kept, start: Recipe, words: Words) -> None:
    place = ("commands", "start")
    low_and_high = _asks_for(start, "$low") and _asks_for(start, "$high")
    if not (_asks_for(start, "$amplitude") or _asks_for(start, "$peak_to_peak") or low_and_high):
        source.add(place, "the amplitude of the program is missing: write $amplitude, $peak_to_peak, or $low and $high")
    shapes = {int(Waveform.SINE), int(Waveform.TRIANGLE)}
    if _asks_for(start, "$waveform") and not shapes & words.waveforms.codes.keys():
        source.add(("waveforms",), "sine or triangle is missing: these entries state the function generator's codes")
    for quantity in {one for step in start if isinstance(step, Write) for one, value in step.values.items()
                     if value == "$waveform"}:  # fmt: skip
        for waveform, codes in words.waveforms.codes.items():
            if not quantity.holds(codes[0]):
                source.add(("waveforms", word(Waveform(waveform))), f"{codes[0]} does not fit {quantity.name}")
    if not (_asks_for(start, "$frequency") or _asks_for(start, "$period") or _asks_for(start, "$mean_speed")):
        source.add(place, "the frequency of the program is missing: write $frequency or $period, or $mean_speed for a "
            "device that moves between two points at constant speed")
    if _asks_for(start, "$mean_speed") and not _only_triangles(words):
        source.add(place, "$mean_speed defines the frequency only if the device moves between two points at "
            "constant speed. Fix: write $frequency, or [waveforms] with triangle alone")
    ramped = _asks_for(start, "$ramp_in_cycles") or _asks_for(start, "$ramp_out_cycles")
    ramps = ramped and _asks_for(start, "$cycles")
    if not (_asks_for(start, "$all_cycles") or _asks_for(start, "$duration") or ramps):
        source.add(
            place, "the length of the program is missing: write $all_cycles, $duration, or $cycles with "
                "$ramp_in_cycles and $ramp_out_cycles"
        )


def _pressure(source: Kept, words: Words, commands: Mapping[Command, Recipe]) -> None:
    on, off = Command.HYDRAULICS_ON in commands, Command.HYDRAULICS_OFF in commands
    if on is not off:
        missing = "hydraulics-off" if on else "hydraulics-on"
        source.add(("commands",), f"{missing} is missing: specify commands to switch the pressure (or power) both on "
            "and off, or neither")
    stated = words.pressure.rules
    seen = State.OFF in words.states.known or bool(words.inputs.members & Input.HYDRAULICS_ON) or bool(stated)
    if on and off and not seen:
        source.add(
            ("state",), "off is missing: this entry states how the device shows that its pressure (or power) is off. "
                "Fix: add this entry, [pressure] off or [inputs] hydraulics-on"
        )
    if Command.HYDRAULICS_LOW in commands and not (
        State.LOW in words.states.known or words.inputs.members & Input.HYDRAULICS_LOW or Pressure.LOW in stated
    ):
        source.add(("state",), "low is missing: this entry states how the device shows low pressure. Fix: add the "
            "entry, or remove hydraulics-low")
    _pressure_codes(source, words)


def _pressure_codes(source: Kept, words: Words) -> None:
    """A code of `state` that shows a motion or a hold does not show at the same time that there is no pressure."""
    held = {code: state for state, codes in words.states.codes.codes.items() for code in codes}
    for pressure, rule in words.pressure.rules.items():
        for code in rule.codes:
            state = State(held.get(code, State.TRIPPED))
            if pressure is not Pressure.ON and state not in {State.TRIPPED, State.OFF, State.LOW}:
                source.add(
                    ("pressure", word(pressure)), f"code {code} means {word(state)} in [state], which does not show "
                        "that the pressure (or power) is off"
                )


def _numbers(source: Kept, quantities: Quantities, words: Words) -> None:
    """Codes that a quantity needs to mean something."""
    for name, codes, table in (
        ("phase", words.phases, "phase"), ("result", words.results, "results"),
        ("acked_command", words.commands, "command_codes"), ("watchdog_action", words.watchdog_actions,
        "watchdog_actions"),
    ):
        if name in quantities and not codes.codes:
            source.add(("quantities", name), f"[{table}] is missing; this table states the meaning of the codes. Fix: "
                f"add the table, or remove {name}")
    if "result" in quantities and words.results.codes and int(Result.DONE) not in words.results.codes:
        source.add(("results",), "done is missing: this entry states the code with which the device acknowledges a "
            "command")


def check_identity(source: Kept, expected: Mapping[str, Value], quantities: Quantities) -> None:
    """Hold the values that prove the device against the quantities that show them."""
    for name, value in expected.items():
        quantity = quantities[name]
        place = ("identity", name)
        if (quantity.type == "string") is not isinstance(value, str):
            source.add(place, f"{value!r} must be a {'text' if quantity.type == 'string' else 'number'}")
        elif not quantity.read:
            source.add(place, "this quantity cannot be read")
        elif name in ROLES:
            source.add(place, "this quantity is part of the status, which changes, so it cannot identify the device")
        elif isinstance(value, str) and not (value.isascii() and value == value.rstrip() and "\0" not in value):
            source.add(place, f"{value!r} is invalid: a string must be ASCII without trailing spaces")
        elif isinstance(value, str) and len(value) > 2 * quantity.length:
            source.add(place, f"{value!r} is too long; allowed: at most {2 * quantity.length} characters")
        elif quantity.values > 1:
            source.add(place, f"this quantity has {quantity.values} values; a device must be identified by a "
                "single number")
        elif not isinstance(value, str) and quantity.bit is None and not quantity.holds(value):
            source.add(place, f"{value!r} cannot be represented by {quantity.type} with scale {quantity.scale:g}")
