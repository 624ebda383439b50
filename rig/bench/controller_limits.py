"""The rig's limits as they are written to the actuator's controller."""

from __future__ import annotations

from drivers.roles import ActuatorLimits, WatchdogAction
from rig.bench.settings import ActuatorConfig, Limits


def controller_limits(limits: Limits, speed_margin: float, actuator: ActuatorConfig) -> ActuatorLimits:
    """What is written to the controller when the rig is armed, as far as it has registers for it.

    Args:
        limits: of the bench file.
        speed_margin: share by which the controller's speed limit is above the bench's.
        actuator: of the bench file.
    """
    return ActuatorLimits(
        position_min_m=limits.position_min_m,
        position_max_m=limits.position_max_m,
        speed_max_m_s=limits.speed_m_s * (1.0 + speed_margin),
        acceleration_max_m_s2=limits.acceleration_m_s2,
        force_max_N=limits.force_N,
        fade_out_cycles=actuator.fade_out_cycles,
        halt_deceleration_m_s2=actuator.halt_deceleration_m_s2,
        watchdog_ms=round(actuator.watchdog_s * 1e3),
        watchdog_action=WatchdogAction.FADE_AND_HOLD,
    )
