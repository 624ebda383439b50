"""A finished campaign, read back: `Run.open(folder)`, its points, and filters over them.

A filter such as `waveform=triangle,current_A=1` means that every condition must hold.
"""

from __future__ import annotations

import html
import math
import operator
import os
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, overload

from protocols.near_miss import meant, near_names
from rig.campaign_folder import CampaignFolder, run_path
from rig.display import Display
from rig.document.axes import draw_on
from rig.errors import DataWarning, FileProblem, NoSuchEntry, some
from rig.files.run_display import run_display
from rig.recording.point_files import unfinished
from rig.recording.recorded_point import RecordedPoint
from rig.recording.views import Over, loops_figure, run_dataset
from rig.signals.test_set import NOMINAL_SHARE, CurrentReading, names_current
from rig.test_point import ENDURANCE
from rig.text_file import read_json
from rig.verdicts import rank

if TYPE_CHECKING:
    import pandas as pd
    import xarray
    from matplotlib.axes import Axes

TEXTS = ("id", "waveform", "verdict")
MOTION = ("amplitude_m", "frequency_Hz")
NUMBERS = ("amplitude_m", "frequency_Hz", "current_A", "cycles", "repeat", "centre_m")
BLOCK_NAME = re.compile(r"-b\d+(-attempt\d+)?$")
"""Names of the files of blocks of endurance tests; other points may have such names, too."""
MOST_IDS = 12
"""Ids of points that a message lists."""
MOST_VALUES = 12
"""Values of an attribute that a message lists."""
EXACT = 1e-6
"""Relative difference of a number in a filter from a requested one that is only rounding."""

REANALYSIS = "reanalysis"
"""Entry of a campaign's description that `rig reanalyse` adds: names of the original (`of`) and of the result."""
OF_CAMPAIGN = {"campaign": "id", "campaign_hash": "hash"}
"""What a point's file and its campaign's description both state: attribute -> key."""


@dataclass(frozen=True)
class Selection:
    """Conditions (attribute, wanted values); a point meets one when its attribute equals any of the values."""

    conditions: tuple[tuple[str, tuple[str | float, ...]], ...]

    @classmethod
    def parse(cls, text: str) -> Selection:
        """Read `name=value[|value...][,name=value...]`; numbers are in the unit of the name.

        Raises:
            FileProblem: one line for each condition that cannot be read.
        """
        conditions, problems = [], []
        for part in text.split(","):
            try:
                conditions.append(_condition(part))
            except ValueError as error:
                problems.append(str(error))
        if problems:
            raise FileProblem(f"filter {text!r}", problems)
        return cls(tuple(conditions))

    def holds(self, point: object) -> bool:
        """True when the point meets every condition; measured values (of an imported test) need only be near."""
        return all(any(_equal(point, name, value) for value in values) for name, values in self.conditions)

    def values_of(self, points: Iterable[object]) -> str:
        """The values that points have of the attributes in the conditions, for a message about a filter without match.

        For example "they have frequency_Hz=0.5|1|1.5"; at most `MOST_VALUES` of an attribute.
        """
        listed = []
        points = tuple(points)
        for name in dict.fromkeys(name for name, _ in self.conditions):
            if name in TEXTS:
                texts = list(dict.fromkeys(str(getattr(point, name)) for point in points))
            else:
                texts = sorted({text for point in points if (text := _number_text(point, name))}, key=float)
            listed.append(f"{name}={some(texts, '|', MOST_VALUES)}" if texts else f"no {name}")
        return f"they have {', '.join(listed)}"


