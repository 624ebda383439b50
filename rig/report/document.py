"""Putting the report together and writing it beside the run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import rig.dampers
from rig.characteristics import characterise
from rig.dampers import DamperModel
from rig.errors import FileProblem, RigError
from rig.recording.atomic_write import write_text_durably
from rig.recording.quality.campaign_delay import pooled_skews
from rig.recording.run import Run
from rig.report import fit as fit_part
from rig.report import loops, section, standard
from rig.report.budget import budget
from rig.report.fragment import box, page, text
from rig.report.instruments import calibrations, doubts_of, instruments
from rig.report.point_tables import achieved_table, conditions, points_table, time_base
from rig.report.view import PointView, view_of
from rig.text_file import read_json


def write_report(run_dir: Path) -> Path:
    """Write `report.html` into a campaign's directory, from its points and, if there is one, its `fit.json`.

    What is measured without a model goes into `characteristics.json` beside it.

    Args:
        run_dir: the campaign's directory.

    Returns:
        The report's path. It is one file, readable without a network.

    Raises:
        FileProblem: the directory is no run, or `fit.json` is not one of ours.
        OSError: the report cannot be written.
    """
    run = Run.open(run_dir)
    fit = read_fit(run.path)
    views, remark = views_of(run, fit)
    found = characterise(run, {view.point.id: view.measured for view in views if view.measured is not None})
    parts = [section.header(run, fit), doubts_of(run), section.warnings(run, fit), remark, loops.overview(views)]
    if fit is not None:
        parts.append(fit_part.parameters(fit))
    parts.append(loops.details(views, fitted=any(_has_fit(view) for view in views)))
    if fit is not None:
        parts.append(fit_part.quality(fit))
    parts += [
        standard.standard_tests(found), points_table(views), achieved_table(run.points),
        conditions(run), instruments(run), time_base(run), budget(views, found.loops),
        calibrations(run), section.provenance(run, fit),
    ]
    write_text_durably(run.path / "characteristics.json", json.dumps(found.to_json(), indent=1, allow_nan=False) + "\n")
    path = run.path / "report.html"
    write_text_durably(path, page(f"Damper test report {run.path.name}", "".join(parts)))
    return path


def read_fit(folder: Path) -> dict[str, Any] | None:
    """The fit beside a run, None when there is none.

    Raises:
        FileProblem: the file is not a JSON object with a model and parameters.
    """
    file = folder / "fit.json"
    if not file.is_file():
        return None
    fit = read_json(file)
    if not isinstance(fit.get("parameters"), dict):
        raise FileProblem(str(file), ["not a fit: expected a JSON object with `model` and `parameters`"])
    return fit


def views_of(run: Run, fit: Mapping[str, Any] | None) -> tuple[list[PointView], str]:
    """What to show of every point, and a remark where the fit's curves cannot be computed again."""
    model, values, remark = _fitted_model(fit)
    error = (fit or {}).get("error") or {}
    kept = {entry.get("id"): entry for entry in error.get("per_test") or ()}
    apart = {entry.get("id"): entry for entry in (error.get("holdout") or {}).get("per_test") or ()}
    skews = pooled_skews(run.usable)
    views = [
        view_of(
            point, model, values, kept.get(point.id) or apart.get(point.id), held_out=point.id in apart,
            skew=skews.get(point.id),
        )
        for point in run.points
    ]
    return views, remark


def _fitted_model(fit: Mapping[str, Any] | None) -> tuple[DamperModel | None, dict[str, float], str]:
    if fit is None:
        return None, {}, ""
    values = {name: entry["value"] for name, entry in fit["parameters"].items() if entry.get("value") is not None}
    try:
        model = rig.dampers.model(str(fit.get("model")), fit.get("hysteresis", "kwok"))
        missing = [name for name in model.names if name not in values and name != "eta"]
    except RigError as error:
        return None, {}, box("warn", f"The fit's curves are not drawn: {text(error)}")
    if missing:
        return None, {}, box("warn", f"The fit's curves are not drawn: fit.json lacks {text(', '.join(missing))}.")
    return model, values, ""


def _has_fit(view: PointView) -> bool:
    return view.loop is not None and view.loop.fitted_N is not None
