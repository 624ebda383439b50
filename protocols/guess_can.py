"""Properties of captured CAN frames: periods, lengths, changing bytes, counters, possible checksums."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

CanFrame = tuple[float, int, bytes, bool]
"""(time s, identifier, data, extended)."""
_LOG = re.compile(r"\s*\((\d+(?:\.\d+)?)\)\s+\S+\s+([0-9A-Fa-f]+)#([0-9A-Fa-f]*)")
FEWEST = 8
SURE = 0.9


@dataclass(frozen=True)
class CanSummary:
    """One identifier on a bus.

    Attributes:
        identifier: of its frames.
        extended: 29 bits.
        count: frames heard.
        period_s: mean time between two; 0 for a single one.
        jitter_s: largest distance of one step from the mean.
        lengths: lengths of their data.
        changing: bytes that change, counted from 0.
        counters: (byte, lowest bit, bits) of what counts frames.
        checksums: bytes that may be a checksum.
        last: data of the last one.
    """

    identifier: int
    extended: bool
    count: int
    period_s: float
    jitter_s: float
    lengths: Sequence[int]
    changing: Sequence[int]
    counters: Sequence[tuple[int, int, int]]
    checksums: Sequence[int]
    last: bytes


def read_candump(text: str) -> list[CanFrame]:
    """Frames of a log as `candump -l` writes it: (1700000000.123456) can0 123#DEADBEEF; other lines are passed over."""
    frames = []
    for line in text.splitlines():
        if (match := _LOG.match(line)) is not None and len(match[3]) % 2 == 0:
            frames.append((float(match[1]), int(match[2], 16), bytes.fromhex(match[3]), len(match[2]) > 3))
    return frames


def summaries(frames: Iterable[CanFrame]) -> list[CanSummary]:
    """One summary for each identifier, in their order."""
    by_id: dict[tuple[int, bool], list[tuple[float, bytes]]] = {}
    for time_s, identifier, data, extended in frames:
        by_id.setdefault((identifier, extended), []).append((time_s, data))
    return [_summary(identifier, extended, heard) for (identifier, extended), heard in sorted(by_id.items())]


def _summary(identifier: int, extended: bool, heard: Sequence[tuple[float, bytes]]) -> CanSummary:
    times_s, payloads = [time_s for time_s, _ in heard], [data for _, data in heard]
    steps_s = [after - before for before, after in pairwise(times_s)]
    period_s = sum(steps_s) / len(steps_s) if steps_s else 0.0
    usual = Counter(map(len, payloads)).most_common(1)[0][0]
    same = [data for data in payloads if len(data) == usual]
    changing = [at for at in range(usual) if len({data[at] for data in same}) > 1]
    counters = [place for at in changing if (place := _counter([data[at] for data in same], at)) is not None]
    whole = {at for at, _, bits in counters if bits == 8}
    checksums = [at for at in changing if at not in whole and _scrambled([data[at] for data in same])]
    counting = [place for place in counters if place[0] not in checksums]
    return CanSummary(
        identifier, extended, len(heard), period_s, max((abs(step - period_s) for step in steps_s), default=0.0),
        sorted(set(map(len, payloads))), changing, counting, checksums, payloads[-1],
    )


def _counter(values: Sequence[int], at: int) -> tuple[int, int, int] | None:
    """(byte, lowest bit, bits) where a byte or half of it goes up by one with every frame, wrapping early or not."""
    for low, bits in ((0, 8), (0, 4), (4, 4)):
        numbers = [value >> low & (1 << bits) - 1 for value in values]
        if len(numbers) < FEWEST:
            return None
        if bits == 8 and max(numbers) < 16:
            continue
        ups = sum((after - before) % (1 << bits) == 1 for before, after in pairwise(numbers))
        wraps = sum(after == 0 and before != 0 for before, after in pairwise(numbers) if after != before + 1)
        if ups + wraps >= SURE * (len(numbers) - 1) and ups > wraps:
            return at, low, bits
    return None


def _scrambled(values: Sequence[int]) -> bool:
    """Whether a byte jumps about as a checksum does: nearly always another value, all over the range."""
    steps = [min((after - before) % 256, (before - after) % 256) for before, after in pairwise(values)]
    if len(values) < FEWEST or len(set(values)) < min(14, 0.5 * len(values)):
        return False
    return sum(step > 0 for step in steps) >= SURE * len(steps) and sum(steps) / len(steps) > 30
