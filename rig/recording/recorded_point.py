"""One recorded point, read back: its description immediately, its arrays on first access.

A file from outside is checked by `rig.recording.hdf5.hdf5_check` before its content is trusted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.document.axes import draw_on
from rig.errors import FileProblem
from rig.recording.hdf5.reading import channel_names, clock_std_s, read_channel, read_description, read_raw
from rig.recording.point_attributes import NOT_STATED, Commanded
from rig.recording.point_files import OUT_OF_TOLERANCE
from rig.recording.quality.point_quality import PointQuality, time_quality
from rig.recording.views import CHANNELS, TABLE_UNITS, Over, loops_figure, point_dataset, time_figure
from rig.signals.arrays import FloatArray
from rig.signals.cycles import measured_motion
from rig.signals.derivatives import velocity_of
from rig.signals.free_motion import RANDOM
from rig.signals.peak_force import PeakForce, peak_force
from rig.test_point import TestPoint

if TYPE_CHECKING:
    import pandas as pd
    import xarray
    from matplotlib.axes import Axes

__all__ = ["CHANNELS", "MOTION_MEASURED", "TABLE_UNITS", "ForceSamples", "RecordedPoint"]

MOTION_MEASURED = "motion_measured"
"""In `test` of a point made from a table: its amplitude and frequency were measured, not requested."""


@dataclass(frozen=True)
class ForceSamples:
    """Force as measured, at its own sample times on the point's time base: `time_s`, `force_N` (m,), `flags` (m,)."""

    time_s: FloatArray
    force_N: FloatArray
    flags: NDArray[np.int64]


