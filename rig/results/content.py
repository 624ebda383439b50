"""All rows that the results database has of one run, read from its directory."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import re
import uuid
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

from rig.campaign_folder import CampaignFolder
from rig.characteristics import Characteristics, characterise
from rig.characteristics.loop import LoopCharacteristics, Measured
from rig.comparison.readings import QUANTITIES, calibration_percent
from rig.comparison.specimen import read_specimen
from rig.errors import DataWarning, FileProblem
from rig.files.toml_source import read_toml
from rig.fits.fit_record import FitRecord, fit_in
from rig.matrix.acceptance_table import has_acceptance
from rig.recording.endurance import withdrawn_points
from rig.recording.hdf5.reading import channel_attributes, channel_names
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run, planned_points, read_campaign, read_words
from rig.recording.tested_on import TESTED, when_tested
from rig.recording.tested_specimens import NO_BANDS, SpecimenVerdict
from rig.results.quantities import BENCH, SPECIMEN, STORED_WITH_POINT, quantity_named
from rig.results.schema import stored_current
from rig.results.special_tests import special_values
from rig.verdicts import worst

NAMESPACE = uuid.UUID("6f3f6d0b-0d0e-5bd2-9a55-1b8f9a3c4d77")
"""Of the campaigns' UUIDs, which are derived from the name in `campaign.json`: a copied or renamed directory, or one
that is read again on another computer, is the same campaign."""
NOT_TESTED = str(SpecimenVerdict.NOT_TESTED)

Row = dict[str, Any]


NOT_STORABLE = re.compile("[\\x00\\ud800-\\udfff]")


@dataclass(frozen=True)
class Content:
    """The rows of one run.

    Attributes:
        campaign: its row in `campaigns`, without its number, `digest`, `filled_by` and `filled`.
        children: table -> its rows, without the number of the campaign.
        remark: what could not be read; empty if everything could.
    """

    campaign: Row
    children: Mapping[str, Sequence[Row]]
    remark: str = ""

    @property
    def campaign_id(self) -> str:
        """UUID of the campaign."""
        return str(self.campaign["campaign_id"])

    @cached_property
    def digest(self) -> str:
        """SHA-256 (hex) of all rows; equal for equal results, whenever and by whichever version they were read."""
        rows = [self.campaign, *(row for name in sorted(self.children) for row in self.children[name])]
        return hashlib.sha256(json.dumps(rows, sort_keys=True, default=str).encode()).hexdigest()


def content_of(folder: Path) -> Content:
    """All rows of the run in a directory. Parts that cannot be read are omitted and named in `remark`.

    Raises:
        FileProblem: the directory has neither a readable description nor a readable point.
    """
    campaign = read_campaign(folder)
    run, remarks = _run_in(folder, campaign)
    campaign_id = campaign_uuid(folder, campaign)
    children: dict[str, list[Row]] = {}
    if run is not None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DataWarning)  # the points' remarks are in their own rows
            made = characterise(run)
        rows = list(_characteristics(run, made, special_values(run, made.response, remarks)))
        children["points"] = [_point(point, made) for point in run.points]
        children["characteristics"] = rows
        children["calibrations"] = list(_calibrations(run))
    try:
        fit = fit_in(folder)
    except FileProblem as error:
        remarks.append(f"{Path(error.file).name}: {error.problems[0]}")
    else:
        children |= {} if fit is None else {"fits": [_fit(fit)], "parameters": list(_parameters(fit))}
    judged = () if run is None else run.judged
    bench_verdict = _worst(judged)
    planned = len(set(planned_points(campaign)) - withdrawn_points(folder))
    children["verdicts"] = [_bench_verdict(bench_verdict, judged, planned), *_specimen_verdicts(folder, remarks)]
    undecided = NOT_TESTED if has_acceptance(folder) else NO_BANDS
    specimen_verdict = next((row["verdict"] for row in children["verdicts"] if row["subject"] == SPECIMEN), undecided)
    row = {
        "campaign_id": campaign_id, **_described(folder, run, campaign), "planned_points": planned,
        "recorded_points": len(judged), "valid_points": sum(point.verdict == "valid" for point in judged),
        "bench_verdict": bench_verdict, "specimen_verdict": specimen_verdict,
    }
    return Content(_plain(row), {name: [_plain(child) for child in part] for name, part in children.items()},
                   storable("; ".join(remarks)))  # fmt: skip


def campaign_uuid(folder: Path, campaign: Mapping[str, Any]) -> str:
    """UUID of a campaign by its description: of its name, and of an imported run also of the time of the import."""
    name = str(campaign.get("id") or folder.name)
    return str(uuid.uuid5(NAMESPACE, storable(f"{name} {campaign.get('created', '')}".strip())))


def _run_in(folder: Path, campaign: Mapping[str, Any]) -> tuple[Run | None, list[str]]:
    """The run with its points; None if no point was recorded.

    Raises:
        FileProblem: there is no description either.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DataWarning)
            run = Run.open(folder)
    except FileProblem as error:
        if not campaign:
            raise
        recorded = any(CampaignFolder(folder).points.glob("*.h5"))
        return None, list(error.problems) if recorded else []
    return run, list(run.unreadable)


