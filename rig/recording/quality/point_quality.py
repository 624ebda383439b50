"""All that is known of the quality of a recorded point, as values: `/entry/quality` of its file, field by field.

Each section stands beside the functions that measure it (`motion_quality`, `sensor_quality`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Self

from rig.recording.layout import Attribute
from rig.recording.quality.motion_quality import CurrentQuality, LoopQuality, MotionQuality
from rig.recording.quality.section import Attributes, Section, Stored, estimate, section, stored
from rig.recording.quality.sensor_quality import DISPLACEMENT, FORCE, SensorQuality, SkewQuality
from rig.recording.quality.verdict import Verdict
from rig.signals.estimate import Estimate


@dataclass(frozen=True)
class Tolerances(Section):
    """By how much two instruments of the bench may differ before one of them is doubted (bench `[checks]`).

    Attributes:
        force_gain, displacement_gain: relative difference of sensitivity.
        force_zero_N, displacement_zero_m: difference at zero.
        force_zero_change_N: how much that may change over a campaign.
        time_s: how much later an input may be than the declared delays say.
        current_zero_A: what the ECU may report while its output stage is off.
        coil_temperature_K: by how much the coil may seem colder than the ECU before anything was warmed.
    """

    force_gain: float = stored("tolerance_force_gain", default=0.02)
    displacement_gain: float = stored("tolerance_displacement_gain", default=0.01)
    force_zero_N: float = stored("tolerance_force_zero_N", default=25.0)
    force_zero_change_N: float = stored("tolerance_force_zero_change_N", default=10.0)
    displacement_zero_m: float = stored("tolerance_displacement_zero_m", default=0.5e-3)
    time_s: float = stored("tolerance_time_s", default=0.5e-3)
    current_zero_A: float = stored("tolerance_current_zero_A", default=0.02)
    coil_temperature_K: float = stored("tolerance_coil_temperature_K", default=10.0)


@dataclass(frozen=True)
class RestQuality(Section):
    """What the instruments showed at rest before the first motion.

    `force_zero_std_N` is the standard error of the load cell's zero; `force_difference_N` its difference to the
    controller's force input; `current_A` what the ECU reported while its output stage was off.
    """

    coil_degC: float | None = stored("rest_coil_degC")
    ecu_degC: float | None = stored("rest_ecu_degC")
    force_N: float | None = stored("rest_force_N")
    force_zero_std_N: float | None = stored("force_zero_std_N")
    force_difference_N: float | None = stored("rest_force_difference_N")
    force_difference_std_N: float | None = stored("rest_force_difference_std_N")
    current_A: float | None = stored("rest_current_A")
    current_std_A: float | None = stored("rest_current_std_A")

    @property
    def current(self) -> Estimate | None:
        """The reported current at rest (A)."""
        return estimate(self.current_A, self.current_std_A)


@dataclass(frozen=True)
class PointQuality(Section):
    """All that a point's file holds under `/entry/quality`.

    Attributes:
        verdict: the verdict and its reasons.
        lost_samples: samples that no channel delivered; `loss_counted_by` how a loss would have been seen: `sequence`,
            `rate` or `nothing`.
        recovered: whether the campaign did not end by itself.
        skew, motion, current, force, displacement, loop, rest: what was measured.
        tolerances: what the bench allowed; None where the file does not say.
        coil_low_degC, coil_high_degC: the coil's temperature over the full cycles.
        judged_again, judged_again_utc: why and when the verdict was changed after the file was made.
    """

    verdict: Verdict = field(default_factory=Verdict)
    lost_samples: int | None = stored("lost_samples", Stored.COUNT)
    loss_counted_by: str | None = stored("loss_counted_by", Stored.TEXT)
    recovered: bool | None = stored("recovered", Stored.FLAG)
    skew: SkewQuality = field(default_factory=SkewQuality, metadata=section(SkewQuality))
    motion: MotionQuality = field(default_factory=MotionQuality, metadata=section(MotionQuality))
    current: CurrentQuality = field(default_factory=CurrentQuality, metadata=section(CurrentQuality))
    force: SensorQuality = field(default_factory=SensorQuality, metadata=FORCE)
    displacement: SensorQuality = field(default_factory=SensorQuality, metadata=DISPLACEMENT)
    loop: LoopQuality = field(default_factory=LoopQuality, metadata=section(LoopQuality))
    tolerances: Tolerances | None = field(default=None, metadata=section(Tolerances, optional=True))
    rest: RestQuality = field(default_factory=RestQuality, metadata=section(RestQuality))
    coil_low_degC: float | None = stored("coil_temperature_low_degC")
    coil_high_degC: float | None = stored("coil_temperature_high_degC")
    judged_again: str | None = stored("judged_again", Stored.TEXT)
    judged_again_utc: str | None = stored("judged_again_utc", Stored.TEXT)

    @classmethod
    def read(cls, attributes: Attributes, **names: str) -> Self:
        """The quality as the attributes of `/entry/quality` tell it; of an older file, what it has."""
        return replace(super().read(attributes, **names), verdict=Verdict.stored(attributes))

    def items(self, **names: str) -> Iterator[tuple[str, Attribute]]:
        """Name and value of each attribute, the verdict first; None where there is none."""
        yield from self.verdict.attributes.items()
        yield from super().items(**names)

    def sensor(self, name: str) -> SensorQuality:
        """The section of `force` or `displacement`."""
        return {"force": self.force, "displacement": self.displacement}[name]
