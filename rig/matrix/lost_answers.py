"""Time without a value after one lost answer of a polled device; warns if this would stop the rig."""

from __future__ import annotations

from drivers.sensor_formats import described_format
from protocols.errors import LocalProtocolError
from rig.bench.model import Bench
from rig.bench.sensor_settings import SensorConfig
from rig.units import show

ROUNDING = 1e-9


def lost_answer_hints(bench: Bench) -> tuple[str, ...]:
    """Warnings on devices whose `stale_after` is shorter than the time without a value after one lost answer."""
    actuator = bench.actuator
    poll_s, timeout_s = actuator.poll_s, actuator.timeout_s
    made_of = f"poll period {_ms(poll_s)}, then one time-out of {_ms(timeout_s)}"
    costs = [("actuator", actuator.stale_after_s, poll_s + timeout_s, made_of, "a shorter [actuator] timeout")]
    auxiliaries = [(f"auxiliary {item.name}", item) for item in bench.auxiliary]
    for name, sensor in (("load_cell", bench.load_cell), ("lvdt", bench.lvdt), *auxiliaries):
        wait_s = _answer_timeout_s(sensor)
        # A simulated rig that runs faster is polled in advance, with its own time-out.
        if wait_s > 0.0 and bench.clock.device_rate == 1.0:
            period_s = 1.0 / sensor.rate_Hz
            made_of = f"period {_ms(period_s)}, then twice the time-out of {_ms(wait_s)}"
            other = "a shorter answer_timeout in the sensor's format"
            costs.append((name, sensor.stale_after_s, period_s + 2.0 * wait_s, made_of, other))
    return tuple(
        f'[{name}] stale_after = "{_ms(stale_s)}": a single lost answer leaves up to {_ms(cost_s)} without a value '
        f'({made_of}) and would stop the rig. Fix: use stale_after = "{_ms(cost_s)}" or more, or {other}'
        for name, stale_s, cost_s, made_of, other in costs if stale_s < cost_s * (1.0 - ROUNDING)
    )


def _ms(time_s: float) -> str:
    return show(time_s, "ms", 3)


def _answer_timeout_s(sensor: SensorConfig) -> float:
    """Time-out of a request (s); 0 for a sensor that sends without requests or has its own driver."""
    try:
        exchange = described_format(sensor.described).exchange
    except LocalProtocolError:
        return 0.0  # frame16, or a plug-in's format
    return exchange.answer_timeout_s if exchange.request else 0.0
