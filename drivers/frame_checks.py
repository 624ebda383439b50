"""What is counted of a current source's frames: counters, checksums, lengths, and messages that stay away."""

from __future__ import annotations

import math
from collections import deque

from drivers.current_source import SourceCounters
from drivers.devices.ecu_description import CLOCK, FAULTS, STATE, EcuDescription, HeardMessage
from protocols.can_frame import EXTENDED
from protocols.e2e import BEYOND, Protection

PATIENCE_PERIODS = 5
"""So many of its periods may pass before a message that a status needs counts as gone ..."""
LEAST_PATIENCE_NS = 100_000_000
"""... but never less than this (host time)."""
DIFFERENCES = 16
FEWEST = 3
BAD_KEPT = 4
MOST_NAMED = 3


class FrameChecks:
    """Judges each frame of the described messages by itself, and counts.

    Attributes:
        sequence: counter of the status frames, unwrapped.
    """

    def __init__(self, description: EcuDescription, counters: SourceCounters) -> None:
        self.sequence = 0
        self._description = description
        self._counters = counters
        self._last: dict[int, int] = {}
        self._heard_ns: dict[int, int] = {}
        self._differences: dict[str, deque[int]] = {}
        self._bad: dict[str, deque[bytes]] = {}
        self._good: set[str] = set()
        status = description.heard[description.status]
        # A clock that ticks at every frame tells a repeated one as a counter does.
        ticks = 0.0 < description.tick_us <= 1e6 * description.timing.status_s
        self._by_clock = status.protection.counter is None and CLOCK in status.roles and ticks
        self._companions = {
            key: max(LEAST_PATIENCE_NS, int(1e9 * PATIENCE_PERIODS * message.pages * message.period_s))
            if message.period_s
            else 0
            for key, message in description.heard.items()
            if key != description.status and any(role == STATE or role.startswith(FAULTS) for role in message.roles)
        }

    def malformed(self, is_status: bool) -> None:
        """A frame of another length or kind."""
        counters = self._counters
        counters.malformed += 1
        if is_status:
            counters.bad_in_a_row += 1
            counters.malformed_in_a_row += 1

    def measured(self, current_A: float) -> bool:
        """Whether a status that is right by itself carries a current: a float may be no number."""
        counters = self._counters
        if math.isfinite(current_A):
            counters.unmeasured_in_a_row = 0
            return True
        counters.bad_checks += 1
        counters.unmeasured_in_a_row += 1
        counters.bad_in_a_row = counters.unmeasured_in_a_row
        return False

    def step(self, key: int, message: HeardMessage, data: bytes) -> int | None:
        """Frames since the last good one of this message (1: none missing); None for one that is thrown away."""
        protection = message.protection
        is_status = key == self._description.status
        difference = protection.difference(data)
        count = protection.count(data)
        if difference or count == BEYOND:
            self._wrong(message.name, difference, is_status)
            self._bad.setdefault(message.name, deque(maxlen=BAD_KEPT)).append(data)
            return None
        self._good.add(message.name)
        if self._by_clock and is_status:
            count, modulus = self._ticks(message, data), 0
        else:
            modulus = protection.modulus
        previous = self._last.get(key)
        if count >= 0:
            self._last[key] = count
        step = 1
        if previous is not None and count >= 0:
            step = (count - previous) % modulus if modulus else int(count != previous)
        return self._count(step) if is_status else step or None

    @staticmethod
    def _ticks(message: HeardMessage, data: bytes) -> int:
        """The device's clock in a frame; -1 where it is not on this frame's page."""
        return int(message.reader.read(data).get(CLOCK, -1))

    def _count(self, step: int) -> int | None:
        """A status frame that is right by itself."""
        counters = self._counters
        counters.bad_in_a_row = counters.malformed_in_a_row = 0
        if step == 0:
            counters.duplicates += 1
            counters.lateness += 2
            return None
        counters.lateness = max(0, counters.lateness - 1)
        counters.gaps_in_a_row = counters.gaps_in_a_row + 1 if step > 1 else 0
        counters.lost += step - 1
        self.sequence += step
        return step

    def _wrong(self, name: str, difference: int, is_status: bool) -> None:
        self._counters.bad_checks += 1
        if is_status:
            self._counters.bad_in_a_row += 1
        self._differences.setdefault(name, deque(maxlen=DIFFERENCES)).append(difference)

    def heard(self, key: int, now_ns: int) -> None:
        """A good frame of this message arrived."""
        if key in self._companions:
            self._heard_ns[key] = now_ns

    def complete(self, now_ns: int) -> bool:
        """Whether state and faults, where they have messages of their own, have come and are not too old."""
        for key, patience_ns in self._companions.items():
            if key not in self._heard_ns or (patience_ns and now_ns - self._heard_ns[key] > patience_ns):
                return False
        return True

    def refusal(self) -> tuple[str, str]:
        """Slug and words of why a message cannot be believed: no frame of it has had a right checksum and counter."""
        for name, differences in self._differences.items():
            if name in self._good or len(differences) < FEWEST:
                continue
            key, protection = next(
                (key, item.protection) for key, item in self._description.heard.items() if item.name == name
            )
            message = f"every frame of {name} has a wrong checksum ({protection.profile}"
            message += f", data ID 0x{protection.data_id:X})" if protection.data_id >= 0 else ")"
            if set(differences) == {0}:
                return "ecu-crc", f"every frame of {name} has a counter outside its range ({protection.profile})"
            slug = "ecu-crc"
            if len(set(differences)) == 1 and protection.data_id >= 0:
                wrong = f"the same bits are wrong every time (0x{differences[-1]:02X}), so the E2E data ID differs"
                slug = "e2e-data-id"
                fitting = self._fitting(key & ~EXTENDED, protection, tuple(self._bad[name]))
                return slug, f"{message}; {wrong}{fitting}. Fix: write the correct data_id under [protection.{name}]"
            fix = (
                f"check the profile, the E2E data ID and the signals under [protection.{name}], and that the DBC file "
                "belongs to this ECU"
            )
            return slug, f"{message}; different bits are wrong every time. Fix: {fix}"
        return "", ""

    def _fitting(self, identifier: int, protection: Protection, frames: tuple[bytes, ...]) -> str:
        """Which data IDs would make these frames right, in words; empty where none can be told.

        First the message's own identifier, what is written read as hexadecimal, the other messages' data IDs, and then
        the nearest to the one that is written.
        """
        if protection.with_id is None:
            return ""
        fitting = protection.fitting_ids(frames)
        if not fitting:
            return "; no data ID matches the frames"
        others = [item.protection.data_id for item in self._description.heard.values()]
        others += [item.protection.data_id for item in self._description.sent]
        nearest = sorted(fitting, key=lambda number: abs(number - protection.data_id))
        likely = dict.fromkeys((identifier, int(str(protection.data_id), 16), *others, *nearest))
        named = [f"0x{number:X} ({number})" for number in likely if number in set(fitting)][:MOST_NAMED]
        if len(fitting) == 1:
            return f"; data ID {named[0]} matches the frames"
        return f"; {len(fitting)} of {protection.ids} data IDs match the frames, most likely first: {', '.join(named)}"
