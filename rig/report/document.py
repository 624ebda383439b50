"""The report as a whole: its parts in order, its head, warnings and provenance; written beside the run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import rig.dampers
from rig.characteristics import characterise
from rig.characteristics.hybrid_tests import hybrid_tests, write_hybrid
from rig.dampers import DamperModel
from rig.dampers.temperature_law import law_of_entries
from rig.errors import RigError
from rig.fit_file import FIT
from rig.fit_file import read_fit as read_fit_file
from rig.recording.atomic_write import write_text_durably
from rig.recording.journal.campaign_log import read_lines
from rig.recording.quality.campaign_delay import pooled_skews
from rig.recording.run import Run
from rig.report import fit as fit_part
from rig.report import loops, standard
from rig.report.budget import budget
from rig.report.events import events
from rig.report.fragment import (
    NOTHING,
    block,
    box,
    bullet_list,
    data_list,
    details,
    fact,
    heading,
    number,
    page,
    text,
)
from rig.report.hybrid import hybrid_part
from rig.report.instruments import calibrations, doubts_of, instruments
from rig.report.loops import PointView, REFERENCE_degC, view_of
from rig.report.over_current import parameters_over_current
from rig.report.plugin_sections import brought_sections
from rig.report.point_tables import achieved_table, conditions, points_table, time_base
from rig.report.signals import signals_part
from rig.report.specimen import described_specimen, specimen_of
from rig.report.traces import time_traces

JsonObject = Mapping[str, Any]
SHOWN_WARNINGS = 5
LACKS = "-without-"
"""In slugs of what a device cannot do."""


def write_report(run_dir: Path) -> Path:
    """Write `report.html` into a campaign's directory, from its points and, if there is one, its `fit.json`.

    What is measured without a model goes into `characteristics.json` beside it, hybrid tests into `hybrid.json`.

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
    characteristics = characterise(run, {view.point.id: view.measured for view in views if view.measured is not None})
    views = loops.placed_views(views, characteristics.loops)
    hybrid = hybrid_tests(run)
    if hybrid:
        write_hybrid(run, hybrid)
    parts = [
        header(run, fit), doubts_of(run), warnings(run, fit), remark, hybrid_part(hybrid), signals_part(views),
        loops.overview(views),
    ]
    if fit is not None:
        parts += [fit_part.parameters(fit), parameters_over_current(fit)]
    parts.append(loops.details(views, fitted=any(_has_fit(view) for view in views)))
    parts.append(time_traces(views))
    if fit is not None:
        parts.append(fit_part.quality(fit))
    parts += [
        standard.standard_tests(characteristics), points_table(views), achieved_table(run.points),
        conditions(run), instruments(run), time_base(run), budget(views, characteristics.loops),
        calibrations(run), lacking(run), events(run), *brought_sections(run, fit), described_specimen(run),
        provenance(run, fit),
    ]
    numbers = json.dumps(characteristics.to_json(), indent=1, allow_nan=False)
    write_text_durably(run.path / "characteristics.json", numbers + "\n")
    path = run.path / "report.html"
    write_text_durably(path, page(f"Damper test report {run.path.name}", "".join(parts)))
    return path


def read_fit(folder: Path) -> dict[str, Any] | None:
    """The fit beside a run, None when there is none.

    Raises:
        FileProblem: its shape is not that of a fit.
    """
    return dict(read_fit_file(folder).content) if (folder / FIT).is_file() else None


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
    if warmth := law_of_entries(fit.get("temperature"), fit["parameters"]):
        values[REFERENCE_degC] = warmth.reference_degC
    return model, values, ""


def _has_fit(view: PointView) -> bool:
    return view.loop is not None and view.loop.fitted_N is not None


def header(run: Run, fit: JsonObject | None) -> str:
    """Title, what was tested, and the result in a few numbers."""
    campaign = run.campaign
    origin = "imported tests" if _any(run, "imported") else "simulated rig" if _simulated(run) else "test rig"
    started = campaign.get("created") or _first(run, "started_utc")
    described = " \N{MIDDLE DOT} ".join(
        text(part) for part in dict.fromkeys((origin, _first(run, "bench"), started, run.path.name)) if part
    )
    valid = _count(run, "valid")
    planned = campaign.get("points")  # identifiers; of an import: its files, which may hold no test
    total = max(len(run.points), sum(isinstance(one, str) for one in planned) if isinstance(planned, list) else 0)
    facts = [*_verdict(fit), fact(f"{valid} of {total}", "points valid", _kind(valid == total))]
    facts += [
        fact(str(_count(run, verdict)), f"{'point' if _count(run, verdict) == 1 else 'points'} {verdict}", kind)
        for verdict, kind in (("suspect", "fair"), ("invalid", "poor")) if _count(run, verdict)
    ]
    facts.append(_lost(run))
    if fit is not None:
        error = fit.get("error") or {}
        facts.append(fact(text(fit.get("model", NOTHING)), f"model, by {text(fit.get('method', NOTHING))}"))
        facts.append(fact(f"{number(error.get('nrmse_percent_of_peak'), 3)} %", "error of peak force, mean of tests"))
        facts.append(fact(f"{number(error.get('rmse_N'), 3)} N", "RMS error"))
        if (apart := error.get("holdout")) is not None:
            facts.append(fact(f"{number(apart.get('nrmse_percent_of_peak'), 3)} %", _of_unseen(apart)))
        if (unseen := fit.get("unseen")) is not None:
            mean = f"{number(unseen.get('nrmse_percent_of_peak'), 3)} %"
            facts.append(fact(mean, "error, each motion from the others"))
    name = specimen_of(run) or run.path.name
    title = heading(f"Damper test report: {text(name)}", described, 1)
    return title + block("facts", "".join(facts))


