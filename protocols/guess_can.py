"""Properties of captured CAN frames: periods, lengths, changing bytes, counters, possible checksums."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

CanFrame = tuple[float, int, bytes, bool]
"""(time s, identifier, data, extended)."""
_STAMP = r"\s*\((\d+(?:\.\d+)?)\)\s+\S+\s+"
_LOG = re.compile(_STAMP + r"([0-9A-Fa-f]{3,8})#(?:(#[0-9A-Fa-f])?([0-9A-Fa-f]*)|R([0-9A-F]?))(?:_[0-9A-F])?\s*")
"""Line of `candump -l`: 123#DEADBEEF, 123##1DEADBEEF (CAN FD), 123#R8 (remote), 20000004#... (error)."""
_SHOWN = re.compile(
    _STAMP + r"(?:[TR]X\s+\S+\s+)?([0-9A-Fa-f]{3,8})\s+\[(\d+)\]\s+"
    r"(?:(remote request)|((?:[0-9A-Fa-f]{2}\s+)*[0-9A-Fa-f]{2}))(\s+ERRORFRAME)?(?:\s+'.*')?\s*"
)
"""Line of `candump -ta`: 123   [4]  DE AD BE EF; a CAN FD frame has a two-digit length."""
_ERROR_BIT, _IDENTIFIER = 0x2000_0000, 0x1FFF_FFFF
ERRORS = {
    0x001: "transmit time-out", 0x002: "lost arbitration", 0x004: "controller problem", 0x008: "protocol violation",
    0x010: "transceiver problem", 0x020: "no acknowledgement", 0x040: "bus-off", 0x080: "bus error",
    0x100: "controller restarted",
}  # fmt: skip
"""Classes of error frames (linux/can/error.h)."""
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


@dataclass
class CanLog:
    """Content of a log, or traffic on a bus.

    Attributes:
        frames: data frames, including CAN FD.
        fd: identifiers of CAN FD frames.
        remote: identifiers that were requested by remote frames.
        errors: number of error frames by class.
        other_lines: number of lines in a log that are not frames.
    """

    frames: list[CanFrame] = field(default_factory=list)
    fd: set[int] = field(default_factory=set)
    remote: Counter[int] = field(default_factory=Counter)
    errors: Counter[str] = field(default_factory=Counter)
    other_lines: int = 0

    @property
    def is_empty(self) -> bool:
        """Whether there are no frames of any type."""
        return not (self.frames or self.remote or self.errors)


def read_candump(text: str) -> CanLog:
    """Read a log of `candump -l` or `candump -ta`; other lines are counted."""
    log = CanLog()
    for line in text.splitlines():
        if (match := _LOG.fullmatch(line)) is not None:
            stamp, name, flags, data, length = match.groups()
            _add(log, float(stamp), name, data or "", fd=flags is not None, remote=length is not None)
        elif (match := _SHOWN.fullmatch(line)) is not None:
            stamp, name, size, remote, data, error = match.groups()
            if error:
                name = f"{int(name, 16) | _ERROR_BIT:08X}"
            _add(log, float(stamp), name, (data or "").replace(" ", ""), fd=len(size) > 1, remote=remote is not None)
        elif line.strip():
            log.other_lines += 1
    return log


def _add(log: CanLog, time_s: float, name: str, data: str, *, fd: bool, remote: bool) -> None:
    number = int(name, 16)
    extended, identifier = len(name) > 3, number & _IDENTIFIER
    if extended and number & _ERROR_BIT:
        classes = [text for bit, text in ERRORS.items() if identifier & bit]
        log.errors[" and ".join(classes) or "error"] += 1
    elif remote:
        log.remote[identifier] += 1
    elif len(data) % 2:
        log.other_lines += 1
    else:
        log.frames.append((time_s, identifier, bytes.fromhex(data), extended))
        if fd:
            log.fd.add(identifier)


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
