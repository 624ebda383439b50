"""The report as a whole: its sections in order, its head, warnings and provenance, written into the run's directory."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rig.campaign_folder import CampaignFolder
from rig.characteristics import Characteristics, characterise
from rig.characteristics.endurance_tests import EnduranceTest, endurance_tests
from rig.characteristics.hybrid_tests import HybridTest, hybrid_tests, write_hybrid
from rig.comparison.specimen import SpecimenResult, specimen_result, write_specimen
from rig.display import Display
from rig.document import html
from rig.document.blocks import (
    Block,
    Blocks,
    Cards,
    Contents,
    Details,
    Document,
    Fact,
    Facts,
    Heading,
    Items,
    Keys,
    Note,
    Paragraph,
    Properties,
    Sheet,
    section,
    with_contents,
)
from rig.document.moments import local_time
from rig.document.numbers import number, with_uncertainty
from rig.document.words import FAIR, GOOD, POOR, Code, Strong
from rig.errors import RigError
from rig.fits.fit_record import COIL, FitRecord, fit_in
from rig.identification.application.law import Law
from rig.matrix.report_table import DetailsFile
from rig.recording.atomic_write import write_text_durably
from rig.recording.endurance import withdrawn_points
from rig.recording.journal.campaign_log import read_log
from rig.recording.quality.campaign_delay import pooled_skews
from rig.recording.run import Run, planned_points
from rig.recording.tested_on import TESTED
from rig.report import fit as fit_sections
from rig.report import loops, standard
from rig.report.acceptance import acceptance_section, others_not_passed, specimen_fact, specimen_note
from rig.report.budget import budget
from rig.report.cover import Details as CoverDetails
from rig.report.cover import conditions, cover, mark_of, terms_of
from rig.report.endurance import endurance_facts, endurance_section
from rig.report.events import events
from rig.report.hybrid import hybrid_section
from rig.report.instruments import calibrations, doubts_of, instruments, sensors_of
from rig.report.iteration import iteration_section
from rig.report.loops import Overlays, overlays
from rig.report.over_current import parameters_over_current
from rig.report.peak_forces import force_text, greatest, peak_forces
from rig.report.plugin_sections import installed_sections
from rig.report.point_tables import point_details, points_table, time_base_words
from rig.report.response import response_section
from rig.report.signals import signals_section
from rig.report.traces import time_traces
from rig.report.views import AS_AMPLITUDE, MotionTerms, PointView, completed_views, view_of
from rig.test_point import ENDURANCE

JsonObject = Mapping[str, Any]
SHOWN_WARNINGS = 5
STATIC = "F0"
"""Parameter of the models: the constant force, that of the gas at mid-stroke."""
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
        endurance: the endurance tests.
        log: the journal's events; None where there is no journal.
        sensors: attributes of the calibrated channels, of the first point that was recorded here.
        details: title, people, logo and conditions, as far as they are known.
        display: the units and signs in which all is shown.
        specimen: the verdict on the specimen; None if the matrix has no acceptance bands.
        terms: the terms in which the matrix states motions.
    """

    run: Run
    fit: FitRecord | None
    views: Sequence[PointView]
    remark: str
    characteristics: Characteristics
    hybrid: Sequence[HybridTest]
    endurance: Sequence[EnduranceTest]
    log: Sequence[JsonObject] | None
    sensors: Mapping[str, Mapping[str, Any]]
    details: CoverDetails
    display: Display
    specimen: SpecimenResult | None = None
    terms: MotionTerms = AS_AMPLITUDE

    @classmethod
    def of(cls, run: Run, details: DetailsFile | None = None) -> Material:
        """Read and compute it; `details` replaces the run's own `[report]`, and each stated entry of `[display]`.

        Raises:
            FileProblem: `fit.json` is not one of ours.
        """
        fit = fit_in(run.path)
        stated = {} if details is None else details.display.model_dump()
        display = Display.of(run.display.to_json(), stated)
        views, remark = views_of(run, fit)
        measured = {view.point.id: view.measured for view in views if view.measured is not None}
        characteristics = characterise(run, measured)
        terms = terms_of(run)
        recorded = next((point for point in run.points if point.path is not None and not point.imported), None)
        return cls(
            run, fit, completed_views(views, characteristics.loops, display, terms), remark, characteristics,
            hybrid_tests(run), endurance_tests(run),
            read_log(run.path) if CampaignFolder(run.path).journal.is_file() else None,
            {} if recorded is None else sensors_of(recorded),
            CoverDetails.of(run, None if details is None else details.report), display,
            specimen_result(run, characteristics), terms,
        )  # fmt: skip


