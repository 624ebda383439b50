"""One test point: the requested motion and current as a value (PHYSICS: waveforms (1) and (2))."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from rig.signals.record import Record
from rig.signals.waveform import Waveform, waveform_named


class Forecast(NamedTuple):
    """What a motion that is no waveform is forecast to reach: m/s, m/s^2, N, and the energy turned to heat, J."""

    peak_speed_m_s: float
    peak_acceleration_m_s2: float
    force_N: float
    energy_J: float


@dataclass(frozen=True)
class TestPoint:
    """A waveform about a centre at a constant coil current, or currents that step while the rod stands.

    `cycles` are at full amplitude; the ramps come beside them. `repeat` counts from 1. `kind` is `loop`, `friction`
    (a slow triangle without current, for gas force and friction) or `current_step`: then `waveform` is `hold`, the
    amplitude 0, a cycle one step, `steps_A` the currents in turn and `current_A` the largest of them. Or it is
    `hybrid`: then `waveform` is `hold`, the amplitude the largest extension that is `forecast`, the whole test one
    cycle, `compensator` what leads the set-points, and `law` what commands the current: where that is not `passive`,
    `current_A` is the most it may ask for, and `steps_A` the one to begin with. Or `signal`: then `record` is the
    motion, its largest distance from the centre `amplitude_m`, the frequency how often it crosses its mean upwards, and
    the whole of it one cycle.

    Raises:
        UnknownWaveform: `waveform` is no waveform's name.
    """

    __test__ = False  # not a test class, whatever its name

    id: str
    waveform: str
    amplitude_m: float
    frequency_Hz: float
    current_A: float
    cycles: int = 10
    ramp_in_cycles: float = 1.0
    ramp_out_cycles: float = 1.0
    centre_m: float = 0.0
    repeat: int = 1
    rest_s: float = 0.0
    kind: str = "loop"
    steps_A: tuple[float, ...] = ()
    forecast: Forecast | None = None
    compensator: str = ""
    law: str = ""
    record: Record | None = None

    def __post_init__(self) -> None:
        waveform_named(self.waveform)

    @property
    def shape(self) -> Waveform:
        """The waveform as a value."""
        return waveform_named(self.waveform)

    @property
    def first_current_A(self) -> float:
        """The current that must have settled before the point begins (A)."""
        return self.steps_A[0] if self.steps_A else self.current_A

    @property
    def peak_speed_m_s(self) -> float:
        """Largest speed (m/s)."""
        if self.forecast is not None:
            return self.forecast.peak_speed_m_s
        if self.record is not None:
            return self.record.peak_velocity * self.amplitude_m
        return self.shape.peak_velocity * self.frequency_Hz * self.amplitude_m

    @property
    def peak_acceleration_m_s2(self) -> float:
        """Largest acceleration (m/s2), corners as the controller rounds them."""
        if self.forecast is not None:
            return self.forecast.peak_acceleration_m_s2
        if self.record is not None:
            return self.record.peak_acceleration * self.amplitude_m
        return self.shape.peak_acceleration * self.frequency_Hz**2 * self.amplitude_m

    @property
    def motion_s(self) -> float:
        """Duration of the programme, ramps included (s)."""
        if self.record is not None:
            return self.record.duration_s
        return (self.ramp_in_cycles + self.cycles + self.ramp_out_cycles) / self.frequency_Hz

    @property
    def has_frequency(self) -> bool:
        """Whether the motion repeats itself; else `frequency_Hz` is no frequency that people know it by."""
        return self.kind not in {"signal", "hybrid"}

    @property
    def motion(self) -> str:
        """What moves, by name: "sine", "road iso8608-c", "hybrid test", "current steps"."""
        name = {"hybrid": "hybrid test", "current_step": "current steps"}.get(self.kind, self.waveform)
        return name if self.record is None or self.record.name == name else f"{name} {self.record.name}"

    @property
    def described(self) -> str:
        """In one phrase: "sine 50 mm 1.5 Hz 1 A"; of what does not repeat itself, how far and for how long."""
        if self.kind == "current_step":
            return f"{self.motion} for {self.motion_s:.3g} s, up to {self.current_A:.3g} A"
        if self.has_frequency:
            return f"{self.motion} {1e3 * self.amplitude_m:.4g} mm {self.frequency_Hz:.4g} Hz {self.current_A:.3g} A"
        current = f"{self.current_A:.3g} A"
        if self.law not in {"", "passive"}:
            current = f"up to {current} by {self.law}"
        return f"{self.motion} up to {1e3 * self.amplitude_m:.3g} mm for {self.motion_s:.3g} s, {current}"