def _plain(row: Mapping[str, Any]) -> Row:
    """The row with plain values; NaN and infinity are None."""
    return {
        name: None if isinstance(value, float) and not math.isfinite(value) else
        storable(value) if isinstance(value, str) else value for name, value in row.items()
    }


def storable(text: str) -> str:
    """A text that every database accepts: PostgreSQL stores no NUL, and UTF-8 has no surrogates."""
    return NOT_STORABLE.sub("\N{REPLACEMENT CHARACTER}", text)


def _described(folder: Path, run: Run | None, campaign: Mapping[str, Any]) -> Row:
    provenance: Mapping[str, Any] = run.points[0].provenance if run is not None and run.points else {}
    hashes = campaign.get("hashes")
    specimen = campaign.get("specimen") or provenance.get("specimen", "")
    specimen = specimen.get("serial_number", "") if isinstance(specimen, Mapping) else specimen
    imported = bool(campaign.get("imported"))
    simulated = campaign.get("simulated") is not None or any(
        bool(point.test.get("simulated")) for point in (() if run is None else run.points)
    )
    return {
        "run": folder.name, "station": _station(folder, campaign) or None, "specimen": str(specimen) or None,
        "operator": _operator(folder, campaign), "matrix": str(campaign.get("matrix_file", "")),
        "matrix_sha256": str(hashes.get("matrix", "")) if isinstance(hashes, Mapping) else "",
        "bench": str(campaign.get("bench") or provenance.get("bench", "")),
        "started": _time(when_tested(campaign) or provenance.get("started_utc")),
        "software": str(campaign.get("software", "")), "simulated": simulated, "imported": imported,
    }


def _when(point: RecordedPoint) -> datetime | None:
    """When a point was recorded; of an imported test its date."""
    return _time(point.provenance.get("started_utc") or point.provenance.get(TESTED))


def _time(text: object) -> datetime | None:
    """A time of a file, which is UTC where it states no zone; None if it is none."""
    try:
        time = datetime.fromisoformat(str(text))
    except ValueError:
        return None
    return time.replace(tzinfo=UTC) if time.tzinfo is None else time.astimezone(UTC)


def _toml(file: Path) -> dict[str, Any]:
    """The content of a user's file in the run; empty if there is none or it cannot be read."""
    try:
        return dict(read_toml(file).data) if file.is_file() else {}
    except FileProblem:
        return {}


def _table(file: Path, name: str) -> Mapping[str, Any]:
    table = _toml(file).get(name)
    return table if isinstance(table, Mapping) else {}


def _station(folder: Path, campaign: Mapping[str, Any]) -> str:
    named = _table(CampaignFolder(folder).bench, "results").get("station")
    return str(named or campaign.get("bench") or "")


