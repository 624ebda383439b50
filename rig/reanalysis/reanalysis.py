"""Analysis of a recorded run by this version: aligned data, verdicts, characteristics, fit and report are made again.

Everything is made from the received samples in the points' files, into a folder of its own that is a complete run:
every command that takes a run takes it. Tests of other programs have no received samples; their verdicts, fit and
report are made again.
"""

from __future__ import annotations

import hashlib
import json
import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path

import rig
from rig import version
from rig.campaign_folder import CampaignFolder, held_inodes, run_path
from rig.characteristics import characterise
from rig.clock import utc_now
from rig.comparison.specimen import read_specimen
from rig.document import html
from rig.errors import DataWarning, FileProblem, Refused, RigError, some
from rig.fits.fit_record import FitRecord, fit_in
from rig.identification.application.saving import saved
from rig.jobs.workers import HERE, Job, Workers
from rig.reanalysis.changes import (
    Cause,
    PointChange,
    ValueChange,
    characteristic_numbers,
    fit_numbers,
    fit_units,
    point_change,
    value_changes,
)
from rig.reanalysis.document import reanalysis_document
from rig.reanalysis.fit_settings import FitSettings
from rig.reanalysis.result import Reanalysis
from rig.reanalysis.stage import copied, staged, view_of
from rig.recording.atomic_write import write_text_durably
from rig.recording.conversion.conversion import Correction
from rig.recording.conversion.delay_correction import retime, write_verdict
from rig.recording.conversion.rebuilding import can_be_rebuilt, rebuild
from rig.recording.imported_quality import TestSamples, assess
from rig.recording.point_files import unfinished
from rig.recording.quality.verdict import Verdict
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import REANALYSIS, Run, read_campaign
from rig.report.document import written_report
from rig.test_point import ENDURANCE
from rig.text_file import read_json

COPIED = (
    CampaignFolder.bench, CampaignFolder.matrix, CampaignFolder.details, CampaignFolder.journal,
    CampaignFolder.baseline, CampaignFolder.operator, CampaignFolder.records, CampaignFolder.reference,
    CampaignFolder.drives,
)
"""Files and folders of the original that the result needs."""
SESSIONS = "bench-session*.toml"


@dataclass(frozen=True)
class ReanalysisOptions:
    """How runs are analysed again.

    Attributes:
        out: folder for the results, one folder for each run in it; None: `reanalysed/` in the run.
        model: damper model to fit, or `auto`; empty: the model of the original fit.
        fit: whether a model is fitted.
        again: whether a run is analysed although a result of this version, from the same files, exists.
    """

    out: Path | None = None
    model: str = ""
    fit: bool = True
    again: bool = False


def reanalyse(run: Path | str, options: ReanalysisOptions | None = None) -> Reanalysis:
    """Analyse a run again; the original is only read.

    Args:
        run: folder or short name of a run.
        options: how.

    Raises:
        FileProblem: the path is not a run, none of its points can be read, or the result cannot be written.
        Refused: the campaign is still running.
    """
    options = options or ReanalysisOptions()
    place = run_path(run)
    if place.is_file():
        raise FileProblem(str(place), ["this is a file. Fix: specify the folder of its run"])
    folder = CampaignFolder.found(place)
    original = _original(folder)
    inputs = _digest(folder)
    parent = folder.reanalysed if options.out is None else options.out.absolute() / folder.path.name
    if not options.again and (done := _up_to_date(parent, inputs)) is not None:
        return Reanalysis(folder.path, done, up_to_date=True, software=version.described())
    before = _state(folder)
    started = utc_now()
    size = sum(point.path.stat().st_size for point in _all_points(original) if point.path is not None)
    if options.out is not None:
        _check_out(options.out)
    with staged(parent, lambda number: _name(started, number), size) as (stage, final):
        made = _made(folder, original, stage, final, options)
        record = {**made.to_json(), "inputs_sha256": inputs}
        write_text_durably(CampaignFolder(stage).reanalysis, json.dumps(record, indent=1, allow_nan=False) + "\n")
        if _state(folder) != before:
            raise FileProblem(str(folder.path), ["its files were changed while it was analysed, for example because "
                "the campaign was resumed or a model was fitted. Fix: analyse the run again when nothing else uses it"])
    return made


def _name(started: datetime, number: int) -> str:
    """Name of a result: those of one second have the names of the seconds after it, so that they stay in order."""
    return f"{started + timedelta(seconds=number):%Y%m%dT%H%M%SZ}-{rig.__version__}"