def _condition(part: str) -> tuple[str, tuple[str | float, ...]]:
    name, separator, value = (piece.strip() for piece in part.partition("="))
    if not separator or not value:
        raise ValueError(f"{part.strip()!r} is not a condition; expected, for example, waveform=triangle or "
            "current_A=1")
    if name in TEXTS:
        return name, tuple(item.strip() for item in value.split("|"))
    if name not in NUMBERS:
        near = near_names(name, (*TEXTS, *NUMBERS), 1, 0.4)
        hint = f"did you mean {near[0]}?" if near else "known: " + ", ".join((*TEXTS, *NUMBERS))
        raise ValueError(f"{name!r} is not an attribute of a point; {hint}")
    try:
        return name, tuple(float(item) for item in value.split("|"))
    except ValueError as error:
        raise ValueError(f"{name} = {value!r}: expected a number in the unit that the name states") from error


def _number_text(point: object, name: str) -> str:
    """A number of a point in as few digits as a filter needs to match it; empty if it has none."""
    value = getattr(point, name)
    if not isinstance(value, (int, float)) or not math.isfinite(value):
        return ""
    short = f"{value:.4g}"
    return short if _equal(point, name, float(short)) else f"{value:.9g}"


def _equal(point: object, name: str, required: str | float) -> bool:
    value = getattr(point, name)
    if isinstance(required, str):
        return str(value) == required
    if not isinstance(value, (int, float)):
        return False
    if name == "current_A" and not getattr(point, "current_requested", True):
        return names_current(required, CurrentReading(value))
    measured = name in MOTION and not getattr(point, "motion_requested", True)
    return math.isclose(value, required, rel_tol=NOMINAL_SHARE if measured else EXACT, abs_tol=1e-9)


