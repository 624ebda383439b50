"""The report's head: title, people, logo, verdict in a few facts, and what the specimen was tested for and under.

What it states comes from `[report]` and `[specimen]` of the campaign's matrix file and from the operator's page.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import fmean

from rig import units
from rig.campaign_folder import CampaignFolder
from rig.characteristics.loop import LoopCharacteristics
from rig.display import SI, Display
from rig.document.blocks import Blocks, Cover, Heading, Note, Properties, Signatures
from rig.document.moments import local_time
from rig.document.numbers import number
from rig.document.picture import MOST_BYTES, Picture, picture_of
from rig.document.words import FAIR, Strong, Words, joined
from rig.errors import FileProblem
from rig.files.loader import validated
from rig.files.section import suffixed_keys
from rig.files.toml_source import read_toml
from rig.matrix.report_table import ReportTable
from rig.matrix.sections import Specimen
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run, read_words
from rig.recording.tested_on import TESTED, when_tested
from rig.report.views import AS_AMPLITUDE, AS_MEASURED, MotionTerms
from rig.signals.test_set import TESTED_SHARE
from rig.text_file import read_bytes

SEPARATOR = " \N{MIDDLE DOT} "
SPACE = "\N{NO-BREAK SPACE}"
SPECIMEN_LABELS = {"stroke": "Stroke", "coil_resistance": "Coil resistance", "max_current": "Largest current"}
"""Entries of `[specimen]` that a customer reads; the others are in the appendix."""
MOST_VALUES = 6
MEASURED_DIGITS = 3
MOST_NOTES = 12


@dataclass(frozen=True)
class Details:
    """What a run's files and its operator state in addition to what was measured.

    Attributes:
        table: `[report]`, as far as it is valid.
        logo: the logo; None without one.
        specimen: `[specimen]`, by the key without its unit.
        operator: who made the test: who had control on the page, else who the matrix file names; empty if unknown.
        entered: what the operator typed as specimen on the page.
        notes: of the operator's page, each with its time and author.
        problems: what of `[report]` could not be used.
    """

    table: ReportTable = field(default_factory=ReportTable)
    logo: Picture | None = None
    specimen: Mapping[str, str] = field(default_factory=dict)
    operator: str = ""
    entered: str = ""
    notes: Sequence[str] = ()
    problems: Sequence[str] = ()

    @classmethod
    def of(cls, run: Run, given: ReportTable | None = None) -> Details:
        """Of a run; `given` takes the place of the run's own `[report]`."""
        tables = matrix_tables(run)
        typed = _typed(run)
        table, logo, problems = (
            _own_table(run, tables.get("report")) if given is None else (given, given.picture, [])
        )
        operator = typed.get("operator") or table.operator or run.campaign.get("operator")
        notes = [
            f"{local_time(note.get('utc', ''))} {note.get('by', '')}: {note.get('text', '')}"
            for note in _list_of_mappings(typed.get("notes"))
        ]
        if written := run.campaign.get("notes"):
            notes.insert(0, str(written))
        return cls(
            table, logo, _specimen_entries(tables.get("specimen"), run.campaign.get("specimen")), str(operator or ""),
            str(typed.get("specimen") or ""), tuple(notes), tuple(problems),
        )  # fmt: skip


def specimen_of(run: Run) -> str:
    """The specimen's serial number; empty where none was given."""
    specimen = run.campaign.get("specimen") or (run.points[0].provenance.get("specimen", "") if run.points else "")
    if isinstance(specimen, Mapping):
        specimen = specimen.get("serial_number", "")
    return str(specimen or "")


def bench_of(run: Run) -> str:
    """Where the run was made, in words."""
    return next((str(name) for point in run.points if (name := point.provenance.get("bench"))), "")


def started(run: Run) -> str:
    """When the run began or its tests were run (ISO 8601); empty where that is not known."""
    stamps = (when_tested(run.campaign), *(point.provenance.get("started_utc") for point in run.points))
    return next((str(stamp) for stamp in stamps if stamp), "")


SIMULATED = "SIMULATED: all values come from the simulated rig, not from a real damper"


def mark_of(runs: Iterable[Run]) -> str:
    """What every page of a document about these runs must state; empty for runs on a test rig."""
    runs = list(runs)
    count = sum(run.simulated for run in runs)
    if not count or count == len(runs):
        return SIMULATED if count else ""
    names = ", ".join(run.name for run in runs if run.simulated)
    return f"SIMULATED: the values of {names} come from the simulated rig, not from a real damper"