def report_of(of: Material) -> Document:
    """The report as a document: two printed pages for a customer, then the model, then everything else.

    Args:
        of: what it shows.
    """
    run, fit, views, loops_of = of.run, of.fit, of.views, of.characteristics.loops
    measured = overlays(views)
    sheets = _sheets(of, measured)
    blocks: Blocks = [*sheets, Contents(screen=False)]
    if measured.first:
        blocks += [*hybrid_section(of.hybrid, of.display), *signals_section(views), *_response(of)]
    blocks += iteration_section(views)
    blocks += endurance_section(of.endurance, of.display)
    blocks += [*acceptance_section(of.specimen, of.display), *model_section(of)]
    blocks += section("Appendix", "All results, and how they were obtained.")
    if measured.rest:
        blocks += [Heading("Loops of further motions"), *measured.keys, Cards(measured.rest, large=True)]
    blocks += loops.all_motions(views)
    blocks += [*points_table(views), *point_details(views, of.log or ())]
    if fit is not None:
        blocks += fit_sections.quality(fit, of.display)
    blocks += [
        *loops.details(views, fitted=any(map(_has_fit, views))), *time_traces(views),
        *standard.standard_tests(of.characteristics, of.display), *instruments(run, of.sensors, of.display),
        *budget(views, loops_of, of.display), *calibrations(of.sensors), *unsupported(of.log or ()),
        *events(of.log), *installed_sections(run, fit), *provenance(run, fit, of.details),
    ]  # fmt: skip
    title = of.details.table.title or "Damper test report"
    return Document(f"{title} {run.name}", with_contents(blocks), mark_of([run]), of.display.paper)


def _response(of: Material) -> Blocks:
    """The section on the response time; empty without response points."""
    return response_section(of.characteristics.response, of.characteristics.response_left_out, of.display)


def _sheets(of: Material, measured: Overlays) -> tuple[Sheet, Sheet]:
    """The first two printed pages: verdict, peak forces and loops; more loops, specimen and conditions, signatures."""
    run, details, gas_force = of.run, of.details, _gas_force(of)
    heading: Blocks = [Heading("Force loops"), *measured.keys] if measured.first else []
    on_first = min(2, len(measured.first))
    first, second = (
        list[Block]([Cards(part, large=True, wide=True)] if part else [])
        for part in (measured.first[:on_first], measured.first[on_first:])
    )
    more: Blocks = []
    if measured.further:
        of_these = "1 further motion" if measured.further == 1 else f"{measured.further} further motions"
        more = [Paragraph(f"The full report contains the loops of {of_these}.", small=True)]
    if not measured.first:
        first = [*hybrid_section(of.hybrid, of.display), *signals_section(of.views), *_response(of)]
    return (
        Sheet((
            cover(run, details), Contents(paper=False), *doubts_of(run.points), *unfinished(run, of.log or ()),
            *warnings(run), facts_of(of), *_specimen(of),
            *peak_forces(of.characteristics.force_tables, of.display, of.terms, gas_force), *heading, *first,
        )),
        Sheet((
            *_again(measured.keys if measured.first[on_first:] else ()), *second, *more,
            *conditions(run, details, of.display, of.sensors.get("force"), loops=of.characteristics.loops,
                        terms=of.terms, gas_force=gas_force),
        )),
    )  # fmt: skip


def _specimen(of: Material) -> Blocks:
    """The verdict on the specimen and the values that decide it; empty without acceptance bands."""
    return [] if of.specimen is None else [specimen_note(of.specimen), *others_not_passed(of.specimen, of.display)]


def _again(keys: Sequence[Block]) -> Blocks:
    """The key of the figures once more, for the second printed page."""
    return [replace(block, paper=True) for block in keys if isinstance(block, Keys)]


def model_section(of: Material) -> Blocks:
    """The fitted model: whether it can be used, its parameters, and what they are of."""
    fit = of.fit
    if fit is None:
        return [Heading("Model"), Paragraph("This run has no fit, so the report shows only measurements.")]
    return [
        Heading("Model"), Facts(tuple(_errors(fit, of.display))),
        *fit_warnings(fit),
        *([Note(FAIR, of.remark)] if of.remark else []), *fit_sections.parameters(fit, of.display),
        *loops.model_overview(of.views),
        *parameters_over_current(fit),
    ]  # fmt: skip


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


def written_report(run_dir: Path, details: DetailsFile | None = None) -> tuple[Path, Document]:
    """As `write_report`, and the report as a document for other writers; `details`: see `Material.of`."""
    material = Material.of(Run.open(run_dir), details)
    run, document = material.run, report_of(material)
    if material.hybrid:
        write_hybrid(run, material.hybrid)
    if material.specimen is not None:
        write_specimen(run.path, material.specimen)
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
        for point in run.points if point.kind != ENDURANCE  # whose files hold only some of their samples
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