def _of_unseen(apart: JsonObject) -> str:
    """What the error on held-out tests is, and the mean without those that are foretold by extrapolation."""
    tests = apart.get("per_test") or ()
    outside = sum(bool(test.get("beyond")) for test in tests)
    if not outside:
        return "error on held-out tests"
    within = apart.get("within_nrmse_percent_of_peak")
    if within is None:
        return "error on held-out tests, all beyond the fitted data: extrapolation"
    apart_from = f"without the {outside} of {len(tests)} beyond the fitted data"
    return f"error on held-out tests; {number(within, 3)} % {apart_from}"


def _verdict(fit: JsonObject | None) -> list[str]:
    """Whether the fit can be used, first of all."""
    if fit is None:
        return []
    if fit.get("adequate") is False:
        return [fact("Does not fit", "model error exceeds the repeatability of the tests", "poor")]
    unknown = sum(not entry.get("identifiable", True) for entry in fit["parameters"].values())
    if fit.get("adequate") is None:
        return [fact("Not judged", "no test has two whole cycles beside its first and last to compare the fit with")]
    known = f"{len(fit['parameters']) - unknown} of {len(fit['parameters'])} parameters identified"
    return [fact("Fits", f"to the tests' scatter; {known}", "good")]


def _lost(run: Run) -> str:
    """Lost samples; a count of 0 is good news only where a loss would have been counted."""
    lost = sum(point.lost_samples for point in run.points)
    by = {point.quality.loss_counted_by or "" for point in run.points if not point.imported}
    if not by and lost:  # imported tests
        return fact(str(lost), "rows missing", _kind(False))
    if lost or by == {"sequence"}:
        return fact(str(lost), "samples lost", _kind(lost == 0))
    if by <= {"sequence", "rate"} and by:
        return fact(str(lost), "samples lost, counted against the nominal rate: single ones may be missed")
    if not by:
        return ""
    return fact("not known", "samples lost: not known, a sensor's format has no sequence number", "fair")


def _kind(good: bool) -> str:
    return "good" if good else "fair"


def warnings(run: Run, fit: JsonObject | None) -> str:
    """Everything a reader must know before believing the rest."""
    boxes = [box("bad", text(line)) for line in run.unreadable]
    if _count(run, "invalid"):
        left_out = " and were left out of the fit" if fit is not None else ""
        boxes.append(box("bad", f"{_count(run, 'invalid')} point(s) are invalid{left_out}."))
    if _count(run, "suspect"):
        boxes.append(box(
            "warn", f"{_count(run, 'suspect')} point(s) are suspect and were left out of the fit; "
            "<code>rig identify --suspect</code> takes them in.",
        ))
    if fit is None:
        boxes.append(box("warn", "No fit is in this run: what follows is measured only."))
    else:
        if fit.get("adequate") is False:
            boxes.append(box(
                "bad",
                "<b>The model does not fit.</b> Its error exceeds the repeatability of the tests: "
                "do not use the parameters as properties of the damper.",
            ))
        remarks = [box("warn", text(warning)) for warning in fit.get("warnings") or ()]
        boxes += remarks[:SHOWN_WARNINGS]
        if more := remarks[SHOWN_WARNINGS:]:
            boxes.append(details(f"{len(more)} more warnings", "".join(more)))
    return "".join(boxes)


def lacking(run: Run) -> str:
    """What the rig's devices cannot do, as it was said at connect; nothing where they lack nothing."""
    told = read_lines(run.path) if (run.path / "journal.jsonl").is_file() else []
    said = {
        str(line.get("slug")): str(line.get("detail")) for line in told
        if line.get("event") == "station" and LACKS in str(line.get("slug"))
    }
    listed = [f"{slug}: {detail}" for slug, detail in said.items()]
    return heading("What this rig lacks", "said at connect") + bullet_list(listed) if said else ""


def provenance(run: Run, fit: JsonObject | None) -> str:
    """Where all this comes from: software, bench, devices, calibrations, hashes."""
    shared = {
        key: value for key, value in (run.points[0].provenance.items() if run.points else ())
        if all(point.provenance.get(key) == value for point in run.points)
    }
    shown: dict[str, object] = {
        "campaign": run.path.name, **shared,
        **{key: value for key, value in run.campaign.items() if isinstance(value, (str, int, float))},
    }
    methods = sorted({point.quality.skew.method for point in run.points if point.quality.skew.method is not None})
    shown["time alignment"] = "; ".join(methods)
    if fit is not None:
        shown["fit"] = f"{fit.get('evaluations', NOTHING)} evaluations, {number(fit.get('wall_s'), 3)} s"
    note = (
        "Each point's file holds its raw samples, calibrations and clock models: "
        "<code>points/*.h5</code> (HDF5; h5dump, xarray, MATLAB, Octave)."
    )
    return heading("Provenance", note) + data_list(shown)


def _first(run: Run, name: str) -> str:
    return str(run.points[0].provenance.get(name, "")) if run.points else ""


def _any(run: Run, name: str) -> bool:
    return any(getattr(point, name) for point in run.points)


def _simulated(run: Run) -> bool:
    return bool(run.campaign.get("simulated")) or any(point.test.get("simulated") for point in run.points)


def _count(run: Run, verdict: str) -> int:
    return sum(point.verdict == verdict for point in run.points)
