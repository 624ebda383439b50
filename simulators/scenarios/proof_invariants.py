"""Checks of a stop's proof: there is one, it is true, and later changes are reported."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rig.campaign.stop_cause import CURRENT_FLOWS
from rig.faults.matrix import MATRIX
from rig.faults.row import StopKind
from rig.station.interlocks.motion_interlock import LEFT_M, STILL_TOLERANCE_M
from simulators.scenarios.scenario import EVERY_S
from simulators.scenarios.view import KILLING, NO_CURRENT_A, STILL_M_S, Findings, View, bench_of

SEEN_NS = 20e6
SHOWS_NS = 1e9
"""Within this time a rod that stood around a reversal only moves on."""
PRESSED_NS = 0.12e9
"""What begins to press on the rod so shortly before a proof is not in it: that looks back 0.1 s."""
SHIFTED_M = 1e-3
"""A held rod that is pressed goes some tenths of a millimetre; one that goes farther moves."""
HANDED_OVER_S = 0.02
"""From an instant to the status that tells of it, and on to the station."""
ZERO_A = 2 * NO_CURRENT_A
COMES_BACK_S = 0.3
LETS_GO_S = 0.8
"""From the rod's leaving its place to a pressure that is off: three samples, a halt that is given 0.4 s, commands."""
OUT_OF_REACH = frozenset({"modbus", "rtu"})
"""Places of faults by which no command may come to the controller."""
DISOBEYED = frozenset({"modbus-write-lost", "second-master", "stop-ignored:pressure"})
"""Faults with which a controller is reached and leaves its pressure on."""
OF_THE_SOURCE = frozenset({"can", "ecu"})


def moving_by_itself(view: View, from_ns: float, to_ns: float) -> NDArray[np.float64]:
    """Rows in which the rod moves, without those in which something presses it a little out of its place."""
    rows = view.between(from_ns, to_ns)
    if not len(rows):
        return rows
    shifted = np.abs(rows[:, 3] - rows[0, 3]) > SHIFTED_M
    pressed = rows[:, 0] >= view.pressed_ns(from_ns - PRESSED_NS)
    moving: NDArray[np.bool_] = (np.abs(rows[:, 1]) > STILL_M_S) & (shifted | ~pressed)
    return rows[moving]


def a_stop_is_proved(view: View) -> Findings:
    """A stop that the devices obey is proved: the state is unknown only if something hides it or a current stays."""
    for unknown in () if view.hidden else view.station("unknown"):
        yield f"the stop is not confirmed: {unknown.get('reason', '')}", float(unknown["t_ns"])


def what_is_proved_is_true(view: View) -> Findings:
    """When the station says that the rig is safe, the rod stands, no current flows, after S1 the pressure is off."""
    for safe in view.station("safe"):
        t_ns = float(safe["t_ns"])
        rows = view.between(t_ns - SEEN_NS, t_ns)
        if not len(rows):
            continue
        slips_ns = _unseen_slip_ns(view, t_ns)
        moving = moving_by_itself(view, t_ns - SEEN_NS, min(t_ns, slips_ns))
        if len(moving) and moving[-1, 0] == rows[-1, 0]:
            yield f"standstill was confirmed while the rod moved at {abs(moving[-1, 1]):.3g} m/s", t_ns
        later = moving_by_itself(view, t_ns, min(t_ns + SHOWS_NS, slips_ns, view.restarted_ns(t_ns)))
        if len(later):
            yield f"standstill was confirmed before the rod moved again at {np.max(np.abs(later[:, 1])):.3g} m/s", t_ns
        heard = np.abs(view.between(t_ns - _heard_ns(view), t_ns)[:, 2])
        # A current that has begun since the last status was measured is not in the proof; it is reported later.
        if safe.get("current_zero") and np.min(heard) > ZERO_A:
            yield f"0 A was confirmed while the current was {heard[-1]:.2f} A", t_ns
        if safe.get("current_left_A") is not None:
            yield f"reported safe although {safe['current_left_A']:.2f} A was measured", t_ns
        unproved = not safe.get("current_zero") and not view.by_hand
        if unproved and not view.faults() and not view.session.happened:
            yield "reported safe without confirmation of 0 A", t_ns
        if str(safe.get("stop")) == str(StopKind.PRESSURE_OFF) and rows[-1, 5] > 0.0:
            yield "an S1 stop was confirmed while the pressure was on", t_ns


