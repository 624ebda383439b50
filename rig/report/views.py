"""What the report shows of each point: its loop, thinned for drawing, and its errors in the fit, made once."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rig.characteristics.loop import LoopCharacteristics
from rig.display import SI, Display, Shown
from rig.document.figure import thinned
from rig.document.numbers import number
from rig.errors import RigError, evaluating
from rig.fits.entries import TestError
from rig.identification.application.law import Law
from rig.identification.models.coil import with_lag
from rig.identification.models.measurement import Measurement, closed_cycle
from rig.identification.points.preparation import prepare
from rig.recording.quality.campaign_delay import PointSkew
from rig.recording.recorded_point import RecordedPoint
from rig.signals.arrays import FloatArray
from rig.signals.peak_force import PeakForce
from rig.signals.waveform import WAVEFORMS
from rig.test_point import HYBRID, RESPONSE, peak_speed_m_s, rate_text

DRAWN_OF_CYCLE, DRAWN_OF_RECORD = 300, 1500
"""Samples at most: a record has many reversals, which fewer samples would cut off."""


@dataclass(frozen=True)
class Loop:
    """One cycle, thinned for drawing (k,): mm about mid-stroke, m/s, N; `fitted_N` None where there is no fit.

    `phase` runs from 0 to 1 over the cycle.
    """

    phase: FloatArray
    displacement_mm: FloatArray
    velocity_m_s: FloatArray
    force_N: FloatArray
    fitted_N: FloatArray | None


@dataclass(frozen=True)
class MotionTerms:
    """The terms in which the matrix states cyclic motions: stroke for amplitude, peak speed for frequency.

    Motions that are `measured`, not requested, have three digits, and their frequency as well as their peak speed.
    """

    stroke: bool = False
    speed: bool = False
    measured: bool = False

    @classmethod
    def of(cls, matrix: Mapping[str, object]) -> MotionTerms:
        """Of the tables of a matrix file as they are written; of the first that states the size of a motion."""
        points = matrix.get("point")
        for table in (matrix.get("matrix"), *(points if isinstance(points, list) else ())):
            keys = {str(key).partition("_")[0] for key in table} if isinstance(table, Mapping) else set()
            if keys & {"amplitude", "stroke", "speed"}:
                return cls("stroke" in keys, "speed" in keys and "frequency" not in keys)
        return cls()

    def size(self, waveform: str, amplitude_m: float, frequency_Hz: float, display: Display) -> str:
        """Size and rate of a motion: "amplitude 50 mm, 1 Hz", "stroke 2 in, 10 in/s"."""
        return f"{self.length(amplitude_m, display)}, {self.rate(waveform, amplitude_m, frequency_Hz, display)}"

    def words(self, waveform: str, amplitude_m: float, frequency_Hz: float, display: Display) -> str:
        """A motion with its waveform: "sine, amplitude 50 mm, 1 Hz"."""
        return f"{waveform}, {self.size(waveform, amplitude_m, frequency_Hz, display)}"

    def length(self, amplitude_m: float, display: Display) -> str:
        """Amplitude or stroke with its word."""
        shown, length_m = display.displacement, self.length_m(amplitude_m)
        return f"{self.length_name} {_three_digits(shown, length_m) if self.measured else shown.text(length_m)}"

    @property
    def length_name(self) -> str:
        """The word for `length_m`."""
        return "stroke" if self.stroke else "amplitude"

    def length_m(self, amplitude_m: float) -> float:
        """Amplitude or stroke of a motion of this amplitude, m."""
        return 2.0 * amplitude_m if self.stroke else amplitude_m

    def rate(self, waveform: str, amplitude_m: float, frequency_Hz: float, display: Display) -> str:
        """Peak speed or frequency; of what was measured both."""
        if self.measured:
            speed = f", {_three_digits(display.speed, peak_speed_m_s(waveform, amplitude_m, frequency_Hz))}"
            return f"{number(frequency_Hz, 3)} Hz{speed if waveform in WAVEFORMS else ''}"
        return rate_text(waveform, amplitude_m, frequency_Hz, display, by_speed=self.speed)

    def by_speed(self, waveform: str) -> bool:
        """Whether the rate of such a motion is named by its peak speed."""
        return self.speed and waveform in WAVEFORMS


AS_AMPLITUDE = MotionTerms()
"""Amplitude and frequency."""
AS_MEASURED = MotionTerms(measured=True)
"""Of imported tests."""


def _three_digits(shown: Shown, si: float) -> str:
    """A measured magnitude (SI) with its unit."""
    return f"{number(shown.value(si), 3)} {shown.unit}"


@dataclass(frozen=True)
class PointView:
    """A point, its loop (None when it cannot be drawn, and `why`), and its errors in the fit; None without.

    `standard` are the results of the standard tests of a loop, `display` the units and signs in which all is shown.
    """

    point: RecordedPoint
    loop: Loop | None
    why: str = ""
    error: TestError | None = None
    held_out: bool = False
    measured: Measurement | None = field(default=None, repr=False)
    standard: LoopCharacteristics | None = field(default=None, repr=False)
    display: Display = SI
    terms: MotionTerms = AS_AMPLITUDE

    @property
    def error_percent(self) -> float | None:
        """Error of the fit on this point, % of force amplitude; None where it is not known."""
        error = math.nan if self.error is None else self.error.nrmse_percent_of_peak
        return None if math.isnan(error) else error

    @property
    def beyond(self) -> Sequence[str]:
        """Quantities in which the point lies outside the fitted data; empty where in none, or unknown."""
        return () if self.error is None else self.error.beyond or ()

    @property
    def peak_force(self) -> PeakForce | None:
        """The largest forces (N); None where the force was not recorded."""
        if self.standard is not None:
            return self.standard.peak_force_N
        try:
            return self.point.peak_force_N
        except RigError:
            return None

    @property
    def level_A(self) -> float:
        """The level of current to which the point belongs (A)."""
        return self.point.current_A if self.standard is None else self.standard.level_A

    @property
    def group(self) -> str:
        """The motion to which the point belongs, in words."""
        if self.standard is None:
            return motion_of(self)
        return self.terms.words(self.point.waveform, *self.standard.group, self.display)

    @property
    def figure_name(self) -> str:
        """The motion as `rig.report.figures` names it, whatever the matrix states: "sine, 50 mm, 1 Hz"."""
        if self.standard is None or not self.point.has_frequency:
            return motion_of(self)
        amplitude_m, frequency_Hz = self.standard.group
        return f"{self.point.waveform}, {self.display.displacement.text(amplitude_m)}, {frequency_Hz:.4g} Hz"


def completed_views(
    views: Sequence[PointView], loops: Sequence[LoopCharacteristics], display: Display,
    terms: MotionTerms = AS_AMPLITUDE,
) -> list[PointView]:
    """The points with the results of the standard tests, as they are to be shown."""
    known = {loop.id: loop for loop in loops}
    return [replace(view, standard=known.get(view.point.id), display=display, terms=terms) for view in views]


def view_of(
    point: RecordedPoint, law: Law | None = None, error: TestError | None = None, *, held_out: bool = False,
    skew: PointSkew | None = None,
) -> PointView:
    """Prepare a point for drawing; a point that cannot be drawn states the reason.

    Args:
        point: the point.
        law: the fitted damper; None: measurements only.
        error: the point's errors in the fit.
        held_out: whether the point was kept for validation.
        skew: what the whole campaign shows of the sensors' delays, as used for the fit.
    """
    if point.at_rest:
        return PointView(point, None, "the rod was at rest while the current was stepped", error, held_out)
    if point.kind == RESPONSE:
        return PointView(point, None, "the current is stepped during the motion", error, held_out)
    if point.kind == HYBRID:
        return PointView(point, None, "the motion of a hybrid test has no cycles", error, held_out)
    try:
        with evaluating("it"):
            measured = prepare(point, skew)
            if law is not None and law.eta_1_s is not None:
                measured = with_lag(measured, law.eta_1_s)
            fitted_N = None if law is None else law.force_of(measured)
            loop = _middle_cycle(measured, fitted_N)
    except RigError as problem:
        return PointView(point, None, str(problem), error, held_out)
    return PointView(point, loop, "", error, held_out, measured)


def _middle_cycle(measured: Measurement, fitted_N: FloatArray | None) -> Loop:
    cyclic, closed = measured.samples_per_cycle > 0, closed_cycle(measured)
    places = thinned(closed.size, DRAWN_OF_CYCLE if cyclic else DRAWN_OF_RECORD)
    chosen = closed[places]
    force = np.where(measured.scored, measured.force_N, np.nan)
    if fitted_N is not None and not cyclic:  # a record's ends are driven, and not judged
        fitted_N = np.where(measured.scored, fitted_N, np.nan)
    return Loop(
        phase=places / (closed.size - 1), displacement_mm=1e3 * measured.u_m[chosen],
        velocity_m_s=measured.v_m_s[chosen], force_N=force[chosen],
        fitted_N=None if fitted_N is None else fitted_N[chosen],
    )


def motion_of(view: PointView) -> str:
    """A point's motion: "sine, amplitude 50 mm, 1 Hz"; of what has no frequency, "road iso8608-c, 10 mm"."""
    point = view.point
    if not point.has_frequency:
        return f"{point.motion}, {view.display.displacement.text(point.amplitude_m, 3)}"
    return view.terms.words(point.waveform, point.amplitude_m, point.frequency_Hz, view.display)
