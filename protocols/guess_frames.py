"""From captured bytes to the description of a binary format: length, sync, checksum, counter, value, packed bits."""

from __future__ import annotations

import math
import struct
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Any

from protocols.binary_format import SIZES
from protocols.checksums import CHECKSUMS

LENGTHS = range(3, 65)
FEWEST = 8
"""Frames below which nothing is guessed."""
SURE = 0.95
MOST_LOOKED_AT = 8192
_TYPES = ("f32", "i32", "i24", "i16", "u16", "f64", "u24", "u32", "u8", "i8")
FEWEST_MARKS, FEWEST_SUMS = 2, 3
"""Marks that a frame usually has at least; different checksums that show that one is no mere copy."""
_ORDERS = ("little", "big")
ENDS, MARKS = frozenset({0x03, 0x0A, 0x0D}), frozenset({0x02, 0x55, 0x5A, 0x7E, 0xA5, 0xAA, 0xEB})
"""Bytes by which frames usually end (ETX, LF, CR) and begin."""


def described_frames(data: bytes) -> Iterator[dict[str, Any]]:
    """Descriptions that may fit captured bytes, the likeliest first.

    Args:
        data: as received; may begin and end inside of a frame.
    """
    data = data[:MOST_LOOKED_AT]
    yield from _packed(data)
    for length in LENGTHS:
        if len(data) < FEWEST * length:
            return
        tables = [
            _described([data[at : at + length] for at in range(begin, len(data) - length + 1, length)], length)
            for begin in _beginnings(data, length)
        ]
        described = [table for table in tables if table is not None]
        yield from sorted(described, key=lambda table: "checksum" not in table)


def _packed(data: bytes) -> Iterator[dict[str, Any]]:
    """Streams in which the highest bits of the bytes repeat: two bytes by one bit, three or four by two."""
    for count, bits in ((2, 1), (3, 2), (4, 2)):
        if len(data) < FEWEST * count:
            continue
        marks = [Counter(byte >> 8 - bits for byte in data[at::count]).most_common(1)[0] for at in range(count)]
        whole = sum(often for _, often in marks)
        if whole < SURE * len(data) or len({mark for mark, _ in marks}) < count:
            continue
        first = _first_of(tuple(mark for mark, _ in marks), count)
        ordered = [marks[(first + at) % count][0] for at in range(count)]
        rising = count > 2
        yield {
            "packed": [f"{mark:0{bits}b}" + "v" * (8 - bits) for mark in ordered],
            "order": "little" if rising else "big",
        }  # fmt: skip


def _first_of(marks: tuple[int, ...], count: int) -> int:
    """Which byte begins: the one marked 0 of three or four, the one marked 1 of two."""
    index = 1 if count == 2 else min(marks)
    return marks.index(index)


def _beginnings(data: bytes, length: int) -> Iterator[int]:
    """Where frames of that length may begin: at bytes that are nearly always the same, and that others are not."""
    columns = [Counter(data[at::length]).most_common(1)[0] for at in range(length)]
    rows = len(data) / length
    constant = [often >= SURE * rows - 1 for _, often in columns]
    if all(constant) or not any(constant):
        return
    # A run of zeros is rather the upper half of a small number than a sync; within a run an end may stand first.
    places = [at for at in range(length) if constant[at]]
    yield from sorted(places, key=lambda at: (
        columns[at][0] in {0x00, 0xFF}, not (constant[at - 1] and columns[at - 1][0] in ENDS),
        columns[at][0] not in MARKS, constant[at - 1],
    ))  # fmt: skip


def _described(frames: Sequence[bytes], length: int, most_marks: int = LENGTHS.stop) -> dict[str, Any] | None:
    """The format of frames that begin with a constant byte; so many of them are marks at most."""
    columns = [Counter(frame[at] for frame in frames).most_common(1)[0] for at in range(length)]
    constant = [often >= SURE * len(frames) - 1 for _, often in columns]
    good = [frame for frame in frames if all(
        frame[at] == columns[at][0] for at in range(length) if constant[at])]  # fmt: skip
    if len(good) < FEWEST or len(set(good)) < 3:
        return None
    marks = 0
    while marks < min(length, most_marks) and constant[marks]:
        marks += 1
    found_sum = _checksum(good, length, marks)
    if found_sum is None and marks < 2 and not (marks == 1 and constant[-1]):
        return None
    table: dict[str, Any] = {"sync": list(good[0][:marks]), "length": length}
    taken = set(range(marks)) | {at for at in range(length) if constant[at]}
    if found_sum is not None:
        table |= found_sum
        taken |= set(range(found_sum["checksum_at"], found_sum["checksum_at"] + CHECKSUMS[found_sum["checksum"]].size))
        end = found_sum["checksum_at"] + CHECKSUMS[found_sum["checksum"]].size
        if end < length and all(constant[end:]):
            table["end"] = list(good[0][end:])
    elif constant[-1]:
        table["end"] = list(good[0][-1:])
    known = set(range(marks)) | set(range(length - len(table.get("end", ())), length))
    if found_sum is not None:
        known |= taken - {at for at in range(length) if constant[at]} | {found_sum["checksum_at"]}
    fields = _fields(good, length, taken, known)
    if fields is None:
        return None
    table["fields"] = fields
    if SIZES[fields["value"]["type"]] == 1 and marks > FEWEST_MARKS:
        # Hardly a number of one byte: what stands still before it is rather its upper end.
        wider = _described(frames, length, FEWEST_MARKS)
        return table if wider is None or SIZES[wider["fields"]["value"]["type"]] == 1 else wider
    return table


