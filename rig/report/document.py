"""The report as a whole: its sections in order, its head, warnings and provenance, written into the run's directory."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rig.campaign_folder import CampaignFolder
from rig.characteristics import Characteristics, characterise
from rig.characteristics.hybrid_tests import HybridTest, hybrid_tests, write_hybrid
from rig.document import html
from rig.document.blocks import (
    Blocks,
    Details,
    Document,
    Fact,
    Facts,
    Heading,
    Items,
    Note,
    Paragraph,
    Properties,
    section,
)
from rig.document.numbers import number
from rig.document.words import FAIR, GOOD, POOR, Code, Severity, Strong
from rig.errors import RigError
from rig.fits.fit_record import COIL, FitRecord, fit_in
from rig.identification.application.law import Law
from rig.recording.atomic_write import write_text_durably
from rig.recording.journal.campaign_log import read_log
from rig.recording.quality.campaign_delay import pooled_skews
from rig.recording.run import Run
from rig.report import fit as fit_sections
from rig.report import loops, standard
from rig.report.budget import budget
from rig.report.events import events
from rig.report.hybrid import hybrid_section
from rig.report.instruments import calibrations, doubts_of, instruments, sensors_of
from rig.report.over_current import parameters_over_current
from rig.report.plugin_sections import installed_sections
from rig.report.point_tables import achieved_table, conditions, points_table, time_base, time_base_words
from rig.report.signals import signals_section
from rig.report.specimen import described_specimen, specimen_of
from rig.report.traces import time_traces
from rig.report.views import PointView, placed_views, view_of

JsonObject = Mapping[str, Any]
SHOWN_WARNINGS = 5
MISSING = "-without-"
"""In the codes of functions that a device does not support."""


@dataclass(frozen=True)
class Material:
    """All that the report's sections show, read and computed once.

    Attributes:
        run: the campaign.
        fit: the campaign's fit; None without one.
        views: what is drawn of each point.
        remark: why the fit's curves are not drawn; empty where they are.
        characteristics: the standard damper tests.
        hybrid: the hybrid tests.
        log: the journal's events; None where there is no journal.
        sensors: attributes of the calibrated channels, of the first point that was recorded here.
    """

    run: Run
    fit: FitRecord | None
    views: Sequence[PointView]
    remark: str
    characteristics: Characteristics
    hybrid: Sequence[HybridTest]
    log: Sequence[JsonObject] | None
    sensors: Mapping[str, Mapping[str, Any]]

    @classmethod
    def of(cls, run: Run) -> Material:
        """Read and compute it.

        Raises:
            FileProblem: `fit.json` is not one of ours.
        """
        fit = fit_in(run.path)
        views, remark = views_of(run, fit)
        measured = {view.point.id: view.measured for view in views if view.measured is not None}
        characteristics = characterise(run, measured)
        recorded = next((point for point in run.points if point.path is not None and not point.imported), None)
        return cls(
            run, fit, placed_views(views, characteristics.loops), remark, characteristics, hybrid_tests(run),
            read_log(run.path) if CampaignFolder(run.path).journal.is_file() else None,
            {} if recorded is None else sensors_of(recorded),
        )  # fmt: skip


def report_of(of: Material) -> Document:
    """The report as a document.

    Args:
        of: what it shows.
    """
    run, fit, views = of.run, of.fit, of.views
    blocks = [
        *header(run, fit), *doubts_of(run.points), *warnings(run, fit), *([Note(FAIR, of.remark)] if of.remark else []),
        *hybrid_section(of.hybrid), *signals_section(views), *loops.overview(views),
    ]
    if fit is not None:
        blocks += [*fit_sections.parameters(fit), *parameters_over_current(fit)]
    blocks += [*loops.details(views, fitted=any(map(_has_fit, views))), *time_traces(views)]
    if fit is not None:
        blocks += fit_sections.quality(fit)
    blocks += [
        *standard.standard_tests(of.characteristics), *points_table(views), *achieved_table(run.points),
        *conditions(run.points, of.log or ()), *instruments(run, of.sensors), *time_base(run.points),
        *budget(views, of.characteristics.loops), *calibrations(of.sensors), *unsupported(of.log or ()),
        *events(of.log), *installed_sections(run, fit), *described_specimen(run), *provenance(run, fit),
    ]  # fmt: skip
    return Document(f"Damper test report {run.path.name}", blocks)


def write_report(run_dir: Path) -> Path:
    """Write `report.html` into a campaign's directory, from its points and, if there is one, its `fit.json`.

    What is measured without a model is written to `characteristics.json` there, hybrid tests to `hybrid.json`.

    Args:
        run_dir: the campaign's directory.

    Returns:
        The report's path. It is one file, readable without a network.

    Raises:
        FileProblem: the directory is no run, or `fit.json` is not one of ours.
        OSError: the report cannot be written.
    """
    path, _ = written_report(run_dir)
    return path


def written_report(run_dir: Path) -> tuple[Path, Document]:
    """As `write_report`, and the report as a document for other writers."""
    material = Material.of(Run.open(run_dir))
    run, document = material.run, report_of(material)
    if material.hybrid:
        write_hybrid(run, material.hybrid)
    numbers = json.dumps(material.characteristics.to_json(), indent=1, allow_nan=False)
    write_text_durably(CampaignFolder(run.path).characteristics, numbers + "\n")
    path = CampaignFolder(run.path).report
    write_text_durably(path, html.page(document))
    return path, document


def views_of(run: Run, fit: FitRecord | None) -> tuple[list[PointView], str]:
    """What to show of every point, and why the fit's curves are not drawn; empty where they are."""
    law, remark = _drawn_law(fit)
    fitted = {} if fit is None else {test.id: test for test in fit.error.per_test}
    held_out = {} if fit is None or fit.holdout is None else {test.id: test for test in fit.holdout.per_test}
    skews = pooled_skews(run.usable)
    views = [
        view_of(
            point, law, fitted.get(point.id) or held_out.get(point.id), held_out=point.id in held_out,
            skew=skews.get(point.id),
        )
        for point in run.points
    ]
    return views, remark


