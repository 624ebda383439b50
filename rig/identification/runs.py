"""From recorded runs to a written fit: which points are taken, what their calibrations leave uncertain, `fit.json`."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard

from rig.campaign_folder import CampaignFolder, run_path
from rig.errors import FileProblem, IdentificationFailed, RigError, evaluating, some
from rig.identification.application.saving import saved
from rig.identification.fitting import identify as fit_tests
from rig.identification.models.measurement import Measurement
from rig.identification.next_test import bench_of
from rig.identification.options import FEW, DeclaredErrors, FitOptions
from rig.identification.remarks import say
from rig.identification.uncertainty.fit import Fit
from rig.jobs.workers import HERE, Job
from rig.recording.load_options import OPTIONS, LoadOptions
from rig.recording.quality.cross_checks import doubts
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run

if TYPE_CHECKING:
    from rig.identification.points.inputs import Tests
    from rig.recording.load_options import Source

AUTO, QUICK = "auto", "asymmetric"


def identify(
    tests: Tests | Source, options: FitOptions | None = None, *, suspect: bool = False,
    **changes: Any,  # noqa: ANN401 - by their names
) -> Fit:
    """Fit a damper model to tests; nothing is written (`Fit.save` does that).

    Args:
        tests: a campaign's folder, files of this or other programs, a pandas `DataFrame`, a run, points, prepared
            measurements, or a list of these: what `rig.load` takes.
        options: what is asked of the fit.
        suspect: of runs, include suspect points, not only valid ones.
        changes: options by name in place of those, such as `model="few"` or `series_spring=True`: see `FitOptions`.
            What is stated of files and tables is taken too, such as `current_A=0.5` or `units={"force": "kN"}`: see
            `rig.recording.loading.LoadOptions`.

    Returns:
        The fit; of several models that of the recommended one. Model "auto": the asymmetric model, and where that is
        not adequate the recommended one of "few"; with options that go with one model only, the asymmetric one.

    Raises:
        IdentificationFailed: nothing can be identified; the message names what the data lack.
        FileProblem: the tests cannot be read.
        TypeError: an option is unknown.
    """
    reading = {name: changes.pop(name) for name in OPTIONS if name in changes}
    options = FitOptions.of(options, changes)
    if isinstance(options.holdout, Path) or (isinstance(options.holdout, str) and Path(options.holdout).exists()):
        options = replace(options, holdout=Run.open(options.holdout))
    if _ready(tests):
        if reading:
            raise FileProblem("identify", [
                f"got {', '.join(reading)}, which applies only when files and tables are loaded, but the tests are "
                "already loaded. Fix: pass this to rig.load"
            ])  # fmt: skip
        return _fitted(tests, options)
    from rig.recording.loading import runs_of  # loads h5py, which prepared tests do not need

    return _fit_of_runs(runs_of(tests, LoadOptions.of(reading)), options, suspect=suspect)


def _ready(tests: Tests | Source) -> TypeGuard[Sequence[RecordedPoint] | Sequence[Measurement]]:
    """Whether these are points or measurements, all of which are meant."""
    return isinstance(tests, Sequence) and not isinstance(tests, str) and bool(tests) and all(
        isinstance(one, RecordedPoint | Measurement) for one in tests
    )


def _fitted(tests: Tests, options: FitOptions) -> Fit:
    """The fit of tests that are ready; of the model "auto" that of one model, or of the best of a few."""
    if options.model != AUTO:
        return fit_tests(tests, options)
    fit = fit_tests(tests, replace(options, model=QUICK))
    if fit.adequate is True or options.one_model_only or options.profile:
        return fit
    return fit_tests(tests, replace(options, model=FEW))


def _fit_of_runs(runs: Sequence[Run], options: FitOptions, *, suspect: bool) -> Fit:
    """The fit of the valid points of runs, with what their calibrations leave uncertain.

    Raises:
        IdentificationFailed: nothing can be identified, or the runs are of different dampers.
    """
    points = [point for run in runs for point in (run.usable if suspect else run.valid)]
    taken = {"valid", "suspect"} if suspect else {"valid"}
    others = [point for run in runs for point in run.points if point.verdict not in taken]
    left_out = [line for run in runs for line in run.unreadable]
    left_out += [
        say("left-out", test=point.id, reason=f"{point.verdict} ({'; '.join(point.reasons)})") for point in others
    ]
    if not points:
        hint = "; `--suspect` (in Python suspect=True) includes suspect points" if any(
            point.verdict == "suspect" for point in others) else ""  # fmt: skip
        raise IdentificationFailed(f"no point is valid: {some(left_out, '; ')}{hint}")
    tested = [*runs, options.holdout] if isinstance(options.holdout, Run) else runs
    specimens = {str(run.campaign.get("specimen")) for run in tested if run.campaign.get("specimen") is not None}
    if len(specimens) > 1:
        raise IdentificationFailed(
            f"these runs have different specimens ({', '.join(sorted(specimens))}), but a fit describes one damper. "
            "Fix: identify the runs separately"
        )
    options = replace(
        options, declared=options.declared or declared_errors(points),
        allowance=options.allowance or bench_of(runs[0].path),
        campaign=options.campaign or [point for run in tested for point in run.usable],
    )  # fmt: skip
    with evaluating(f"the fit of {some([point.id for point in points])}"):
        fit = _fitted(points, options)
    doubted = [f"doubtful calibration, not included in any interval: {line}" for line in doubts(points)]
    return replace(fit, warnings=(*doubted, *left_out, *fit.warnings))


def identify_run(
    paths: Sequence[Path | str],
    options: FitOptions | None = None,
    *,
    suspect: bool = False,
    **changes: Any,  # noqa: ANN401 - by their names
) -> Fit:
    """Fit recorded runs and write `fit.json` into the first of them, or next to the file it is.

    Args:
        paths: campaign directories, folders in which exactly one campaign is located, or point files.
        options: what is asked of the fit, as in `identify`. A held-out run may be given by its path.
        suspect: include suspect points, not only valid ones.
        changes: options by name, which replace those in `options`; see `FitOptions`.

    Raises:
        IdentificationFailed: nothing can be identified.
        FileProblem: a path is no run.
        TypeError: an option is unknown.
    """
    runs = [Run.open(path) for path in paths]
    fit = identify(runs, options, suspect=suspect, **changes)
    written, kept = write_fit(fit, runs[0].path)
    return replace(fit, path=written, kept=kept)


@dataclass(frozen=True)
class RunFit:
    """Result of one run of several that are fitted separately.

    Attributes:
        run: folder of the run, or the point file.
        text: content of its `fit.json`; empty if it could not be fitted.
        model: the fitted model; empty without one.
        nrmse_percent_of_peak: error on the fitted tests; NaN without a fit.
        adequate: whether the model fits within the measurement noise; None if unknown.
        error: reason why there is no fit; empty if there is one.
        path, kept: paths of the written fit and of an earlier fit; None before writing.
    """

    run: Path
    text: str = ""
    model: str = ""
    nrmse_percent_of_peak: float = math.nan
    adequate: bool | None = None
    error: str = ""
    path: Path | None = None
    kept: Path | None = None

    def to_json(self) -> dict[str, Any]:
        """As plain types; `docs/json.md` lists the keys."""
        error = self.nrmse_percent_of_peak
        return {
            "run": str(self.run), "fit": None if self.path is None else str(self.path),
            "kept": None if self.kept is None else str(self.kept), "model": self.model or None,
            "nrmse_percent_of_peak": error if math.isfinite(error) else None, "adequate": self.adequate,
            "error": self.error or None,
        }  # fmt: skip


def identify_each(
    paths: Sequence[Path | str],
    options: FitOptions | None = None,
    *,
    suspect: bool = False,
    finished: Callable[[RunFit, int], None] | None = None,
    **changes: Any,  # noqa: ANN401 - by their names
) -> list[RunFit]:
    """Fit recorded runs separately, and write `fit.json` to each as soon as it is fitted.

    Args:
        paths: as for `identify_run`.
        options: options of each fit; the `workers` fit the runs.
        suspect: include suspect points, not only valid ones.
        finished: called with each finished run and the number of finished runs.
        changes: options by name, which replace those in `options`; see `FitOptions`.

    Returns:
        One entry per run, in the order of the runs. A run that cannot be fitted does not affect the others.

    Raises:
        FileProblem: a path is not a run, or is specified twice.
        RigError: the workers cannot read the runs.
        WorkersFailed: the workers can no longer be used; fits finished before are written.
        TypeError: an option is unknown.
    """
    options = FitOptions.of(options, changes)
    workers = options.workers
    runs = [_run_of(path) for path in paths]
    _check_separate_targets(runs)
    files = [file for run in runs for file in _files_of(run)]
    held_out = options.holdout
    if isinstance(held_out, (str, Path)) and Path(held_out).exists():
        options = replace(options, holdout=str(Path(held_out).absolute()))
        files += _files_of(_run_of(held_out))
    workers.check_files(files)
    sent = replace(options, workers=HERE, on_progress=None, method=options.how.without_executor)
    done: dict[Path, RunFit] = {}
    for _, fit in workers.results(Job(run.name, _run_fit, (run, sent, suspect)) for run in runs):
        done[fit.run] = _written(fit) if fit.text else fit
        if finished is not None:
            finished(done[fit.run], len(done))
    return [done[run] for run in runs]


def _run_of(path: Path | str) -> Path:
    """Full path of a run's folder, or of a point file."""
    place = run_path(path)
    return place.absolute() if place.is_file() else CampaignFolder.found(place).path.absolute()


