"""The report's section on specimen and operator: the specimen as the matrix describes it, operator and notes."""

from __future__ import annotations

from collections.abc import Mapping

from rig.campaign_folder import CampaignFolder
from rig.document.blocks import Blocks, Heading, Paragraph, Properties
from rig.errors import FileProblem
from rig.files.toml_source import read_toml
from rig.recording.run import Run, read_words

PEOPLE = ("operator", "notes")


def specimen_of(run: Run) -> str:
    """The specimen's serial number; empty where none was given."""
    specimen = run.campaign.get("specimen") or (run.points[0].provenance.get("specimen", "") if run.points else "")
    if isinstance(specimen, Mapping):
        specimen = specimen.get("serial_number", "")
    return str(specimen or "")


def described_specimen(run: Run) -> Blocks:
    """Specimen, operator and notes; missing entries are named."""
    given = run.campaign.get("specimen")
    shown: dict[str, object] = {"serial number": specimen_of(run), **_matrix(run)}
    if isinstance(given, Mapping):
        shown |= {str(name): value for name, value in given.items() if isinstance(value, (str, int, float))}
        shown.pop("serial_number", None)
    typed = _typed(run)
    if typed.get("specimen"):
        shown["specimen, as entered"] = str(typed["specimen"])
    people = {name: run.campaign.get(name) or typed.get(name) for name in PEOPLE}
    shown |= {name: value for name, value in people.items() if isinstance(value, (str, int, float)) and value}
    unknown = [name for name, value in people.items() if not value]
    note: Blocks = [Paragraph(f"Not given: {', '.join(unknown)}.", small=True)] if unknown else []
    return [Heading("Specimen and operator"), Properties(shown), *note]


def _typed(run: Run) -> dict[str, object]:
    """Entries of the operator's page; the notes in one text, each with its time and author."""
    try:
        words = read_words(run.path)
    except FileProblem:
        return {}
    notes = words.get("notes")
    known = [note for note in notes if isinstance(note, Mapping)] if isinstance(notes, list) else []
    lines = [f"{note.get('utc', '')} {note.get('by', '')}: {note.get('text', '')}" for note in known]
    return {**words, "notes": "; ".join(lines)}


def _matrix(run: Run) -> dict[str, object]:
    """`[specimen]` of the campaign's matrix file, as written there."""
    file = CampaignFolder(run.path).matrix
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
