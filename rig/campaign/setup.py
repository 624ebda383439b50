"""Before anything is connected: the campaign's directory, its description, room on the disk, the station's settings.

Also what the bench file must promise: calibrations that are not overdue, and clocks where the matrix asks for the skew.
"""

from __future__ import annotations

import hashlib
import json
import math
import secrets
import shutil
from datetime import date
from pathlib import Path
from typing import Any

from drivers.catalogue import clocked_format_names
from rig import __version__
from rig.bench.model import Bench
from rig.bench.settings import StationConfig
from rig.campaign.results import CampaignOptions
from rig.campaign.sequencer.amplitude_compensation import MOST_STEPS
from rig.clock import utc_now
from rig.errors import FileProblem, Refused
from rig.matrix.model import Matrix
from rig.matrix.plan import Plan
from rig.recording.atomic_write import write_text_durably
from rig.recording.layout import RECORD_DTYPE

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
    """What the station is told: the bench's settings as they are, its limits narrowed to the specimen's travel.

    Args:
        bench: the bench.
        matrix: the matrix, for the specimen.
        ring_path: where the station makes its ring.
    """
    return StationConfig(
        **vars(bench.station),
        **vars(bench.clock),
        actuator=bench.actuator,
        ecu=bench.ecu,
        load_cell=bench.load_cell,
        lvdt=bench.lvdt,
        auxiliary=bench.auxiliary,
        limits=bench.limits.within_stroke(matrix.specimen.stroke_m, matrix.specimen.mid_stroke_m),
        ring_path=str(ring_path),
    )


def check_calibrations(bench: Bench, today: date) -> tuple[str, ...]:
    """One warning for each sensor whose calibration is past its due date.

    Args:
        bench: the bench.
        today: the date to compare with.

    Raises:
        Refused: there is one, and the bench file says `require_valid_calibration = true` (slug `calibration-overdue`).
    """
    sensors = {"load_cell": bench.load_cell, "lvdt": bench.lvdt, **{item.name: item for item in bench.auxiliary}}
    warnings = tuple(
        f"{name}: the calibration of sensor {sensors[name].calibration.serial_number} was due on "
        f"{sensors[name].calibration.due}"
        for name in bench.overdue(today)
    )
    if warnings and bench.require_valid_calibration:
        raise Refused(
            "calibration-overdue",
            "; ".join(warnings) + "; have it calibrated and enter the new certificate and due date in the bench file "
            "(it says require_valid_calibration = true); nothing was moved",
        )
    return warnings


def check_clocks(bench: Bench) -> None:
    """Refuse a bench on which the skew between force and displacement cannot be measured.

    Raises:
        Refused: a sensor speaks a format without a clock (slug `format-without-clock`); each is named.
    """
    formats = {"load_cell": bench.load_cell.format, "lvdt": bench.lvdt.format}
    clocked = clocked_format_names()
    without = [
        f"[{name}] format = {value if isinstance(value, str) else 'a described line'!r} carries neither a clock nor "
        "sync edges"
        for name, value in formats.items() if value not in clocked
    ]
    if without:
        raise Refused(
            "format-without-clock",
            "; ".join(without) + f", and the matrix asks for the skew ([campaign] require_skew = true): use a sensor "
            f"that speaks {' or '.join(clocked)}, or leave require_skew out and take the skew as uncertain as the "
            "report states it; nothing was moved",
        )
