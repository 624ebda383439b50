"""The executor of a campaign: what the runner carries actions out with, gathered in one value."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rig import __version__
from rig.bench.model import CHANGE_OF_ZERO, Bench
from rig.bench.sensor_settings import SensorConfig
from rig.bench.settings import StationConfig
from rig.campaign.preflight.baseline import Baseline
from rig.campaign.preflight.rest_check import RestLimits
from rig.campaign.results import Display
from rig.campaign.resume import Stock
from rig.campaign.setup import campaign_hash
from rig.clock import utc_now
from rig.matrix.model import Matrix
from rig.matrix.plan import Plan
from rig.matrix.point import TestPoint
from rig.recording.journal.campaign_log import CampaignLog
from rig.recording.layout import PointContext, SensorContext, WantedPoint
from rig.recording.point_files import attempt_name
from rig.recording.quality.point_quality import Tolerances
from rig.station.client import StationClient

CENTRING_SPEED_M_S = 0.05
CENTRING_SPEED_SHARE = 0.25


@dataclass
class CampaignContext:
    """What one campaign works with.

    Attributes:
        folder: the campaign's directory.
        bench: the rig.
        matrix: the test matrix.
        plan: the accepted plan.
        config: what the station was told.
        client: the station.
        log: the campaign's journal.
        display: what the operator sees.
        simulated: no real damper is tested.
        stock: what is kept of earlier sessions, and what remains to be run.
        baseline: what the campaign's first session found.
        identities: what the devices said about themselves at connect.
        at_rest: what was seen of the instruments before the first motion, by attribute of `/entry/quality`.
    """

    folder: Path
    bench: Bench
    matrix: Matrix
    plan: Plan
    config: StationConfig
    client: StationClient
    log: CampaignLog
    display: Display
    simulated: bool
    stock: Stock
    baseline: Baseline
    identities: dict[str, Any] = field(default_factory=dict)
    at_rest: dict[str, float] = field(default_factory=dict)

    @property
    def centring_speed_m_s(self) -> float:
        """Speed of the slow move to a point's centre (m/s)."""
        return min(CENTRING_SPEED_M_S, CENTRING_SPEED_SHARE * self.bench.limits.speed_m_s)

    @property
    def rest_limits(self) -> RestLimits:
        """What a resting rig is compared with."""
        allowed = self.config.limits
        return RestLimits(
            force_N=allowed.force_N,
            position_min_m=self.bench.limits.position_m[0],
            position_max_m=self.bench.limits.position_m[1],
            disagreement_m=self.config.disagreement_m,
            range_N=self.bench.load_cell.range_N,
            zero_N=self.tolerances.force_zero_N,
            current_zero_A=self.bench.checks.current_zero_A,
            force_per_wire=self.bench.load_cell.sensitivity,
            displacement_per_wire=self.bench.lvdt.sensitivity,
            force_offset_N=self.bench.load_cell.offset,
            displacement_offset_m=self.bench.lvdt.offset,
        )

    @property
    def point_ids(self) -> tuple[str, ...]:
        """Ids of all the matrix's points."""
        return tuple(item.point.id for item in self.plan.points)

    def attempt_name(self, point_id: str, attempt: int) -> str:
        """Name of the files of a point's attempt, counted from 1; never another point's."""
        return attempt_name(point_id, attempt, self.point_ids)

    @property
    def tolerances(self) -> Tolerances:
        """What two instruments of the bench may differ by; zeros in proportion to the largest force of the matrix."""
        checks = self.bench.checks
        predicted_N = [item.predicted_force_N for item in self.plan.points if item.predicted_force_N is not None]
        zero_N = checks.zero_N(self.bench.load_cell.range_N, max(predicted_N, default=None))
        return Tolerances(
            force_gain=checks.force_gain, displacement_gain=checks.displacement_gain, force_zero_N=zero_N,
            force_zero_change_N=CHANGE_OF_ZERO * zero_N, displacement_zero_m=checks.displacement_zero_m,
            time_s=checks.time_s, current_zero_A=checks.current_zero_A,
        )

    def context(self, point: TestPoint, attempt: int, commanded: TestPoint) -> PointContext:
        """The header of a point's journal; `commanded` is the program that makes its motion."""
        return PointContext(
            point=self._wanted(point, attempt, commanded),
            sensors=sensor_contexts(self.bench),
            device_rate=self.bench.clock.device_rate,
            controller_delay_s=self.bench.actuator.input_delay_s,
            mid_stroke_m=self.matrix.specimen.mid_stroke_m,
            moving_mass_kg=self.bench.fixture.moving_mass_kg,
            current_tolerance_A=self.matrix.campaign.current_settled_A,
            simulated=self.simulated,
            provenance=self._provenance(point, attempt),
            calibration={**self.tolerances.numbers, **self.at_rest},
        )

    def _wanted(self, point: TestPoint, attempt: int, commanded: TestPoint) -> WantedPoint:
        """The point's own values, and what it was to find."""
        sweep, temperature = self.matrix.sweep, self.matrix.temperature
        low_degC, high_degC = (None, None) if temperature is None else temperature.window_degC
        return WantedPoint(
            id=self.attempt_name(point.id, attempt),
            waveform=point.waveform,
            amplitude_m=point.amplitude_m,
            frequency_Hz=point.frequency_Hz,
            current_A=point.current_A,
            cycles=point.cycles,
            ramp_in_cycles=point.ramp_in_cycles,
            ramp_out_cycles=point.ramp_out_cycles,
            centre_m=point.centre_m,
            repeat=point.repeat,
            rest_s=point.rest_s,
            kind=point.kind,
            steps_A=" ".join(f"{step_A:g}" for step_A in point.steps_A),
            commanded_amplitude_m=commanded.amplitude_m,
            commanded_centre_m=commanded.centre_m,
            amplitude_tolerance=sweep.amplitude_tolerance if sweep.adapt_amplitude else None,
            temperature_low_degC=low_degC,
            temperature_high_degC=high_degC,
        )

    def _provenance(self, point: TestPoint, attempt: int) -> dict[str, str]:
        identities = {f"identity_{name}": _text(value) for name, value in self.identities.items()}
        return {
            "software": f"mr-damper-rig {__version__}",
            "campaign": self.folder.name,
            "bench": self.bench.name,
            "bench_hash": self.bench.digest,
            "matrix_hash": self.matrix.digest,
            "campaign_hash": campaign_hash(self.bench, self.matrix),
            "specimen": self.matrix.specimen.serial_number,
            "point": point.id,
            "attempt": str(self.stock.attempts.get(point.id, 0) + attempt),
            "started_utc": utc_now().isoformat(timespec="milliseconds"),
            **identities,
        }