def facts_of(of: Material) -> Facts:
    """The result in a few numbers: are the tests valid, how large are the forces, does a model fit."""
    run, fit = of.run, of.fit
    valid = _count(run, "valid")
    total = max(len(run.judged), len(set(planned_points(run.campaign)) - withdrawn_points(run.path)))
    severity = GOOD if valid == total else POOR if valid == 0 else FAIR
    facts = [] if of.specimen is None else [specimen_fact(of.specimen)]
    facts.append(Fact(f"{valid} of {total}", "points valid", severity))
    facts += [
        Fact(str(_count(run, verdict)), f"{'point' if _count(run, verdict) == 1 else 'points'} {verdict}", severity)
        for verdict, severity in (("suspect", FAIR), ("invalid", POOR)) if _count(run, verdict)
    ]
    return Facts((*facts, *_lost(run), *endurance_facts(of.endurance, of.display), *largest_forces(of), *_verdict(fit)))


def largest_forces(of: Material) -> list[Fact]:
    """The greatest force of the force tables in each direction as they show it, and where.

    "none" where all forces act in the other direction.
    """
    shown, facts = of.display, list[Fact]()
    for name, rebound in (("rebound", True), ("compression", False)):
        most = greatest(of.characteristics.force_tables, rebound=rebound)
        if most is not None:
            table, current_A, row, cell = most
            if (cell.rebound_N if rebound else -cell.compression_N) <= 0.0:
                other = "compression: the gas force exceeds the damping force" if rebound else "rebound"
                facts.append(Fact("none", f"{name} force at {table.kind}: all forces act in {other}"))
                continue
            at = f"{number(current_A, 3)} A, {shown.speed.text(row.speed_m_s, 3)}"
            force = f"{force_text(table, cell, shown, rebound=rebound)} {shown.force.unit}"
            facts.append(Fact(force, f"greatest {name} force at {table.kind} ({at})"))
    return facts


def _gas_force(of: Material) -> str:
    """The static gas force with its sign and source: of a slow test, else the constant force of the fit; else empty."""
    shown = of.display.force
    for test in of.characteristics.friction:
        force = with_uncertainty(shown.signed(test.gas_force_N.value), shown.value(test.gas_force_N.std))
        return f"{force} {shown.unit} (measured at {of.display.speed.text(test.speed_m_s, 3)})"
    fitted = None if of.fit is None or of.fit.adequate is False else of.fit.parameters.get(STATIC)
    if fitted is None or fitted.value is None or not fitted.identifiable or fitted.unit != "N":
        return ""
    std_N = math.nan if fitted.standard_error is None else fitted.standard_error
    return f"{with_uncertainty(shown.signed(fitted.value), shown.value(std_N))} {shown.unit} (fitted, {STATIC})"


def _verdict(fit: FitRecord | None) -> list[Fact]:
    """Whether the fitted model can be used."""
    if fit is None:
        return []
    if fit.adequate is None:
        return [Fact("Model not evaluated", "no test has two full cycles in addition to its first and last")]
    if not fit.adequate:
        return [Fact("Model does not fit", "its error exceeds the repeatability of the tests", POOR)]
    error = f"{number(fit.error.nrmse_percent_of_peak, 2)} %"
    return [Fact("Model fits", f"within measurement noise; RMS error {error} of force amplitude, mean of tests", GOOD)]


def _errors(fit: FitRecord, display: Display) -> list[Fact]:
    """The model, and its errors on fitted and other tests."""
    known = f"{len(fit.identifiable)} of {len(fit.parameters)}"
    facts = [
        Fact(fit.model, f"model, fitted by {fit_sections.METHODS.get(fit.method, fit.method)}"),
        Fact(f"{number(fit.error.nrmse_percent_of_peak, 3)} %", "RMS error / force amplitude, mean of all tests"),
        Fact(f"{number(display.force.value(fit.error.rmse_N), 3)} {display.force.unit}", "RMS error"),
        Fact(known, "parameters identified"),
    ]
    if fit.holdout is not None:
        meaning = f"error on validation tests{fit_sections.extrapolated_words(fit.holdout)}"
        facts.append(Fact(f"{number(fit.holdout.nrmse_percent_of_peak, 3)} %", meaning))
    if fit.unseen is not None:
        mean = f"{number(fit.unseen.nrmse_percent_of_peak, 3)} %"
        facts.append(Fact(mean, "error, leave-one-motion-out cross-validation"))
    return facts


def _losses(run: Run) -> tuple[int, set[str]]:
    """Samples lost, and how they were counted at the points that were recorded here (empty: not counted)."""
    lost = sum(point.lost_samples for point in run.points)
    return lost, {point.quality.loss_counted_by or "" for point in run.points if not point.imported}