def cover(run: Run, details: Details) -> Cover:
    """Title, for whom, by whom and when."""
    table, specimen = details.table, specimen_of(run)
    people = (
        ("Specimen", ", ".join(filter(None, (specimen, table.description)))), ("Customer", table.customer),
        ("Order", table.order_number), ("Laboratory", table.laboratory),
    )
    when = started(run)
    dated = TESTED in run.campaign or not _imported(run)
    made = (
        ("Tested" if dated else "Imported", local_time(when, seconds=False) if when else ""),
        ("Operator", details.operator), ("Bench", bench_of(run)),
    )  # fmt: skip
    title = table.title or f"Damper test report{f': {specimen}' if specimen else ''}"
    lines = [line_of(people), line_of(made), line_of((("Run", run.name),))]
    return Cover(title, tuple(line for line in lines if line), details.logo)


def line_of(pairs: Iterable[tuple[str, str | None]]) -> Words:
    """Names and values in a line; what has no value is left out."""
    return joined([(f"{name}{SPACE}", Strong(value)) for name, value in pairs if value], SEPARATOR)


def _imported(run: Run) -> bool:
    return any(point.imported for point in run.points)


def conditions(
    run: Run, details: Details, display: Display, load_cell: Mapping[str, object] | None = None, *,
    loops: Sequence[LoopCharacteristics] = (), terms: MotionTerms = AS_AMPLITUDE, gas_force: str = "",
) -> Blocks:
    """Specimen, people and conditions of the test, and lines for the signatures."""
    table = details.table
    points = [point for point in run.points if point.verdict != "invalid"] or list(run.points)
    stated: dict[str, object] = {
        "Specimen": specimen_of(run), "Description": table.description, "Entered on the page": details.entered,
        **{label: _in_display(details.specimen.get(key), display) for key, label in SPECIMEN_LABELS.items()},
        "Customer": table.customer, "Order number": table.order_number, "Laboratory": table.laboratory,
        "Operator": details.operator or "not given", "Bench": bench_of(run), "Load cell": _instrument(load_cell or {}),
        "Motions": _motions(points, display, terms), "Currents": _currents(points), "Cycles evaluated": _cycles(loops),
        "Static gas force": gas_force,
        "Temperature" if _imported(run) else "Coil temperature": _temperatures(points, display),
        "Signs": f"force, displacement and velocity are positive in {display.positive}", "Conditions": table.conditions,
    }  # fmt: skip
    notes: dict[str, object] = {"Notes": "\n".join(details.notes[:MOST_NOTES])}
    blocks: Blocks = [Heading("Specimen and test conditions"), Properties(stated, across=2)]
    if details.notes:
        blocks.append(Properties(notes))
    blocks += [Note(FAIR, f"[report]: {problem}") for problem in details.problems]
    return [*blocks, Signatures((("Tested by", details.operator), ("Approved by", table.approved_by or "")))]


def _instrument(attributes: Mapping[str, object]) -> str:
    serial, due = attributes.get("serial_number"), attributes.get("due")
    return "" if not serial else f"{serial}{f', calibration due {due}' if due else ''}"


def _values(values: Iterable[float], unit: str, digits: int = 4) -> str:
    """A few values one by one, many as a range."""
    known = list(dict.fromkeys(number(value, digits) for value in sorted(values)))
    if not known:
        return ""
    if len(known) > MOST_VALUES:
        return f"{known[0]} to {known[-1]} {unit} ({len(known)} values)"
    return f"{', '.join(known)} {unit}"


def _merged(values: Sequence[float]) -> list[float]:
    """Measured values, neighbours within `TESTED_SHARE` as their mean."""
    groups: list[list[float]] = []
    for value in sorted(values):
        if groups and value <= (1.0 + TESTED_SHARE) * groups[-1][0]:
            groups[-1].append(value)
        else:
            groups.append([value])
    return [fmean(group) for group in groups]


