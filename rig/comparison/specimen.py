"""The verdict on the specimen of a campaign: its values against the bands that the matrix names in `[acceptance]`.

It is separate from the verdict on the test: a good test can show a bad damper, and a bad test shows nothing of it.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rig.campaign_folder import CampaignFolder
from rig.characteristics import Characteristics
from rig.comparison.acceptance import AcceptanceResult, Result, State, evaluate
from rig.comparison.bands import Bands, load_bands
from rig.comparison.readings import readings_of
from rig.comparison.words import result_text
from rig.errors import FileProblem
from rig.files.loader import lines_of, validated
from rig.files.run_display import run_display
from rig.files.toml_source import read_toml
from rig.matrix.acceptance_table import LARGEST_BANDS_BYTES, AcceptanceTable, has_acceptance
from rig.recording.atomic_write import write_text_durably
from rig.recording.run import Run, read_campaign
from rig.recording.tested_specimens import SpecimenVerdict
from rig.text_file import read_bytes, read_json

FORMAT = 1
EDITED = (
    "after the campaign was started. Fix: restore the file, or compare the run with other bands (rig compare RUN "
    "--bands FILE)"
)


@dataclass(frozen=True)
class SpecimenResult:
    """The verdict on a specimen and what it is based on.

    Attributes:
        serial_number: of the specimen; empty if unknown.
        verdict: `ok`, `not-ok` or `not-tested`.
        reason: the value that decides, in the units of the run; of `ok` the value with the smallest margin.
        acceptance: every value against its band; None where the bands or the run cannot be read.
    """

    serial_number: str
    verdict: SpecimenVerdict
    reason: str
    acceptance: AcceptanceResult | None = None

    @property
    def deciding(self) -> Result | None:
        """The value that decides: the first that is missing or undecided, else the one with the smallest margin."""
        if self.acceptance is None:
            return None
        states = {SpecimenVerdict.OK: {State.PASSED}, SpecimenVerdict.NOT_OK: {State.FAILED}}
        decisive = states.get(self.verdict, {State.MISSING, State.UNSURE})
        results = [result for result in self.acceptance.results if result.state in decisive]
        return min(results, key=_nearness, default=None)

    def to_json(self) -> dict[str, Any]:
        """Plain types; the keys are in `docs/json.md`."""
        acceptance = None if self.acceptance is None else self.acceptance.to_json()
        return {
            "format": FORMAT, "specimen": str(self.verdict), "serial_number": self.serial_number,
            "reason": self.reason, "acceptance": acceptance,
        }  # fmt: skip

    @classmethod
    def from_json(cls, entry: Mapping[str, Any]) -> SpecimenResult:
        """The result that `to_json` wrote.

        Raises:
            LookupError: a key is missing.
            TypeError, ValueError: a value is not of its type.
        """
        acceptance = entry["acceptance"]
        return cls(
            str(entry["serial_number"]), SpecimenVerdict(entry["specimen"]), str(entry["reason"]),
            None if acceptance is None else AcceptanceResult.from_json(acceptance),
        )  # fmt: skip


def _nearness(result: Result) -> float:
    """Order of the values that decide: missing ones first, then by the margin relative to the limit."""
    if math.isfinite(result.margin_percent):
        return result.margin_percent
    return math.inf if result.margin >= 0.0 else -math.inf  # a limit of 0 has no relative margin


def specimen_result(run: Run, characteristics: Characteristics | None = None) -> SpecimenResult | None:
    """The verdict on the specimen of a run; None if its matrix has no `[acceptance]`.

    Args:
        run: the run.
        characteristics: of the run, if they are known already.
    """
    try:
        bands = _bands(run)
        if bands is None:
            return None
        readings = readings_of(run, characteristics)
        results = evaluate(bands, [readings], bands.name)
        display = run_display(run.path)
    except FileProblem as error:
        return untested(run.path, str(error))
    verdict = verdict_of(results)
    result = SpecimenResult(readings.specimen, verdict, "", results)
    deciding = result.deciding
    why = "" if deciding is None else result_text(deciding, display) + _invalid(run, deciding)
    return SpecimenResult(readings.specimen, verdict, why, results)


def verdict_of(results: AcceptanceResult) -> SpecimenVerdict:
    """`not-ok` if a value fails, `ok` if every value passes, else `not-tested`."""
    if any(result.state == State.FAILED for result in results.results):
        return SpecimenVerdict.NOT_OK
    return SpecimenVerdict.OK if results.passed else SpecimenVerdict.NOT_TESTED


def untested(folder: Path, reason: str) -> SpecimenResult:
    """The verdict on a specimen of whose run nothing can be read."""
    try:
        serial_number = read_campaign(folder).get("specimen")
    except FileProblem:
        serial_number = None
    return SpecimenResult(
        serial_number if isinstance(serial_number, str) else "", SpecimenVerdict.NOT_TESTED, reason
    )


def write_specimen(folder: Path, result: SpecimenResult) -> Path:
    """Write `acceptance.json` into a campaign's folder.

    Raises:
        OSError: it cannot be written.
    """
    path = CampaignFolder(folder).acceptance
    write_text_durably(path, json.dumps(result.to_json(), indent=1, allow_nan=False) + "\n")
    return path


def read_specimen(folder: Path) -> SpecimenResult:
    """The verdict that `write_specimen` wrote.

    Raises:
        FileProblem: there is none, or it is damaged.
    """
    path = CampaignFolder(folder).acceptance
    try:
        return SpecimenResult.from_json(read_json(path))
    except (LookupError, TypeError, ValueError) as error:
        raise FileProblem(str(path), [f"damaged: {error!r}. Fix: write it again with `rig report`"]) from error


def _bands(run: Run) -> Bands | None:
    """The bands that were kept with a run; None if its matrix names none.

    Raises:
        FileProblem: they cannot be read, or bands and decision rule are not those with which the campaign was started.
    """
    folder = run.path
    matrix, hashes = CampaignFolder(folder).matrix, run.campaign.get("hashes")
    hashes = hashes if isinstance(hashes, Mapping) else {}
    if not has_acceptance(folder):
        if "acceptance" in hashes:
            raise FileProblem(str(matrix), [f"the table [acceptance] was removed {EDITED}"])
        return None
    source = read_toml(matrix)
    written = source.data["acceptance"]
    if not isinstance(written, Mapping) or not isinstance(written.get("bands"), str):
        raise FileProblem(str(matrix), ["acceptance.bands: the name of the bands file is missing"])
    file = CampaignFolder(folder).record(written["bands"])
    table, problems = validated({**written, "bands": str(file)}, AcceptanceTable)
    if table is None:
        raise FileProblem(str(matrix), lines_of(source, [(("acceptance", *place), text) for place, text in problems]))
    _unchanged(folder, file, hashes)
    if table.digest != hashes.get("acceptance", table.digest):
        raise FileProblem(str(matrix), [f"acceptance.decision was changed {EDITED}"])
    bands = load_bands(file)
    return bands if table.decision is None else bands.model_copy(update={"decision": table.decision})


def _unchanged(folder: Path, file: Path, hashes: Mapping[str, Any]) -> None:
    """Refuse bands that were edited after the campaign had started.

    Raises:
        FileProblem: they were.
    """
    files = hashes.get("files")
    name = f"{CampaignFolder.records}/{file.name}"
    if not isinstance(files, Mapping) or not files:
        return
    if name not in files:
        raise FileProblem(str(CampaignFolder(folder).matrix), [
            f"acceptance.bands names {name}, which is not a file of this campaign. Fix: restore it, or compare the "
            "run with other bands (rig compare RUN --bands FILE)"
        ])
    if files[name] != hashlib.sha256(read_bytes(file, LARGEST_BANDS_BYTES)).hexdigest():
        raise FileProblem(str(file), [
            f"the acceptance bands were changed {EDITED}"
        ])


def _invalid(run: Run, result: Result) -> str:
    """Why the points of a missing value are not valid."""
    if result.state != State.MISSING:
        return ""
    reasons = [f"{point.id}: {point.reasons[0]}" for point in run.points if point.id in result.points and point.reasons]
    return f" ({'; '.join(reasons[:3])})" if reasons else ""
