"""RPC III files (.rsp, .rpc, .tim, .drv): time histories of servo-hydraulic controllers, read and written.

Source: MTS, "RPC III File Format": records of 128 bytes (32 for the keyword, 96 for its value) in blocks of 512, then
the samples in groups: PTS_PER_GROUP samples of the first channel, as many of the second, and so on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rig.errors import FileProblem
from rig.recording.file_formats.table_file import NoLines, TableColumn, check_size
from rig.signals.arrays import FloatArray

RECORD, KEY, BLOCK = 128, 32, 512
MOST_RECORDS = 100_000
MOST_CHANNELS = 4096
INTEGERS, FLOATS = "SHORT_INTEGER", "FLOATING_POINT"
TYPES = {INTEGERS: "i2", FLOATS: "f4"}
ORDERS = {"BINARY": "<", "BINARY_IEEE_LITTLE_END": "<", "BINARY_IEEE_BIG_END": ">"}
LARGEST = 32752
"""Largest integer of a channel that RPC III software writes."""
FULL_SCALE = 32768
"""INT_FULL_SCALE of the files written here: programs that multiply by INT_FULL_SCALE / 32768 read the same values."""
KNOWN_FULL_SCALES = range(LARGEST - 1, FULL_SCALE + 1)
POINTS_PER_FRAME = 256
"""Of the files written here, one frame a group; the format requires a power of two."""
COUNTS = "counts"


def is_rpc3(data: bytes) -> bool:
    """Whether a file begins with RPC III's first keyword."""
    return data[:KEY].split(b"\0")[0].strip() == b"FORMAT" and len(data) >= BLOCK