def sensor_contexts(bench: Bench) -> dict[str, SensorContext]:
    """The sensors as the recording names them: `force`, `displacement`, `auxiliary_1` ..."""
    contexts = {
        "force": _sensor(bench.load_cell, "N", "Force at the load cell"),
        "displacement": _sensor(bench.lvdt, "m", "Damper extension"),
    }
    for number, sensor in enumerate(bench.auxiliary, start=1):
        contexts[f"auxiliary_{number}"] = _sensor(sensor, sensor.unit, sensor.name)
    return contexts


def _sensor(sensor: SensorConfig, unit: str, long_name: str) -> SensorContext:
    calibration = sensor.calibration
    return SensorContext(
        sensor=sensor.label,
        rate_Hz=sensor.rate_Hz,
        delay_s=sensor.delay_s,
        range_SI=sensor.span,
        unit=unit,
        long_name=long_name,
        sensitivity=sensor.sensitivity,
        offset=sensor.offset,
        serial_number=calibration.serial_number,
        certificate=calibration.certificate,
        due="" if calibration.due is None else calibration.due.isoformat(),
        uncertainty_percent=calibration.uncertainty_percent,
        overdue=calibration.due is not None and calibration.due < utc_now().date(),
        format=sensor.format if isinstance(sensor.format, str) else "a line described in the bench file",
        bandwidth_Hz=sensor.bandwidth_Hz,
    )


def _text(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {entry}" for key, entry in value.items())
    return str(value)
