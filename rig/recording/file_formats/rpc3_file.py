"""RPC III files (.rsp, .rpc, .tim): time histories of servo-hydraulic controllers.

Source: MTS, "RPC III File Format": records of 128 bytes (32 for the keyword, 96 for its value) in blocks of 512, then
the samples in groups: PTS_PER_GROUP samples of the first channel, as many of the second, and so on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rig.errors import FileProblem
from rig.recording.file_formats.table_file import NoLines, TableColumn, check_size
from rig.signals.arrays import FloatArray

RECORD, KEY, BLOCK = 128, 32, 512
MOST_RECORDS = 100_000
TYPES = {"SHORT_INTEGER": "i2", "FLOATING_POINT": "f4"}
ORDERS = {"BINARY": "<", "BINARY_IEEE_LITTLE_END": "<", "BINARY_IEEE_BIG_END": ">"}


def is_rpc3(data: bytes) -> bool:
    """Whether a file begins with RPC III's first keyword."""
    return data[:KEY].rstrip(b"\0 ") == b"FORMAT" and len(data) >= BLOCK


class Rpc3File(NoLines):
    """An RPC III file; see `TableFile`. Channels by their description, or `#3`."""

    def __init__(self, file: Path, data: bytes) -> None:
        """Read its header and find its samples.

        Raises:
            FileProblem: it is damaged, no time history, or of a variant that is not known.
        """
        self._file = file
        keys = _header(data)
        try:
            form, kind = keys["FORMAT"], keys.get("DATA_TYPE", "SHORT_INTEGER")
            channels, frames = int(keys["CHANNELS"]), int(keys["FRAMES"])
            frame, group = int(keys["PTS_PER_FRAME"]), int(keys.get("PTS_PER_GROUP", keys["PTS_PER_FRAME"]))
            self._step_s, blocks = float(keys["DELTA_T"]), int(keys["NUM_HEADER_BLOCKS"])
            scales = [float(keys.get(f"SCALE.CHAN_{k + 1}", 1.0)) for k in range(min(channels, 4096))]
        except KeyError as error:
            raise FileProblem(str(file), [f"the RPC III file is damaged: keyword {error} is missing"]) from error
        except ValueError as error:
            raise FileProblem(str(file), [
                f"the header of the RPC III file contains an invalid number: {error}"
            ]) from error
        dtype, history = f"{ORDERS.get(form, '')}{TYPES.get(kind, '')}", keys.get("FILE_TYPE", "TIME_HISTORY")
        if len(dtype) != 3 or history != "TIME_HISTORY":
            raise FileProblem(str(file), [
                f"the RPC III file has FORMAT {form[:40]!r}, DATA_TYPE {kind[:40]!r}, FILE_TYPE {history[:40]!r}; "
                f"expected FORMAT {' or '.join(ORDERS)}, DATA_TYPE {' or '.join(TYPES)}, FILE_TYPE TIME_HISTORY. Fix: "
                "export the file in one of these formats, or as CSV"
            ])  # fmt: skip
        if not (0 < channels <= 4096 and 0 < frame <= group and frames > 0 and blocks > 0 and self._step_s > 0.0
                and math.isfinite(self._step_s)):  # fmt: skip
            raise FileProblem(str(file), ["the RPC III file is damaged: its header states impossible sizes"])
        check_size(file, channels * (frames * frame + group))
        self._samples = _samples(file, data[BLOCK * blocks :], np.dtype(dtype), (channels, frames * frame, group))
        self._scales = scales if kind == "SHORT_INTEGER" else [1.0] * channels
        self.read_as = f"RPC III, {kind}, {1.0 / self._step_s:g} Hz" + ", SCALE applied" * (kind == "SHORT_INTEGER")
        self.columns: Sequence[TableColumn] = [
            TableColumn(keys.get(f"DESC.CHAN_{k + 1}") or f"Channel {k + 1}", keys.get(f"UNITS.CHAN_{k + 1}", ""))
            for k in range(channels)
        ]

    def own_time(self, places: Sequence[int]) -> FloatArray:
        """See `TableFile.own_time`: of the step in the header."""
        del places
        return np.asarray(self._step_s * np.arange(self._samples.shape[1]), np.float64)

    def values(self, places: Sequence[int]) -> list[FloatArray]:
        """See `TableFile.values`."""
        return [np.asarray(self._samples[place] * self._scales[place], np.float64) for place in places]


def _header(data: bytes) -> dict[str, str]:
    """Keywords and values of all records in the header's blocks."""
    keys: dict[str, str] = {}
    end = BLOCK
    for place in range(0, min(len(data), RECORD * MOST_RECORDS), RECORD):
        if place >= end:
            break
        record = data[place : place + RECORD].decode("cp1252", "replace")
        key, value = record[:KEY].rstrip("\0 "), record[KEY:].split("\0")[0].strip()
        if key:
            keys.setdefault(key, value)
        if key == "NUM_HEADER_BLOCKS" and value.isdecimal():
            end = BLOCK * int(value)
    return keys


def _samples(file: Path, body: bytes, dtype: np.dtype[np.generic], sizes: tuple[int, int, int]) -> FloatArray:
    """Samples by channel, (channels, samples). The last group is filled up with zeros, or short.

    Raises:
        FileProblem: the file has fewer or more bytes than its header states.
    """
    channels, count, group = sizes
    groups, rest = divmod(count, group)
    held = len(body) // dtype.itemsize
    full, short = (groups + (rest > 0)) * group * channels, count * channels
    if held < short or (full != short and short < held < full):
        raise FileProblem(str(file), [
            f"the RPC III file is truncated or damaged: {held} numbers after the header, expected {full}"
        ])  # fmt: skip
    numbers = np.frombuffer(body, dtype, held)
    whole = numbers[: groups * group * channels].reshape(groups, channels, group).transpose(1, 0, 2)
    parts = [whole.reshape(channels, groups * group)]
    if rest:
        last, width = numbers[groups * group * channels :], group if held >= full else rest
        parts.append(last[: channels * width].reshape(channels, width)[:, :rest])
    return np.concatenate(parts, axis=1).astype(np.float64)
