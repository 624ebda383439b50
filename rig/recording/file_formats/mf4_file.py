"""MDF files (ASAM, versions 3 and 4): channels with units, on the time of their group's master channel."""

from __future__ import annotations

import io
import logging
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from rig.errors import FileProblem
from rig.extras import how_to_install
from rig.recording.file_formats.file_units import named_unit
from rig.recording.file_formats.table_file import NoLines, TableColumn, check_size, stream, unreadable
from rig.signals.arrays import FloatArray
from rig.units import Unit

READ_AS = "MDF"
ALGEBRAIC = 3
"""Kind of a conversion by a formula in text, which is not evaluated."""
NO_CONVERSION = (None, 0, 65535)
"""Kinds of a conversion that leave the numbers as they are: of version 4, and of version 3."""
SYNC_KINDS = {2: "an angle", 3: "a distance", 4: "a count"}
"""ASAM MDF 4, "synchronisation type" of a master channel: 1 is a time."""


@contextmanager
def _quiet() -> Iterator[None]:
    """Without what asammdf writes to the screen of what it leaves out."""
    logger = logging.getLogger("asammdf")
    disabled = logger.disabled
    logger.disabled = True
    try:
        with warnings.catch_warnings(), redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.disabled = disabled


def _applied(conversion: Any) -> str:  # noqa: ANN401 - of a library that mypy does not follow
    """The conversion from stored numbers that asammdf applies; empty where there is none."""
    kind = getattr(conversion, "conversion_type", None)
    factor, offset = getattr(conversion, "a", None), getattr(conversion, "b", None)
    if isinstance(factor, float) and isinstance(offset, float):
        return f"conversion {factor:g} x + {offset:g}" if (factor, offset) != (1.0, 0.0) else ""
    return "conversion of the channel" if kind not in NO_CONVERSION else ""


class Mf4File(NoLines):
    """An MDF file; see `rig.recording.file_formats.table_file.TableFile`. A channel is also found as `GROUP/CHANNEL`.

    GROUP is the number of the channel's group, from 0.
    """

    def __init__(self, file: Path, data: bytes) -> None:
        """Read which channels there are.

        Raises:
            FileProblem: it is damaged, claims to hold too much, or asammdf is not installed.
        """
        try:
            from asammdf import MDF
        except ImportError as error:
            raise FileProblem(str(file), [f"MDF files require asammdf: {how_to_install('files')}"]) from error
        self._file = file
        try:
            with _quiet():
                self._mdf: Any = MDF(stream(data))
                groups: list[tuple[int, Any]] = list(enumerate(self._mdf.groups))
                check_size(file, sum(
                    int(group.channel_group.cycles_nr) * len(group.channels) for _number, group in groups
                ))  # fmt: skip
                self._check_records(groups)
                masters: Any = self._mdf.masters_db
                self._places = sorted(
                    ((number, index) for number, group in groups for index in range(len(group.channels))),
                    key=lambda place: masters.get(place[0]) == place[1],
                )
                self.columns: Sequence[TableColumn] = [self._column(*place) for place in self._places]
                self.read_as = f"{READ_AS} {self._mdf.version}"
        except FileProblem:
            raise
        except Exception as error:
            raise FileProblem(str(file), unreadable(READ_AS, error)) from error

    def _check_records(self, groups: Sequence[tuple[int, Any]]) -> None:
        """Refuse channels that lie beyond their records: asammdf reads the memory behind them, and may end there.

        Raises:
            FileProblem: one does.
        """
        for number, group in groups:
            size = int(group.channel_group.samples_byte_nr)
            for channel in group.channels:
                first_bit = (
                    8 * int(channel.byte_offset) + int(channel.bit_offset) if hasattr(channel, "bit_offset")
                    else int(channel.start_offset) + 8 * int(channel.additional_byte_offset)
                )
                end = -(-(first_bit + int(channel.bit_count)) // 8)
                if int(channel.bit_count) > 0 and end > size:
                    raise FileProblem(str(self._file), [
                        f"group {number}: channel {str(channel.name)!r} ends at byte {end}, but its records have "
                        f"{size} bytes: the file is damaged. Fix: export the file again"
                    ])  # fmt: skip

    def _column(self, group: int, index: int) -> TableColumn:
        channel = self._mdf.groups[group].channels[index]
        return TableColumn(str(channel.name), str(self._mdf.get_channel_unit(group=group, index=index) or ""),
                             f"{group}/{channel.name}", applied=_applied(channel.conversion))  # fmt: skip

    def own_time(self, places: Sequence[int]) -> FloatArray | list[FloatArray]:
        """See `TableFile.own_time`: of the master channels.

        Raises:
            FileProblem: they hold an angle, a distance or a count.
        """
        times = [
            np.asarray(self._signal(place).timestamps, np.float64) * self._master_scale(self._places[place][0])
            for place in places
        ]
        return times[0] if all(np.array_equal(time, times[0]) for time in times) else times

    def _master_scale(self, group: int) -> float:
        """Seconds in one of a group's master channel.

        Raises:
            FileProblem: it holds no time.
        """
        index = self._mdf.masters_db.get(group)
        if index is None:
            return 1.0
        master = self._mdf.groups[group].channels[index]
        unit = str(self._mdf.get_channel_unit(group=group, index=index) or "").strip()
        kind = SYNC_KINDS.get(int(getattr(master, "sync_type", 0) or 0), "")
        known = named_unit(unit, "time") if unit else ("s", Unit("time", 1.0))
        if kind or known is None:
            what = kind or f"numbers in {unit!r}"
            raise FileProblem(str(self._file), [
                f"group {group}: the master channel {str(master.name)!r} contains {what} instead of a time. Fix: "
                "use --column time= with a time channel, or --rate"
            ])  # fmt: skip
        return known[1].scale

    def values(self, places: Sequence[int]) -> list[FloatArray]:
        """See `TableFile.values`."""
        return [self._numbers(place) for place in places]

    def _numbers(self, place: int) -> FloatArray:
        group, index = self._places[place]
        if self._mdf.masters_db.get(group) == index:
            try:
                with _quiet():
                    return np.asarray(self._mdf.get_master(group), np.float64)
            except Exception as error:
                raise FileProblem(str(self._file), unreadable(self.read_as, error)) from error
        signal = self._signal(place)
        values = np.asarray(signal.samples)
        if values.dtype.kind not in "fiub" or values.ndim != 1:
            raise FileProblem(str(self._file), [f"channel {self.columns[place].name!r} does not contain a series of "
                "numbers"])
        numbers = values.astype(np.float64)
        if signal.invalidation_bits is not None:
            numbers[np.asarray(signal.invalidation_bits, bool)] = np.nan
        return numbers

    def _signal(self, place: int) -> Any:  # noqa: ANN401 - of a library that mypy does not follow
        group, index = self._places[place]
        conversion = self._mdf.groups[group].channels[index].conversion
        if conversion is not None and getattr(conversion, "conversion_type", None) == ALGEBRAIC:
            raise FileProblem(str(self._file), [
                f"channel {self.columns[place].name!r}: the values require a text formula in the file, which this "
                "program does not evaluate. Fix: export the file with converted values"
            ])  # fmt: skip
        try:
            with _quiet():
                return self._mdf.get(group=group, index=index, ignore_invalidation_bits=True)
        except Exception as error:
            raise FileProblem(str(self._file), unreadable(self.read_as, error)) from error
