"""Quantities as users write them."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig import units
from rig.units import UnitProblem, parse


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("50 mm", "length", 0.05),
        ("50mm", "length", 0.05),
        ("-85 mm", "length", -0.085),
        ("5 µm", "length", 5e-6),
        ("0.8 m/s", "speed", 0.8),
        ("2 inch/sec", "speed", 0.0508),
        ("1 lbs", "force", 4.4482216152605),
        ("60 m/s^2", "acceleration", 60.0),
        ("60 m/s²", "acceleration", 60.0),
        ("5 kN", "force", 5000.0),
        ("250 Hz", "frequency", 250.0),
        ("0.225 ms", "time", 0.000225),
        ("2 min", "time", 120.0),
        ("210 bar", "pressure", 2.1e7),
        ("120 degC", "temperature", 120.0),
        ("300 K", "temperature", 26.85),
        ("20 mA", "current", 0.02),
        ("1.5 ohm", "resistance", 1.5),
        ("1.5 Ω", "resistance", 1.5),
        ("1e-3 kg", "mass", 0.001),
        ("13.5 V", "voltage", 13.5),
    ],
)
def test_a_quantity_becomes_its_SI_value(text: str, dimension: str, value: float) -> None:
    assert parse(text, dimension) == pytest.approx(value, rel=1e-12)
    assert re.match(units.pattern(dimension), text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("25 N", '25 N is a force; a length is written as, for example, "50 mm"'),
        ("9.8 g", "9.8 g is a mass"),
        (50, "the number 50 has no unit"),
        (50.5, "the number 50.5 has no unit"),
        ("50", "50 has no unit"),
        ("50 MM", 'unknown unit "MM" (did you mean "mm"?)'),
        ("50 parsec", 'unknown unit "parsec" (known units: m, mm, cm'),
        ("0,5 mm", "the decimal separator must be a point"),
        ("nan mm", "not a number with a unit"),
        ("inf mm", "not a number with a unit"),
        ("1e999 mm", "the number is too large"),
        ("mm", "not a number with a unit"),
        ("", "not a number with a unit"),
        (True, "not true or false"),
        (("50 mm",), "not a list"),
        (None, "not nothing"),
        ({"mm": 50}, "not a table"),
    ],
)
def test_what_is_no_length_is_refused_with_what_would_fit(text: object, message: str) -> None:
    with pytest.raises(UnitProblem, match=re.escape(message)) as caught:
        parse(text, "length")
    assert "50 mm" in str(caught.value)


@pytest.mark.parametrize("dimension", units.DIMENSIONS)
def test_every_dimension_reads_its_own_example_and_offers_a_pattern_for_editors(dimension: str) -> None:
    example = units.DIMENSIONS[dimension].example
    assert math.isfinite(parse(example, dimension))
    assert re.match(units.pattern(dimension), example)
    assert not re.match(units.pattern(dimension), "25 furlong")


@given(value=st.floats(-1e6, 1e6), unit=st.sampled_from(sorted(units.UNITS)))
def test_what_is_shown_reads_back(value: float, unit: str) -> None:
    known = units.UNITS[unit]
    text = units.show(value, unit, digits=17)
    assert parse(text, known.dimension) == pytest.approx(value, rel=1e-9, abs=1e-9)


@given(text=st.text(max_size=40))
def test_no_text_crashes_the_parser_or_gives_a_number_that_is_not_finite(text: str) -> None:
    try:
        value = parse(text, "force")
    except UnitProblem:
        return
    assert math.isfinite(value)


def test_key_suffixes_name_units_without_signs_a_key_cannot_have() -> None:
    assert units.key_suffixes("acceleration")["m_s2"] == "m/s^2"
    assert units.key_suffixes("speed")["mm_s"] == "mm/s"


def test_a_quantity_of_any_dimension_is_split_into_value_and_dimension() -> None:
    assert units.split("2 bar") == (2e5, "pressure")
    with pytest.raises(UnitProblem, match="known unit"):
        units.split("2")