def _motions(points: Sequence[RecordedPoint], display: Display, terms: MotionTerms) -> str:
    lines = []
    for waveform in dict.fromkeys(point.waveform for point in points if point.has_frequency and not point.at_rest):
        own = [point for point in points if point.waveform == waveform and point.has_frequency]
        shown, speed = display.displacement, display.speed
        lengths = [shown.value(terms.length_m(point.amplitude_m)) for point in own]
        sizes = (
            _values(lengths, shown.unit) if all(point.motion_requested for point in own)
            else _values(_merged(lengths), shown.unit, MEASURED_DIGITS)
        )
        if terms.by_speed(waveform):
            speeds_m_s = (point.peak_speed_m_s for point in own)
            rates = f"peak velocity {_values(map(speed.value, speeds_m_s), speed.unit)}"
        else:
            rates = _values((point.frequency_Hz for point in own), "Hz")
        lines.append(f"{waveform}, {terms.length_name} {sizes}, {rates}")
    lines += sorted({point.motion for point in points if not point.has_frequency})
    return "\n".join(lines)


def _currents(points: Sequence[RecordedPoint]) -> str:
    return _values((round(point.current_A, 3) for point in points), "A")


def _cycles(loops: Sequence[LoopCharacteristics]) -> str:
    """Cycles of a test from which its forces are: without the first and the last."""
    counts = sorted({loop.cycles for loop in loops})
    if not counts:
        return ""
    return f"{counts[0]} per test" if len(counts) == 1 else f"{counts[0]} to {counts[-1]} per test"


def _temperatures(points: Sequence[RecordedPoint], display: Display) -> str:
    known = [
        value for point in points for value in (point.quality.coil_low_degC, point.quality.coil_high_degC)
        if value is not None
    ]
    if not known:
        return ""
    ends = [f"{display.temperature.value(end):.1f}" for end in (min(known), max(known))]
    return f"{' to '.join(dict.fromkeys(ends))} {display.temperature.unit}"


def matrix_tables(run: Run) -> Mapping[str, object]:
    """The campaign's matrix file, or the details of an import, as written; empty where it is missing or damaged."""
    folder = CampaignFolder(run.path)
    file = folder.matrix if folder.matrix.is_file() else folder.details
    if not file.is_file():
        return {}
    try:
        return read_toml(file).data
    except FileProblem:
        return {}


def terms_of(run: Run) -> MotionTerms:
    """The terms in which a run's motions are described: those of its matrix, of imported tests as measured."""
    return AS_MEASURED if _imported(run) else MotionTerms.of(matrix_tables(run))


def _own_table(run: Run, written: object) -> tuple[ReportTable, Picture | None, list[str]]:
    """`[report]` of a run's copy of its matrix file; a wrong entry is reported, and costs no report."""
    if not isinstance(written, Mapping):
        return ReportTable(), None, []
    logo = written.get("logo")
    table, problems = validated({key: value for key, value in written.items() if key != "logo"}, ReportTable)
    lines = [f"{'.'.join(map(str, place))}: {text}" if place else text for place, text in problems]
    picture = None
    if isinstance(logo, str):
        try:
            picture = _kept_logo(run, logo)
        except (FileProblem, ValueError) as error:
            lines.append(f"logo: {error}")
    return table or ReportTable(), picture, lines


def _kept_logo(run: Run, name: str) -> Picture:
    """The logo among the run's own copies.

    Raises:
        FileProblem: it is missing or no regular file.
        ValueError: it is no picture that is accepted.
    """
    return picture_of(read_bytes(CampaignFolder(run.path).record(name), MOST_BYTES))


def _typed(run: Run) -> Mapping[str, object]:
    """Entries of the operator's page."""
    try:
        return read_words(run.path)
    except FileProblem:
        return {}


def _list_of_mappings(value: object) -> list[Mapping[str, object]]:
    return [one for one in value if isinstance(one, Mapping)] if isinstance(value, list) else []


def _in_display(text: str | None, display: Display) -> str | None:
    """A length of the matrix file in the unit of a display that the user chose; anything else as it is written."""
    if text is None or display.displacement_unit == SI.displacement_unit:
        return text
    try:
        return display.displacement.text(units.parse(text, "length"))
    except units.UnitProblem:
        return text


def _specimen_entries(written: object, described: object) -> dict[str, str]:
    """The entries of `[specimen]` and of the campaign's description by key, a unit in the key moved to the value."""
    units, entries = suffixed_keys(Specimen), dict[str, str]()
    for table in (written, described):
        if isinstance(table, Mapping):
            for key, value in table.items():
                if isinstance(value, (str, int, float)) and not isinstance(value, bool):
                    name, unit = units.get(str(key), (str(key), ""))
                    entries.setdefault(name, f"{value} {unit}".rstrip())
    return entries
