"""Lines of a supply: numbers into commands, numbers out of answers, wherever the bytes were cut."""

from __future__ import annotations

import re

import pytest

from protocols.errors import LocalProtocolError, RemoteProtocolError
from protocols.patterns import Pattern
from protocols.scpi import AnswerLines, Command, number_in


@pytest.mark.parametrize(
    ("text", "sent"),
    [
        ("CURR {current_A:.3f}", b"CURR 1.250"),
        ("ISET1:{current_mA:.0f}", b"ISET1:1250"),
        ("CURR {current_A}", b"CURR 1.2500"),
        ("SOUR:CURR {current_A:.4E}", b"SOUR:CURR 1.2500E+00"),
        ("VOLT {voltage_V:.2f};CURR {current_A:.2f}", b"VOLT 12.00;CURR 1.25"),
        ("WDOG {time_ms:.0f}", b"WDOG 2000"),
        ("PC {current_A:06.3f}", b"PC 01.250"),
        ("*RST", b"*RST"),
    ],
)
def test_numbers_are_put_into_a_command_as_it_says(text: str, sent: bytes) -> None:
    assert Command.of(text).line(1.25, 12.0, 2.0) == sent


def test_zero_has_no_sign() -> None:
    assert Command.of("CURR {current_A:.3f}").line(-0.0) == b"CURR 0.000"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("CURR {current}", "{current} is not allowed here; allowed: {current_A}"),
        ("CURR {current_A.__class__}", "is not allowed here"),
        ("CURR {current_A:>{width}}", "is not allowed here"),
        ("CURR {current_A:999999999f}", "such as {current_A:.3f}"),
        ("CURR {current_A", "unmatched brace"),
        ("CURR 1\nOUTP ON", "on one line"),
        ("CURR 1 µA", "ASCII"),
        ("", "1 to 200 characters"),
    ],
)
def test_a_command_that_cannot_be_sent_is_refused(text: str, says: str) -> None:
    with pytest.raises(LocalProtocolError, match=re.escape(says)):
        Command.of(text)


@pytest.mark.parametrize(
    ("answer", "value"),
    [
        ("+1.50000000E+00", 1.5), ("0.500", 0.5), ("  -12 ", -12.0), (".5", 0.5), ("1.20A", 1.2), ("350 mA", 0.35),
        ("1.5E-3", 0.0015), ("12.00 V", 12.0),
    ],
)  # fmt: skip
def test_an_answer_is_a_number_with_or_without_its_unit(answer: str, value: float) -> None:
    assert number_in(answer) == pytest.approx(value)


@pytest.mark.parametrize("answer", ["9.91E37", "9.9E+37", "nan", "inf", "", "OVLD", "1,5", "1.5 kg", "1.5 2.5", "0x10"])
def test_what_is_no_measurement_is_refused(answer: str) -> None:
    with pytest.raises(RemoteProtocolError):
        number_in(answer)


def test_a_pattern_says_where_the_number_stands() -> None:
    pattern = Pattern(r"^I1 (?P<value>[-+0-9.]+)$")
    assert number_in("I1 -0.25", pattern) == -0.25
    with pytest.raises(RemoteProtocolError, match="does not match"):
        number_in("V1 12.0", pattern)


def test_answers_are_the_same_wherever_the_bytes_were_cut() -> None:
    data = b"KEPCO,BOP\r\n+1.5E0\r\r\n\n0.25\n"
    for cut in range(len(data) + 1):
        lines = AnswerLines()
        assert lines.feed(data[:cut]) + lines.feed(data[cut:]) == ["KEPCO,BOP", "+1.5E0", "0.25"]


def test_a_line_without_end_is_thrown_away() -> None:
    lines = AnswerLines()
    assert lines.feed(b"7" * 2000) == []
    assert lines.feed(b"\xff1\n1.0\n") == ["1.0"]
    assert lines.malformed == 2
