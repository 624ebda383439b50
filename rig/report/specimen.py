"""The report's part about who tested what: the specimen as the matrix describes it, operator and notes."""

from __future__ import annotations

from collections.abc import Mapping

from rig.bench.toml_source import read_toml
from rig.errors import FileProblem
from rig.recording.run import Run, read_words
from rig.report.fragment import data_list, heading, lead

PEOPLE = ("operator", "notes")


def specimen_of(run: Run) -> str:
    """The specimen's serial number; empty where nobody gave one."""
    specimen = run.campaign.get("specimen") or (run.points[0].provenance.get("specimen", "") if run.points else "")
    if isinstance(specimen, Mapping):
        specimen = specimen.get("serial_number", "")
    return str(specimen or "")


def described_specimen(run: Run) -> str:
    """Specimen, operator and notes; what was not given is said."""
    given = run.campaign.get("specimen")
    shown: dict[str, object] = {"serial number": specimen_of(run), **_matrix(run)}
    if isinstance(given, Mapping):
        shown |= {str(name): value for name, value in given.items() if isinstance(value, (str, int, float))}
        shown.pop("serial_number", None)
    typed = _typed(run)
    if typed.get("specimen"):
        shown["specimen, as typed"] = str(typed["specimen"])
    people = {name: run.campaign.get(name) or typed.get(name) for name in PEOPLE}
    shown |= {name: value for name, value in people.items() if isinstance(value, (str, int, float)) and value}
    unknown = [name for name, value in people.items() if not value]
    note = lead(f"Not given: {', '.join(unknown)}.") if unknown else ""
    return heading("Specimen and operator") + data_list(shown) + note


def _typed(run: Run) -> dict[str, object]:
    """What was typed on the operator's page; the notes in one text, with the day and who wrote each."""
    try:
        words = read_words(run.path)
    except FileProblem:
        return {}
    notes = words.get("notes")
    told = [note for note in notes if isinstance(note, Mapping)] if isinstance(notes, list) else []
    lines = [f"{note.get('utc', '')} {note.get('by', '')}: {note.get('text', '')}" for note in told]
    return {**words, "notes": "; ".join(lines)}


def _matrix(run: Run) -> dict[str, object]:
    """`[specimen]` of the matrix file that the campaign keeps, as it is written there."""
    file = run.path / "matrix.toml"
    if not file.is_file():
        return {}
    try:
        table = read_toml(file).data.get("specimen")
    except FileProblem:
        return {}
    if not isinstance(table, Mapping):
        return {}
    return {
        str(name).replace("_", " "): value for name, value in table.items()
        if isinstance(value, (str, int, float)) and name != "serial_number"
    }  # fmt: skip