def _drawn_law(fit: FitRecord | None) -> tuple[Law | None, str]:
    """The fitted damper whose curves are drawn; None without one, and why."""
    if fit is None:
        return None, ""
    try:
        model = fit.damper
    except RigError as error:
        return None, f"The fitted curves are not drawn: {error}"
    missing = [name for name in model.names if name not in fit.values and name != COIL]
    if missing:
        return None, f"The fitted curves are not drawn: {', '.join(missing)} missing from fit.json."
    return replace(Law.of(model, fit.values, None), temperature=fit.temperature_law), ""


def _has_fit(view: PointView) -> bool:
    return view.loop is not None and view.loop.fitted_N is not None


def header(run: Run, fit: FitRecord | None) -> Blocks:
    """Title, what was tested, and the result in a few numbers."""
    campaign = run.campaign
    origin = "imported tests" if _any(run, "imported") else "simulated rig" if _simulated(run) else "test rig"
    started = campaign.get("created") or _first(run, "started_utc")
    described = " \N{MIDDLE DOT} ".join(
        str(part) for part in dict.fromkeys((origin, _first(run, "bench"), started, run.path.name)) if part
    )
    valid = _count(run, "valid")
    planned = campaign.get("points")  # identifiers; of an import: its files, which may hold no test
    total = max(len(run.points), sum(isinstance(one, str) for one in planned) if isinstance(planned, list) else 0)
    facts = [*_verdict(fit), Fact(f"{valid} of {total}", "points valid", _severity(valid == total))]
    facts += [
        Fact(str(_count(run, verdict)), f"{'point' if _count(run, verdict) == 1 else 'points'} {verdict}", severity)
        for verdict, severity in (("suspect", FAIR), ("invalid", POOR)) if _count(run, verdict)
    ]
    facts += [*_lost(run), *_errors(fit)]
    title = Heading(f"Damper test report: {specimen_of(run) or run.path.name}", 1)
    return [title, Paragraph(described, small=True), Facts(tuple(facts))]


def _errors(fit: FitRecord | None) -> list[Fact]:
    """The model, and its errors on fitted and other tests."""
    if fit is None:
        return []
    facts = [
        Fact(fit.model, f"model ({fit_sections.METHODS.get(fit.method, fit.method)})"),
        Fact(f"{number(fit.error.nrmse_percent_of_peak, 3)} %", "error relative to peak force, mean of all tests"),
        Fact(f"{number(fit.error.rmse_N, 3)} N", "RMS error"),
    ]
    if fit.holdout is not None:
        meaning = f"error on validation tests{fit_sections.extrapolated_words(fit.holdout)}"
        facts.append(Fact(f"{number(fit.holdout.nrmse_percent_of_peak, 3)} %", meaning))
    if fit.unseen is not None:
        mean = f"{number(fit.unseen.nrmse_percent_of_peak, 3)} %"
        facts.append(Fact(mean, "error, leave-one-motion-out cross-validation"))
    return facts


