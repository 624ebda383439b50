"""What a user states of tests that are not recordings of this program, as one value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, get_args

from protocols.near_miss import near_names
from rig.display import Positive
from rig.errors import FileProblem
from rig.recording.file_formats.table_file import Dialect
from rig.signals.free_motion import RANDOM
from rig.signals.waveform import SINE, WAVEFORM_NAMES

if TYPE_CHECKING:
    import pandas as pd

    from rig.recording.recorded_point import RecordedPoint
    from rig.recording.run import Run

    Table = pd.DataFrame | Mapping[str, Any]
    Source = Run | RecordedPoint | Path | str | Table | Sequence[Any]


class LoadKeywords(TypedDict, total=False):
    """The keywords of `load`; `LoadOptions` explains each."""

    columns: Mapping[str, str]
    units: Mapping[str, str]
    by: str
    current_A: float | Sequence[float]
    current_from_name: str
    waveform: str
    specimen: str
    mid_stroke_m: float
    rate_Hz: float
    scales: Mapping[str, str | float]
    accept: Sequence[str]
    no_value: Sequence[float]
    dialect: Dialect
    positive: Positive


@dataclass(frozen=True)
class LoadOptions:
    """What a user states of tests that are not recordings of this program.

    Attributes:
        columns: quantity (`time`, `displacement`, `force`, `current`, `commanded_current`, `temperature`) -> name of
            its column, with the unit behind a colon where neither the name nor the file states it (`"Weg:mm"`). Empty:
            the columns whose names state quantity and unit (`force_kN`, `Force [kN]`, the names of our exports).
        units: of tables in memory, column or quantity -> unit (`{"force": "kN"}`).
        by: column of a table by whose values its rows belong to different tests.
        current_A: coil current (A) where no column has it: one number, or one for each file or table.
        current_from_name: regular expression with a group `current` (A), to be found in the names of the files.
        waveform: `sine`, `triangle`, or `random` for motion without cycles.
        specimen: serial number of the damper.
        mid_stroke_m: mid-stroke in the coordinate of the displacement (m); None: the mean of the motion.
        rate_Hz: sampling rate (Hz) of files without a time.
        scales: quantity -> factor of its column (`-1`) or sensitivity (`"500 N/V"`).
        accept: codes of implausible magnitudes that are right all the same (`units-force`, ...).
        no_value: numbers that stand for no value; None: the usual ones.
        dialect: how text files are written, where the guess is wrong.
        positive: direction in which displacement and force are positive after `scales` was applied: `rebound`
            (extension) or `compression`, for which both signs are inverted.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    by: str | None = None
    current_A: float | Sequence[float] | None = None
    current_from_name: str | None = None
    waveform: str = SINE.name
    specimen: str | None = None
    mid_stroke_m: float | None = None
    rate_Hz: float | None = None
    scales: Mapping[str, str | float] = field(default_factory=dict)
    accept: Sequence[str] = ()
    no_value: Sequence[float] | None = None
    dialect: Dialect = field(default_factory=Dialect)
    positive: Positive = "rebound"

    @classmethod
    def of(cls, keywords: Mapping[str, Any]) -> LoadOptions:
        """The options by their names.

        Raises:
            TypeError: there is no such option.
            FileProblem: a value is not one of those that are allowed.
        """
        for name in keywords:
            if name not in OPTIONS:
                near = near_names(name, OPTIONS)
                hint = f"did you mean {near[0]}?" if near else f"expected one of {', '.join(OPTIONS)}"
                raise TypeError(f"load: got the option {name!r}; {hint}")
        options = cls(**keywords)
        if options.waveform not in (*WAVEFORM_NAMES, RANDOM):
            allowed = ", ".join((*WAVEFORM_NAMES, RANDOM))
            raise FileProblem("load", [f"waveform: got {options.waveform!r}, expected one of {allowed}"])
        if options.positive not in get_args(Positive):
            raise FileProblem("load", [f"positive: got {options.positive!r}, expected rebound or compression"])
        return options


OPTIONS = tuple(one.name for one in fields(LoadOptions))
