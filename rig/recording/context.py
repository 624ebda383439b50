"""What a point's journal says about itself in its header: everything the finaliser needs besides the samples."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class SensorContext:
    """One sensor channel as the bench file declares it (SI units).

    `delay_s` is the declared group delay of its conditioner (None: not stated, taken as 0); `range_SI` the full scale
    (None: unknown); `sensitivity` is SI per unit on the wire, `offset` in SI; dates are ISO 8601 text.
    `bandwidth_Hz` is what its conditioner passes (-3 dB; None: not stated). `uncertainty_percent` is the standard
    uncertainty of the sensitivity (None: not stated); `overdue`: the calibration was past its due date. `format` names
    what it sends: a preset of `protocols.line_format`, or `frame16`.
    """

    sensor: str
    rate_Hz: float
    delay_s: float | None = 0.0
    range_SI: float | None = None
    unit: str = ""
    long_name: str = ""
    sensitivity: float = 1.0
    offset: float = 0.0
    serial_number: str = ""
    certificate: str = ""
    due: str = ""
    uncertainty_percent: float | None = None
    overdue: bool = False
    format: str = ""
    bandwidth_Hz: float | None = None

    @property
    def declared_s(self) -> float:
        """The delay to take off, s."""
        return 0.0 if self.delay_s is None else self.delay_s


@dataclass(frozen=True)
class PointContext:
    """The header of a point's journal.

    Attributes:
        point: the fields of `rig.matrix.point.TestPoint` (`dataclasses.asdict`): `id`, `waveform`, `amplitude_m`,
            `frequency_Hz`, `current_A`, `cycles`, `ramp_in_cycles`, `ramp_out_cycles`, `centre_m`, `repeat`, `rest_s`.
        sensors: sensor by channel name: `force`, `displacement`, `auxiliary_1` ... as in `rig.recording.channel`.
        device_rate: seconds of device clock per second of wall time (bench `[clock] device_rate`).
        controller_delay_s: delay of the controller's own position and force inputs (bench `[actuator] input_delay`),
            against which the sensors' delays are checked; None when it may not be relied on.
        mid_stroke_m: the specimen's mid-stroke in the displacement sensor's coordinate; None when unknown.
        moving_mass_kg: mass between load cell and damper; its inertia is part of the measured force.
        current_tolerance_A: largest deviation of measured from wanted current in a valid point.
        simulated: True when no real damper was tested.
        calibration: what is known of the instruments before the point, by attribute of `/entry/quality`: what the bench
            allows them to differ by, and what they showed at rest before the first motion.
        provenance: flat text attributes: software version, bench and matrix names and hashes, device identities,
            start time (UTC, ISO 8601), operator.
    """

    point: Mapping[str, Any]
    sensors: Mapping[str, SensorContext]
    device_rate: float = 1.0
    controller_delay_s: float | None = None
    mid_stroke_m: float | None = None
    moving_mass_kg: float = 0.0
    current_tolerance_A: float = 0.02
    simulated: bool = False
    calibration: Mapping[str, float] = field(default_factory=dict)
    provenance: Mapping[str, str] = field(default_factory=dict)

    def to_json(self) -> str:
        """One line of JSON that `from_json` turns back into an equal context."""
        return json.dumps(asdict(self), allow_nan=False)

    @classmethod
    def from_json(cls, text: str) -> PointContext:
        """Read `to_json`'s line again.

        Raises:
            ValueError: the text is not JSON of this shape; the message says what is wrong.
        """
        try:
            raw = json.loads(text)
            sensors = {name: SensorContext(**entry) for name, entry in raw.pop("sensors").items()}
            context = cls(sensors=sensors, **raw)
        except (AttributeError, KeyError, RecursionError, TypeError) as error:
            raise ValueError(f"journal header is not a point's context: {error}") from error
        if not isinstance(context.point, dict) or not isinstance(context.provenance, dict):
            raise ValueError("journal header is not a point's context: point and provenance are not both objects")
        return context