def _state(folder: CampaignFolder) -> list[tuple[str, int, int]]:
    """Name, size and time of change of everything that the results depend on."""
    files = [(file, file.stat()) for file in (*folder.evaluated, *unfinished(folder.points))]
    return [(file.name, stat.st_size, stat.st_mtime_ns) for file, stat in files]


def _check_out(out: Path) -> None:
    """Make the folder for results.

    Raises:
        FileProblem: it cannot be made.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileProblem(str(out), [f"cannot be created: {error.strerror}. Fix: specify another folder"]) from error


def _original(folder: CampaignFolder) -> Run:
    """The run as it is.

    Raises:
        FileProblem: none of its points can be read.
        Refused: its campaign is running.
    """
    if folder.path.is_dir() and os.stat(folder.path).st_ino in held_inodes():
        raise Refused("two-instances", f"{folder.path}: the campaign is still running, or another process is "
            "recovering it. Fix: wait until it has finished")
    with _without_warnings():
        return Run.open(folder.path)


@contextmanager
def _without_warnings() -> Iterator[None]:
    """Ignore warnings on data: they are in `left_out` and `remarks`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DataWarning)
        yield


def _all_points(run: Run) -> tuple[RecordedPoint, ...]:
    return (*run.points, *run.apart)


def _digest(folder: CampaignFolder) -> str:
    """SHA-256 over everything that the results depend on."""
    digest = hashlib.sha256()
    for file in folder.evaluated:
        with file.open("rb") as content:
            digest.update(f"{file.name}\n{hashlib.file_digest(content, 'sha256').hexdigest()}\n".encode())
    return digest.hexdigest()


def _up_to_date(parent: Path, inputs: str) -> Path | None:
    """The newest result of this version from the same files; none of a version with uncommitted changes."""
    software = version.described()
    if "-dirty" in software or not parent.is_dir():
        return None
    for done in sorted(parent.iterdir(), reverse=True):
        try:
            record = read_json(CampaignFolder(done).reanalysis)
        except FileProblem:
            continue
        if (record.get("software"), record.get("inputs_sha256")) == (software, inputs):
            return done
    return None


def _made(
    folder: CampaignFolder, original: Run, stage: Path, final: Path, options: ReanalysisOptions
) -> Reanalysis:
    """Make everything in the folder `stage`, which will be called `final`."""
    target = CampaignFolder(stage)
    target.points.mkdir()
    kept = {point.path.name: remark for point in _all_points(original)
            if point.path is not None and (remark := _remade(point, target.points / point.path.name))}
    for _ in retime(target.points):
        pass
    _copy_descriptions(folder, target, final.name)
    remarks = list(_remarks(folder, original, kept))
    with _without_warnings():
        new = Run.open(stage)
    old_files = {point.path.name: point for point in _all_points(original) if point.path is not None}
    points = tuple(
        point_change(old_files[point.path.name], point, kept.get(point.path.name, ""))
        for point in _all_points(new) if point.path is not None
    )
    result = Reanalysis(
        folder.path, final, software=version.described(), recorded_by=_software_of(_all_points(original)),
        points=points, left_out=original.unreadable, remarks=tuple(remarks),
    )
    with _view_if_changed(folder, stage, points) as view:
        result = _with_fit(result, folder, original, new, view, options)
        with _without_warnings():
            written_report(stage)
        result = replace(result, specimen=(_specimen(folder), _specimen(target)))
        result = _with_characteristics(result, folder, stage, view)
    write_text_durably(target.reanalysis_page, html.page(reanalysis_document(result, new)))
    return result


def _specimen(folder: CampaignFolder) -> str:
    """The verdict on the specimen in `acceptance.json`; empty without a readable one."""
    if not folder.acceptance.is_file():
        return ""
    try:
        return str(read_specimen(folder.path).verdict)
    except FileProblem:
        return ""


def _software_of(points: Iterable[RecordedPoint]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(str(point.provenance.get("software", "unknown")) for point in points))


