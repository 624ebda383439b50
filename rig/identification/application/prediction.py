"""Force from motion and current: of a measured table, or of a motion with the coil's lag and the model's states.

Columns of every result: `force_N`, `low_N` and `high_N` (95 % of the samples of a new motion lie there; NaN beyond
what the tests covered, and where no prediction error is known), `extrapolates` (whether this row lies beyond what the
tests covered) and `beyond` (in which quantities). `attrs["extrapolation"]` and `attrs["band"]` say it in one sentence.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.errors import FileProblem
from rig.fits.entries import TestedRange
from rig.identification.application.law import Law
from rig.identification.application.motion_table import Motion, motion_of
from rig.identification.application.tested_range import UNKNOWN, beyond_tested
from rig.identification.models.temperature_effect import filled

if TYPE_CHECKING:
    import pandas as pd

    from rig.identification.application.motion_table import Table

NO_BAND = (
    "no band: the fit contains no prediction error, because an earlier version made it, because all tests have one "
    "motion, or because no test lies within the range of tests of other motions. Fix: identify the run again, with "
    "tests of two or more motions"
)


def predict(law: Law, tested: TestedRange | None, table: Table, mid_stroke_m: float) -> pd.DataFrame:
    """Force on the rows of a table (see `motion_table.motion_of`); `current_A` is the coil's own current.

    Raises:
        FileProblem: the table cannot be used; everything that is wrong with it.
    """
    reason = (
        f"{law.model.name} has internal states, which depend on the history of the motion" if law.model.states else ""
    )
    motion = motion_of(table, mid_stroke_m, needs_time=reason)
    known = _at_a_temperature(law, motion)
    force_N, _ = along(law, known)
    return _assuming(with_band({"force_N": force_N}, known, tested), law, motion)


def simulate(law: Law, tested: TestedRange | None, table: Table, mid_stroke_m: float, *, lag: bool) -> pd.DataFrame:
    """Force and states over a motion in time; with `lag`, `current_A` is the commanded current that the coil follows.

    Raises:
        FileProblem: the table cannot be used, or the lag is wanted and not known.
    """
    motion = motion_of(table, mid_stroke_m, needs_time="a simulation integrates over time")
    if lag:
        if law.eta_1_s is None:
            raise FileProblem("the fit", [
                "the rate of the coil lag (eta) was not identified in these tests. Fix: provide the actual coil "
                "current with lag=False, or fit tests with current steps",
            ])  # fmt: skip
        motion = replace(motion, current_A=coil_current(motion.current_A, law.eta_1_s, motion.dt_s))
    given, motion = motion, _at_a_temperature(law, motion)
    force_N, states = along(law, motion)
    columns = {
        "displacement_m": motion.u_m, "velocity_m_s": motion.v_m_s, "current_A": motion.current_A, "force_N": force_N,
    }  # fmt: skip
    columns |= {f"state_{place + 1}": states[:, place] for place in range(law.model.states)}
    result = _assuming(with_band(columns, motion, tested), law, given)
    if "time_s" not in (result.index.name,):
        result.insert(0, "time_s", motion.time_s)
    return result


def along(law: Law, motion: Motion) -> tuple[FloatArray, FloatArray]:
    """Force (N), (n,), and states, (n, S), from rest at the first sample; algebraic models need no time."""
    vectors, seen_A = law.vectors(motion.current_A)
    model = law.model
    if model.states == 0 and law.current is None and law.temperature is None:
        force_N = model.force(law.values, motion.u_m, motion.v_m_s, motion.a_m_s2, seen_A, motion.dt_s)
        return force_N, np.zeros((motion.u_m.size, 0))
    from rig.dampers.trajectory import trajectory_of  # loads numba

    start = model.initial_state(float(motion.u_m[0]))
    if law.temperature is not None and motion.temperature_degC is not None:
        known_degC = filled(motion.temperature_degC, law.temperature.reference_degC)
        vectors = law.temperature.vectors(model, law.values, known_degC)
    data = (motion.u_m, motion.v_m_s, motion.a_m_s2, seen_A)
    force, states = trajectory_of(model)(vectors, start, *data, motion.dt_s)
    return force, states


def _at_a_temperature(law: Law, motion: Motion) -> Motion:
    """The motion at the temperatures that a law takes which follows one: gaps bridged, the reference where none is."""
    if law.temperature is None:
        return motion
    recorded = np.full(motion.u_m.size, math.nan) if motion.temperature_degC is None else motion.temperature_degC
    return replace(motion, temperature_degC=filled(recorded, law.temperature.reference_degC))


def _assuming(frame: pd.DataFrame, law: Law, motion: Motion) -> pd.DataFrame:
    """The result, with the temperature that was assumed where none was given."""
    if law.temperature is None:
        return frame
    given = motion.temperature_degC
    missing = motion.u_m.size if given is None else int(np.count_nonzero(np.isnan(given)))
    if missing == motion.u_m.size:
        frame.attrs["assumed"] = f"no temperature given; the force applies at {law.temperature.reference_degC:.4g} degC"
    elif missing:
        frame.attrs["assumed"] = f"no temperature in {missing} of {motion.u_m.size} rows: interpolated linearly"
    return frame


def coil_current(commanded_A: FloatArray, eta_1_s: float, dt_s: float) -> FloatArray:
    """Coil current (A), shape (n,), behind a command held from sample to sample: I' = -eta (I - Icmd), exact."""
    from scipy.signal import lfilter

    stays = math.exp(-eta_1_s * dt_s)
    start = np.array([stays * commanded_A[0]])
    before = np.concatenate((commanded_A[:1], commanded_A[:-1]))
    result, _ = lfilter([1.0 - stays], [1.0, -stays], before, zi=start)
    return np.asarray(result)


