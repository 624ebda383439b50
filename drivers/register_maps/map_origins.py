"""Which registers each channel of the actuator's status is made of, by its register map."""

from __future__ import annotations

from collections.abc import Iterable

from drivers.origins import ChannelOrigin, Origins
from drivers.register_maps.controller_map import PRESSURES, ControllerMap
from drivers.register_maps.quantity import Quantity
from drivers.ring import Channel

SOURCE = "controller"
SHOWN = {
    Channel.POSITION: "position", Channel.VELOCITY: "velocity", Channel.SETPOINT: "setpoint",
    Channel.CYCLES_DONE: "cycles_done", Channel.SUPPLY_PRESSURE: "supply_pressure",
    Channel.ACCUMULATOR_PRESSURE: "accumulator_pressure", Channel.SERVO_ERROR: "servo_error",
    Channel.CONTROLLER_FORCE: "force", Channel.PULSE: "pulse_count",
}
"""Channels that are one quantity of the map, where the map has it."""


def map_origins(controller: ControllerMap) -> Origins:
    """The origin of each channel that a controller with this map fills.

    A velocity and a count of cycles that the map does not show are the driver's (`drivers.derived_status`).
    """
    quantities, words = controller.quantities, controller.words
    origins = {
        channel: ChannelOrigin(SOURCE, f"value = {quantities[name].on_wire}")
        for channel, name in SHOWN.items() if name in quantities
    }
    meanings = {
        Channel.STATE: words.states.quantities | {quantities[name] for name in ("state",) if name in quantities},
        Channel.FAULT_BITS: words.faults.quantities,
        Channel.INPUTS: words.inputs.quantities | words.pressure.quantities,
        Channel.PHASE: frozenset(quantities[name] for name in ("phase",) if name in quantities),
    }
    if not words.pressure.rules and not words.inputs.members & PRESSURES and controller.capabilities.hydraulics:
        meanings[Channel.INPUTS] |= meanings[Channel.STATE]  # the pressure among the inputs follows from the state
    if any(rule.codes for rule in words.pressure.rules.values()):
        meanings[Channel.INPUTS] |= {quantities["state"]}
    origins |= {channel: ChannelOrigin(SOURCE, _meaning(of)) for channel, of in meanings.items() if of}
    if Channel.VELOCITY not in origins:
        text = "value = smoothed finite difference of the controller's position over the host time"
        origins[Channel.VELOCITY] = ChannelOrigin("station", text, "Velocity computed from the controller's position")
    if Channel.CYCLES_DONE not in origins and not controller.capabilities.streamed_setpoints:
        text = (
            "value = whole cycles, calculated from the program's frequency and the host time since the program "
            "started"
        )
        origins[Channel.CYCLES_DONE] = ChannelOrigin("station", text)
    return origins


def _meaning(quantities: Iterable[Quantity]) -> str:
    places = sorted(quantity.on_wire for quantity in quantities)
    return f"value = meaning of {'; '.join(places)} according to the register map"