def _remade(point: RecordedPoint, target: Path) -> str:
    """Make a point's new file; why its samples are those of the original, empty if they were aligned again.

    Raises:
        FileProblem: the original cannot be read.
        OSError: the disk refuses.
    """
    source = point.path
    if source is None:
        return ""
    stated = {
        "reanalysed_utc": utc_now().isoformat(timespec="seconds"),
        "reanalysed_from_software": str(point.provenance.get("software", "unknown")),
    }
    if can_be_rebuilt(point):
        try:
            rebuild(source, target, Correction(None, None, None, stated), old=point)
        except (ValueError, LookupError, TypeError, RigError) as error:  # what an earlier version wrote may not fit
            target.unlink(missing_ok=True)
            copied(source, target)
            return f"could not be aligned again ({type(error).__name__}: {error})"
        return ""
    copied(source, target)
    if point.imported:
        _judge_imported(point, target)
        return "imported: the file contains no received samples; only the verdict was regenerated"
    if point.kind == ENDURANCE:
        return "endurance block: the file contains the samples of some cycles only, so it was copied"
    return "the file contains no received samples: an earlier version did not store them"


def _judge_imported(point: RecordedPoint, target: Path) -> None:
    """Evaluate an imported test by the present checks, and replace its verdict where it differs."""
    measured = point.provenance.get("current") == "measured"
    samples = TestSamples(
        point.time_s, point.displacement_m, point.force_N, point.velocity_m_s, point.current_measured_A,
        point.current_A, measured,
    )
    after: Verdict = assess(samples, point.waveform).verdict
    before = point.quality.verdict
    if [(one.slug, one.kind) for one in after.entries] != [(one.slug, one.kind) for one in before.entries]:
        write_verdict(target, after, f"reanalysed by mr-damper-rig {rig.__version__}")


def _copy_descriptions(folder: CampaignFolder, target: CampaignFolder, name: str) -> None:
    """Copy what describes the run, and state in `campaign.json` what it is made of.

    Raises:
        OSError: the disk refuses.
    """
    sources = [*(folder.path / name for name in COPIED), *sorted(folder.path.glob(SESSIONS))]
    for source in sources:
        for file in [source] if source.is_file() else sorted(source.rglob("*")) if source.is_dir() else []:
            if file.is_file():
                place = target.path / file.relative_to(folder.path)
                place.parent.mkdir(parents=True, exist_ok=True)
                copied(file, place)
    described = read_campaign(folder.path)
    described[REANALYSIS] = {
        "of": folder.path.name, "name": name, "software": version.described(),
        "created": utc_now().isoformat(timespec="seconds"),
    }
    write_text_durably(target.description, json.dumps(described, indent=1) + "\n")


def _remarks(folder: CampaignFolder, original: Run, kept: Mapping[str, str]) -> Iterable[str]:
    """What must be known before the differences are believed."""
    waiting = unfinished(folder.points)
    if waiting:
        yield (f"points of an interrupted campaign that are not included: {len(waiting)}. Fix: run `rig recover` on "
               "the original first")
    by_remark: dict[str, list[str]] = {}
    for name, remark in kept.items():
        by_remark.setdefault(remark, []).append(name.removesuffix(".h5"))
    for remark, names in by_remark.items():
        yield f"{some(names)}: {remark}"
    if not original.campaign:
        yield "the run has no campaign.json; specimen, bench and start are unknown"


def _view_if_changed(
    folder: CampaignFolder, stage: Path, points: Sequence[PointChange]
) -> AbstractContextManager[Path | None]:
    """The original through links, to be evaluated by this version; None if no point differs.

    One for fit and characteristics, so that each point is prepared once: the result is in the cache of the view.
    """
    return view_of(folder.path, stage) if any(point.changed for point in points) else nullcontext()


def _points_cause(points: Sequence[PointChange]) -> Cause:
    """As what points that differ are the cause of other differences."""
    aligned = any(Cause.ALIGNMENT in point.causes for point in points)
    return Cause.ALIGNMENT if aligned else Cause.VERDICTS


def _with_characteristics(result: Reanalysis, folder: CampaignFolder, stage: Path, view: Path | None) -> Reanalysis:
    """With the characteristics that have changed; those of the new points were written with the report."""
    after = characteristic_numbers(read_json(CampaignFolder(stage).characteristics))
    present, remarks = after, list(result.remarks)
    if view is not None:
        with _without_warnings():
            present = characteristic_numbers(characterise(Run.open(view)).to_json())
    original = None
    if folder.characteristics.is_file():
        try:
            original = characteristic_numbers(read_json(folder.characteristics))
        except FileProblem as error:
            remarks.append(f"characteristics.json of the original cannot be read: {error.problems[0]}")
    else:
        remarks.append("the original has no characteristics.json, so changes of definitions cannot be shown")
    changes = value_changes(original, present, after, _points_cause(result.points), Cause.DEFINITION)
    return replace(result, characteristics=changes, remarks=tuple(remarks))


