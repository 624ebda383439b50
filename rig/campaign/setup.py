"""Before anything is connected: the campaign's directory, its description, the room on the disk."""

from __future__ import annotations

import hashlib
import json
import math
import secrets
import shutil
from pathlib import Path
from typing import Any

from rig import __version__
from rig.bench.model import Bench, Sensor
from rig.campaign.adaptation import MOST_STEPS
from rig.campaign.options import CampaignOptions
from rig.clock import utc_now
from rig.errors import FileProblem, Refused
from rig.matrix.model import Matrix
from rig.matrix.plan import Plan
from rig.recording.atomic_write import write_text_durably
from rig.recording.layout import RECORD_DTYPE
from rig.station.config import ActuatorConfig, EcuConfig, Limits, SensorConfig, StationConfig

SPIKE_FORCE_SHARE = 0.6
"""A triangle's reversal turns the whole yield force round between two samples; a larger jump is no physics."""
SPIKE_SPEED_FACTOR = 2.0
SPIKE_DISPLACEMENT_M = 1e-3
RESERVE_BYTES = 200_000_000
COPIES_ON_DISK = 2.5
"""Journal, HDF5 file being written beside it, and margin."""
STATUS_RECORDS_Hz = 1500.0
"""Records of the controller's and the ECU's status a second, above the sensors' samples."""


def make_campaign_folder(out: Path, specimen: str) -> Path:
    """Make `<UTC>-<specimen>-<short id>` in `out`; never an existing one.

    Raises:
        Refused: the folder cannot be made or written (slug `dir-readonly`).
    """
    stamp = utc_now().strftime("%Y%m%dT%H%M%SZ")
    folder = out / f"{stamp}-{specimen}-{secrets.token_hex(3)}"
    try:
        (folder / "points").mkdir(parents=True)
    except OSError as error:
        raise Refused(
            "dir-readonly", f"{folder}: cannot be made: {error}; give a writable folder with --out"
        ) from error
    return folder


def copy_into(source: Path, folder: Path, name: str) -> None:
    """Keep a user's file with the campaign, as it was.

    Raises:
        Refused: it cannot be copied.
        FileProblem: the source cannot be read.
    """
    try:
        content = source.read_bytes()
    except OSError as error:
        raise FileProblem(str(source), [f"cannot be read: {error.strerror}"]) from error
    try:
        (folder / name).write_bytes(content)
    except OSError as error:
        raise Refused("dir-readonly", f"{folder / name}: cannot be written: {error}") from error


def check_room(folder: Path, plan: Plan, bench: Bench, matrix: Matrix) -> None:
    """Refuse a campaign that the disk cannot hold, records of motions out of tolerance included.

    Raises:
        Refused: less free space than forecast (slug `disk-full`); both numbers are in the message.
    """
    sensors = (bench.load_cell, bench.lvdt, *bench.auxiliary)
    rate_Hz = sum(sensor.rate_Hz for sensor in sensors) + STATUS_RECORDS_Hz
    records = (plan.recorded_s + _corrections_s(plan, matrix)) * rate_Hz
    needed = int(records * RECORD_DTYPE.itemsize * COPIES_ON_DISK) + RESERVE_BYTES
    free = shutil.disk_usage(folder).free
    if free < needed:
        raise Refused(
            "disk-full",
            f"{folder}: {free / 1e6:.0f} MB free, about {needed / 1e6:.0f} MB needed; free some or give --out",
        )


def _corrections_s(plan: Plan, matrix: Matrix) -> float:
    """The longest that motions out of tolerance are recorded (s): each motion is learned at each current."""
    if not matrix.sweep.adapt_amplitude:
        return 0.0
    motions: dict[tuple[str, float, float, float], float] = {}
    for item in plan.points:
        point = item.point
        key = point.waveform, point.amplitude_m, point.frequency_Hz, point.current_A
        motions[key] = max(motions.get(key, 0.0), point.motion_s if point.kind == "loop" else 0.0)
    return MOST_STEPS * math.fsum(motions.values())


def campaign_hash(bench: Bench, matrix: Matrix) -> str:
    """SHA-256 (hex) of what a resumed campaign must find unchanged.

    Physics, limits, calibration, identities and matrix count; addresses do not.
    """
    return hashlib.sha256(f"{bench.digest}{matrix.digest}".encode()).hexdigest()


