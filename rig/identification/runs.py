"""From recorded runs to a written fit: which points are taken, what their calibrations leave uncertain, `fit.json`."""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rig.campaign_folder import CampaignFolder
from rig.errors import IdentificationFailed, evaluating
from rig.identification.fitting import identify
from rig.identification.next_test import bench_of
from rig.identification.options import FEW, DeclaredErrors, FitOptions
from rig.identification.remarks import say, some
from rig.identification.uncertainty.fit import Fit
from rig.recording.atomic_write import write_durably, write_text_durably
from rig.recording.quality.cross_checks import doubts
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run

AUTO, QUICK = "auto", "asymmetric"


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
        options: what is asked of the fit. Model "auto": the asymmetric model, and where that is not adequate "few";
            with options that go with one model only, the asymmetric one. A held-out run may be given by its path.
        suspect: include suspect points, not only valid ones.
        changes: options by name in place of those: see `FitOptions`.

    Raises:
        IdentificationFailed: nothing can be identified.
        FileProblem: a path is no run.
        TypeError: there is no such option.
    """
    options = FitOptions.of(options, changes)
    runs = [Run.open(path) for path in paths]
    points = [point for run in runs for point in (run.usable if suspect else run.valid)]
    taken = {"valid", "suspect"} if suspect else {"valid"}
    others = [point for run in runs for point in run.points if point.verdict not in taken]
    left_out = [line for run in runs for line in run.unreadable]
    left_out += [
        say("left-out", test=point.id, reason=f"{point.verdict} ({'; '.join(point.reasons)})") for point in others
    ]
    if not points:
        hint = "; `--suspect` includes suspect points" if any(point.verdict == "suspect" for point in others) else ""
        raise IdentificationFailed(f"no point is valid: {some(left_out, '; ')}{hint}")
    other = options.holdout
    if isinstance(other, str | Path) and Path(other).exists():
        other = Run.open(other)
    tested = [*runs, other] if isinstance(other, Run) else runs
    specimens = {str(run.campaign.get("specimen")) for run in tested if run.campaign.get("specimen") is not None}
    if len(specimens) > 1:
        raise IdentificationFailed(
            f"these runs have different specimens ({', '.join(sorted(specimens))}), but a fit describes one damper. "
            "Fix: identify the runs separately"
        )
    options = replace(
        options, holdout=other, declared=declared_errors(points), allowance=bench_of(runs[0].path),
        campaign=[point for run in tested for point in run.usable],
    )  # fmt: skip
    with evaluating(f"the fit of {some([point.id for point in points])}"):
        fit = identify(points, options, model=QUICK if options.model == AUTO else options.model)
        if options.model == AUTO and fit.adequate is not True and not (options.one_model_only or options.profile):
            fit = identify(points, options, model=FEW)
    doubted = [f"doubtful calibration, not included in any interval: {line}" for line in doubts(points)]
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
    target = CampaignFolder(folder).fit
    kept = _kept(target)
    write_text_durably(target, json.dumps(fit.to_json(), indent=1, allow_nan=False) + "\n")
    return target, kept


def _kept(target: Path) -> Path | None:
    """Give an older fit a name of its own, by the time it was written; None where there is none."""
    if not target.is_file():
        return None
    written = datetime.fromtimestamp(target.stat().st_mtime, UTC).strftime("%Y%m%dT%H%M%SZ")
    for number in itertools.count(1):
        name = CampaignFolder(target.parent).earlier_fit(f"{written}{'' if number == 1 else f'-{number}'}")
        try:
            name.hardlink_to(target)
        except FileExistsError:
            continue
        except OSError:  # a file system without hard links
            write_durably(name, target.read_bytes())
        return name
    return None
