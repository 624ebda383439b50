"""Faults that drive the rig beyond the bench's limits: variants of rows of the fault matrix.

A person at the controller's panel turns its knobs while a program of ours runs, its limit detectors switched off; the
transducer of its position loop slips; the damper jams; the coil's output stage or the coil itself goes wrong. How far
they go follows from the limits that the controller was given.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from simulators.faulty import Faulty, LastingInjector, PassingInjector, Undo
from simulators.plant import records

GROWTH_1_S = 6.0
FASTEST, FARTHEST, STRONGEST = 1.3, 1.12, 1.3
"""Peak speed, set-point's centre and force, as shares of the controller's limits."""
SPAN = 0.95
"""The span knob's end, as a share of the stroke."""
OFFSET_M_S = 0.12
JUMP_M, JUMP_EVERY_S = 6e-3, 0.25
SLIP_M_S, MOST_SLIP_M = 0.02, 0.02
RISE_S = 0.1
COOLER_K = 15.0
"""A coil that is too hot for the bench is so much cooler than the ECU's own limit."""
ENDLESS = 1e9

Turn = Callable[[Faulty, float], None]
"""What is done in so much simulated time (s) in which the controller runs a program."""


def _while_running(turn: Turn, *, limits_off: bool = False) -> PassingInjector:
    """A hand at the panel, for as long as programs run."""

    def begin(rig: Faulty) -> Undo:
        before_s = rig.plant.time_s

        def go_on() -> None:
            nonlocal before_s
            elapsed_s, before_s = rig.plant.time_s - before_s, rig.plant.time_s
            if limits_off:
                rig.plant.order(
                    position_min_m=-ENDLESS, position_max_m=ENDLESS, speed_max_m_s=ENDLESS, force_max_N=ENDLESS,
                    following_error_max_m=ENDLESS,
                )
            if int(rig.plant.command["mode"][0]) == records.MODE_PROGRAM:
                turn(rig, elapsed_s)

        following_m = float(rig.plant.command["following_error_max_m"][0])
        rig.every_tick.append(go_on)

        def end() -> None:
            rig.every_tick.remove(go_on)
            rig.plant.order(following_error_max_m=following_m)
            rig.actuator.order_limits()

        return end

    return begin


def _span(rig: Faulty, elapsed_s: float) -> None:
    """The amplitude grows until the rod is too fast."""
    command, limits = rig.plant.command, rig.actuator.limits
    amplitude_m, frequency_Hz = float(command["amplitude_m"][0]), float(command["frequency_Hz"][0])
    target_m = FASTEST * limits.speed_max_m_s / (4.0 * frequency_Hz)
    target_m = min(target_m, SPAN * max(-limits.position_min_m, limits.position_max_m))
    if amplitude_m < target_m:
        rig.plant.order(amplitude_m=min(target_m, amplitude_m * math.exp(GROWTH_1_S * elapsed_s)))


def _offset(rig: Faulty, elapsed_s: float) -> None:
    """The centre goes out until the rod is beyond its stroke."""
    centre_m = float(rig.plant.command["centre_m"][0])
    rig.plant.order(centre_m=min(centre_m + OFFSET_M_S * elapsed_s, FARTHEST * rig.actuator.limits.position_max_m))


def _jumps(rig: Faulty, elapsed_s: float) -> None:
    """The centre jumps back and forth, which asks for more acceleration than the rod may have."""
    before, now = (int((rig.plant.time_s - ago_s) / JUMP_EVERY_S) for ago_s in (elapsed_s, 0.0))
    if now != before:
        rig.plant.order(centre_m=float(rig.plant.command["centre_m"][0]) + math.copysign(JUMP_M, now % 2 - 0.5))


def slipping(rig: Faulty) -> None:
    """The transducer of a closed position loop slips: the rod is not where the controller says, nor held there."""
    plant = rig.plant
    before_s = plant.time_s

    def slip() -> None:
        nonlocal before_s
        elapsed_s, before_s = plant.time_s - before_s, plant.time_s
        zero_m = plant.position_input.zero
        closed = int(plant.command["mode"][0]) in {records.MODE_PROGRAM, records.MODE_FOLLOW, records.MODE_HOLD}
        if closed and abs(zero_m) < MOST_SLIP_M:
            plant.position_input.zero = zero_m + SLIP_M_S * elapsed_s
            plant.constants["position_zero_m"] = plant.position_input.zero

    rig.every_tick.append(slip)


def jammed(rig: Faulty) -> Undo:
    """Something presses against the rod, more and more, until the force is too great."""
    constants = rig.plant.constants
    before_N, began_s = float(constants["gas_force_N"][0]), rig.plant.time_s

    def press() -> None:
        share = min(1.0, (rig.plant.time_s - began_s) / RISE_S)
        constants["gas_force_N"] = before_N + share * STRONGEST * rig.actuator.limits.force_max_N

    rig.every_tick.append(press)

    def end() -> None:
        rig.every_tick.remove(press)
        constants["gas_force_N"] = before_N

    return end


def heated(rig: Faulty) -> Undo:
    """The coil is too hot for the bench, the ECU has nothing against it yet."""

    def heat() -> None:
        rig.plant.state["coil_degC"] = rig.ecu.options.over_temperature_degC - COOLER_K

    rig.every_tick.append(heat)
    return lambda: rig.every_tick.remove(heat)


BEYOND_LASTING: dict[str, LastingInjector] = {"actuator-frozen:slips": slipping}
BEYOND_PASSING: dict[str, PassingInjector] = {
    "second-master:span": _while_running(_span, limits_off=True),
    "second-master:offset": _while_running(_offset, limits_off=True),
    "second-master:jumps": _while_running(_jumps),
    "load-train:jammed": jammed,
    "ecu-overtemp:coil": heated,
}