def _unseen_slip_ns(view: View, t_ns: float) -> float:
    """When a controller began to drive the rod out of its place that no sensor can have shown when it was proved.

    Either after the proof, or so shortly before it that the rod had not gone as far as a standstill may.
    """
    slips_ns = view.slips_ns(t_ns - PRESSED_NS)
    heard = view.between(slips_ns, t_ns - 1e9 * HANDED_OVER_S)[:, 3]
    return math.inf if len(heard) and np.ptp(heard) > STILL_TOLERANCE_M else slips_ns


def a_held_rod_stays(view: View) -> Findings:
    """A rod that is held under pressure after the proof stays in its place, or loses the pressure.

    Excused where the LVDT has a fault, or no command reaches the controller, or it does not obey.
    """
    for safe in view.station("safe"):
        t_ns = float(safe["t_ns"])
        rows = view.between(t_ns, view.restarted_ns(t_ns))
        if str(safe.get("stop")) == str(StopKind.PRESSURE_OFF) or not len(rows):
            continue
        away = rows[(np.abs(rows[:, 3] - rows[0, 3]) > LEFT_M + STILL_TOLERANCE_M) & (rows[:, 5] > 0.0)]
        if len(away) > (LETS_GO_S + view.stalled_s) / EVERY_S and not _cannot_let_go(view, t_ns, away[-1, 0]):
            far_m = np.max(np.abs(away[:, 3] - rows[0, 3]))
            yield f"the rod was driven {1e3 * far_m:.1f} mm away after standstill was confirmed", away[0, 0]


def _cannot_let_go(view: View, from_ns: float, to_ns: float) -> bool:
    """The station may not see that a held rod moves, or cannot take its pressure away."""
    faults = view.active(from_ns, to_ns)
    killed = any(at_ns < to_ns and event.what in KILLING for at_ns, event in view.session.happened)
    unseen = any("lvdt" in fault for fault in faults)
    return killed or unseen or bool(view.hiding_places(faults) & OUT_OF_REACH or faults & DISOBEYED)


def _heard_ns(view: View) -> float:
    """So old is the truth that a proof of 0 A tells of, at most: a status counts until its source is called silent."""
    bench = bench_of(view)
    silent_s = 0.0 if bench is None else bench.ecu.silent_after_s
    return 1e9 * (silent_s + HANDED_OVER_S)


def _reported(view: View) -> set[str]:
    return {str(line["slug"]) for line in view.station("trip", "also", "warning")}


def source_is_hidden(view: View) -> bool:
    """The station reported something else of the current source, which may hide its current."""
    return any(MATRIX[slug].place in OF_THE_SOURCE for slug in _reported(view) - CURRENT_FLOWS if slug in MATRIX)


def a_current_that_comes_back_is_reported(view: View) -> Findings:
    """A current that flows after a proof of 0 A is reported, and so is what hides it."""
    if view.session.answer is None or view.by_hand:
        return
    if source_is_hidden(view) or CURRENT_FLOWS & _reported(view):
        return
    for safe in view.station("safe"):
        t_ns = float(safe["t_ns"])
        rows = view.between(t_ns, min(view.restarted_ns(t_ns), view.session.ended_ns))
        flowing = rows[np.abs(rows[:, 2]) > ZERO_A]
        if safe.get("current_zero") and len(flowing) > COMES_BACK_S / EVERY_S:
            yield f"after 0 A was confirmed, {flowing[-1, 2]:.2f} A flowed and was not reported", flowing[0, 0]


PROOF_CHECKS: dict[str, Callable[[View], Findings]] = {
    "proved": a_stop_is_proved,
    "true-proof": what_is_proved_is_true,
    "held": a_held_rod_stays,
    "comes-back": a_current_that_comes_back_is_reported,
}