def _operator(folder: Path, campaign: Mapping[str, Any]) -> str:
    """As in the report: entered on the page, else stated in `[report]`, else in the description."""
    with contextlib.suppress(FileProblem, OSError):
        if entered := read_words(folder).get("operator"):
            return str(entered)
    for file in (CampaignFolder(folder).details, CampaignFolder(folder).matrix):
        if stated := _table(file, "report").get("operator"):
            return str(stated)
    return str(campaign.get("operator") or "")


def _worst(judged: Sequence[RecordedPoint]) -> str:
    return worst({point.verdict for point in judged})


def _bench_verdict(verdict: str, points: Sequence[RecordedPoint], planned: int) -> Row:
    reasons = [f"{len(points)} of {planned} points recorded"] if len(points) < planned else []
    reasons += [
        f"{point.id} {point.verdict}: {'; '.join(point.reasons)}" for point in points if point.verdict != "valid"
    ]
    return _verdict_row(BENCH, 0, verdict, reason="; ".join(reasons))


def _specimen_verdicts(folder: Path, remarks: list[str]) -> list[Row]:
    """The specimen's verdict, and one row for each value with its band; none without acceptance bands."""
    if not CampaignFolder(folder).acceptance.is_file():
        return []
    try:
        specimen = read_specimen(folder)
    except FileProblem as error:
        remarks.append(f"{Path(error.file).name}: {error.problems[0]}")
        return []
    accepted = specimen.acceptance
    bands, decision = ("", "") if accepted is None else (accepted.name, str(accepted.decision))
    rows = [_verdict_row(
        SPECIMEN, 0, str(specimen.verdict), reason=specimen.reason, bands=bands, decision=decision,
    )]  # fmt: skip
    for number, result in enumerate(() if accepted is None else accepted.results, start=1):
        rows.append(_verdict_row(
            SPECIMEN, number, str(result.state), reason=result.why, quantity=result.quantity, location=result.where,
            value=result.value, expanded_uncertainty=result.expanded, low=result.low, high=result.high,
            margin=result.margin, unit=result.unit,
        ))  # fmt: skip
    return rows


def _verdict_row(subject: str, item: int, verdict: str, **values: object) -> Row:
    texts = dict.fromkeys(("reason", "bands", "decision", "quantity", "location", "unit"), "")
    numbers = dict.fromkeys(("value", "expanded_uncertainty", "low", "high", "margin"))
    return {"subject": subject, "item": item, "verdict": verdict, **texts, **numbers, **values}


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, (int, float)) and math.isfinite(value) else None


def _motion(point: RecordedPoint, loop: LoopCharacteristics | None) -> Row:
    """The motion of a point by its level and group in the run, so that repeats and other runs have the same."""
    amplitude_m, frequency_hz = (point.amplitude_m, point.frequency_Hz) if loop is None else loop.group
    current_a = point.current_A if loop is None else loop.level_A
    if point.cyclic and point.has_frequency:
        text = f"{point.waveform} {1e3 * amplitude_m:.4g} mm {frequency_hz:.4g} Hz"
    else:
        text = point.motion
    return {
        "motion": text, "waveform": point.waveform, "amplitude_m": amplitude_m, "frequency_hz": frequency_hz,
        "current_a": stored_current(current_a),
    }


def _point(point: RecordedPoint, made: Characteristics) -> Row:
    loop = next((loop for loop in made.loops if loop.id == point.id), None)
    return {
        "point": point.id, "kind": point.kind, **_motion(point, loop), "centre_m": point.centre_m,
        "cycles": float(point.cycles), "repeat": int(point.repeat),
        "recorded": _when(point),
        "verdict": point.verdict, "reasons": "; ".join(point.reasons), "lost_samples": int(point.lost_samples),
        "skew_s": point.skew_s, "skew_standard_uncertainty_s": point.skew_std_s,
    }