@dataclass(frozen=True, repr=False)
class Run:
    """A campaign's directory and its points in the order of their names; of imported tests, in that of the import.

    `len(run)`, `for point in run`, `run["p001"]`, `run[0]` and `run[:3]` (a run of three points) are those of a
    sequence of points.

    `apart` are records of motions out of tolerance, after which the point was run again: originals that no fit uses.
    `unreadable` has one line for each file of a point that is damaged: the others are used without it.
    """

    path: Path
    points: tuple[RecordedPoint, ...]
    campaign: Mapping[str, Any] = field(default_factory=dict, repr=False)
    apart: tuple[RecordedPoint, ...] = ()
    unreadable: tuple[str, ...] = ()

    NOWHERE: ClassVar[Path] = Path(os.devnull)
    """The folder of points that were made in memory."""

    @property
    def simulated(self) -> bool:
        """Whether any of its points comes from the simulated rig."""
        return bool(self.campaign.get("simulated")) or any(point.test.get("simulated") for point in self.points)

    def __len__(self) -> int:
        return len(self.points)

    def __bool__(self) -> bool:
        """Also a run without points is one."""
        return True

    def __iter__(self) -> Iterator[RecordedPoint]:
        return iter(self.points)

    def __contains__(self, one: object) -> bool:
        """Whether a point, or a point of that id, is in the run."""
        return any(point is one or point.id == one for point in self.points)

    @overload
    def __getitem__(self, place: str | int) -> RecordedPoint: ...

    @overload
    def __getitem__(self, place: slice) -> Run: ...

    def __getitem__(self, place: str | int | slice) -> RecordedPoint | Run:
        """A point by its id or its place from 0, or a run of some of the points by a slice of places.

        Raises:
            NoSuchEntry: there is no such point.
        """
        if isinstance(place, slice):
            try:
                return replace(self, points=self.points[place], apart=(), unreadable=())
            except TypeError:
                raise NoSuchEntry(f"run: got the slice {place}, expected integer indices, for example "
                    "run[:3]") from None
        if isinstance(place, str):
            named = [point for point in self.points if point.id == place]
            if len(named) == 1:
                return named[0]
            if named:
                raise NoSuchEntry(f"run: {len(named)} points have the ID {place!r}. Fix: use an index, for example "
                    "run[0]")
            known = [point.id for point in self.points]
            shown = known if near_names(place, known) else known[:MOST_IDS]
            raise NoSuchEntry(f"run: received the point {place!r}; {meant(place, shown)}")
        try:
            return self.points[operator.index(place)]
        except IndexError:
            count = len(self.points)
            raise NoSuchEntry(f"run: got the index {place}, expected {-count} to {count - 1}") from None
        except TypeError:
            raise NoSuchEntry(
                f"run: got {place!r:.60}, expected a point ID, an index, or a slice such as run[:3]"
            ) from None

    def __repr__(self) -> str:
        """One line: folder, number of points, and how many of them are not valid."""
        where = "in memory" if self.path == self.NOWHERE else repr(str(self.path))
        others = sum(point.verdict != "valid" for point in self.points)
        return f"Run({where}, {len(self.points)} points{f', {others} of them not valid' if others else ''})"

    def _repr_html_(self) -> str:
        """The table of the points, for notebooks."""
        return f"<p>{html.escape(repr(self))}</p>{self.to_pandas().drop(columns='path').to_html(index=False)}"

    def to_xarray(self) -> xarray.Dataset:
        """All points as one xarray `Dataset`, for selection by name: `data.force_N.sel(point="p001")`.

        Returns:
            Dimensions `point` (the ids) and `sample`; variables as in the CSV export (`time_s`, `displacement_m`,
            `velocity_m_s`, `force_N`, `current_measured_A`, ...), each (point, sample) with its `units`, NaN behind
            the end of shorter points and where nothing was recorded; coordinates over `point`: `waveform`,
            `amplitude_m`, `frequency_Hz`, `current_A`, `verdict`.

        Raises:
            FileProblem: xarray is not installed, or a file cannot be read.
        """
        return run_dataset(self.points)

    def plot_loops(self, ax: Axes | None = None, *, over: Over = "velocity") -> Axes:
        """Draw the force of all points, coloured by current.

        Args:
            ax: matplotlib axes to draw on; None: new ones.
            over: `velocity` (m/s) or `displacement` (mm).

        Returns:
            The axes.

        Raises:
            RigError: matplotlib is not installed.
        """
        return draw_on(loops_figure(self.points, over), ax)

    @classmethod
    def open(cls, path: Path | str) -> Run:
        """Open a campaign's directory (or the folder it alone lies in), or a single point's file as a run of one.

        A path that does not exist can be a short name of a run in `logs/`: `last`, `-1`, part of the name.

        Damaged files of points are left out with a `DataWarning` and named in `unreadable`.

        Raises:
            FileProblem: the path is no run, or none of its points can be read; every damaged file is listed.
        """
        place = run_path(path)
        if place.is_file():
            return cls(place.parent, (RecordedPoint.open(place),), read_campaign(place.parent.parent))
        campaign = CampaignFolder.found(place)
        place = campaign.path
        files = sorted(campaign.points.glob("*.h5"), key=lambda file: file.stem)
        if not files:
            raise FileProblem(str(place), [_why_no_run(place)])
        points: list[RecordedPoint] = []
        problems: list[tuple[str, str]] = []
        for file in files:
            try:
                points.append(_opened(file))
            except FileProblem as error:
                problems += [(file.stem, problem) for problem in error.problems]
        if not points:
            raise FileProblem(str(place), [f"points/{name}.h5: {problem}" for name, problem in problems])
        described = read_campaign(place)
        points, copies = _without_copies(points)
        order = _import_order(described)
        points = sorted(points, key=lambda point: order.get(_stem(point), len(order)))
        for remark in _misplaced(points, described):
            warnings.warn(f"{place}: {remark}", DataWarning, stacklevel=2)
        unreadable = tuple(f"{name} left out: unreadable (points/{name}.h5: {problem})" for name, problem in problems)
        unreadable += copies
        if unreadable:
            fix = "restore the file from a backup, or move it out of points/"
            warnings.warn(f"{place}: {'; '.join(unreadable)}. Fix: {fix}", DataWarning, stacklevel=2)
        counted = tuple(point for point in points if not point.kept_apart)
        apart = tuple(point for point in points if point.kept_apart)
        return cls(place, counted, described, apart, unreadable)

    @property
    def name(self) -> str:
        """Name of the folder; of a result of `rig reanalyse` also that of the original run."""
        made = self.campaign.get(REANALYSIS)
        if not isinstance(made, Mapping):
            return self.path.name
        return f"{made.get('of')} (reanalysed: {made.get('name')})"

    @cached_property
    def display(self) -> Display:
        """Units and signs in which people read this run's numbers: `[display]` of its bench and matrix files.

        Raises:
            FileProblem: an entry of `[display]` is not valid.
        """
        return run_display(self.path)

    @property
    def valid(self) -> tuple[RecordedPoint, ...]:
        """The points a fit uses unless told otherwise: those judged valid, of the specimen before endurance tests."""
        return tuple(point for point in self.usable if point.verdict == "valid")

    @property
    def judged(self) -> tuple[RecordedPoint, ...]:
        """One recording of each point, whose verdict is that of the point.

        A block of an endurance test that was interrupted and continued has several recordings, which together are the
        block: the best verdict counts, then the latest recording, as while the campaign runs.
        """
        blocks: dict[str, RecordedPoint] = {}
        for number, point in enumerate(self.points):
            block = point.kind == ENDURANCE and point.endurance is not None
            name = f"block {point.provenance.get('point', point.id)}" if block else f"point {number}"
            known = blocks.get(name)
            if known is None or _piece_rank(point) >= _piece_rank(known):
                blocks[name] = point
        return tuple(blocks.values())

    @property
    def usable(self) -> tuple[RecordedPoint, ...]:
        """The points a fit can use when told so: all but the invalid ones and those of endurance tests."""
        return tuple(point for point in self.points if point.verdict != "invalid" and not point.after_cycles)

    @property
    def left_out(self) -> tuple[str, ...]:
        """One line for each point that cannot be read or is not valid: its verdict and reasons."""
        checked = (
            f"{point.id} left out: {point.verdict} ({'; '.join(point.reasons)})"
            for point in self.points if point.verdict != "valid"
        )
        return (*self.unreadable, *checked)

    def select(self, filter_text: str) -> tuple[RecordedPoint, ...]:
        """Points that meet every condition of a filter such as `waveform=triangle,current_A=1`.

        Raises:
            FileProblem: the filter names no attribute of a point, or cannot be read.
        """
        selection = Selection.parse(filter_text)
        return tuple(point for point in self.points if selection.holds(point))

    def to_pandas(self) -> pd.DataFrame:
        """One row a point, those kept apart last: wanted values, verdict, reasons, losses and skew."""
        import pandas as pd

        fields = (
            "id", "waveform", "amplitude_m", "frequency_Hz", "current_A", "cycles", "repeat", "verdict", "reasons",
            "lost_samples", "skew_s", "skew_std_s", "path",
        )
        return pd.DataFrame([{name: getattr(point, name) for name in fields} for point in (*self.points, *self.apart)])