def _check_separate_targets(runs: Sequence[Path]) -> None:
    """Reject runs whose fits would be written to the same file.

    Raises:
        FileProblem: a run is specified twice, or two point files are in the same folder.
    """
    targets = Counter(_folder_of(run) for run in runs)
    for folder, count in targets.items():
        if count > 1:
            raise FileProblem(str(folder), [
                f"specified {count} times, but each run gets one fit.json. Fix: specify each run once, by its folder"
            ])  # fmt: skip


def _folder_of(run: Path) -> Path:
    """Folder for a run's fit: that of the run, or of the point file."""
    return run if run.is_dir() else run.parent


def _files_of(run: Path) -> list[Path]:
    """Files that a fit of a run reads."""
    return [run] if run.is_file() else CampaignFolder(run).evaluated


def _run_fit(run: Path, options: FitOptions, suspect: bool) -> RunFit:
    """In a worker: fit one run."""
    try:
        fit = identify([Run.open(run)], options, suspect=suspect)
    except RigError as error:
        return RunFit(run, error=str(error))
    return RunFit(run, fit.text, fit.model, fit.error.nrmse_percent_of_peak, fit.adequate)


def _written(fit: RunFit) -> RunFit:
    """Write a fit to its run's folder; a write error affects only this run."""
    try:
        path, kept = saved(fit.text, CampaignFolder(_folder_of(fit.run)).fit)
    except FileProblem as error:
        return replace(fit, error=str(error))
    return replace(fit, path=path, kept=kept)


def declared_errors(points: Sequence[RecordedPoint]) -> DeclaredErrors:
    """What the calibrations in the recorded points leave uncertain; the largest where they differ."""

    def largest(name: str) -> float:
        return max((float(point.test.get(f"{name}_uncertainty_percent", 0.0)) for point in points), default=0.0) / 100.0

    return DeclaredErrors(force_gain=largest("force"), displacement_gain=largest("displacement"))


def write_fit(fit: Fit, folder: Path) -> tuple[Path, Path | None]:
    """Write `fit.json` into a campaign directory, whole or not at all.

    Returns:
        Its path, and where an older `fit.json` was kept: `fit-<UTC of its writing>.json`.
    """
    return saved(fit.text, CampaignFolder(folder).fit)
