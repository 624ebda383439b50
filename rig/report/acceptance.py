"""Acceptance bands in documents: every value with its limits and margin, and the verdict on the specimen."""

from __future__ import annotations

import math
from collections import Counter

from rig.comparison.acceptance import AcceptanceResult, Result, State
from rig.comparison.specimen import SpecimenResult
from rig.comparison.words import SEVERITIES, SPECIMEN, result_text
from rig.display import Display
from rig.document.blocks import Blocks, Column, Fact, Head, Items, Note, Paragraph, section, table
from rig.document.numbers import PLUS_MINUS, known_digits, number
from rig.document.words import Label, Words
from rig.recording.tested_specimens import SpecimenVerdict

EXPANDED = f"{PLUS_MINUS} (95 %)"
MOST_LISTED = 5
"""Values beside the deciding one on the first page."""
DECISIONS = {"simple": "The uncertainty does not affect the result."} | dict.fromkeys(
    ("guarded", "guarded-acceptance"),
    "A value passes only if the margin is at least its expanded uncertainty (ISO 14253-1, guarded acceptance).",
) | {
    "guarded-rejection": "A value fails only if it lies outside its limits by at least its expanded uncertainty "
    "(ISO 14253-1, guarded rejection)."
}


def specimen_fact(specimen: SpecimenResult) -> Fact:
    """The verdict on the specimen in one line."""
    title, severity = SPECIMEN[specimen.verdict]
    acceptance = specimen.acceptance
    if acceptance is None:
        return Fact(title, "specimen: its values could not be evaluated", severity)
    bad = len(acceptance.not_passed)
    detail = f": {bad} of {len(acceptance.results)} values" if bad else ""
    return Fact(title, f"specimen, against {acceptance.name}{detail}", severity)


def acceptance_section(specimen: SpecimenResult | None, display: Display) -> Blocks:
    """The verdict on the specimen and every value; nothing if the matrix has no acceptance bands."""
    if specimen is None:
        return []
    if specimen.acceptance is None:
        return [*section("Acceptance bands"), specimen_note(specimen)]
    return bands_section(specimen.acceptance, display, several=False)


def specimen_note(specimen: SpecimenResult) -> Note:
    """The verdict on the specimen with the value that decides."""
    title, severity = SPECIMEN[specimen.verdict]
    name = f"Specimen {specimen.serial_number}" if specimen.serial_number else "Specimen"
    nearest = "smallest margin: " if specimen.verdict == SpecimenVerdict.OK else ""
    return Note(severity, f"{name}: {title}; {nearest}{specimen.reason}")


def others_not_passed(specimen: SpecimenResult, display: Display) -> Blocks:
    """The values that did not pass besides the one that decides, the worst first; of more than a few their number."""
    acceptance, deciding = specimen.acceptance, specimen.deciding
    others = [] if acceptance is None else [result for result in acceptance.not_passed if result is not deciding]
    if not others:
        return []
    others.sort(key=lambda result: (result.state != State.FAILED, _or_last(result.margin_percent)))
    lines = [result_text(result, display) for result in others[:MOST_LISTED]]
    rest = Counter(result.title for result in others[MOST_LISTED:])
    if rest:
        counts = ", ".join(f"{title} {count}" for title, count in rest.items())
        lines.append(f"and {rest.total()} more ({counts}); the full report lists every value")
    return [Paragraph(f"Further values that did not pass: {len(others)}", small=True), Items(tuple(lines))]


def bands_section(acceptance: AcceptanceResult, display: Display, *, several: bool) -> Blocks:
    """Every value with its limits and margin; those that did not pass first."""
    ordered = sorted(acceptance.results, key=lambda result: (result.state == State.PASSED, _or_last(result.margin)))
    head: list[Head] = [
        "Result", "Quantity", "Where", *(["Run"] if several else []), Column("Value", "", True),
        Column(EXPANDED, "", True), Column("From", "", True), Column("To", "", True), "Unit",
        Column("Margin", "", True), Column("Margin", "%", True), "Remark",
    ]  # fmt: skip
    note = f"Margin: distance to the nearest limit, negative outside the limits. {DECISIONS[acceptance.decision]}"
    rows = [_result(result, display, several=several) for result in ordered]
    return [*section(f"Acceptance bands: {acceptance.name}", note), table(head, rows)]


def _result(result: Result, display: Display, *, several: bool) -> list[Words]:
    shown = result.shown(display)
    value, (low, high) = shown.signed(result.value), result.band(shown)
    expanded, margin = shown.value(result.expanded), shown.value(result.margin)
    remark = "; ".join(part for part in (result.why, result.note) if part)
    return [
        Label(str(result.state), SEVERITIES[result.state]), result.title, result.location(display),
        *([result.run] if several else []), known_digits(value, expanded), known_digits(expanded, expanded),
        number(low), number(high), shown.unit, known_digits(margin, expanded), number(result.margin_percent, 3), remark,
    ]  # fmt: skip


def _or_last(value: float) -> float:
    return value if math.isfinite(value) else math.inf