def _piece_rank(point: RecordedPoint) -> tuple[int, int]:
    """Of the recordings of a block, the one with the highest rank is the block's."""
    before = 0 if point.endurance is None else point.endurance.cycles_before
    return rank(point.verdict), before


def _opened(file: Path) -> RecordedPoint:
    """A point of a run; all of its file is checked, but for blocks of endurance tests, of which there are thousands.

    Of these, what is read later is checked then.

    Raises:
        FileProblem: as `RecordedPoint.open`.
    """
    if BLOCK_NAME.search(file.stem):
        point = RecordedPoint.open(file, whole=False)
        if point.kind == ENDURANCE:
            return point
    return RecordedPoint.open(file)


def _stem(point: RecordedPoint) -> str:
    return "" if point.path is None else point.path.stem


def _has_own_name(point: RecordedPoint) -> bool:
    """The file is called by the point's id, or as a further attempt of it."""
    rest = _stem(point).removeprefix(point.id)
    return not rest or (rest != _stem(point) and rest[0] in "-.")


def _without_copies(points: list[RecordedPoint]) -> tuple[list[RecordedPoint], tuple[str, ...]]:
    """Points without second copies of a recording, and a line for each copy: the one with its own name stays."""
    kept: dict[object, RecordedPoint] = {}
    copies: list[str] = []
    for point in sorted(points, key=_has_own_name, reverse=True):
        recording = point.provenance.get("journal_check") or object()
        first = kept.setdefault((recording, point.id), point)
        if first is not point:
            copies.append(
                f"{_stem(point)} left out as a copy (points/{_stem(point)}.h5 contains the same recording of "
                f"{point.id} as points/{_stem(first)}.h5)"
            )
    return sorted(kept.values(), key=_stem), tuple(copies)


