"""Lines of a programmable supply: commands with numbers, answers that are numbers. Bytes in, values out.

A supply's commands are data (`drivers.devices.supply`); this module contains what all supplies share. A command is
ASCII text in which `{current_A:.3f}`, `{current_mA:.0f}`, `{voltage_V:.2f}`, `{voltage_mV}` or `{time_s}`, `{time_ms}`
stand for numbers. An answer is one line; a number in it may be followed by its unit (IEEE 488.2: NR1, NR2, NR3).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from protocols.errors import LocalProtocolError, RemoteProtocolError
from protocols.patterns import Pattern

LONGEST_ANSWER = 512
LONGEST_COMMAND = 200
NO_MEASUREMENT = 9.9e37
"""SCPI's numbers for overflow and "not a number" (9.9E37, 9.91E37) are no measurements."""

FIELDS: Mapping[str, tuple[str, float, int]] = {
    "current_A": ("current", 1.0, 4), "current_mA": ("current", 1e3, 1),
    "voltage_V": ("voltage", 1.0, 3), "voltage_mV": ("voltage", 1e3, 0),
    "time_s": ("time", 1.0, 3), "time_ms": ("time", 1e3, 0),
}  # fmt: skip
"""What may stand in braces: the quantity, how many of the unit make one SI unit, places where no form is given."""

_FIELD = re.compile(r"\{([^{}:]*)(?::([^{}]*))?\}")
_FORM = re.compile(r"[+]?0?\d{0,2}(?:\.\d)?[feEgG]")
_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([a-zA-Z%]*)\s*")
_UNITS = {"": 1.0, "A": 1.0, "MA": 1e-3, "V": 1.0, "MV": 1e-3, "KV": 1e3, "ADC": 1.0, "VDC": 1.0}


@dataclass(frozen=True)
class Command:
    """One line to a supply.

    Attributes:
        text: as it was described, with its fields in braces.
        quantities: which of `current`, `voltage` and `time` stand in it.
    """

    text: str
    quantities: frozenset[str]

    @classmethod
    def of(cls, text: str) -> Command:
        """Check a described command.

        Raises:
            LocalProtocolError: not printable ASCII on one line, too long, or with a field that is none.
        """
        if not 1 <= len(text.strip()) <= LONGEST_COMMAND:
            raise LocalProtocolError(f"must have 1 to {LONGEST_COMMAND} characters")
        if not (text.isascii() and text.isprintable()):
            raise LocalProtocolError("must be printable ASCII on one line; the terminator is added ([link] terminator)")
        quantities = set()
        for name, form in _FIELD.findall(text):
            if name not in FIELDS:
                known = ", ".join("{" + field + "}" for field in FIELDS)
                raise LocalProtocolError(f"{{{name}}} is not allowed here; allowed: {known}")
            if form and not _FORM.fullmatch(form):
                raise LocalProtocolError(f"{{{name}:{form}}}: expected a number format such as {{{name}:.3f}}")
            quantities.add(FIELDS[name][0])
        if set("{}") & set(_FIELD.sub("", text)):
            raise LocalProtocolError("has an unmatched brace { or }")
        return cls(text, frozenset(quantities))

    @property
    def is_query(self) -> bool:
        """The supply answers with a value."""
        return "?" in self.text

    def line(self, current_A: float = 0.0, voltage_V: float = 0.0, time_s: float = 0.0) -> bytes:
        """The line without its end, the numbers put in."""
        values = {"current": current_A, "voltage": voltage_V, "time": time_s}

        def number(match: re.Match[str]) -> str:
            quantity, per_si, places = FIELDS[match[1]]
            # Adding 0.0 takes the sign from -0.0, which some supplies refuse.
            return format(round(values[quantity] * per_si, 9) + 0.0, match[2] or f".{places}f")

        return _FIELD.sub(number, self.text).encode("ascii")


def number_in(answer: str, pattern: Pattern | None = None) -> float:
    """The number in an answer, in SI.

    Args:
        answer: the line without its end.
        pattern: where the number stands, as its group `value`; None: the answer is the number, its unit may follow.

    Raises:
        RemoteProtocolError: there is none, or it stands for "no measurement".
    """
    text = answer
    if pattern is not None:
        match = pattern.search(answer)
        if match is None:
            raise RemoteProtocolError(f"{answer!r:.60}: does not match {pattern.text}")
        text = match["value"] or ""
    number = _NUMBER.fullmatch(text)
    scale = None if number is None else _UNITS.get(number[2].upper())
    if number is None or scale is None:
        raise RemoteProtocolError(f"{answer!r:.60}: expected a number")
    value = float(number[1]) * scale
    if not math.isfinite(value) or abs(value) >= NO_MEASUREMENT:
        raise RemoteProtocolError(f"{answer!r:.60}: means no measurement")
    return value


class AnswerLines:
    """Cuts what arrives into answers; CR, LF or both end one, and a chunk may begin and end anywhere.

    Attributes:
        malformed: lines that are too long or no ASCII, thrown away.
    """

    def __init__(self) -> None:
        self.malformed = 0
        self._rest = b""

    def feed(self, data: bytes) -> list[str]:
        """Take bytes; the answers that are complete, without their ends, empty ones left out."""
        *lines, self._rest = re.split(rb"[\r\n]", self._rest + data)
        if len(self._rest) > LONGEST_ANSWER:
            self.malformed += 1
            self._rest = b""
        answers = []
        for line in lines:
            if len(line) > LONGEST_ANSWER or not line.isascii():
                self.malformed += 1
            elif line.strip():
                answers.append(line.decode("ascii").strip())
        return answers

    def forget(self) -> None:
        """Begin anew: what was cut off is no answer."""
        self._rest = b""