def _lost(run: Run) -> list[Fact]:
    """Lost samples; none is no news where a loss would have been counted."""
    lost, by = _losses(run)
    if not by:  # imported tests
        return [Fact(str(lost), "rows missing", FAIR)] if lost else []
    if lost:
        estimated = "" if by == {"sequence"} else ", estimated from the nominal rate"
        return [Fact(str(lost), f"samples lost{estimated}", FAIR)]
    if by <= {"sequence", "rate"}:
        return []
    return [Fact("unknown", "number of samples lost; the data format of a sensor has no sequence number", FAIR)]


def unfinished(run: Run, log: Sequence[JsonObject]) -> Blocks:
    """That the campaign ended before its last point, and what stopped it; empty where every point was recorded."""
    names = planned_points(run.campaign)
    missing = set(names) - {point.id for point in run.points} - withdrawn_points(run.path)
    if not missing or all(point.imported for point in run.points):
        return []
    last = next((line for line in reversed(log) if line.get("event") == "result"), {})
    stopped_by = last.get("stopped_by")
    cause = f" It was stopped: {last.get('detail') or stopped_by}." if stopped_by else ""
    count = f"{len(missing)} of {len(names)}"
    return [Note(POOR, f"The test is incomplete. Planned points that were not recorded: {count}.{cause}")]


def warnings(run: Run) -> Blocks:
    """What a reader must know before believing the measurements."""
    notes: Blocks = [Note(POOR, line) for line in run.unreadable]
    blocks = [point.verdict for point in run.judged if point.kind == ENDURANCE]
    if count := _count(run, "invalid") - blocks.count("invalid"):
        notes.append(Note(POOR, f"{_points(count)} invalid and not used; see the remarks in the full report."))
    if count := sum(verdict != "valid" for verdict in blocks):
        which = "1 block of an endurance test is" if count == 1 else f"{count} blocks of endurance tests are"
        counted = "its cycles are counted" if count == 1 else "their cycles are counted"
        notes.append(Note(POOR if "invalid" in blocks else FAIR,
                          f"{which} not valid; {counted}. The full report states the reasons."))
    if count := _count(run, "suspect") - blocks.count("suspect"):
        use = Code("rig identify --suspect")
        stated = f"{_points(count)} suspect; see the remarks in the full report. A model fit includes them only with "
        notes.append(Note(FAIR, (stated, use, ".")))
    return notes


def fit_warnings(fit: FitRecord) -> Blocks:
    """What a reader must know before believing the model."""
    notes: Blocks = []
    if fit.adequate is False:
        notes.append(Note(POOR, (
            Strong("The model does not fit."), " The model error exceeds the repeatability of the tests. Do not use "
            "the parameters as properties of the damper.",
        )))  # fmt: skip
    remarks = [Note(FAIR, warning) for warning in fit.warnings]
    notes += remarks[:SHOWN_WARNINGS]
    if more := remarks[SHOWN_WARNINGS:]:
        notes.append(Details(f"Further warnings: {len(more)}", tuple(more)))
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


def provenance(run: Run, fit: FitRecord | None, details: CoverDetails) -> Blocks:
    """Where all this comes from: software, bench, devices, calibrations, hashes."""
    shared = {
        key: value for key, value in (run.points[0].provenance.items() if run.points else ())
        if all(point.provenance.get(key) == value for point in run.points)
    }
    shown: dict[str, object] = {
        "campaign": run.name, **shared,
        **{key: value for key, value in run.campaign.items() if isinstance(value, (str, int, float))},
    }
    for key in ("started_utc", TESTED, "created"):
        if key in shown:
            shown[key.removesuffix("_utc")] = local_time(shown.pop(key))
    shown |= {f"specimen, {key.replace('_', ' ')}": value for key, value in details.specimen.items()}
    methods = sorted({point.quality.skew.method for point in run.points if point.quality.skew.method is not None})
    shown["time alignment"] = "; ".join(map(time_base_words, methods))
    lost, counted = _losses(run)
    if counted and counted <= {"sequence", "rate"}:
        single = "" if counted == {"sequence"} else ", estimated from the nominal rate; single losses may go undetected"
        shown["samples lost"] = f"{lost}{single}"
    if fit is not None:
        shown["fit"] = f"{fit.evaluations} evaluations, {number(fit.wall_s, 3)} s"
    note = (
        "The file for each point contains the raw samples, calibrations and clock models: ", Code("points/*.h5"),
        " (HDF5, readable with h5dump, xarray, MATLAB and Octave).",
    )
    return [*section("Provenance", note), Properties({key.replace("_", " "): value for key, value in shown.items()})]


def _count(run: Run, verdict: str) -> int:
    return sum(point.verdict == verdict for point in run.judged)