def write_description(folder: Path, bench: Bench | None, matrix: Matrix, options: CampaignOptions) -> None:
    """Write `campaign.json`: id, time, software, hashes, how the rig was simulated, the points in order.

    Args:
        folder: the campaign's directory.
        bench: the rig; None while it is not known yet, so that a campaign cut off this early can still be resumed.
        matrix: the matrix.
        options: how the campaign was asked for.

    Raises:
        Refused: it cannot be written.
    """
    description: dict[str, Any] = {
        "format": 1,
        "id": folder.name,
        "started_utc": utc_now().isoformat(timespec="seconds"),
        "software": f"mr-damper-rig {__version__}",
        "bench": "" if bench is None else bench.name,
        "specimen": matrix.specimen.serial_number,
        "hash": "" if bench is None else campaign_hash(bench, matrix),
        "hashes": {"bench": "" if bench is None else bench.digest, "matrix": matrix.digest},
        "simulated": {"speed": options.speed, "seed": options.seed, "arguments": list(options.simulator_args)}
        if options.simulate
        else None,
        "points": [point.id for point in matrix.points()],
    }
    try:
        write_text_durably(folder / "campaign.json", json.dumps(description, indent=1) + "\n")
    except OSError as error:
        raise Refused("dir-readonly", f"{folder / 'campaign.json'}: cannot be written: {error}") from error


def station_config(bench: Bench, matrix: Matrix, ring_path: Path) -> StationConfig:
    """What the station is told, from the bench file and the specimen.

    The specimen's stroke about its mid-stroke narrows the bench's position limits.

    Args:
        bench: the bench.
        matrix: the matrix, for the specimen.
        ring_path: where the station makes its ring.
    """
    return StationConfig(
        actuator=_actuator(bench),
        ecu=_ecu(bench),
        load_cell=_sensor(
            "load_cell", bench.load_cell, bench.load_cell.range_N, SPIKE_FORCE_SHARE * bench.limits.force_N
        ),
        lvdt=_sensor(
            "lvdt",
            bench.lvdt,
            bench.lvdt.range_m,
            SPIKE_DISPLACEMENT_M + SPIKE_SPEED_FACTOR * bench.limits.speed_m_s / bench.lvdt.rate_Hz,
        ),
        auxiliary=tuple(_sensor(each.name, each, each.range_SI, float("inf")) for each in bench.auxiliary),
        limits=limits(bench, matrix),
        ring_path=str(ring_path),
        device_rate=bench.clock.device_rate,
        heartbeat_timeout_s=bench.station.heartbeat_timeout_s,
        late_limit_s=bench.station.late_limit_s,
        real_time=bench.station.real_time,
    )


def limits(bench: Bench, matrix: Matrix) -> Limits:
    """The bench's limits, the stroke narrowed to the specimen's."""
    allowed, specimen = bench.limits, matrix.specimen
    half_m = 0.5 * specimen.stroke_m
    return Limits(
        position_min_m=max(allowed.position_m[0], specimen.mid_stroke_m - half_m),
        position_max_m=min(allowed.position_m[1], specimen.mid_stroke_m + half_m),
        speed_m_s=allowed.speed_m_s,
        acceleration_m_s2=allowed.acceleration_m_s2,
        force_N=allowed.force_N,
        current_A=allowed.current_A,
        coil_temperature_degC=allowed.coil_temperature_degC,
    )


def _actuator(bench: Bench) -> ActuatorConfig:
    given = bench.actuator
    return ActuatorConfig(
        url=given.url,
        baudrate=given.baudrate,
        parity=given.parity,
        device_id=given.device_id,
        register_map=given.register_map,
        poll_s=given.poll_s,
        timeout_s=given.timeout_s,
        stale_after_s=given.stale_after_s,
        watchdog_s=given.watchdog_s,
        fade_out_cycles=given.fade_out_cycles,
        halt_deceleration_m_s2=given.halt_deceleration_m_s2,
        serial_number=given.serial_number,
    )


def _ecu(bench: Bench) -> EcuConfig:
    given = bench.ecu
    return EcuConfig(
        interface=given.interface,
        channel=given.channel,
        bitrate=given.bitrate,
        dbc=given.dbc,
        command_period_s=given.command_period_s,
        stale_after_s=given.stale_after_s,
        serial_number=given.serial_number,
    )


def _sensor(name: str, given: Sensor, span: float, spike_jump: float) -> SensorConfig:
    return SensorConfig(
        name=name,
        url=given.url,
        rate_Hz=given.rate_Hz,
        span=span,
        stale_after_s=given.stale_after_s,
        baudrate=given.baudrate,
        format=given.format,
        sensitivity=given.sensitivity,
        offset=given.offset,
        spike_jump=spike_jump,
    )