def _with_fit(
    result: Reanalysis, folder: CampaignFolder, before: Run, new: Run, view: Path | None,
    options: ReanalysisOptions,
) -> Reanalysis:
    """With a new fit, and its differences from the original."""
    try:
        original = fit_in(folder.path)
        remarks = result.remarks
    except FileProblem as error:
        original, remarks = None, (*result.remarks, f"fit.json of the original cannot be read: {error.problems[0]}")
    settings = FitSettings.of(original, before, options.model) if options.fit else None
    if settings is None:
        without = ("no model was fitted: the original has no fit, and its matrix requests none or none of its points "
            "can be fitted")
        return replace(result, remarks=(*remarks, *([without] if options.fit else [])))
    try:
        fit, more = settings.fitted(new)
    except RigError as error:
        return replace(result, remarks=remarks, fit_error=str(error), models=(original.model if original else "", ""))
    text = fit.text.replace(json.dumps(str(new.path))[1:-1], json.dumps(str(result.result))[1:-1])
    saved(text, CampaignFolder(new.path).fit)
    result = replace(result, remarks=(*remarks, *more), models=(original.model if original else "", fit.model))
    if original is None:
        return result
    present: FitRecord = fit
    if view is not None:
        try:
            with _without_warnings():
                present, _ = settings.fitted(Run.open(view))
        except RigError as error:
            result = replace(result, remarks=(*result.remarks, "the original points cannot be fitted by this "
                f"version, so the cause of changed parameters is not separated: {error}"))
    return replace(result, fit=_fit_changes(original, present, fit, _points_cause(result.points)))


def _fit_changes(original: FitRecord, present: FitRecord, fit: FitRecord, cause: Cause) -> tuple[ValueChange, ...]:
    """Differences of two fits of one model; of two models only the error is compared."""
    before, between, after = (fit_numbers(one) for one in (original, present, fit))
    method = Cause.METHOD
    if original.model != fit.model:
        method = Cause.MODEL
        before, between, after = ({"error": one["error"]} for one in (before, between, after))
    return value_changes(before, between, after, cause, method, fit_units(fit))


def reanalyse_each(
    runs: Sequence[Path | str], options: ReanalysisOptions | None = None, *, workers: Workers = HERE,
    finished: Callable[[Reanalysis, int], None] | None = None,
) -> list[Reanalysis]:
    """Analyse runs again; a run that cannot be analysed does not affect the others.

    Args:
        runs: folders or short names of runs.
        options: how.
        workers: analyse the runs; they write the results.
        finished: called with each result and the number of results.

    Returns:
        One entry per run, in the order of the runs; `error` states why a run has no result.

    Raises:
        FileProblem: a path is not a run, or a run is specified twice.
        WorkersFailed: the workers can no longer be used; finished results are kept.
    """
    options = options or ReanalysisOptions()
    if options.out is not None:
        options = replace(options, out=options.out.absolute())
    paths = [CampaignFolder.found(run_path(run)).path.absolute() for run in runs]
    _check_targets(paths, options)
    workers.check_files([file for path in paths for file in CampaignFolder(path).evaluated])
    done: dict[Path, Reanalysis] = {}
    for _, result in workers.results(Job(path.name, _attempted, (path, options)) for path in paths):
        done[result.run] = result
        if finished is not None:
            finished(result, len(done))
    return [done[path] for path in paths]


def _check_targets(paths: Sequence[Path], options: ReanalysisOptions) -> None:
    """Reject runs whose results would have one folder.

    Raises:
        FileProblem: a run is specified twice, or two runs have the same name and one folder for the results.
    """
    seen: dict[object, Path] = {}
    for path in paths:
        key = path.name if options.out is not None else path
        if key in seen:
            why = "specified twice" if seen[key] == path else f"has the same name as {seen[key]}, and --out is given"
            raise FileProblem(str(path), [f"{why}. Fix: specify each run once"])
        seen[key] = path


def _attempted(path: Path, options: ReanalysisOptions) -> Reanalysis:
    """In a worker: one run; an error becomes part of the result."""
    try:
        return reanalyse(path, options)
    except RigError as error:
        return Reanalysis(path, software=version.described(), error=str(error))
