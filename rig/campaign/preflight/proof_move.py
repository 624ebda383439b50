"""The slow proof move at low amplitude (fault row `sensors-swapped`): do LVDT and load cell follow the actuator?

After full pressure and before anything else moves, the rod goes 2 mm one way and 2 mm the other way, at 10 mm/s and
0 A. At both ends, where it rests and no clocks need to be tied together, the LVDT is compared with the controller's own
position. On the way the damper resists, so the force of the way up must lie above the force of the way down.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.ring import Channel
from rig.campaign.sequencer import event as ev
from rig.campaign.stop_cause import StopCause, because

SWAPPED = "sensors-swapped"
PROOF_M = 2e-3
PROOF_SPEED_M_S = 0.010
SCALE_TOLERANCE = 0.1
FORCE_FACTOR = 2.0
"""The controller's force input is coarse: the two forces may differ by this factor."""
FEWEST_SAMPLES = 10
FEWEST_STATUSES = 3
SURE = 6.0
"""Standard errors by which a difference of forces is more than noise."""
QUIET_S = 0.1
SETTLED_NS = 10_000_000


def proof_targets(start_m: float, low_m: float, high_m: float) -> tuple[float, float]:
    """Where the two ways of the proof move end (m): first up, then down, inside the position limits.

    Args:
        start_m: the controller's present position.
        low_m: lower position limit.
        high_m: upper position limit.
    """
    centre_m = min(max(start_m, low_m + 2.0 * PROOF_M), high_m - 2.0 * PROOF_M)
    return centre_m + PROOF_M, centre_m - PROOF_M


@dataclass(frozen=True)
class Leg:
    """One way of the move.

    Attributes:
        lvdt_m: LVDT at its end.
        position_m: the controller's own position there.
        force_N: load-cell samples on the way, (n,).
        controller_force_N: the controller's own coarse force input on the way, (k,).
        rest_force_N: load-cell samples at the end, (m,); on a rig faster than life the way can be over unseen.
    """

    lvdt_m: float
    position_m: float
    force_N: NDArray[np.float64]
    controller_force_N: NDArray[np.float64]
    rest_force_N: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))


DamperJudge = Callable[[Leg, Leg], StopCause | None]


def judge_proof(up: Leg, down: Leg) -> StopCause | None:
    """Whether the sensors followed the actuator; None when they did.

    A force of motion that drowns in the load cell's noise proves nothing and refuses nothing.
    """
    moved_m, shown_m = up.position_m - down.position_m, up.lvdt_m - down.lvdt_m
    scale = shown_m / moved_m if moved_m > 0.5 * PROOF_M else math.nan
    if not abs(scale - 1.0) <= SCALE_TOLERANCE:
        return because(SWAPPED, "lvdt-scale", shown_mm=1e3 * shown_m, moved_mm=1e3 * moved_m)
    force_N, noise_N = _difference(up.force_N, down.force_N)
    if force_N < -SURE * noise_N:
        return because(SWAPPED, "force-sign", force_N=-force_N)
    coarse_N, coarse_noise_N = _difference(up.controller_force_N, down.controller_force_N)
    if abs(coarse_N) <= SURE * coarse_noise_N or abs(force_N) <= SURE * noise_N:
        return None
    if not 1.0 / FORCE_FACTOR <= force_N / coarse_N <= FORCE_FACTOR:
        return because(SWAPPED, "force-scale", force_N=force_N, own_N=coarse_N)
    return None


def _difference(up_N: NDArray[np.float64], down_N: NDArray[np.float64]) -> tuple[float, float]:
    """Mean of one way less mean of the other, and its standard error (N); not known with few samples."""
    if min(len(up_N), len(down_N)) < FEWEST_STATUSES:
        return 0.0, math.inf
    error_N = math.sqrt(float(np.var(up_N)) / len(up_N) + float(np.var(down_N)) / len(down_N))
    return float(np.mean(up_N) - np.mean(down_N)), error_N


class ProofWatch:
    """Collects both ways from ring records.

    Args:
        holds: whether the controller holds at a position (m) in a status that arrived after a host time (ns).
        device_s: the controller's clock now (s).
        damper: whether it is the campaign's damper, by both ways; asked once the sensors are proved.
    """

    def __init__(
        self, holds: Callable[[float, int], bool], device_s: Callable[[], float], damper: DamperJudge
    ) -> None:
        self._damper = damper
        self._holds = holds
        self._device_s = device_s
        self._legs: list[Leg] = []

    def _judged(self, up: Leg, down: Leg) -> StopCause | None:
        return judge_proof(up, down) or self._damper(up, down)

    def leg(self, target_m: float, since_ns: int) -> Callable[[NDArray[Any]], ev.Event | None]:
        """What to ask every batch of records until the way to `target_m` has ended: `ProofLegDone`, `ProofJudged`."""
        on_the_way: list[NDArray[Any]] = []
        at_end: list[NDArray[Any]] = []
        held_s = math.inf
        held_ns = 0

        def wait(records: NDArray[Any]) -> ev.Event | None:
            nonlocal held_s, held_ns
            if held_s == math.inf:
                on_the_way.append(records[records["host_ns"] > since_ns])
                if self._holds(target_m, since_ns):
                    held_s, held_ns = self._device_s(), int(records["host_ns"].max())
                return None
            at_end.append(records[records["host_ns"] > held_ns + SETTLED_NS])
            lvdt_m, position_m = _values(at_end, Channel.DISPLACEMENT), _values(at_end, Channel.POSITION)
            if self._device_s() < held_s + QUIET_S or len(lvdt_m) < FEWEST_SAMPLES or len(position_m) == 0:
                return None
            forces = _values(on_the_way, Channel.FORCE), _values(on_the_way, Channel.CONTROLLER_FORCE)
            rest_N = _values(at_end, Channel.FORCE)
            self._legs.append(Leg(float(np.mean(lvdt_m)), float(np.mean(position_m)), *forces, rest_N))
            return ev.ProofLegDone() if len(self._legs) == 1 else ev.ProofJudged(self._judged(*self._legs))

        return wait


def _values(parts: list[NDArray[Any]], channel: Channel) -> NDArray[np.float64]:
    """Finite values (n,) of one channel."""
    values = np.concatenate([part["value"][part["channel"] == channel] for part in parts]).astype(np.float64)
    return np.asarray(values[np.isfinite(values)])
