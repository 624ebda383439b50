"""Python names of earlier versions that keep working until 2.0."""

from __future__ import annotations

from rig.matrix.point import TestPoint as EarlierTestPoint
from rig.test_point import TestPoint


def test_a_test_point_has_its_earlier_name() -> None:
    assert EarlierTestPoint is TestPoint
