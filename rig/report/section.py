"""The report's sections, each a function from values to HTML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rig.recording.estimate import Estimate
from rig.recording.run import RecordedPoint, Run
from rig.recording.verdict import blamed
from rig.report.fragment import NOTHING, box, chip, data_list, number, plus_minus, table, text
from rig.report.view import PointView

JsonObject = Mapping[str, Any]

SHOWN_WARNINGS = 5


def header(run: Run, fit: JsonObject | None) -> str:
    """Title, what was tested, and the result in a few numbers."""
    campaign = run.campaign
    origin = "imported tests" if _any(run, "imported") else "simulated rig" if _simulated(run) else "test rig"
    started = campaign.get("created") or _first(run, "started_utc")
    described = " \N{MIDDLE DOT} ".join(
        text(part) for part in dict.fromkeys((origin, _first(run, "bench"), started, run.path.name)) if part
    )
    valid = _count(run, "valid")
    facts = [*_verdict(fit), _fact(f"{valid} of {len(run.points)}", "points valid", _kind(valid == len(run.points)))]
    facts += [
        _fact(str(_count(run, verdict)), f"points {verdict}", kind)
        for verdict, kind in (("suspect", "fair"), ("invalid", "poor")) if _count(run, verdict)
    ]
    facts.append(_lost(run))
    if fit is not None:
        error = fit.get("error") or {}
        facts.append(_fact(text(fit.get("model", NOTHING)), f"model, by {text(fit.get('method', NOTHING))}"))
        facts.append(_fact(f"{number(error.get('nrmse_percent_of_peak'), 3)} %", "error of peak force, mean of tests"))
        facts.append(_fact(f"{number(error.get('rmse_N'), 3)} N", "RMS error"))
        if (apart := error.get("holdout")) is not None:
            facts.append(_fact(f"{number(apart.get('nrmse_percent_of_peak'), 3)} %", "error on held-out tests"))
    name = _specimen(run) or run.path.name
    title = f'<h1>Damper test report: {text(name)}</h1><p class="lead">{described}</p>'
    return f'{title}<div class="facts">{"".join(facts)}</div>'


def _verdict(fit: JsonObject | None) -> list[str]:
    """Whether the fit can be used, first of all."""
    if fit is None:
        return []
    if fit.get("adequate") is False:
        return [_fact("Does not fit", "the model leaves more than the tests' scatter", "poor")]
    unknown = sum(not entry.get("identifiable", True) for entry in fit["parameters"].values())
    if fit.get("adequate") is None:
        return [_fact("Not judged", "no test has two whole cycles beside its first and last to compare the fit with")]
    known = f"{len(fit['parameters']) - unknown} of {len(fit['parameters'])} parameters identified"
    return [_fact("Fits", f"to the tests' scatter; {known}", "good")]


def _lost(run: Run) -> str:
    """Lost samples; a count of 0 is good news only where a loss would have been counted."""
    lost = sum(point.lost_samples for point in run.points)
    by = {str(point.quality.get("loss_counted_by", "")) for point in run.points if not point.imported}
    if lost or by == {"sequence"}:
        return _fact(str(lost), "samples lost", _kind(lost == 0))
    if by <= {"sequence", "rate"} and by:
        return _fact(str(lost), "samples lost, counted against the nominal rate: a single one may be missed")
    if not by:
        return _fact(str(lost), "rows missing")
    return _fact("not known", "samples lost: a sensor's format has no sequence, so nobody can tell", "fair")


def _fact(value: str, meaning: str, kind: str = "") -> str:
    return f'<div class="fact {kind}"><b>{value}</b><span>{meaning}</span></div>'


def _kind(good: bool) -> str:
    return "good" if good else "fair"


def warnings(run: Run, fit: JsonObject | None) -> str:
    """Everything a reader must know before believing the rest."""
    boxes = []
    if _count(run, "invalid"):
        boxes.append(box("bad", f"{_count(run, 'invalid')} point(s) are invalid and were left out of the fit."))
    if _count(run, "suspect"):
        boxes.append(box(
            "warn", f"{_count(run, 'suspect')} point(s) are suspect and were left out of the fit; "
            "<code>rig identify --suspect</code> takes them in.",
        ))
    if fit is None:
        boxes.append(box("warn", "No fit is in this run: the loops below are measured only."))
    else:
        if fit.get("adequate") is False:
            boxes.append(box(
                "bad",
                "<b>The model does not fit.</b> Its error is larger than the measurement's own scatter explains: "
                "do not use the parameters as properties of the damper.",
            ))
        remarks = [box("warn", text(warning)) for warning in fit.get("warnings") or ()]
        boxes += remarks[:SHOWN_WARNINGS]
        if more := remarks[SHOWN_WARNINGS:]:
            boxes.append(f"<details><summary>{len(more)} more warnings</summary>{''.join(more)}</details>")
    return "".join(boxes)


def points_table(views: Sequence[PointView]) -> str:
    """One row a point: what was asked, what was achieved, verdict and reasons, error of the fit."""
    head = ["Point", "Waveform", "A mm", "A measured", "f Hz", "f measured", "I A", "Cycles", "Lost", "Skew ms",
            "Verdict", "Error %", "Remarks"]
    rows = []
    for view in views:
        point, quality = view.point, view.point.quality
        remarks = [f"{reason} [{blamed(reason)}]" for reason in point.reasons]
        remarks += [view.why] if view.why and point.verdict != "invalid" else []
        if view.held_out:
            remarks.append("held out of the fit")
        rows.append(("", [
            text(point.id), text(point.waveform), number(1e3 * point.amplitude_m),
            number(_scaled(quality.get("measured_amplitude_m"), 1e3)), number(point.frequency_Hz),
            number(quality.get("measured_frequency_Hz")), number(point.current_A),
            number(quality.get("measured_cycles"), 3), str(point.lost_samples), _skew(point),
            chip(point.verdict, point.verdict), number(view.error.get("nrmse_percent_of_peak"), 3),
            f'<div class="remark">{"<br>".join(text(remark) for remark in remarks)}</div>',
        ]))
    note = "Error: 100 \N{MULTIPLICATION SIGN} RMS error / largest deviation of the force from its mean."
    if not all(view.point.imported for view in views):
        note += (
            " Skew: by how much force lagged displacement beyond the declared delays; it is corrected, and "
            "\N{PLUS-MINUS SIGN} is one standard deviation of what remains. In brackets behind a remark: whether it is "
            "the specimen, the bench or the test that is at fault."
        )
    return f'<h2>Test points</h2><p class="lead">{note}</p>' + table(head, rows, (2, 3, 4, 5, 6, 7, 8, 9, 11))


def _skew(point: RecordedPoint) -> str:
    if point.imported:
        return NOTHING
    if "skew_s" not in point.quality:
        return f"\N{PLUS-MINUS SIGN} {number(1e3 * point.skew_std_s, 2)}"
    return plus_minus(Estimate(point.skew_s, point.skew_std_s).times(1e3))


def _scaled(value: object, factor: float) -> float | None:
    return factor * value if isinstance(value, (int, float)) else None


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
    methods = sorted({str(point.quality["skew_method"]) for point in run.points if "skew_method" in point.quality})
    shown["time alignment"] = "; ".join(methods)
    if fit is not None:
        shown["fit"] = f"{fit.get('evaluations', NOTHING)} evaluations, {number(fit.get('wall_s'), 3)} s"
    return "<h2>Provenance</h2>" + data_list(shown) + (
        '<p class="lead">Each point\'s file holds its raw samples, calibrations and clock models: '
        "<code>points/*.h5</code> (HDF5; h5dump, xarray, MATLAB, Octave).</p>"
    )


def _specimen(run: Run) -> str:
    specimen = run.campaign.get("specimen") or _first(run, "specimen")
    if isinstance(specimen, Mapping):
        specimen = specimen.get("serial_number", "")
    return str(specimen or "")


def _first(run: Run, name: str) -> str:
    return str(run.points[0].provenance.get(name, "")) if run.points else ""


def _any(run: Run, name: str) -> bool:
    return any(getattr(point, name) for point in run.points)


def _simulated(run: Run) -> bool:
    return any(point.test.get("simulated") for point in run.points)


def _count(run: Run, verdict: str) -> int:
    return sum(point.verdict == verdict for point in run.points)