def _import_order(campaign: Mapping[str, Any]) -> dict[str, int]:
    """Place of each test of an imported run by its name: in the order of the files and of the sheets of a workbook."""
    entries = campaign.get("points") if campaign.get("imported") is True else None
    names = [entry.get("id") for entry in entries if isinstance(entry, dict)] if isinstance(entries, list) else []
    return {name: place for place, name in enumerate(names) if isinstance(name, str)}


def _misplaced(points: Iterable[RecordedPoint], campaign: Mapping[str, Any]) -> Iterator[str]:
    """Files that have another point's name, or come from another campaign: they are used, and named."""
    for point in points:
        if not _has_own_name(point):
            yield (
                f"points/{_stem(point)}.h5 contains the point {point.id} and is used under that ID. Fix: rename the "
                "file"
            )
        pairs = [(point.provenance.get(name), campaign.get(key)) for name, key in OF_CAMPAIGN.items()]
        if all(theirs and ours and theirs != ours for theirs, ours in pairs):
            yield (
                f"points/{_stem(point)}.h5 was recorded in another campaign ({point.provenance['campaign']}), with "
                "another bench or matrix. Fix: move it out of points/ unless it belongs to this run"
            )


def unreadable_points(folder: Path) -> list[str]:
    """One line for each file of a point in a campaign's directory that cannot be read."""
    lines = []
    for file in sorted(CampaignFolder(folder).points.glob("*.h5"), key=lambda file: file.stem):
        try:
            RecordedPoint.open(file)
        except FileProblem as error:
            lines += [f"points/{file.name} cannot be read: {problem}" for problem in error.problems]
    return lines


def read_campaign(folder: Path) -> dict[str, Any]:
    """The campaign's description, `campaign.json`; empty when there is none.

    Raises:
        FileProblem: the file is there but is not a JSON object.
    """
    file = CampaignFolder(folder).description
    if not file.is_file():
        return {}
    return read_json(file)


def planned_points(campaign: Mapping[str, Any]) -> list[str]:
    """Ids of the points that a campaign planned, by its description; none of an import, which states files."""
    planned = campaign.get("points")
    return [name for name in planned if isinstance(name, str)] if isinstance(planned, list) else []


def read_words(folder: Path) -> dict[str, Any]:
    """What was typed on the operator's page, `operator.json`: `operator`, `specimen`, `notes`; empty without one.

    Raises:
        FileProblem: the file is there but is not a JSON object.
    """
    file = CampaignFolder(folder).operator
    return read_json(file) if file.is_file() else {}


def _why_no_run(place: Path) -> str:
    if not place.exists():
        return (
            "no such folder. Fix: specify the folder of a campaign, as printed by `rig run` or listed by `rig runs`"
        )
    points = CampaignFolder(place).points
    journals = unfinished(points) if points.is_dir() else []
    if journals:
        return f"contains {len(journals)} journal(s) but no finished points. Fix: run `rig recover` on this folder"
    if CampaignFolder(place).description.is_file():
        return "no points were recorded: the campaign ended before its first point"
    return "this is not a run: it contains no points/*.h5"
