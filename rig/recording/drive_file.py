"""Drives of iterated signals as files: `drives/p001.h5` of a campaign's folder (`docs/files.md`).

One file per point: the target, the command and the measured motion of each trial with its error, the response of the
machine. A later session or run starts from the command with the smallest error.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from rig.errors import FileProblem
from rig.recording.atomic_write import inner_folder, write_durably
from rig.signals.drive_iteration import KEPT, FrequencyResponse, SignalDrive, SignalDrives, with_samples
from rig.signals.record import STEP_S, Record
from rig.test_point import TestPoint
from rig.text_file import read_bytes

FORMAT = 1
LARGEST_BYTES = 500_000_000
ENDING = ".h5"


@dataclass(frozen=True)
class DriveOwner:
    """What a drive belongs to: a command is started from only on the same machine with the same specimen.

    Attributes:
        specimen: serial number.
        bench: digest of the bench.
    """

    specimen: str
    bench: str


def write_drive(
    folder: Path, name: str, owner: DriveOwner, point: TestPoint, drive: SignalDrive, tolerance: float | None = None
) -> None:
    """Store a drive after each trial; the file of an earlier trial is replaced.

    Args:
        folder: the campaign's folder for drives.
        name: of the point.
        owner: what the drive belongs to.
        point: the signal.
        drive: with its trials.
        tolerance: of the error, relative; None: not stated.

    Raises:
        OSError: it cannot be written.
    """
    target = point.record_samples
    if target is None or drive.response is None:
        return
    image = io.BytesIO()
    with h5py.File(image, "w") as file:
        file.attrs.update({
            "format": FORMAT, "point": name, "record": target.name, "specimen": owner.specimen, "bench": owner.bench,
            "current_A": drive.current_A, "target_mark": drive.mark, "target_amplitude_m": drive.amplitude_m,
            "step_s": STEP_S, "outcome": drive.outcome, "reason": drive.cannot, "start": drive.start,
            "follows": "force" if drive.of_force else "displacement",
            "delay_s": drive.response.delay_s, "least_coherence": drive.response.least_coherence,
            **({} if tolerance is None else {"tolerance": tolerance}),
        })
        _put(file, "target", target.amplitude_m * target.shape, "m")
        _put(file, "error", np.array(drive.errors), "1")
        _put(file, "delay", np.array([trial.delay_s for trial in drive.trials]), "s")
        for what, values in (
            ("command", [trial.command.amplitude_m * trial.command.shape for trial in drive.trials]),
            ("measured", [trial.measured for trial in drive.trials]),
        ):
            _put(file, what, np.array(values, np.float32).reshape(len(drive.trials), len(target.shape)), "m")
        if target.force is not None:
            forces = [trial.force_N for trial in drive.trials if trial.force_N is not None]
            _put(file, "target_force", target.force.force_N, "N")
            _put(file, "force", np.array(forces, np.float32).reshape(len(forces), len(target.shape)), "N")
        response = file.create_group("response")
        _put(response, "frequency", drive.response.frequency_Hz, "Hz")
        _put(response, "gain", np.abs(drive.response.response), "1")
        _put(response, "phase", np.angle(drive.response.response), "rad")
        _put(response, "coherence", drive.response.coherence, "1")
    write_durably(inner_folder(folder.parent, folder.name) / f"{name}{ENDING}", image.getvalue())


def _put(group: h5py.Group, name: str, values: np.typing.NDArray[np.floating], unit: str) -> None:
    packed = {"compression": "gzip", "shuffle": True} if values.ndim == 2 and values.size else {}
    group.create_dataset(name, data=values, **packed).attrs["units"] = unit


def kept_drives(
    folder: Path, owner: DriveOwner, points: tuple[TestPoint, ...], gain: float
) -> tuple[SignalDrives, tuple[str, ...]]:
    """Stored drives that can be started from, and what speaks against the others.

    Args:
        folder: of the drives; it need not exist.
        owner: machine and specimen of this campaign.
        points: signals of this campaign, whose targets are compared.
        gain: of the iteration.

    Returns:
        One drive for each target and current, the command with the smallest error to be run next; and a line for each
        file that cannot be used.
    """
    drives: list[SignalDrive] = []
    problems: list[str] = []
    for path in sorted(folder.glob(f"*{ENDING}")) if folder.is_dir() else ():
        try:
            drives += _read(path, owner, points, gain)
        except FileProblem as error:
            problems += [f"{path.name}: {problem}" for problem in error.problems]
    return tuple(drives), tuple(problems)


def _read(path: Path, owner: DriveOwner, points: tuple[TestPoint, ...], gain: float) -> list[SignalDrive]:
    """The drive in a file; none where no trial is in it, or no point has its target and current.

    Raises:
        FileProblem: it is not a drive, or that of another machine or specimen.
    """
    try:
        with h5py.File(io.BytesIO(read_bytes(path, LARGEST_BYTES)), "r") as file:
            about, errors = dict(file.attrs), np.asarray(file["error"], np.float64)
            response = {name: np.asarray(file["response"][name], np.float64) for name in file["response"]}
            best = int(np.argmin(errors)) if len(errors) else 0
            command = np.asarray(file["command"][best], np.float64) if len(errors) else np.zeros(0)
            known = FrequencyResponse(
                float(about["delay_s"]), float(about["least_coherence"]), response["frequency"],
                response["gain"] * np.exp(1j * response["phase"]), response["coherence"],
            )
        _check(known)
        differs = _differs(about, owner)
    except (OSError, KeyError, TypeError, ValueError, IndexError) as error:
        raise FileProblem(str(path), [f"this is not a drive file: {error}"]) from error
    if differs:
        raise FileProblem(str(path), [f"{differs}; the command is not used"])
    target, current_A = _target(about, points), float(about["current_A"])
    if target is None or len(command) != len(target.shape) or not np.all(np.isfinite(command)):
        return []
    kept = with_samples(target, command)
    return [
        SignalDrive(
            target.mark, target.amplitude_m, current_A, gain, kept, known, start=KEPT, of_force=target.of_force
        )
    ]


def _check(known: FrequencyResponse) -> None:
    """Refuse a response from which no command can be calculated: a value that is not finite would spread to all.

    Raises:
        ValueError: it is not one.
    """
    columns = (known.frequency_Hz, known.response, known.coherence)
    if {column.shape for column in columns} != {(len(known.frequency_Hz),)} or len(known.frequency_Hz) < 2:
        raise ValueError("the columns of the response differ in length, or contain fewer than 2 frequencies")
    if not all(np.all(np.isfinite(column)) for column in columns) or not np.isfinite(known.delay_s):
        raise ValueError("the response contains values that are not finite")
    if known.frequency_Hz[0] <= 0.0 or np.any(np.diff(known.frequency_Hz) <= 0.0):
        raise ValueError("the frequencies of the response must be above 0 Hz and increase from entry to entry")


def _differs(about: dict[str, object], owner: DriveOwner) -> str:
    for key, mine in (("specimen", owner.specimen), ("bench", owner.bench)):
        if about[key] != mine:
            what = "serial number" if key == "specimen" else "digest"
            return f"the {key} differs ({what} {str(about[key])[:40]!r}, here {mine[:40]!r})"
    return ""


def _target(about: dict[str, object], points: tuple[TestPoint, ...]) -> Record | None:
    """The target of a drive among those of the campaign's points."""
    for point in points:
        record = point.record_samples
        if record is not None and (record.mark, record.amplitude_m) == (
            about["target_mark"], about["target_amplitude_m"]
        ):
            return record
    return None
