"""The report's sections, each a function from values to HTML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import rig.dampers
from rig.recording.run import RecordedPoint, Run
from rig.recording.verdict import blamed
from rig.report.fragment import NOTHING, box, chip, data_list, number, table, text
from rig.report.view import PointView

JsonObject = Mapping[str, Any]


def header(run: Run, fit: JsonObject | None) -> str:
    """Title, what was tested, and the result in a few numbers."""
    campaign = run.campaign
    origin = "imported tests" if _any(run, "imported") else "simulated rig" if _simulated(run) else "test rig"
    started = campaign.get("created") or _first(run, "started_utc")
    described = " \N{MIDDLE DOT} ".join(
        text(part) for part in dict.fromkeys((origin, _first(run, "bench"), started, run.path.name)) if part
    )
    facts = [_fact(f"{_count(run, 'valid')} of {len(run.points)}", "points valid")]
    facts += [
        _fact(str(_count(run, verdict)), f"points {verdict}") for verdict in ("suspect", "invalid")
        if _count(run, verdict)
    ]
    facts.append(_fact(str(sum(point.lost_samples for point in run.points)), "samples lost"))
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


def _fact(value: str, meaning: str) -> str:
    return f'<div class="fact"><b>{value}</b><span>{meaning}</span></div>'


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
        boxes += [box("warn", text(warning)) for warning in fit.get("warnings") or ()]
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
            "<br>".join(text(remark) for remark in remarks),
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
    known = f"{number(1e3 * point.skew_s, 3)} " if "skew_s" in point.quality else ""
    return f"{known}\N{PLUS-MINUS SIGN} {number(1e3 * point.skew_std_s, 2)}"


def _scaled(value: object, factor: float) -> float | None:
    return factor * value if isinstance(value, (int, float)) else None


def parameters_table(fit: JsonObject) -> str:
    """Fitted parameters with their intervals, then those the data cannot identify, and why."""
    known, unknown = [], []
    meanings = _meanings(str(fit.get("model")))
    for name, entry in (fit.get("parameters") or {}).items():
        value, unit = number(entry.get("value"), 5), text(entry.get("unit", ""))
        if entry.get("identifiable", True):
            low, high = entry.get("low"), entry.get("high")
            half = _half_percent(entry.get("value"), low, high)
            interval = f"{number(low, 5)} \N{HORIZONTAL ELLIPSIS} {number(high, 5)}"
            known.append(("", [text(name), value, interval, half, unit, text(meanings.get(name, ""))]))
        else:
            why = entry.get("reason") or "the data do not determine it"
            unknown.append(("no", [text(name), value, unit, text(meanings.get(name, "")), text(why)]))
    parts = ["<h2>Fitted parameters</h2>"]
    head = ["Parameter", "Value", "95 % interval", "\N{PLUS-MINUS SIGN} %", "Unit", "Meaning"]
    parts.append(table(head, known, (1, 2, 3)))
    if unknown:
        parts.append("<h3>Not identifiable from these data</h3>")
        parts.append(table(["Parameter", "Value used", "Unit", "Meaning", "Why"], unknown, (1,)))
    parts += [f'<p class="lead">{text(note)}</p>' for note in fit.get("notes") or ()]
    parts.append(_selection(fit))
    return "".join(parts)


def _meanings(name: str) -> dict[str, str]:
    if name not in rig.dampers.MODELS:
        return {}
    return {parameter.name: parameter.meaning for parameter in rig.dampers.model(name).parameters}


def _half_percent(value: object, low: object, high: object) -> str:
    if isinstance(value, float) and isinstance(low, float) and isinstance(high, float) and value != 0.0:
        return number(50.0 * abs((high - low) / value), 2)
    return NOTHING


def _selection(fit: JsonObject) -> str:
    entries = fit.get("selection") or ()
    if len(entries) < 2:
        return ""
    rows = [("", [text(entry.get("model")), number(entry.get("holdout_nrmse_percent_of_peak"), 3),
                  number(entry.get("bic"), 6)]) for entry in entries]
    return "<h3>Models compared</h3>" + table(["Model", "Error on held-out tests %", "BIC"], rows, (1, 2))


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
