"""An analogue output on Modbus from its table, or everything that its entries contradict, with its place."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drivers.current_source import SourceFault
from drivers.devices.output import CURRENT, ENABLE, FAULT_BITS, MEASURED, AnalogueOutput, OutputWatchdog
from drivers.devices.supply import SupplyCommands, SupplyDescription, SupplyLink, current_range
from drivers.register_maps.entries import Kept, Table
from drivers.register_maps.quantity import COIL, FLOATS, HOLDING, Quantity, Value
from drivers.register_maps.read_meanings import number_of, read_bits
from drivers.register_maps.read_quantities import read_modbus, read_quantities
from drivers.register_maps.read_recipes import read_values
from drivers.register_maps.recipe import WATCHDOG, Recipe, Write
from protocols.descriptions import Problem
from protocols.near_miss import meant

Quantities = Mapping[str, Quantity]

ZERO_A = 0.010
"""By so much the number that stands for 0 A may be off."""


def is_output(given: Mapping[str, Any]) -> bool:
    """Whether a supply's file describes registers, not lines of text."""
    return "quantities" in given or "modbus" in given


def read_output(given: Mapping[str, Any], name: str) -> tuple[SupplyDescription | None, list[Problem]]:
    """An output's description, or None and everything that is wrong with it."""
    kept = Kept()
    top = Table(kept, (), given)
    modbus = read_modbus(top.table("modbus"))
    quantities = read_quantities(top.table("quantities"), modbus)
    current_A = current_range(given["range"]["current_A"])
    faults = read_bits(top.table("faults"), SourceFault, quantities.get(FAULT_BITS), FAULT_BITS, quantities)
    for one in quantities.values():
        if one.values > 1:
            top.table("quantities").add(one.name, "must be a single value. Fix: remove count")
    output = AnalogueOutput(
        quantities, modbus.rules, _identity(top.table("identity"), quantities), faults,
        _written(top, "prepare", quantities),
        _watchdog(top.table("watchdog"), quantities) if "watchdog" in top else None,
    )
    _needs(top, output, current_A)
    link = top.table("link")
    if kept.problems:
        return None, kept.problems
    return SupplyDescription(
        name, SupplyLink(baudrate=link.get("baudrate", 9600), parity=link.get("parity", "N")), SupplyCommands(),
        current_A, maker=top.get("maker", ""), model=top.get("model", ""), tried=top.get("tried", ""),
        settling_s=1e-3 * top.get("settling_ms", 300.0), output=output,
    ), []  # fmt: skip


def _identity(table: Table, quantities: Quantities) -> dict[str, Value]:
    """What must be shown: quantity -> value (SI, or a text)."""
    table.named(quantities, "quantities")
    named = {name: quantities[name] for name in table if name in quantities}
    for name, quantity in named.items():
        if not quantity.read:
            table.add(name, "cannot be read because its access is \"w\"")
    return {
        name: table.given[name] if isinstance(table.given[name], str)
        else number_of(table, name, table.given[name], quantity, ())
        for name, quantity in named.items()
    }


def _written(table: Table, key: str, quantities: Quantities, names: tuple[str, ...] = ()) -> Recipe:
    """One write of these quantities; nothing where the key is not there. The current is set by nothing of the file."""
    if key not in table:
        return ()
    values = read_values(table, key, quantities, names)
    for quantity in values:
        if quantity.name in {CURRENT, ENABLE}:
            table.add(key, f"writes {quantity.name}, which is reserved for the test matrix and for stops. Fix: remove "
                "this write")
    return (Write(values),)


def _watchdog(table: Table, quantities: Quantities) -> OutputWatchdog:
    start, stop = (_written(table, key, quantities) for key in ("start", "stop"))
    return OutputWatchdog(table.get("time_s"), start, stop, _written(table, "feed", quantities, WATCHDOG))


def _needs(top: Table, output: AnalogueOutput, current_A: tuple[float, float]) -> None:
    """What entries that are right by themselves say wrong together, and what nothing can be run without."""
    table, quantities = top.table("quantities"), output.quantities
    if CURRENT not in quantities:
        if CURRENT not in table:
            near = meant(CURRENT, quantities)
            table.add(None, f'current is missing: current = {{address = 0, scale = 0.001, unit = "A"}}; {near}')
        return
    current, measured = quantities[CURRENT], quantities.get(MEASURED)
    if current.space != HOLDING or not current.written:
        table.add(CURRENT, 'the set-point must be a holding register with access "rw" or "w"')
    for one in (current, measured):
        if one is not None and (one.measures != "current" or one.type == "string" or one.values > 1):
            table.add(one.name, 'must be a current: one number with unit = "A" or unit = "mA"')
    if measured is not None and not measured.read:
        table.add(MEASURED, "must be readable")
    enable = quantities.get(ENABLE)
    if enable is not None and (not enable.written or not enable.whole or enable.type == "string"):
        table.add(ENABLE, f"must be a {COIL} or a whole register without scale, because 1 (on) or 0 (off) is written")
    faults = quantities.get(FAULT_BITS)
    if faults is not None and (not faults.read or not faults.whole or faults.type in {*FLOATS, "string"}):
        table.add(FAULT_BITS, "must be a readable integer without a scale, because it contains bits")
    if not any(one.read for one in quantities.values()):
        table.add(None, "there is no readable quantity, so the module's presence could not be detected. Fix: add a "
            "readable quantity")
    if current.places:
        table.add(CURRENT, "the registers of the set-point are written one after the other, so the output could give a "
            "current made of an old and a new word. Fix: use adjacent registers and a single address")
    elif current.space == HOLDING and current.type != "string":
        _zero(top, current, current_A, switched=enable is not None)


def _zero(top: Table, current: Quantity, current_A: tuple[float, float], *, switched: bool) -> None:
    """0 A is a number of the register, or the output can be switched off; the ends of the range are such numbers."""
    table = top.table("quantities")
    for end_A in current_A:
        if not current.holds(end_A):
            table.add(CURRENT, f"{current.type} with this scale and offset cannot represent {end_A:g} A, a limit "
                "in [range]")
    reaches = current_A[0] <= 0.0 <= current_A[1] and current.holds(0.0)
    if not reaches and not switched:
        top.table("range").add(
            "current_A", "the register cannot represent 0 A, and there is no quantity `enable` to switch the output "
                "off, so the coil could not be switched off"
        )
        return
    off_A = abs(float(current.decode(current.encode(0.0)))) if reaches else 0.0
    if off_A > ZERO_A:
        table.add(
            CURRENT, f"the value nearest to 0 A is {off_A:.3g} A (allowed: at most {ZERO_A:g} A), so the coil "
                "could not be switched off. Fix: check scale and offset"
        )
