"""The fit that can be used: force, current for a force, figures; `rig.identification.application` does it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike

from rig.campaign_folder import CampaignFolder
from rig.dampers.arrays import FloatArray
from rig.document.axes import draw_on
from rig.errors import IdentificationFailed
from rig.fits.entries import TestCycle
from rig.fits.fit_file import fit_text
from rig.fits.fit_record import FitRecord
from rig.fits.plain import APART
from rig.fits.summary import summary, summary_html
from rig.identification.application.law import Law
from rig.identification.application.residuals import residual_table
from rig.identification.application.saving import saved
from rig.identification.application.test_cycles import cycles_of, tests_of
from rig.identification.models.measurement import Measurement
from rig.identification.uncertainty.prediction_band import known_draws, predict_with_band
from rig.recording.recorded_point import RecordedPoint
from rig.recording.views import Over, axis_over

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

    from rig.document.plot import Plot
    from rig.identification.application.controller import Controller
    from rig.identification.application.motion_table import Table
    from rig.recording.load_options import Source


@dataclass(frozen=True, repr=False)
class Fit(FitRecord):
    """A model fitted to tests, and its use; see `FitRecord` for what it holds.

    `print(fit)` is a summary; `fit["beta"]`, `fit.params` and `fit.covariance` are the parameters; `fit.save(path)`
    and `rig.load_fit(path)` keep it; `fit.predict`, `fit.simulate` and `fit.inverse` use it; `fit.plot_loops()` draws.

    Attributes:
        cycles: the same as values of the file, of a loaded fit whose tests have no files.
        tests: one cycle of each fitted test, for figures; empty in a loaded fit.
    """

    cycles: tuple[TestCycle, ...] = field(default=(), repr=False, compare=False)

    tests: tuple[Measurement, ...] = field(default=(), repr=False, compare=False, metadata=APART)

    def __str__(self) -> str:
        """At most 40 lines of 80 columns: verdict, errors, parameters with intervals, tested range, warnings."""
        return summary(self)

    def _repr_html_(self) -> str:
        return summary_html(self)

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """As `FitRecord.load`; a folder in which one campaign is located stands for that campaign."""
        return super().load(CampaignFolder.found(Path(path)).path)

    @property
    def law(self) -> Law:
        """The fitted model with its values, to be evaluated.

        Raises:
            IdentificationFailed: a value is missing, or there is a series spring, whose motion is not the table's.
            UnknownName: the model is not known here, such as a plug-in's that is not installed.
        """
        if self.series is not None and self.series.stiffness_N_m is not None:
            raise IdentificationFailed(
                "this fit describes the damper behind a series spring, whose motion is displacement - force / "
                "stiffness. Fix: pass that motion to `fit.behind_spring`"
            )
        estimated = {name: estimate.value for name, estimate in self.parameters.items()}
        if self.coil_eta_1_s is not None:
            estimated["eta"] = self.coil_eta_1_s
        law = Law.of(self.damper, estimated, self.current)
        return replace(law, temperature=self.temperature_law)

    @property
    def behind_spring(self) -> Self:
        """The damper behind the series spring, for its own motion."""
        return replace(self, corrections=replace(self.corrections, series=None))

    @property
    def plot(self) -> FitPlots:
        """Figures of the fit."""
        return FitPlots(self)

    def to_pandas(self) -> pd.DataFrame:
        """The estimates as a table, one row a parameter: value, unit, intervals, standard error, reason."""
        import pandas as pd

        rows = [vars(estimate) for estimate in self.parameters.values()]
        return pd.DataFrame(rows, index=pd.Index(self.parameters, name="parameter"))

    def tests_to_pandas(self) -> pd.DataFrame:
        """Errors and energies as a table, one row a test (N, J); `held_out` says which the fit has not seen.

        `beyond` says in which quantities a held-out test lies beyond the fitted ones, as `predict` does of rows; empty
        where in none.
        """
        import pandas as pd

        held_out = () if self.holdout is None else self.holdout.per_test
        rows = [vars(error) | {"held_out": False} for error in self.error.per_test]
        rows += [vars(test) | {"held_out": True} for test in held_out]
        for row in rows:
            del row["residual"]
            row["beyond"] = " ".join(row["beyond"] or ())
        return pd.DataFrame(rows).set_index("id")

    def save(self, path: Path | str) -> Path:
        """Write the fit as JSON ([keys](docs/json.md)), whole or not at all; `rig.load_fit` reads it.

        Args:
            path: the file, `fit.json` by convention, or a folder for a file of that name. An older fit at that place
                keeps its content under the name `fit-<time of its writing>.json`.

        Returns:
            The file's path.

        Raises:
            FileProblem: there is something else at that place, or the file cannot be written.
        """
        return saved(self.text, Path(path))[0]

    @property
    def text(self) -> str:
        """What `save` writes; tests that have no files are in it with a cycle each, for figures."""
        cycles = self.cycles if not self.tests or any(test.file for test in self.tests) else cycles_of(self.tests)
        return fit_text(replace(self, cycles=cycles).to_json())

    def export(self, format: str, folder: Path | str) -> list[Path]:
        """Write the fitted model for another program.

        Args:
            format: `c`, `fmi`, `modelica`, `matlab`, `octave`, `simulink`, `python`, `table`, `inverse`, `json`, or
                that of a plug-in.
            folder: for the files; created where it does not exist.

        Returns:
            The files.

        Raises:
            RigError: there is no such format, or the fit cannot be written in it; the message states the reason.
        """
        # `rig.export` is above this room and is found by its name, as the corrections are.
        written: list[Path] = import_module("rig.export.exporter").export(self, format, folder)
        return written

    def predict(
        self, table: Table | None = None, velocity_m_s: ArrayLike | None = None, current_A: ArrayLike | None = None, *,
        displacement_m: ArrayLike | None = None, time_s: ArrayLike | None = None,
        acceleration_m_s2: ArrayLike | None = None, temperature_degC: ArrayLike | None = None,
        mid_stroke_m: float | None = None, band: bool = False,
    ) -> pd.DataFrame:
        """Force for rows of motion and coil current.

        Args:
            table: a table (a DataFrame or a mapping) with the columns `displacement_m`, `current_A` (the coil's own),
                `velocity_m_s` or `time_s`, and where there are `acceleration_m_s2` and `temperature_degC`; columns with
                other units in their names (`displacement_mm`) are converted. Or a recorded point. Or an array of shape
                (n, 3): displacement (m), velocity (m/s), current (A). Or the displacement (m), shape (n,), followed by
                the velocity and the current: `predict(u, v, i)`.
            velocity_m_s: velocity (m/s), shape (n,) or one number.
            current_A: coil current (A), shape (n,) or one number.
            displacement_m: displacement (m), shape (n,) or one number, in place of a table.
            time_s: evenly spaced times (s), shape (n,).
            acceleration_m_s2: acceleration (m/s^2), shape (n,) or one number.
            temperature_degC: temperature (degC), shape (n,) or one number.
            mid_stroke_m: displacement (m) at the damper's mid-stroke; None: 0, or of a recorded point its own.
            band: add what the parameters' uncertainty alone does to the force, by the fit's bootstrap, or without one
                by their covariance: `model_low_N`, `model_high_N` (95 %).

        Returns:
            `force_N` (N), `low_N`, `high_N` (95 % of the samples of a new motion within the tested range lie between;
            NaN beyond it, or where no prediction error is known), `extrapolates` and `beyond` (in which quantities a
            row lies beyond the fitted tests), with the table's index. `attrs["band"]`: where the band comes from.

        Raises:
            FileProblem: the table cannot be used; everything that is wrong with it.
            IdentificationFailed: the fit has no value of a parameter, or a band is wanted and it tells no covariance.
        """
        from rig.identification.application.motion_table import table_of  # loads pandas or the compiled loops
        from rig.identification.application.prediction import predict  # loads pandas or the compiled loops

        given = {
            "time_s": time_s, "displacement_m": displacement_m, "velocity_m_s": velocity_m_s,
            "acceleration_m_s2": acceleration_m_s2, "current_A": current_A, "temperature_degC": temperature_degC,
        }  # fmt: skip
        motion, own_m = table_of(table, given)
        middle_m = own_m if mid_stroke_m is None else mid_stroke_m
        if band:
            return self.predict_among(*known_draws(self), motion, mid_stroke_m=middle_m)
        return predict(self.law, self.tested, motion, middle_m)

    def predict_among(
        self, names: tuple[str, ...], draws: FloatArray, widening: float, table: Table, *, mid_stroke_m: float = 0.0
    ) -> pd.DataFrame:
        """As `predict` with `band=True`, by draws (k, p) of the parameters `names` whose spread is widened.

        Raises:
            FileProblem: the table cannot be used.
            IdentificationFailed: the fit has no value of a parameter.
        """

        def predicted(values: Mapping[str, float]) -> pd.DataFrame:
            if not values:
                return self.predict(table, mid_stroke_m=mid_stroke_m)
            drawn = {name: replace(self.parameters[name], value=value) for name, value in values.items()}
            one = replace(self, parameters={**self.parameters, **drawn}, tested=None)
            return one.predict(table, mid_stroke_m=mid_stroke_m)

        return predict_with_band(predicted, names, draws, widening)

    def simulate(
        self,
        time_s: ArrayLike,
        displacement_m: ArrayLike,
        current_A: ArrayLike,
        *,
        velocity_m_s: ArrayLike | None = None,
        lag: bool = False,
        mid_stroke_m: float = 0.0,
    ) -> pd.DataFrame:
        """Force and internal states along a motion, from rest at the first sample.

        Args:
            time_s: evenly spaced times (s), shape (n,).
            displacement_m: displacement (m), shape (n,).
            current_A: current (A), shape (n,) or one number: the coil's own, or with `lag` the commanded one.
            velocity_m_s: velocity (m/s), shape (n,); differentiated from the displacement where it is not given.
            lag: let the coil follow the command at the fitted rate eta.
            mid_stroke_m: displacement (m) at the damper's mid-stroke.

        Returns:
            `time_s`, `displacement_m` (about mid-stroke), `velocity_m_s`, `current_A` (the coil's), `force_N`,
            `state_1` ..., and `low_N`, `high_N`, `extrapolates`, `beyond` as in `predict`.

        Raises:
            FileProblem: arrays that do not fit together, or a lag that is not known.
            IdentificationFailed: the fit has no value of a parameter.
        """
        from rig.identification.application.prediction import simulate  # loads pandas or the compiled loops

        motion = {"displacement_m": displacement_m, "velocity_m_s": velocity_m_s}
        table = {"time_s": time_s, "current_A": current_A, **motion}
        return simulate(self.law, self.tested, table, mid_stroke_m, lag=lag)

    def inverse(
        self,
        force_N: ArrayLike,
        velocity_m_s: ArrayLike,
        displacement_m: ArrayLike = 0.0,
        *,
        state: ArrayLike | None = None,
        time_s: ArrayLike | None = None,
        acceleration_m_s2: ArrayLike | None = None,
    ) -> pd.DataFrame:
        """The coil current that makes the damper give a force: I(F, v, u, state).

        Args:
            force_N: wanted force (N), shape (n,) or one number.
            velocity_m_s: velocity (m/s), likewise.
            displacement_m: extension about mid-stroke (m), likewise.
            state: internal states of the model as `simulate` gives them, shape (S,) or (n, S).
            time_s: evenly spaced times (s), shape (n,): the states then follow from rest with the currents that are
                found.
            acceleration_m_s2: acceleration (m/s^2); by default from the velocity over `time_s`, else 0.

        Returns:
            `current_A` with its 95 % band `low_A`, `high_A`; `attainable` (if not, `current_A` gives the nearest
            force), `least_N`, `most_N` (what the tested currents give); `force_N` at that current with `low_N`,
            `high_N`; `gain_N_A` (dF/dI); `resolvable` (the band is within 10 % of the tested currents' range each way);
            `extrapolates`, `beyond`; states.

        Raises:
            FileProblem: arrays that do not fit together or hold what is no number, or neither states nor time for a
                model with states.
            IdentificationFailed: the tests ran at one current.
        """
        from rig.identification.application.inversion import inverse  # loads pandas or the compiled loops
        from rig.identification.application.motion_table import motion_of  # loads pandas or the compiled loops

        given = np.atleast_1d(np.asarray(force_N, dtype=float))
        count = max(np.size(one) for one in (given, velocity_m_s, displacement_m, time_s) if one is not None)
        table = {
            "time_s": time_s, "displacement_m": displacement_m, "velocity_m_s": velocity_m_s,
            "acceleration_m_s2": acceleration_m_s2, "current_A": np.zeros(count), "force_N": given,
        }  # fmt: skip
        motion = motion_of(table, 0.0, also=("force_N",))
        target = np.ascontiguousarray(np.broadcast_to(given, (motion.u_m.size,)))
        chosen = None if state is None else np.asarray(state, dtype=float)
        return inverse(self.law.at_reference(), self.tested, motion, target, chosen)

    def control_range(self) -> pd.DataFrame:
        """What the current can do at each tested speed: forces, dF/dI, whether they can be inverted, passivity.

        See `rig.identification.application.inversion.control_range`.

        Raises:
            IdentificationFailed: the tests ran at one current.
        """
        from rig.identification.application.inversion import control_range  # loads pandas or the compiled loops

        return control_range(self.law.at_reference(), self.tested)

    def inverse_table(self) -> pd.DataFrame:
        """The current over speed and force, for controllers that look it up.

        See `rig.identification.application.inversion.inverse_table`.

        Raises:
            IdentificationFailed: the tests ran at one current.
        """
        from rig.identification.application.inversion import inverse_table  # loads pandas or the compiled loops

        return inverse_table(self.law.at_reference(), self.tested)

    def controller(
        self, dt_s: float, *, limits_A: tuple[float, float] | None = None, mid_stroke_m: float = 0.0
    ) -> Controller:
        """Current commands for wanted forces, one `step` a sampling interval of `dt_s` (s), the coil's lag undone.

        See `rig.identification.application.controller.Controller`.

        Raises:
            FileProblem: an interval or limits that are none.
            IdentificationFailed: the tests ran at one current.
        """
        from rig.identification.application.controller import Controller  # loads pandas or the compiled loops

        return Controller(self.law.at_reference(), self.tested, dt_s, limits_A, mid_stroke_m)


    @property
    def residuals(self) -> pd.DataFrame:
        """Measured minus modelled force over one cycle of each fitted test, as `residuals_of` gives it.

        Raises:
            IdentificationFailed: the fit knows no test.
            FileProblem: a test's file, which a loaded fit names, cannot be read.
        """
        return residual_table(self.behind_spring.law, self.shown_tests())

    def residuals_of(self, tests: Source) -> pd.DataFrame:
        """Measured minus modelled force over all evaluated cycles of any tests.

        Args:
            tests: a run, points, or what `rig.load` takes.

        Returns:
            One row a sample: `test`, `displacement_m` (about mid-stroke), `velocity_m_s`, `current_A`, `force_N`,
            `model_N`, `residual_N` (N, measured minus modelled; NaN where the force was not measured).

        Raises:
            FileProblem: the tests cannot be read.
            IdentificationFailed: none of them can be used.
        """
        return residual_table(self.behind_spring.law, _prepared(tests))

    def plot_loops(self, ax: Axes | None = None, *, over: Over = "velocity", tests: Source | None = None) -> Axes:
        """Draw measured (lines) and modelled (dashed) loops of the fitted tests, coloured by current.

        Args:
            ax: matplotlib axes to draw on; None: new ones.
            over: `velocity` (m/s) or `displacement` (mm).
            tests: other tests to draw, such as those of a validation: what `rig.load` takes.

        Returns:
            The axes.

        Raises:
            RigError: matplotlib is not installed, or there is nothing to draw.
        """
        from rig.identification.application.drawing import LINES, loops  # loads pandas or the compiled loops

        axis_over(over)
        drawn = loops(self.behind_spring.law, self.shown_tests(tests), by_current=True)
        panel = drawn.figures[1 if over == "velocity" else 0]
        return draw_on(replace(panel, title=f"{self.model}\n{LINES}", legend=True), ax)

    def plot_residuals(
        self, ax: Axes | None = None, *, over: Over = "velocity", tests: Source | None = None
    ) -> Axes:
        """Draw measured minus modelled force (N) over velocity (m/s) or displacement (mm); arguments as `plot_loops`.

        Raises:
            RigError: matplotlib is not installed, or there is nothing to draw.
        """
        from rig.identification.application.drawing import residuals  # loads pandas or the compiled loops

        return draw_on(residuals(self.behind_spring.law, self.shown_tests(tests), axis_over(over)), ax)

    def shown_tests(self, tests: Source | None = None) -> list[Measurement]:
        """The tests to show: those that are given, else a cycle of each fitted one; none where the fit knows none.

        Raises:
            FileProblem: a test, or the file of the fit, cannot be read.
        """
        if tests is not None:
            return _prepared(tests)
        return list(self.tests) or tests_of(self.cycles, str(self.path)) or _tests_of_files(self)


def load_fit(path: Path | str) -> Fit:
    """A fit that was written: by `Fit.save`, `rig identify` or `identify_run`.

    Args:
        path: the file, or the folder of the campaign.

    Raises:
        FileProblem: there is no such file, or it is no fit; everything that is wrong with it.
    """
    return Fit.load(path)


def _prepared(tests: Source) -> list[Measurement]:
    """Tests from anywhere, ready to be compared with a model."""
    from rig.identification.points.preparation import prepare_all  # reads recordings
    from rig.recording.loading import load  # reads recordings

    return prepare_all(point for point in load(tests) if point.verdict != "invalid")[0]


class FitPlots:
    """Figures of a fit."""

    def __init__(self, fit: Fit) -> None:
        self._fit = fit

    def loops(self) -> Plot:
        """Measured and modelled loops of the fitted tests; `save("loops.svg")` or `.pdf` writes them.

        Raises:
            IdentificationFailed: there is nothing to draw.
            FileProblem: a test's file, which a loaded fit names, cannot be read.
        """
        from rig.identification.application.drawing import loops  # loads pandas or the compiled loops

        return loops(self._fit.behind_spring.law, self._fit.shown_tests())


def _tests_of_files(fit: Fit) -> list[Measurement]:
    """One cycle of each fitted test, read again from its file; those without a file are left out."""
    from rig.identification.points.preparation import prepare  # reads recordings
    return [prepare(RecordedPoint.open(Path(test.file))) for test in fit.error.per_test if test.file]
