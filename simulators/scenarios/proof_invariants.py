"""What must hold of a stop's proof: there is one, it is true, and what comes after it is told."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rig.campaign.stop_cause import CURRENT_FLOWS
from rig.faults.matrix import MATRIX
from rig.faults.row import StopKind
from simulators.scenarios.scenario import EVERY_S
from simulators.scenarios.view import NO_CURRENT_A, STILL_M_S, Findings, View, bench_of

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
    """A stop that the devices obey is proved: unknown is the rig's state only where something hides it."""
    for unknown in () if view.hidden else view.station("unknown"):
        yield f"the stop is not proved: {unknown.get('reason', '')}", float(unknown["t_ns"])


def what_is_proved_is_true(view: View) -> Findings:
    """When the station says that the rig is safe, the rod stands, no current flows, after S1 the pressure is off."""
    for safe in view.station("safe"):
        t_ns = float(safe["t_ns"])
        rows = view.between(t_ns - SEEN_NS, t_ns)
        if not len(rows):
            continue
        moving = moving_by_itself(view, t_ns - SEEN_NS, t_ns)
        if len(moving) and moving[-1, 0] == rows[-1, 0]:
            yield f"standstill was proved at {abs(moving[-1, 1]):.3g} m/s", t_ns
        later = moving_by_itself(view, t_ns, min(t_ns + SHOWS_NS, view.restarted_ns(t_ns)))
        if len(later) and not view.faults_by_name() & {"second-master"}:
            yield f"standstill was proved before the rod moved on at {np.max(np.abs(later[:, 1])):.3g} m/s", t_ns
        heard = np.abs(view.between(t_ns - _heard_ns(view), t_ns)[:, 2])
        # A current that has begun since the last status was measured is not in the proof: it comes back, and is told.
        if safe.get("current_zero") and np.min(heard) > ZERO_A:
            yield f"0 A was proved at {heard[-1]:.2f} A", t_ns
        unproved = not safe.get("current_zero") and not view.by_hand
        if unproved and not view.faults() and not view.session.happened:
            yield "safe without a proof of 0 A", t_ns
        if str(safe.get("stop")) == str(StopKind.PRESSURE_OFF) and rows[-1, 5] > 0.0:
            yield "an S1 stop was proved with the pressure on", t_ns


def _heard_ns(view: View) -> float:
    """So old is the truth that a proof of 0 A tells of, at most: a status counts until its source is called silent."""
    bench = bench_of(view)
    silent_s = 0.0 if bench is None else bench.ecu.silent_after_s
    return 1e9 * (silent_s + HANDED_OVER_S)


def a_current_that_comes_back_is_told(view: View) -> Findings:
    """A current that flows after a proof of 0 A does not stay untold, nor what hides it."""
    if view.session.answer is None or view.by_hand:
        return
    told = {str(line["slug"]) for line in view.station("trip", "also", "warning")}
    if told & CURRENT_FLOWS or any(MATRIX[slug].place in OF_THE_SOURCE for slug in told if slug in MATRIX):
        return
    for safe in view.station("safe"):
        t_ns = float(safe["t_ns"])
        rows = view.between(t_ns, min(view.restarted_ns(t_ns), view.session.ended_ns))
        flowing = rows[np.abs(rows[:, 2]) > ZERO_A]
        if safe.get("current_zero") and len(flowing) > COMES_BACK_S / EVERY_S:
            yield f"{flowing[-1, 2]:.2f} A after 0 A was proved, and nobody told", flowing[0, 0]


PROOF_CHECKS: dict[str, Callable[[View], Findings]] = {
    "proved": a_stop_is_proved,
    "true-proof": what_is_proved_is_true,
    "comes-back": a_current_that_comes_back_is_told,
}