class Rpc3File(NoLines):
    """An RPC III file; see `TableFile`. Channels by their description, or `#3`."""

    def __init__(self, file: Path, data: bytes) -> None:
        """Read its header and find its samples.

        Raises:
            FileProblem: it is damaged or was never finished, no time history, or of a variant that is not known.
        """
        self._file = file
        keys = _header(data)
        try:
            form, kind = keys["FORMAT"], keys.get("DATA_TYPE", INTEGERS)
            channels, frames = int(keys["CHANNELS"]), int(keys["FRAMES"])
            frame, group = int(keys["PTS_PER_FRAME"]), int(keys.get("PTS_PER_GROUP", keys["PTS_PER_FRAME"]))
            self._step_s, blocks = float(keys["DELTA_T"]), int(keys["NUM_HEADER_BLOCKS"])
            count = int(keys.get("SAMPLES", frames * frame))
            stated = [keys.get(f"SCALE.CHAN_{k + 1}", "") for k in range(min(channels, MOST_CHANNELS))]
            scales = [float(text or 1.0) for text in stated]
            full_scale = float(keys.get("INT_FULL_SCALE", FULL_SCALE))
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
        if frames == 0:
            raise FileProblem(str(file), ["the header of the RPC III file states FRAMES = 0: the recording was not "
                "finished. Fix: export the recording again with the controller's software"])
        if not (0 < channels <= MOST_CHANNELS and 0 < frame <= group and frames > 0 and blocks > 0
                and self._step_s > 0.0 and math.isfinite(self._step_s) and 0 < count <= frames * frame):  # fmt: skip
            raise FileProblem(str(file), ["the RPC III file is damaged: its header states impossible sizes"])
        wrong = [k + 1 for k, scale in enumerate(scales) if not math.isfinite(scale) or scale == 0.0]
        if wrong and kind == INTEGERS:
            raise FileProblem(str(file), [f"the RPC III file is damaged: SCALE.CHAN_{wrong[0]} = "
                                          f"{stated[wrong[0] - 1][:40]!r}, expected a finite number other than 0"])
        check_size(file, channels * (frames * frame + group))
        samples, rest = _samples(file, data[BLOCK * blocks :], np.dtype(dtype), (channels, frames * frame, group))
        padding = 0 if "SAMPLES" in keys else _padding(samples, group)
        self._samples = samples[:, : count - padding]
        self._scales = scales if kind == INTEGERS else [1.0] * channels
        notes = [f"RPC III {keys.get('TIME_TYPE', '')}".strip(), kind, f"{1.0 / self._step_s:g} Hz"]
        if kind == INTEGERS and int(full_scale) not in KNOWN_FULL_SCALES:
            notes.append(f"INT_FULL_SCALE {full_scale:g} not applied (value = number x SCALE)")
        if padding:
            notes.append(f"{padding} samples at the end left out (padding: no channel changes)")
        if rest:
            notes.append(f"{rest} bytes after the last sample ignored")
        self.read_as = ", ".join(notes)
        self.columns: Sequence[TableColumn] = [
            TableColumn(
                keys.get(f"DESC.CHAN_{k + 1}") or f"Channel {k + 1}",
                keys.get(f"UNITS.CHAN_{k + 1}", "") if stated[k] or kind == FLOATS else COUNTS,
                applied=f"SCALE {scales[k]:g}" if stated[k] and kind == INTEGERS else "",
            )
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
        key, value = (part.split("\0")[0].strip() for part in (record[:KEY], record[KEY:]))
        if key:
            keys.setdefault(key, value)
        if key == "NUM_HEADER_BLOCKS" and value.isdecimal():
            end = BLOCK * int(value)
    return keys


def _samples(
    file: Path, body: bytes, dtype: np.dtype[np.generic], sizes: tuple[int, int, int]
) -> tuple[FloatArray, int]:
    """Samples by channel, (channels, samples), and how many bytes follow them.

    The last group is filled up, or short.

    Raises:
        FileProblem: the file has fewer bytes than its header states.
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
    used = dtype.itemsize * (full if held >= full else short)
    return np.concatenate(parts, axis=1).astype(np.float64), len(body) - used


def _padding(samples: FloatArray, group: int) -> int:
    """How many samples at the end are none: they repeat each channel's last value up to a full group, or are all zero.

    Zeros may be more than a group, where space was reserved that the recording did not fill. A record that really ends
    so loses no motion.
    """
    same = np.all(samples == samples[:, -1:], axis=0)
    moving = np.flatnonzero(~same)
    run = samples.shape[1] - (int(moving[-1]) + 1 if len(moving) else samples.shape[1])
    padding = run if np.all(samples[:, -1] == 0.0) else min(run, group) - 1
    return padding if padding > 1 else 0


@dataclass(frozen=True)
class Rpc3Channel:
    """A channel to write: its name, its unit, and its values (n,)."""

    name: str
    unit: str
    values: FloatArray


def encoded(
    channels: Sequence[Rpc3Channel], step_s: float, described: Mapping[str, object], *, integers: bool
) -> bytes:
    """A time history as an RPC III file.

    The last group is filled up with each channel's last value; the keyword SAMPLES states how many samples there are.

    Args:
        channels: all of one length.
        step_s: time between two samples (s).
        described: further keywords, at most 32 characters, with their values, at most 96.
        integers: 16-bit integers with a scale, rounded to 1/32752 of the largest value; else 32-bit floats.

    Raises:
        ValueError: integers of values that are not finite.
    """
    if integers and not all(np.isfinite(one.values).all() for one in channels):
        raise ValueError("16-bit integers cannot represent missing values")
    rows = len(channels[0].values)
    frames = -(-rows // POINTS_PER_FRAME)
    keys: dict[str, object] = {
        "FORMAT": "BINARY_IEEE_LITTLE_END", "NUM_HEADER_BLOCKS": "", "NUM_PARAMS": "",
        "FILE_TYPE": "TIME_HISTORY", "TIME_TYPE": "RESPONSE", "DATA_TYPE": INTEGERS if integers else FLOATS,
        "DELTA_T": step_s, "CHANNELS": len(channels), "PTS_PER_FRAME": POINTS_PER_FRAME,
        "PTS_PER_GROUP": POINTS_PER_FRAME, "FRAMES": frames, "SAMPLES": rows, "BYPASS_FILTER": 0, "HALF_FRAMES": 0,
        "REPEATS": 1, "INT_FULL_SCALE": FULL_SCALE, "PARTITIONS": 1, "PART.CHAN_1": 1, "PART.NCHAN_1": len(channels),
    }  # fmt: skip
    numbers = np.empty((len(channels), frames * POINTS_PER_FRAME))
    for k, one in enumerate(channels):
        scale = (float(np.max(np.abs(one.values))) / LARGEST or 1.0) if integers else 1.0
        scaled = np.round(one.values / scale) if integers else one.values
        numbers[k] = np.pad(scaled, (0, numbers.shape[1] - rows), mode="edge")
        finite = one.values[np.isfinite(one.values)]
        keys |= {
            f"DESC.CHAN_{k + 1}": one.name, f"UNITS.CHAN_{k + 1}": one.unit, f"SCALE.CHAN_{k + 1}": scale,
            f"LOWER_LIMIT.CHAN_{k + 1}": float(np.min(finite, initial=np.inf if len(finite) else 0.0)),
            f"UPPER_LIMIT.CHAN_{k + 1}": float(np.max(finite, initial=-np.inf if len(finite) else 0.0)),
            f"MAP.CHAN_{k + 1}": k + 1,
        }  # fmt: skip
    keys |= described
    blocks = -(-len(keys) * RECORD // BLOCK)
    keys |= {"NUM_HEADER_BLOCKS": blocks, "NUM_PARAMS": len(keys)}
    records = [_cut(key, KEY) + _cut(_text(value), RECORD - KEY) for key, value in keys.items()]
    grouped = numbers.reshape(len(channels), frames, POINTS_PER_FRAME).transpose(1, 0, 2)
    return b"".join(records).ljust(BLOCK * blocks, b"\0") + grouped.astype("<i2" if integers else "<f4").tobytes()


def _text(value: object) -> str:
    return f"{value:.16E}" if isinstance(value, float) else str(value)


def _cut(text: str, size: int) -> bytes:
    return text.encode("cp1252", "replace")[: size - 1].ljust(size, b"\0")