def with_band(columns: dict[str, FloatArray], motion: Motion, tested: TestedRange | None) -> pd.DataFrame:
    """Columns as a table, with the band of the force and what lies beyond the tests."""
    import pandas as pd

    frame = pd.DataFrame(columns, index=motion.index)
    if tested is None:
        frame["low_N"] = frame["high_N"] = math.nan
        frame["extrapolates"], frame["beyond"] = True, UNKNOWN
        frame.attrs["extrapolation"] = "the fit does not contain the tested range. Fix: identify the run again"
        frame.attrs["band"] = NO_BAND
        return frame
    flagged = beyond_tested(tested, motion)
    outside, names = _flags(flagged, len(frame))
    half_N = np.where(outside | (not tested.band.of_predictions), math.nan, tested.band.at(motion.current_A))
    frame["low_N"], frame["high_N"] = columns["force_N"] - half_N, columns["force_N"] + half_N
    frame["extrapolates"], frame["beyond"] = outside, names
    frame.attrs["band"] = tested.band.describe() if tested.band.of_predictions else NO_BAND
    frame.attrs["extrapolation"] = _beyond_text(flagged, len(frame), tested)
    return frame


def _flags(flagged: dict[str, np.ndarray[tuple[int], np.dtype[np.bool_]]], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Whether each row lies beyond the tests, and in what."""
    code = np.zeros(count, dtype=np.int64)
    for place, where in enumerate(flagged.values()):
        code |= where.astype(np.int64) << place
    words = [
        " ".join(name for place, name in enumerate(flagged) if number >> place & 1)
        for number in range(2 ** len(flagged))
    ]
    return code > 0, np.array(words, dtype=object)[code]


def _beyond_text(
    flagged: dict[str, np.ndarray[tuple[int], np.dtype[np.bool_]]], count: int, tested: TestedRange
) -> str:
    if not flagged:
        return ""
    rows = {name: int(np.count_nonzero(where)) for name, where in flagged.items()}
    parts = ", ".join(f"{name} in {many} of {count} rows" for name, many in rows.items())
    unrecorded = " (no temperature was recorded in the fitted tests)" if tested.temperature_degC is None else ""
    range_text = tested.describe() + (unrecorded if "temperature_degC" in rows else "")
    return f"outside the tested range: {parts}; tested: {range_text}"
