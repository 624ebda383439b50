"""From recorded runs to a written fit: which points are taken, what their calibrations leave uncertain, `fit.json`."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from rig.dampers import Hysteresis
from rig.errors import IdentificationFailed, evaluating
from rig.identification.fitting import FEW, identify
from rig.identification.models.solving import SEPARABLE, Method
from rig.identification.next_test import bench_of
from rig.identification.per_current import AFFINE
from rig.identification.uncertainty.covariance import DeclaredErrors
from rig.identification.uncertainty.fit import Fit
from rig.identification.words import say, some
from rig.recording.atomic_write import write_durably, write_text_durably
from rig.recording.quality.cross_checks import doubts
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run

AUTO, QUICK = "auto", "asymmetric"


def one_model_alone(method: str, current: str, series_spring: bool, temperature_law: str) -> bool:
    """Whether these settings, each as in `identify_run`, go with one model and not with a comparison of several."""
    return method != SEPARABLE or current != AFFINE or series_spring or temperature_law != "none"


def identify_run(
    paths: Sequence[Path | str],
    *,
    model: str = "asymmetric",
    method: str | Method = "separable",
    holdout: str | None = None,
    hysteresis: Hysteresis = "kwok",
    suspect: bool = False,
    profile: bool | Sequence[str] = False,
    current: str = AFFINE,
    current_law: str = AFFINE,
    series_spring: bool = False,
    diagnose: bool | None = None,
    bootstrap: int = 0,
    unseen: str | None = None,
    temperature_law: str = "none",
    on_progress: Callable[[str], None] | None = None,
) -> Fit:
    """Fit recorded runs and write `fit.json` into the first of them, or beside the file it is.

    Args:
        paths: campaign directories, folders in which exactly one campaign lies, or point files.
        model: as in `identify`; "auto": the asymmetric model, and where that is not adequate "few", which is what `rig
            identify` does unasked; with settings that go with one model alone, the asymmetric one.
        method: as in `identify`.
        holdout: a filter on the points, or the path of another run.
        hysteresis: as in `identify`.
        suspect: take suspect points too, not only valid ones.
        profile: as in `identify`.
        current: as in `identify`.
        current_law: as in `identify`.
        series_spring: as in `identify`.
        diagnose: as in `identify`.
        bootstrap: as in `identify`.
        unseen: as in `identify`.
        temperature_law: as in `identify`.
        on_progress: as in `identify`.

    Raises:
        IdentificationFailed: nothing can be identified.
        FileProblem: a path is no run.
    """
    runs = [Run.open(path) for path in paths]
    points = [point for run in runs for point in (run.usable if suspect else run.valid)]
    taken = {"valid", "suspect"} if suspect else {"valid"}
    others = [point for run in runs for point in run.points if point.verdict not in taken]
    left_out = [line for run in runs for line in run.unreadable]
    left_out += [
        say("left-out", test=point.id, reason=f"{point.verdict} ({'; '.join(point.reasons)})") for point in others
    ]
    if not points:
        hint = "; `--suspect` takes suspect points too" if any(point.verdict == "suspect" for point in others) else ""
        raise IdentificationFailed(f"no point is valid: {some(left_out, '; ')}{hint}")
    other = Run.open(holdout) if holdout is not None and Path(holdout).exists() else holdout
    tested = [*runs, other] if isinstance(other, Run) else runs
    specimens = {str(run.campaign.get("specimen")) for run in tested if run.campaign.get("specimen") is not None}
    if len(specimens) > 1:
        raise IdentificationFailed(
            f"these runs tested different specimens ({', '.join(sorted(specimens))}); one fit describes one damper: "
            "identify them apart"
        )
    declared = declared_errors(points)
    fitted = partial(
        identify,
        points,
        method=method,
        holdout=other,
        hysteresis=hysteresis,
        declared=declared,
        profile=profile,
        current=current,
        current_law=current_law,
        series_spring=series_spring,
        diagnose=diagnose,
        bootstrap=bootstrap,
        unseen=unseen,
        temperature_law=temperature_law,
        allowance=bench_of(runs[0].path),
        campaign=[point for run in tested for point in run.usable],
        on_progress=on_progress,
    )
    named = method if isinstance(method, str) else method.name
    alone = one_model_alone(named, current, series_spring, temperature_law) or bool(profile)
    with evaluating(f"the fit of {some([point.id for point in points])}"):
        fit = fitted(model=QUICK if model == AUTO else model)
        if model == AUTO and fit.adequate is not True and not alone:
            fit = fitted(model=FEW)
    doubted = [f"calibration in doubt, and in no interval: {line}" for line in doubts(points)]
    fit = replace(fit, warnings=(*doubted, *left_out, *fit.warnings))
    written, kept = write_fit(fit, runs[0].path)
    return replace(fit, path=written, kept=kept)


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
    target = folder / "fit.json"
    kept = _kept(target)
    write_text_durably(target, json.dumps(fit.to_json(), indent=1, allow_nan=False) + "\n")
    return target, kept


def _kept(target: Path) -> Path | None:
    """Give an older fit a name of its own, by the time it was written; None where there is none."""
    if not target.is_file():
        return None
    written = datetime.fromtimestamp(target.stat().st_mtime, UTC).strftime("%Y%m%dT%H%M%SZ")
    for number in itertools.count(1):
        name = target.with_name(f"fit-{written}{'' if number == 1 else f'-{number}'}.json")
        try:
            name.hardlink_to(target)
        except FileExistsError:
            continue
        except OSError:  # a file system without hard links
            write_durably(name, target.read_bytes())
        return name
    return None
