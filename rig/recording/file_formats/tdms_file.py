"""TDMS files of LabVIEW: channels in groups, with their units and wave form times."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from rig.errors import FileProblem
from rig.extras import how_to_install
from rig.recording.file_formats.table_file import (
    NoLines,
    TableColumn,
    check_equal_lengths,
    check_size,
    stream,
    unapplied_factor,
    unreadable,
)
from rig.recording.file_formats.text_cells import seconds_of_dates
from rig.signals.arrays import FloatArray

UNITS = ("unit_string", "NI_UnitDescription", "NI_ChannelUnit", "unit", "Unit")
"""Properties in which programs write a channel's unit."""
APPLIED = ("NI_Scale[", "NI_Number_Of_Scales", "NI_Scaling_Status", "NI_UnitDescription", "NI_ChannelUnit", "wf_")
"""Beginnings of the names of properties that LabVIEW defines: npTDMS applies the scales among them."""
READ_AS = "TDMS"
SCALES = "NI_Number_Of_Scales"
MOST_SCALES = 256
"""npTDMS counts the scales of a channel one by one, however many a damaged file claims."""


class TdmsFile(NoLines):
    """A TDMS file; see `TableFile`. A channel is also found as `GROUP/CHANNEL`."""

    def __init__(self, file: Path, data: bytes) -> None:
        """Read all channels.

        Raises:
            FileProblem: it is damaged, claims to hold too much, or npTDMS is not installed.
        """
        try:
            from nptdms import TdmsFile as Reader
        except ImportError as error:
            raise FileProblem(str(file), [f"TDMS files require npTDMS: {how_to_install('files')}"]) from error
        self._file, self.read_as = file, READ_AS
        try:
            with warnings.catch_warnings(), _logged() as remarks:
                warnings.simplefilter("ignore")  # on what it leaves out
                heads = Reader.read_metadata(stream(data))
                check_size(file, sum(len(channel) for group in heads.groups() for channel in group.channels()))
                _check_scales(file, heads)
                groups = Reader.read(stream(data)).groups()
                self._channels = [channel for group in groups for channel in group.channels()]
                self._values: dict[int, Any] = {k: channel[:] for k, channel in enumerate(self._channels)}
        except FileProblem:
            raise
        except Exception as error:
            raise FileProblem(str(file), unreadable(READ_AS, error)) from error
        if remarks:
            self.read_as = f"{READ_AS}, truncated or damaged: {remarks[0]}"
        self.columns: Sequence[TableColumn] = [
            TableColumn(channel.name, _unit(channel.properties), f"{channel.group_name}/{channel.name}",
                          self._unapplied(channel), applied=_applied(channel.properties))
            for channel in self._channels
        ]  # fmt: skip

    @staticmethod
    def _unapplied(channel: Any) -> str:  # noqa: ANN401 - of a library without annotations
        """What may be the factor of a channel's integers; scales of LabVIEW that npTDMS does not know are one too."""
        properties = channel.properties
        if not np.issubdtype(channel.dtype, np.integer):
            return ""
        kinds = [str(value) for name, value in properties.items() if str(name).endswith("_Scale_Type")]
        if kinds and str(properties.get("NI_Scaling_Status", "unscaled")) != "scaled":
            return f"'Scale_Type' = {kinds[0]}"
        return unapplied_factor({
            name: value for name, value in properties.items() if not str(name).startswith(APPLIED)
        })

    def is_stamps(self, place: int) -> bool:
        """See `TableFile.is_stamps`."""
        return bool(np.asarray(self._values[place]).dtype.kind == "M")

    def own_time(self, places: Sequence[int]) -> FloatArray | None:
        """See `TableFile.own_time`: from the channels' wave form properties, which must agree.

        Raises:
            FileProblem: they do not.
        """
        waves = {_wave(self._channels[place].properties) for place in places}
        if len(waves) > 1:
            reported = ", ".join(f"{self.columns[place].name}: {_wave(self._channels[place].properties)}"
                             for place in places)  # fmt: skip
            problem = f"the channels were not sampled together (start, step in s, start time): {reported}"
            raise FileProblem(str(self._file), [problem])
        (wave,) = waves
        if wave is None:
            return None
        return np.asarray(wave[0] + wave[1] * np.arange(len(self._values[places[0]])), np.float64)

    def values(self, places: Sequence[int]) -> list[FloatArray]:
        """See `TableFile.values`."""
        names = [self.columns[place].name for place in places]
        check_equal_lengths(self._file, names, [len(self._values[place]) for place in places])
        return [self._numbers(place) for place in places]

    def _numbers(self, place: int) -> FloatArray:
        values = np.asarray(self._values[place])
        if values.dtype.kind == "M":
            return seconds_of_dates(values)
        if values.dtype.kind not in "fiub":
            raise FileProblem(str(self._file), [f"channel {self.columns[place].name!r} contains no numbers"])
        return values.astype(np.float64)


def _check_scales(file: Path, heads: Any) -> None:  # noqa: ANN401 - of a library without annotations
    """Refuse more scales than a channel can have.

    Raises:
        FileProblem: there are.
    """
    holders = [heads, *heads.groups(), *(channel for group in heads.groups() for channel in group.channels())]
    for holder in holders:
        count = holder.properties.get(SCALES, 0)
        if not isinstance(count, (int, np.integer)) or not 0 <= int(count) <= MOST_SCALES:
            raise FileProblem(str(file), [
                f"{SCALES} = {str(count)[:40]}, expected at most {MOST_SCALES}: the file is damaged. Fix: export "
                "the file again"
            ])


@contextmanager
def _logged() -> Iterator[list[str]]:
    """What npTDMS logs meanwhile, kept off the screen: a file that was cut off is read as far as it goes."""
    from nptdms.log import log_manager

    remarks: list[str] = []

    def keep(record: logging.LogRecord) -> bool:
        remarks.append(record.getMessage().replace(";", ","))
        return False

    log_manager.console_handler.addFilter(keep)
    try:
        yield remarks
    finally:
        log_manager.console_handler.removeFilter(keep)


def _unit(properties: Any) -> str:  # noqa: ANN401 - of a library without annotations
    return next((str(properties[name]).strip() for name in UNITS if properties.get(name)), "")


def _applied(properties: Any) -> str:  # noqa: ANN401 - of a library without annotations
    """The scales of LabVIEW that npTDMS applies; empty where there are none."""
    texts = []
    for k in range(int(properties.get(SCALES, 0))):
        kind = str(properties.get(f"NI_Scale[{k}]_Scale_Type", ""))
        slope, offset = (properties.get(f"NI_Scale[{k}]_Linear_{name}") for name in ("Slope", "Y_Intercept"))
        linear = kind == "Linear" and isinstance(slope, float) and isinstance(offset, float)
        texts.append(f"{slope:g} x + {offset:g}" if linear else kind)
    return f"NI_Scale {', '.join(text for text in texts if text)}" if any(texts) else ""


def _wave(properties: Any) -> tuple[float, float, str] | None:  # noqa: ANN401 - of a library without annotations
    """Start and step (s) of a wave form, and the date and time that it counts from, empty where it says none."""
    try:
        step, start = float(properties["wf_increment"]), float(properties.get("wf_start_offset", 0.0))
    except (KeyError, TypeError, ValueError):
        return None
    begun = str(properties.get("wf_start_time", ""))
    return (start, step, begun) if np.isfinite(step) and step > 0.0 and np.isfinite(start) else None