def _characteristics(run: Run, made: Characteristics, special: Mapping[str, Mapping[str, Measured]]) -> Iterator[Row]:
    """Every value of every point that is not invalid; the state of the bench of every point."""
    loops = {loop.id: loop for loop in made.loops}
    ranges = {ratio.id: ratio for ratio in made.dynamic_range}
    friction = {test.id: test for test in made.friction}
    steps = [point.id for point in run.points if point.kind == "current_step" and point.verdict != "invalid"]
    for point in run.points:
        loop = loops.get(point.id)
        values: dict[str, Measured] = {}
        if loop is not None:
            values |= {
                "rebound_force": loop.rebound_N, "jounce_force": loop.jounce_N, "energy": loop.energy_J,
                "damping": loop.equivalent_damping_N_s_m,
            }
        if point.id in ranges:
            values["dynamic_range"] = Measured(ranges[point.id].rebound, ranges[point.id].std, math.nan)
        if point.id in friction:
            test = friction[point.id]
            values |= {"friction_force": test.friction_N, "gas_force": test.gas_force_N,
                       "gas_spring_stiffness": test.stiffness_N_m}  # fmt: skip
        if made.lag is not None and steps and point.id == steps[0]:
            values["coil_rate"] = Measured(made.lag.eta_1_s, made.lag.std_1_s, math.nan)
        values |= {**_recorded(point), **special.get(point.id, {})}
        motion = _motion(point, loop)
        for name, measured in values.items():
            if math.isfinite(measured.value):
                yield _value(point, name, measured, motion)


def _value(point: RecordedPoint, name: str, measured: Measured, motion: Row) -> Row:
    about = quantity_named(name)
    compared = QUANTITIES.get(name)
    percent = math.nan if compared is None else calibration_percent(compared, point)
    calibration = abs(measured.value) * percent / 100.0
    known = [part for part in (measured.std, calibration) if math.isfinite(part)]
    return {
        "point": point.id, "quantity": name, "subject": about.subject, **motion,
        "recorded": _when(point), "point_verdict": point.verdict,
        "repeat": int(point.repeat), "value": measured.value,
        "unit": about.unit, "standard_uncertainty": math.hypot(*known) if math.isfinite(measured.std) else None,
        "repeatability_uncertainty": measured.std, "calibration_uncertainty": calibration,
    }


def _recorded(point: RecordedPoint) -> dict[str, Measured]:
    """Values in the file of a point: peak forces and temperature, and the state of the bench."""
    quality, values = point.quality, dict[str, Measured]()
    for name, read in STORED_WITH_POINT.items():
        value, std = read(quality)
        if value is not None and (quantity_named(name).subject == BENCH or point.verdict != "invalid"):
            values[name] = Measured(value, math.nan if std is None else std, math.nan)
    return values


def _calibrations(run: Run) -> Iterator[Row]:
    """The sensors of the last point: a campaign has one calibration, which a resumed session must find unchanged."""
    point = run.points[-1] if run.points else None
    if point is None or point.path is None:
        return
    for channel in channel_names(point.path):
        attributes = channel_attributes(point.path, channel)
        if "sensitivity" not in attributes:
            continue
        texts = {
            name: str(attributes.get(name) or "") for name in ("sensor", "serial_number", "certificate", "due")
        }
        yield {
            "channel": channel, **texts, "overdue": bool(attributes.get("overdue")),
            "sensitivity": _number(attributes.get("sensitivity")), "offset_value": _number(attributes.get("offset")),
            "uncertainty_percent": _number(attributes.get("uncertainty_percent")),
            "range_value": _number(attributes.get("range_SI")), "unit": str(attributes.get("units") or ""),
        }


def _fit(fit: FitRecord) -> Row:
    return {
        "model": fit.model, "method": fit.method, "adequate": fit.adequate, "rmse_n": fit.error.rmse_N,
        "nrmse_percent": fit.error.nrmse_percent_of_peak, "tests": len(fit.error.per_test), "sha256": fit.sha256,
    }


def _parameters(fit: FitRecord) -> Iterator[Row]:
    for name, one in fit.parameters.items():
        yield {
            "parameter": name, "value": one.value, "unit": one.unit, "standard_uncertainty": one.standard_error,
            "low": one.low, "high": one.high, "identifiable": bool(one.identifiable), "reason": one.reason,
        }