@dataclass(frozen=True, repr=False)
class RecordedPoint(TestPoint):
    """A test point and what was recorded of it. Arrays (n,) float64 with NaN where nothing is.

    Cycles and ramps that a recording does not state are 0. `verdict` is `valid`, `suspect` or `invalid`, with
    `reasons`. `skew_s` is by how much force lagged displacement when paired by arrival (0 where unknown, as in
    simulated runs faster than real time); it is corrected in the arrays, and `skew_std_s` is what remains uncertain
    (one standard deviation). `mid_stroke_m` None: use the measured mean.
    """

    cycles: float = 0.0
    ramp_in_cycles: float = 0.0
    ramp_out_cycles: float = 0.0
    commanded: Commanded = NOT_STATED
    mid_stroke_m: float | None = None
    verdict: str = "valid"
    reasons: tuple[str, ...] = ()
    lost_samples: int = 0
    skew_s: float = 0.0
    skew_std_s: float = 0.0
    sample_rate_Hz: float = 0.0
    imported: bool = False
    path: Path | None = None
    test: Mapping[str, Any] = field(default_factory=dict, repr=False)
    quality: PointQuality = field(default_factory=PointQuality, repr=False)
    provenance: Mapping[str, Any] = field(default_factory=dict, repr=False)
    arrays: Mapping[str, NDArray[Any]] | None = field(default=None, repr=False)

    @classmethod
    def open(cls, path: Path | str, *, whole: bool = True) -> RecordedPoint:
        """Read a point's description from its file; the arrays follow when they are asked for.

        All of the file is checked first. `whole=False` checks only what is read, which is ten times as fast, for files
        of one's own campaign; the rest is checked before arrays are read.

        Raises:
            FileProblem: the file is missing, is no HDF5, is not in this layout, or carries what a recording never does.
        """
        path = Path(path)
        described = read_description(path, whole=whole)
        if described["imported"]:  # files of earlier versions hold numbers rounded to two digits
            measured = described["quality"].motion
            described |= {
                name: value for name, value in (("amplitude_m", measured.amplitude_m),
                                                ("frequency_Hz", measured.frequency_Hz)) if value is not None
            }  # fmt: skip
        return cls(path=path, **described)

    @classmethod
    def from_arrays(
        cls, *, time_s: FloatArray, displacement_m: FloatArray, force_N: FloatArray,
        current_measured_A: FloatArray | None = None, velocity_m_s: FloatArray | None = None,
        **description: Any,  # noqa: ANN401 - the other attributes, each of its own type
    ) -> RecordedPoint:
        """A point made in memory: arrays (n,) in SI; `description` holds the other attributes (`id`, `waveform` ...).

        Without `current_measured_A` the wanted current is used; without `velocity_m_s` central differences are.

        Raises:
            FileProblem: arrays of different lengths or of more than one dimension, or a time that does not increase.
        """
        given = {"time_s": time_s, "displacement_m": displacement_m, "force_N": force_N,
                 "current_measured_A": current_measured_A, "velocity_m_s": velocity_m_s}
        _check_arrays(str(description.get("id", "a point")), given)
        current = np.full(len(time_s), float(description["current_A"]))
        velocity = np.gradient(displacement_m, time_s) if velocity_m_s is None else velocity_m_s
        arrays = {
            "time": time_s, "displacement": displacement_m, "velocity": velocity, "force": force_N,
            "current": current if current_measured_A is None else current_measured_A,
        }
        return cls(arrays=arrays, **description)

    @classmethod
    def from_pandas(
        cls, table: pd.DataFrame, *, id: str, current_A: float, waveform: str = "sine",
        units: Mapping[str, str] | None = None, accept: Sequence[str] = (),
        **description: Any,  # noqa: ANN401 - the other attributes, each of its own type
    ) -> RecordedPoint:
        """A point from a table: the inverse of `to_pandas`; columns as the CSV export names them are taken too.

        Args:
            table: one row a sample; columns `displacement`, `force` and, where there are, `current` (measured),
                `commanded_current`, `coil_temperature` and any other channel, each with its unit: at the end of its
                name (`force_kN`), in `units`, or in `table.attrs["units"]`; without any it is taken in SI, with a
                warning. The time is the index, or a column such as `time_s` (see
                `rig.recording.table_columns.table_time`); row numbers are not taken for it. Columns of texts are left
                out. Times with few digits, equal neighbours among them, become the uniform rate behind them
                (`quality.time`).
            id: the point's id.
            current_A: the wanted coil current (A).
            waveform: `sine` or `triangle`.
            units: column or quantity -> unit of its numbers, such as `{"force": "kN", "time": "ms"}`.
            accept: slugs of implausible sizes (`units-force`, ...) that are right all the same.
            **description: other attributes; amplitude and frequency are measured where they are not given, and the
                verdict is that of the same checks as `rig import` makes: a fit leaves an invalid test out.

        Raises:
            FileProblem: the current is no number, a column is missing or not numbers, a unit is unknown, a size is
                implausible, there is no time or it does not increase, or there are several motions (`rig import` makes
                a test of each). A record without a whole cycle is an invalid test (`too-few-cycles`).
        """
        from rig.recording.imported_quality import TestSamples, assess  # loads h5py
        from rig.recording.motion_parts import between_numbers, check_one_motion  # loads h5py
        from rig.recording.table_columns import check_current, table_channels  # loads h5py
        check_current(current_A, id)
        channels, times = table_channels(table, id, units, accept)
        rows = between_numbers(channels["displacement"], channels["force"])
        arrays = {name: values[rows] for name, values in channels.items()}
        time_s, displacement_m = arrays["time"], arrays["displacement"]
        measured = "current" in arrays
        arrays.setdefault(
            "current", np.full(len(time_s), np.nan if "commanded_current" in arrays else current_A)
        )
        if "velocity" not in arrays:
            arrays["velocity"] = velocity_of(time_s, displacement_m)[0]
        if "amplitude_m" not in description:
            check_one_motion(id, time_s, displacement_m, arrays["current"] if measured else None, waveform)
        assessment = assess(TestSamples(
            time_s - time_s[0], displacement_m, arrays["force"], arrays["velocity"], arrays["current"], current_A,
            measured,
        ), waveform)  # fmt: skip
        if not {"amplitude_m", "frequency_Hz"} <= set(description):
            motion = assessment.motion  # none without a whole cycle: invalid, as by `rig import`
            sizes = {
                "amplitude_m": 0.0 if motion is None else motion.amplitude_m,
                "frequency_Hz": 0.0 if motion is None else motion.frequency_Hz,
            }
            description = {**sizes, **description}
            description["test"] = {**description.get("test", {}), MOTION_MEASURED: True}
        if "verdict" not in description:
            verdict = assessment.verdict
            description |= {"verdict": verdict.verdict, "reasons": verdict.reasons, "lost_samples": assessment.lost}
        stamps = None if times is None else time_quality(times)
        description.setdefault("quality", PointQuality(verdict=assessment.verdict, time=stamps))
        return cls(id=id, waveform=waveform, current_A=current_A, arrays=arrays, **description)

    def channel(self, name: str) -> FloatArray:
        """Any aligned channel by its name in the file, (n,) float64; NaN everywhere when the file lacks it.

        Raises:
            FileProblem: the file changed or was damaged since it was opened.
        """
        values = self.arrays.get(name) if self.arrays is not None else read_channel(self._file, name)
        return np.full(self.samples, np.nan) if values is None else np.asarray(values, np.float64)

    @property
    def motion_requested(self) -> bool:
        """Whether amplitude and frequency were requested; those of an imported test were measured."""
        return not (self.imported or self.test.get(MOTION_MEASURED))

    @property
    def current_requested(self) -> bool:
        """Whether the current was requested or given; of an imported test with a column of it, it was measured."""
        return not (self.imported and self.provenance.get("current") == "measured")

    @property
    def kept_apart(self) -> bool:
        """A motion that was not the wanted one, recorded before its point was run again: shown, never used."""
        return any(reason.slug == OUT_OF_TOLERANCE for reason in self.quality.verdict.entries)

    @property
    def _file(self) -> Path:
        if self.path is None:
            raise FileProblem(self.id, [
                "this point was created in memory: it has no file and does not contain these data"
            ])
        return self.path

    @property
    def samples(self) -> int:
        """Number of samples n."""
        return len(self.time_s)

    @cached_property
    def time_s(self) -> FloatArray:
        """Time of each sample, s, 0 at the first.

        Raises:
            FileProblem: the file has no time.
        """
        if self.arrays is not None:
            return np.asarray(self.arrays["time"], np.float64)
        values = read_channel(self._file, "time")
        if values is None:
            raise FileProblem(str(self.path), ["/entry/data/time is missing"])
        return np.asarray(values, np.float64)

    @cached_property
    def displacement_m(self) -> FloatArray:
        """Damper extension in the displacement sensor's coordinate, m."""
        return self.channel("displacement")

    @cached_property
    def velocity_m_s(self) -> FloatArray:
        """Velocity differentiated from measured displacement without phase, m/s."""
        return self.channel("velocity")

    @cached_property
    def force_N(self) -> FloatArray:
        """Measured force brought to the displacement's sample times, N."""
        return self.channel("force")

    @cached_property
    def peak_force_N(self) -> PeakForce:
        """Largest force in rebound (positive) and compression (negative), N; see `rig.signals.peak_force`.

        As stored when the point was recorded; calculated for files without it (earlier versions, imported tests).
        """
        stored = self.quality.loop.peak_force
        if stored is not None:
            return stored
        time_s, force_N = self.time_s, self.force_N
        motion = None if not self.cyclic or self.waveform == RANDOM else measured_motion(time_s, self.displacement_m)
        if motion is None:
            return peak_force(time_s, force_N)
        starts_s = np.linspace(motion.start_s, motion.end_s, motion.cycles + 1)
        inside = (time_s >= motion.start_s) & (time_s < motion.end_s)
        return peak_force(time_s[inside], force_N[inside], starts_s)

    @cached_property
    def current_measured_A(self) -> FloatArray:
        """Coil current measured by the ECU at the displacement's sample times, A; the wanted one in imported tests."""
        return self.channel("current")

    @cached_property
    def force_samples(self) -> ForceSamples:
        """The measured force at its own sample times, not interpolated: best input for a fit.

        Made from the aligned channel where a file has no raw force (imported tests, points made in memory). Samples
        without a place in time (the device's clock went back) are not in it.
        """
        if self.arrays is None:
            raw = read_raw(self._file, "force")
            if raw is not None and "time" in raw:
                placed = np.isfinite(raw["time"])
                time_s, force_N, flags = (raw[name][placed] for name in ("time", "value", "flags"))
                return ForceSamples(
                    np.asarray(time_s, np.float64), np.asarray(force_N, np.float64), np.asarray(flags, np.int64)
                )
        return ForceSamples(self.time_s, self.force_N, np.zeros(self.samples, np.int64))

    def raw(self, name: str) -> dict[str, NDArray[Any]] | None:
        """A channel as received: `value`, `sequence`, `device_us`, `host_ns`, `flags` and, if aligned, `time`.

        None when the file holds no such channel.
        """
        return None if self.path is None else read_raw(self.path, name)

    def clock_std_s(self, name: str) -> float | None:
        """Standard uncertainty of a received channel's place on the time base (s); None where it is not stated."""
        return None if self.path is None else clock_std_s(self.path, name)

    def to_pandas(self) -> pd.DataFrame:
        """The aligned channels as a table indexed by time in s, one column a channel in SI (`attrs["units"]`)."""
        import pandas as pd

        names = channel_names(self.path) if self.path is not None else list(self.arrays or {})
        columns = {name: self.channel(name) for name in names if name != "time"}
        table = pd.DataFrame(columns, index=pd.Index(self.time_s, name="time_s"))
        table.attrs["units"] = {name: unit for name, unit in TABLE_UNITS.items() if name in columns}
        return table


    def to_xarray(self) -> xarray.Dataset:
        """The channels as an xarray `Dataset` over `time_s`, named as in the CSV export, each with its `units`.

        Raises:
            FileProblem: xarray is not installed, or the file cannot be read.
        """
        return point_dataset(self)

    def plot_loops(self, ax: Axes | None = None, *, over: Over = "velocity") -> Axes:
        """Draw the force over the velocity (m/s) or the displacement (mm).

        Args:
            ax: matplotlib axes to draw on; None: new ones.
            over: `velocity` or `displacement`.

        Returns:
            The axes.

        Raises:
            RigError: matplotlib is not installed, or the file cannot be read.
        """
        return draw_on(loops_figure([self], over), ax)

    def plot_time(self, channel: str = "force", ax: Axes | None = None) -> Axes:
        """Draw a channel over time (s).

        Args:
            channel: `force` (N), `displacement` (mm), `velocity` (m/s), `current` (A), `commanded_current` (A) or
                `coil_temperature` (degC).
            ax: matplotlib axes to draw on; None: new ones.

        Returns:
            The axes.

        Raises:
            FileProblem: the point has no such channel.
            RigError: matplotlib is not installed.
        """
        return draw_on(time_figure(self, channel), ax)

    def __len__(self) -> int:
        """Number of samples."""
        return self.samples

    def __bool__(self) -> bool:
        """Also a point without samples is one."""
        return True

    def __repr__(self) -> str:
        """One line: id, motion, current, verdict."""
        motion = f"{1e3 * self.amplitude_m:.4g} mm, {self.frequency_Hz:.4g} Hz, {round(self.current_A, 3) + 0.0:g} A"
        return f"RecordedPoint({self.id!r}, {self.waveform}, {motion}, {self.verdict})"


def _check_arrays(name: str, given: Mapping[str, FloatArray | None]) -> None:
    """Refuse arrays that are no samples of one time base.

    Raises:
        FileProblem: one line for each.
    """
    shapes = {key: np.shape(values) for key, values in given.items() if values is not None}
    expected = shapes["time_s"]
    problems = [
        f"{key} has shape {shape}, expected (n,) as for time_s: {expected}"
        for key, shape in shapes.items() if shape != expected or len(shape) != 1
    ]
    if not problems and (expected[0] < 2 or not np.all(np.diff(np.asarray(given["time_s"], np.float64)) > 0.0)):
        problems.append("time_s must have two or more samples and increase from sample to sample")
    if problems:
        raise FileProblem(name, problems)
