"""The campaign's directory and its description, and the requirements before anything is connected.

The plan must be within limits, the disk must have room, calibrations must not be overdue if the bench file requires
it, and sensors must have clocks if the matrix requires a known sensor delay.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import secrets
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from datetime import date
from pathlib import Path
from typing import Any

from drivers.catalogue import clocked_format_names
from drivers.ring import RECORD_SIZE
from rig import __version__
from rig.bench.model import Bench
from rig.campaign.confirmation import EarlierStop, resume_command
from rig.campaign.file_copies import keep_bench, keep_drives, keep_matrix, kept_hashes
from rig.campaign.machine_resources import locked
from rig.campaign.results import CampaignOptions, Display
from rig.campaign.sequencer.point_preparation import MOST_STEPS
from rig.campaign.stop_cause import disk_slug
from rig.campaign.words import say
from rig.campaign_folder import CampaignFolder
from rig.clock import utc_now
from rig.errors import FileProblem, Refused, Stopped
from rig.matrix.model import Matrix
from rig.matrix.plan import Plan, plan
from rig.matrix.storage import COPIES_ON_DISK, records_Hz
from rig.recording.atomic_write import inner_folder, write_text_durably
from rig.recording.journal.campaign_log import CampaignLog
from rig.recording.journal.journal_lock import campaign_held
from rig.recording.run import REANALYSIS, read_campaign
from rig.test_point import LOOP
from rig.text_file import LARGEST_NAMED_FILE_BYTES, read_bytes

ZERO_CHECKS = "zero_checks"
"""Entry of `campaign.json`: one for each session."""
RESERVE_BYTES = 200_000_000


@contextmanager
def campaign_folder(
    options: CampaignOptions, matrix: Matrix, bench: Bench | None, display: Display
) -> Iterator[tuple[CampaignLog, tuple[int, ...]]]:
    """Hold the campaign's directory, a new one or the resumed one, keep its journal and the rig's locks meanwhile.

    A new one gets the user's files. A refusal before the start is kept in the journal too, where the disk takes it.

    Args:
        options: which campaign.
        matrix: the matrix.
        bench: the rig; None while it is not known yet: nothing is locked then.
        display: told of a disk that refuses the journal's end; that takes nothing from the result.

    Raises:
        Refused: the directory cannot be made or written, directory or rig are in use, or the block refused.
        FileProblem: one of the user's files cannot be read.
        Stopped: the operator's stop before the rig was connected.
    """
    folder = options.resume_path or make_campaign_folder(options.out, matrix.specimen.serial_number)
    with campaign_held(folder):
        log = _journal(folder)
        try:
            with _refusals_in(log), contextlib.nullcontext(()) if bench is None else locked(bench) as locks:
                if options.resume_path is None:
                    _keep_files(folder, options, bench, matrix)
                yield log, locks
        finally:
            try:
                log.close()
            except OSError as error:
                display.message("error", say("at-the-end", error=error))


def make_campaign_folder(out: Path, specimen: str) -> Path:
    """Make `<UTC>-<specimen>-<short id>` in `out`; never an existing one.

    Raises:
        Refused: the folder cannot be made or written (slug `dir-readonly`).
    """
    stamp = utc_now().strftime("%Y%m%dT%H%M%SZ")
    folder = out / f"{stamp}-{specimen}-{secrets.token_hex(3)}"
    try:
        inner_folder(folder, CampaignFolder.points)
    except OSError as error:
        raise Refused(
            "dir-readonly", f"{folder}: cannot be created: {error}. Fix: specify a writable folder with --out"
        ) from error
    return folder


def _journal(folder: Path) -> CampaignLog:
    """The campaign's journal.

    Raises:
        Refused: it cannot be opened.
    """
    try:
        return CampaignLog(folder)
    except OSError as error:
        raise Refused(disk_slug(error), f"{CampaignFolder(folder).journal}: {error}; nothing was connected") from error


@contextmanager
def _refusals_in(log: CampaignLog) -> Iterator[None]:
    """Keep a refusal before the start in the campaign's journal too, where the disk takes it.

    Raises:
        Refused: the same one, or that of a disk on which nothing can be begun.
        Stopped: the operator's stop before the rig was connected.
    """
    try:
        try:
            yield
        except OSError as error:
            text = f"the campaign cannot be started: {error}; nothing was connected"
            raise Refused(disk_slug(error), text) from error
    except Refused as refusal:
        with contextlib.suppress(OSError):
            log.write("refused", slug=refusal.slug, text=str(refusal))
        raise
    except Stopped as stop:
        text = f"{stop}: no motion was started. Continue with: {resume_command(log.path.parent)}"
        with contextlib.suppress(OSError):
            log.write("refused", slug=stop.slug, text=text)
        raise Stopped(stop.slug, text) from stop


def _keep_files(folder: Path, options: CampaignOptions, bench: Bench | None, matrix: Matrix) -> None:
    """Keep the files of a new campaign as they were, and describe it, so that it can be resumed from here on.

    Raises:
        Refused: they cannot be written.
        FileProblem: one of them cannot be read.
    """
    with options.files:
        keep_matrix(options.matrix_path, CampaignFolder(folder).matrix, options.serial_number)
        if options.bench_path is not None:
            keep_bench(options.bench_path, CampaignFolder(folder).bench)
    if options.drives_path is not None:
        keep_drives(options.drives_path, folder, matrix)
    write_description(folder, bench, matrix, options)


def accepted(matrix: Matrix, bench: Bench, folder: Path | None = None) -> Plan:
    """The plan, when every point of it is feasible on this bench, and there is room for it in `folder`, if given.

    Raises:
        Refused: some point is not: each is named with its reason and the amplitude that would fit. Or the bench file
            does not fulfil `check_requirements`, or as `check_room`.
    """
    check_requirements(bench, matrix)
    planned = plan(matrix, bench)
    refused: dict[str, list[str]] = {}
    for item in planned.planned_points:
        if not item.feasible:
            fits = item.fits_text(planned.display)
            refused.setdefault("; ".join((*item.reasons, *([fits] if fits else []))), []).append(item.point.id)
    if refused:
        lines = [f"{', '.join(points)}: {why}" for why, points in refused.items()]
        raise Refused("matrix-infeasible", "the matrix is outside the limits of the rig; no motion "
            "was started:\n" + "\n".join(lines))
    if folder is not None:
        check_room(folder, planned, bench, matrix)
    return planned


def check_requirements(bench: Bench, matrix: Matrix) -> None:
    """What a matrix requires of the bench apart from limits: calibrations, sensors with clocks, the current source.

    Raises:
        Refused: as `check_calibrations`, `check_clocks` and `check_source`.
    """
    check_calibrations(bench, utc_now().date())
    if matrix.campaign.require_skew:
        check_clocks(bench)
    check_source(bench, matrix)


def check_room(folder: Path, plan: Plan, bench: Bench, matrix: Matrix) -> None:
    """Refuse a campaign that the disk cannot hold, records of motions out of tolerance included.

    Raises:
        Refused: less free space than forecast (slug `disk-full`); both numbers are in the message.
    """
    corrections = COPIES_ON_DISK * _corrections_s(plan, matrix) * records_Hz(bench) * RECORD_SIZE
    needed = plan.storage.total + int(corrections) + RESERVE_BYTES
    free = shutil.disk_usage(folder).free
    if free < needed:
        raise Refused(
            "disk-full",
            f"{folder}: {free / 1e6:.0f} MB free, but about {needed / 1e6:.0f} MB needed. Fix: free disk space or "
            "specify another folder with --out",
        )


def _corrections_s(plan: Plan, matrix: Matrix) -> float:
    """The longest that motions out of tolerance are recorded (s): each motion is learned at each current."""
    if not matrix.sweep.adapt_amplitude:
        return 0.0
    motions: dict[tuple[str, float, float, float], float] = {}
    for item in plan.points:
        point = item.point
        key = point.waveform, point.amplitude_m, point.frequency_Hz, point.current_A
        motions[key] = max(motions.get(key, 0.0), point.motion_s if point.kind == LOOP else 0.0)
    return MOST_STEPS * math.fsum(motions.values())


def campaign_hash(bench: Bench, matrix: Matrix, matrix_digest: str | None = None) -> str:
    """SHA-256 (hex) of what a resumed campaign must find unchanged.

    Physics, limits, calibration, identities and matrix count; addresses do not. `matrix_digest` stands for the
    matrix's own: one of its earlier ones.
    """
    return hashlib.sha256(f"{bench.digest}{matrix_digest or matrix.digest}".encode()).hexdigest()


def plan_digest(matrix_path: Path, bench_path: Path, matrix: Matrix, bench: Bench) -> str:
    """SHA-256 (hex) of everything that a plan was computed from: both files, and what they name.

    Args:
        matrix_path: the matrix file.
        bench_path: the bench file.
        matrix: the first one's content, as read before this call.
        bench: the second one's.

    Raises:
        FileProblem: a file cannot be read.
    """
    files = (read_bytes(path, LARGEST_NAMED_FILE_BYTES) for path in (matrix_path, bench_path))
    hashes = (campaign_hash(bench, matrix), *(hashlib.sha256(content).hexdigest() for content in files))
    return hashlib.sha256("".join(hashes).encode()).hexdigest()


def same_plan(planned: str, digest: str) -> None:
    """Refuse to start anything else than what was planned.

    Args:
        planned: `plan_digest` of the plan that the operator saw.
        digest: the present one.

    Raises:
        Refused: they differ (slug `plan-changed`); nothing was connected.
    """
    if planned != digest:
        raise Refused(
            "plan-changed",
            "the matrix file or the bench file was changed after the campaign was planned; no motion was started. "
            "Fix: read the new plan, then start the campaign",
        )


def write_description(folder: Path, bench: Bench | None, matrix: Matrix, options: CampaignOptions) -> None:
    """Write `campaign.json`: id, time, software, matrix file, hashes, how the rig was simulated, points in order.

    Once the rig is known, it is written again; the time is that of the first time.

    Args:
        folder: the campaign's directory.
        bench: the rig; None while it is not known yet, so that a campaign cut off this early can still be resumed.
        matrix: the matrix.
        options: how the campaign was asked for.

    Raises:
        Refused: it cannot be written.
    """
    hashes: dict[str, Any] = {"bench": "" if bench is None else bench.digest, "matrix": matrix.digest}
    if files := kept_hashes(folder):
        hashes["files"] = files
    if matrix.acceptance is not None:
        hashes["acceptance"] = matrix.acceptance.digest
    file = CampaignFolder(folder).description
    before = read_campaign(folder) if file.is_file() else {}
    description: dict[str, Any] = {
        "format": 1,
        "id": folder.name,
        "started_utc": before.get("started_utc") or utc_now().isoformat(timespec="seconds"),
        "software": f"mr-damper-rig {__version__}",
        "bench": "" if bench is None else bench.name,
        "specimen": matrix.specimen.serial_number,
        "matrix_file": options.matrix_path.name,
        "hash": "" if bench is None else campaign_hash(bench, matrix),
        "hashes": hashes,
        "simulated": {"speed": options.speed, "seed": options.seed, "arguments": list(options.simulator_args)}
        if options.simulate
        else None,
        "points": [point.id for point in matrix.points()],
    }
    try:
        write_text_durably(file, json.dumps(description, indent=1) + "\n")
    except OSError as error:
        raise Refused("dir-readonly", f"{file}: cannot be written: {error}") from error


def described(folder: Path) -> dict[str, Any]:
    """The campaign's description.

    Raises:
        FileProblem: there is none, or it is damaged.
    """
    description = read_campaign(folder) if folder.is_dir() else {}
    if REANALYSIS in description:
        raise FileProblem(str(folder), ["this is a result of `rig reanalyse`. Fix: resume the original campaign"])
    if not isinstance(description.get("hashes"), dict) or not CampaignFolder(folder).matrix.is_file():
        raise FileProblem(
            str(folder), ["does not contain a started campaign. Fix: specify the folder that `rig run` printed (see "
                "`rig runs`)"]
        )
    return description


def note_session(folder: Path, options: CampaignOptions, confirmed: Iterable[EarlierStop]) -> int:
    """Enter a further session in `campaign.json`; returns its number, the first one is 1.

    Raises:
        Refused: it cannot be written.
    """
    try:
        return _append(folder, "sessions", _session(options, confirmed)) + 1
    except OSError as error:
        raise Refused("dir-readonly", f"{CampaignFolder(folder).description}: cannot be written: {error}") from error


def note_zeros(folder: Path, check: Mapping[str, Any]) -> None:
    """Enter a session's zero check (`ZeroReturn.to_json`) in `campaign.json`.

    Raises:
        FileProblem: there is no such campaign.
        OSError: it cannot be written.
    """
    _append(folder, ZERO_CHECKS, check)


def _append(folder: Path, name: str, entry: Mapping[str, Any]) -> int:
    description = described(folder)
    entries = description.get(name, [])
    entries = [*(entries if isinstance(entries, list) else ()), entry]
    write_text_durably(CampaignFolder(folder).description, json.dumps({**description, name: entries}, indent=1) + "\n")
    return len(entries)


def _session(options: CampaignOptions, confirmed: Iterable[EarlierStop]) -> dict[str, Any]:
    simulated = {"speed": options.speed, "seed": options.seed, "arguments": list(options.simulator_args)}
    return {
        "resumed_utc": utc_now().isoformat(timespec="seconds"), "simulated": simulated if options.simulate else None,
        "confirmed": [stop.to_json() for stop in confirmed], "requalified": options.requalified,
    }  # fmt: skip


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
            "; ".join(warnings) + "; no motion was started. Fix: have the sensor calibrated and enter the new "
                "certificate and due date in the bench file (the file sets require_valid_calibration = true)",
        )
    return warnings


def check_source(bench: Bench, matrix: Matrix) -> None:
    """Refuse a matrix that asks for what a supply cannot do.

    Raises:
        Refused: temperatures that are not measured (`source-without-temperature`), or currents that it does not drive
            (`source-without-negative-current`).
    """
    described = bench.ecu.described_supply
    if described is None and not bench.ecu.by_hand:
        return
    needing = "[temperature] window" if matrix.temperature is not None else ""
    if any(test.stop.temperature is not None for test in matrix.endurance):
        needing = "stop rule on the temperature ([endurance.stop])"  # it could never end the test
    if needing:
        raise Refused(
            "source-without-temperature",
            f"the matrix has a {needing}, but this bench does not measure the coil temperature; no motion was started. "
            "Fix: remove it, or drive the coil with a current controller that measures the coil temperature",
        )
    if described is None:
        _check_by_hand(matrix)
        return
    negative = _has_negative(matrix)
    if described.current_A[0] >= 0.0 and (matrix.campaign.demagnetise or negative):
        raise Refused(
            "source-without-negative-current",
            f"the matrix requires negative currents, but {described.name} delivers {described.current_A[0]:g} to "
            f"{described.current_A[1]:g} A; no motion was started. Fix: remove the negative currents and [campaign] "
            "demagnetise, or use a bipolar supply",
        )


def _has_negative(matrix: Matrix) -> bool:
    """Whether a point requires a negative current."""
    return any(min((point.current_A, *point.steps_A)) < 0.0 for point in matrix.points())


def _check_by_hand(matrix: Matrix) -> None:
    """Refuse a matrix that an operator cannot follow manually.

    Raises:
        Refused: as `check_source`; or it has a [[current_step]] (`by-hand-without-steps`).
    """
    stepped = "[[current_step]]" if matrix.current_step else "[[response]]" if matrix.response else ""
    if not stepped and any(point.current_programmed for point in matrix.points()):
        stepped = "current program"
    if stepped:
        raise Refused(
            "by-hand-without-steps",
            f"the matrix has a {stepped}, but an operator cannot set currents at exact times; no motion "
            "was started. Fix: remove it",
        )
    if matrix.campaign.demagnetise or _has_negative(matrix):
        raise Refused(
            "source-without-negative-current",
            "the matrix requires negative currents, but the current is set manually; no motion was started. Fix: "
            "remove the negative currents and [campaign] demagnetise",
        )


def check_clocks(bench: Bench) -> None:
    """Refuse a bench on which the skew between force and displacement cannot be measured.

    Raises:
        Refused: a sensor speaks a format without a clock (slug `format-without-clock`); each is named.
    """
    formats = {"load_cell": bench.load_cell.format, "lvdt": bench.lvdt.format}
    clocked = clocked_format_names()
    without = [
        f"[{name}] format = {value if isinstance(value, str) else 'a described line'!r} has neither a clock nor "
        "sync edges"
        for name, value in formats.items() if value not in clocked
    ]
    if without:
        raise Refused(
            "format-without-clock",
            "; ".join(without) + ", but the matrix requires a known sensor delay ([campaign] require_skew = true); "
                f"no motion was started. Fix: use a sensor with format {' or '.join(clocked)}, or remove "
                "require_skew and accept the uncertainty that the report states",
        )