def _verdict(fit: FitRecord | None) -> list[Fact]:
    """Whether the fit can be used, first of all."""
    if fit is None:
        return []
    if fit.adequate is None:
        return [Fact("Not evaluated", "no test has two full cycles in addition to its first and last")]
    if not fit.adequate:
        return [Fact("Does not fit", "model error exceeds the repeatability of the tests", POOR)]
    known = f"{len(fit.identifiable)} of {len(fit.parameters)} parameters identified"
    return [Fact("Fits", f"within measurement noise; {known}", GOOD)]


def _lost(run: Run) -> list[Fact]:
    """Lost samples; a count of 0 is good news only where a loss would have been counted."""
    lost = sum(point.lost_samples for point in run.points)
    by = {point.quality.loss_counted_by or "" for point in run.points if not point.imported}
    if not by:  # imported tests
        return [Fact(str(lost), "rows missing", FAIR)] if lost else []
    if lost or by == {"sequence"}:
        return [Fact(str(lost), "samples lost", _severity(lost == 0))]
    if by <= {"sequence", "rate"}:
        return [Fact(str(lost), "samples lost, estimated from the nominal rate; single losses may go undetected")]
    return [Fact("unknown", "number of samples lost; the data format of a sensor has no sequence number", FAIR)]


def _severity(good: bool) -> Severity:
    return GOOD if good else FAIR


def warnings(run: Run, fit: FitRecord | None) -> Blocks:
    """Everything a reader must know before believing the rest."""
    notes: Blocks = [Note(POOR, line) for line in run.unreadable]
    if count := _count(run, "invalid"):
        left_out = " and excluded from the fit" if fit is not None else ""
        notes.append(Note(POOR, f"{_points(count)} invalid{left_out}."))
    if count := _count(run, "suspect"):
        use = Code("rig identify --suspect")
        left_out = f"{_points(count)} suspect and excluded from the fit; to include suspect points, use "
        notes.append(Note(FAIR, (left_out, use, ".")))
    if fit is None:
        return [*notes, Note(FAIR, "This run has no fit, so the report shows only measurements.")]
    if fit.adequate is False:
        notes.append(Note(POOR, (
            Strong("The model does not fit."), " The model error exceeds the repeatability of the tests. Do not use "
            "the parameters as properties of the damper.",
        )))  # fmt: skip
    remarks = [Note(FAIR, warning) for warning in fit.warnings]
    notes += remarks[:SHOWN_WARNINGS]
    if more := remarks[SHOWN_WARNINGS:]:
        notes.append(Details(f"{len(more)} more warnings", tuple(more)))
    return notes


def _points(count: int) -> str:
    return f"{count} point is" if count == 1 else f"{count} points are"


def unsupported(log: Sequence[JsonObject]) -> Blocks:
    """Functions that the rig's devices do not support, as reported at connect; empty where there are none."""
    stated = {
        str(line.get("slug")): str(line.get("detail")) for line in log
        if line.get("event") == "station" and MISSING in str(line.get("slug"))
    }
    if not stated:
        return []
    listed = Items(tuple(f"{slug}: {detail}" for slug, detail in stated.items()))
    return [*section("Functions that this rig does not support", "As reported by the devices on connection."), listed]


def provenance(run: Run, fit: FitRecord | None) -> Blocks:
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
    shown["time alignment"] = "; ".join(map(time_base_words, methods))
    if fit is not None:
        shown["fit"] = f"{fit.evaluations} evaluations, {number(fit.wall_s, 3)} s"
    note = (
        "The file for each point contains the raw samples, calibrations and clock models: ", Code("points/*.h5"),
        " (HDF5, readable with h5dump, xarray, MATLAB and Octave).",
    )
    return [*section("Provenance", note), Properties(shown)]


def _first(run: Run, name: str) -> str:
    return str(run.points[0].provenance.get(name, "")) if run.points else ""


def _any(run: Run, name: str) -> bool:
    return any(getattr(point, name) for point in run.points)


def _simulated(run: Run) -> bool:
    return bool(run.campaign.get("simulated")) or any(point.test.get("simulated") for point in run.points)


def _count(run: Run, verdict: str) -> int:
    return sum(point.verdict == verdict for point in run.points)
