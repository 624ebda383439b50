"""Sections of the report that other packages bring: entry points `mr_rig.report_sections`, in the order of their names.

A section is a function of the run and its fit (`fit.json` as an object, or None) that returns HTML. One that fails
leaves a remark in its place: a report is never lost by it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rig.plugins import REPORT_SECTIONS, BrokenPlugIn, PlugIn, found, made_of
from rig.recording.run import Run
from rig.report.fragment import box, text

Section = Callable[[Run, Mapping[str, Any] | None], str]


def section_of(name: str, brought: object) -> Section:
    """What an entry point brings, as a section.

    Raises:
        ValueError: it cannot be called.
    """
    if not callable(brought):
        raise ValueError(f"{name}: expected a function of a run and its fit, got {type(brought).__name__}")
    return brought


def brought_sections(run: Run, fit: Mapping[str, Any] | None) -> list[str]:
    """The HTML of every installed section."""
    return [_written(plug_in, run, fit) for plug_in in found(REPORT_SECTIONS)]


def _written(plug_in: PlugIn, run: Run, fit: Mapping[str, Any] | None) -> str:
    try:
        section = made_of(plug_in, section_of)
    except BrokenPlugIn as error:
        return box("warn", f"A section is missing: {text(error)}")
    try:
        content: object = section(run, fit)
    except Exception as error:  # noqa: BLE001 - whatever foreign code raises is told in the section's place
        why = f"section {plug_in.name!r} of {plug_in.place} failed: {type(error).__name__}: {error}"
        return box("warn", f"A section is missing: {text(why)}")
    if not isinstance(content, str):
        why = f"section {plug_in.name!r} of {plug_in.place} returned {type(content).__name__}, not HTML as text"
        return box("warn", f"A section is missing: {text(why)}")
    return content
