"""What commands the coils: laws of the current from what body and wheel do at each corner; pure numbers, no numpy.

passive     I = constant
skyhook     Imax where zs' (zs' - zu') > 0, else 0          Karnopp, Crosby, Harwood 1974
groundhook  Imax where -zu' (zs' - zu') > 0, else 0
hybrid      the current for sigma zs' - (1 - sigma) zu', as a share of Imax, where that takes energy out
inverse     the current at which the damper's force is c (sigma zs' - (1 - sigma) zu') as far as the damper can
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

Law = Literal["passive", "skyhook", "groundhook", "hybrid", "inverse"]
LAWS: tuple[Law, ...] = ("passive", "skyhook", "groundhook", "hybrid", "inverse")
MOST_A = 20.0
FULL_SPEED_M_S = 0.3
"""Blended speed at which the hybrid law asks for the whole current."""


@dataclass(frozen=True)
class Control:
    """A law and its numbers.

    Attributes:
        law: which one.
        current_A: of the passive law, and of every coil at the start.
        most_A: Imax.
        sky_share: sigma of the hybrid and inverse laws, 1 only the body's speed, 0 only the wheel's.
        damping_N_s_m: c of the inverse law.
    """

    law: Law = "passive"
    current_A: float = 0.0
    most_A: float = 1.0
    sky_share: float = 0.7
    damping_N_s_m: float = 3000.0

    def __post_init__(self) -> None:
        if self.law not in LAWS:
            raise ValueError(f"law: got {self.law!r}, expected one of {', '.join(LAWS)}")
        if not (0.0 <= self.current_A <= MOST_A and 0.0 <= self.most_A <= MOST_A):
            raise ValueError(f"currents: got {self.current_A} A and {self.most_A} A, expected 0 to {MOST_A:g} A")
        if not 0.0 <= self.sky_share <= 1.0:
            raise ValueError(f"share: got {self.sky_share}, expected 0 to 1")

    @property
    def vector(self) -> tuple[float, float, float, float, float]:
        """As `requested_current` takes it: law, Imax, I, sigma, c."""
        return (float(LAWS.index(self.law)), self.most_A, self.current_A, self.sky_share, self.damping_N_s_m)

    @property
    def range_A(self) -> tuple[float, float]:
        """The least and the most current that the law may ask for."""
        if self.law == "passive":
            return self.current_A, self.current_A
        return 0.0, max(self.most_A, self.current_A)


CONTROL = Control()


def law_named(name: str) -> Law:
    """The law of a name; passive where there is no such one."""
    return next((law for law in LAWS if law == name), "passive")


def requested_current(
    law: Sequence[float], body_m_s: float, wheel_m_s: float, ratio: float, at_zero_N: float, at_most_N: float
) -> float:
    """Current (A) that a law asks for.

    Args:
        law: `Control.vector`.
        body_m_s: speed of the body over the wheel, upwards.
        wheel_m_s: speed of the wheel, upwards.
        ratio: motion ratio of the damper.
        at_zero_N: the damper's force at this motion without current; inverse law only.
        at_most_N: the same with the most current.
    """
    kind, most = law[0], float(law[1])
    apart = body_m_s - wheel_m_s
    blend = law[3] * body_m_s - (1.0 - law[3]) * wheel_m_s
    if kind == 0.0:
        return float(law[2])
    if kind == 1.0:
        return most if body_m_s * apart > 0.0 else 0.0
    if kind == 2.0:
        return most if -wheel_m_s * apart > 0.0 else 0.0
    if kind == 3.0:
        return min(1.0, abs(blend) / FULL_SPEED_M_S) * most if blend * apart > 0.0 else 0.0
    reach = at_most_N - at_zero_N
    if reach == 0.0:
        return 0.0
    target_N = float(law[4]) * blend / ratio
    share: float = min(1.0, max(0.0, (target_N - at_zero_N) / reach)) * most
    return share
