"""Limits of the iterated command of a signal: every command is checked as the plan checks a point."""

from __future__ import annotations

from dataclasses import dataclass, replace

from rig.bench.model import Bench
from rig.errors import clean_text
from rig.matrix.feasibility import reasons_against, too_hot, would_fit
from rig.matrix.forecast import Forecast
from rig.matrix.model import Matrix
from rig.signals.record import Record
from rig.test_point import TestPoint


@dataclass(frozen=True)
class SignalLimits:
    """`rig.signals.drive_iteration.CommandLimits` of a signal.

    Attributes:
        point: the signal.
        matrix, bench: specimen and machine.
        predict: force and heat.
    """

    point: TestPoint
    matrix: Matrix
    bench: Bench
    predict: Forecast

    def against(self, command: Record, expected: Record) -> str:
        """Why a command may not be run, in words; empty: it may."""
        force_N, energy_J = self.predict(_moving(self.point, expected))
        causes = (
            *reasons_against(_moving(self.point, command), force_N, self.matrix, self.bench),
            *too_hot(energy_J, self.matrix),
        )
        return "; ".join(clean_text(cause.text) for cause in causes)

    def share(self, command: Record) -> float:
        """Largest factor, up to 1, by which the command may be multiplied; 0: none."""
        fits_m = would_fit(_moving(self.point, command), self.matrix, self.bench, self.predict)
        return 0.0 if fits_m is None else min(1.0, fits_m / command.amplitude_m)


def _moving(point: TestPoint, record: Record) -> TestPoint:
    """The point with another motion."""
    return replace(point, record=record, amplitude_m=record.amplitude_m)
