"""Name of `rig.test_point` until 2.0."""

from __future__ import annotations

from rig.test_point import Forecast, TestPoint

__all__ = ["Forecast", "TestPoint"]