def _checksum(frames: Sequence[bytes], length: int, marks: int) -> dict[str, Any] | None:
    """A sum near the end that holds in every frame."""
    sample = frames[:40]
    for name, kind in CHECKSUMS.items():
        for at in (length - kind.size, length - kind.size - 1, length - kind.size - 2):
            # The sign of a number is a copy of its neighbour, too.
            if at <= marks or len({frame[at] for frame in sample}) < FEWEST_SUMS:
                continue
            for begin in range(min(marks, 8) + 1):
                for order in _ORDERS:
                    if all(
                        kind.of(frame[begin:at]).to_bytes(kind.size, order) == frame[at : at + kind.size]  # type: ignore[arg-type]  # "little" or "big"
                        for frame in sample
                    ):
                        return {"checksum": name, "checksum_at": at, "checksum_over": [begin, at - 1],
                                "checksum_order": order}  # fmt: skip
                    if kind.size == 1:
                        break
    return None


def _fields(
    frames: Sequence[bytes], length: int, taken: set[int], known: set[int]
) -> dict[str, dict[str, Any]] | None:
    """Counter and value among the bytes that are nothing else.

    Args:
        frames: all of that length.
        length: of a frame.
        taken: bytes that are something else, or always the same.
        known: those of them that belong to marks, checksum and end.
    """
    fields: dict[str, dict[str, Any]] = {}
    for name in ("u16", "u8"):
        for order in _ORDERS if SIZES[name] > 1 else ("little",):
            for at in range(length - SIZES[name] + 1):
                places = set(range(at, at + SIZES[name]))
                if places & taken or fields:
                    continue
                numbers = _numbers(frames, at, name, order)
                modulus = 1 << 8 * SIZES[name]
                steps = [(after - before) % modulus for before, after in pairwise(numbers)]
                if steps.count(1) >= SURE * len(steps) - 1 and len(set(numbers)) > 2:
                    fields["sequence"] = {"at": at, "type": name} | ({"order": order} if SIZES[name] > 1 else {})
                    taken, known = taken | places, known | places
    value = _value(frames, length, taken, known)
    return None if value is None else {"value": value, **fields}


def _value(frames: Sequence[bytes], length: int, taken: set[int], known: set[int]) -> dict[str, Any] | None:
    """The number that is smooth beside its range, and takes the most of the bytes that change.

    Bytes that never change may be its upper end where it then takes all that nothing else explains.
    """
    still = set(range(length)) - known
    changing = {at for at in range(length) if len({frame[at] for frame in frames}) > 1} - taken
    best: tuple[float, dict[str, Any]] | None = None
    for kind in _TYPES:
        size = SIZES[kind]
        for order in _ORDERS if size > 1 else ("little",):
            for at in range(length - size + 1):
                places = set(range(at, at + size))
                whole = places == still
                if not places & changing or (places & (taken - _quiet(frames, taken)) and not whole):
                    continue
                numbers = _numbers(frames, at, kind, order)
                rough = _roughness(numbers, wide=kind.startswith("f"))
                score = rough - 0.15 * len(places & changing) + (-0.01 if whole else 0.02) * len(places - changing)
                # What stands still is the upper end of a number, not the lower one.
                score += 0.0 if (at if order == "little" else at + size - 1) in changing else 0.1
                if best is None or score < best[0] - 1e-9:
                    best = score, {"at": at, "type": kind} | ({"order": order} if size > 1 else {})
    return None if best is None else best[1]


def _quiet(frames: Sequence[bytes], taken: set[int]) -> set[int]:
    """Bytes that are 0 or FF in nearly every frame: they may be the upper end of a small number."""
    return {at for at in taken if {frame[at] for frame in frames[:200]} <= {0x00, 0xFF} and at > 0}


def _numbers(frames: Sequence[bytes], at: int, kind: str, order: str) -> list[Any]:
    size = SIZES[kind]
    if kind.startswith("f"):
        read: Callable[[bytes, int], tuple[float]] = struct.Struct(
            f"{'<' if order == 'little' else '>'}{'f' if size == 4 else 'd'}"
        ).unpack_from
        return [read(frame, at)[0] for frame in frames]
    return [
        int.from_bytes(frame[at : at + size], order, signed=kind.startswith("i"))  # type: ignore[arg-type]  # "little" or "big"
        for frame in frames
    ]


def _roughness(numbers: Sequence[float], *, wide: bool) -> float:
    """Mean and largest step beside the range: small for a signal; 2 for what is no measured number."""
    if not all(math.isfinite(number) for number in numbers):
        return 2.0
    low, high = min(numbers), max(numbers)
    largest = max(abs(low), abs(high))
    if high == low or (wide and (largest > 1e9 or 0.0 < largest < 1e-6)):
        return 2.0
    steps = [abs(after - before) for before, after in pairwise(numbers)]
    return (sum(steps) / len(steps) + 0.5 * max(steps)) / (high - low) - (0.1 if wide else 0.0)
