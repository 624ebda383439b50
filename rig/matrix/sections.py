"""The tables of a matrix file, one class each; `rig.matrix.model` combines them. Every number is SI."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeVar

from pydantic import (
    Field,
    PrivateAttr,
    create_model,
    field_validator,
)

from protocols.descriptions import Problem
from protocols.near_miss import near_names
from rig.campaign_folder import IDENTIFIER, IDENTIFIER_TEXT
from rig.dampers import MODELS, PARAMETER_SETS
from rig.dampers.current_law import PER_CURRENT, UnknownLaw, current_law
from rig.dampers.grey_box import GREY, UnknownPart, named_parts, with_residual
from rig.errors import FileProblem
from rig.files.quantity import Quantity, Wording
from rig.files.section import ExtendedSection, Section
from rig.matrix.assumed_damper import ENDING, AssumedDamper, is_fit_file, of_fit, of_set
from rig.matrix.corrections import CORRECTIONS, SETTINGS, Correction
from rig.matrix.methods import DEPENDENCES, LAWS, METHODS, check_method, method_names
from rig.matrix.motion_size import (
    OTHER_NAMES,
    SPEED,
    STROKE,
    Amplitude,
    Frequency,
    MotionSize,
    PeakSpeed,
    Stroke,
)
from rig.matrix.signal_tables import FileTable, IterateTable, RoadTable, SignalTable, SweepTable
from rig.plugins import PlugInProblem
from rig.signals.drive_iteration import IterationSettings
from rig.signals.waveform import SIGNAL_NAMES, SINE, WAVEFORM_NAMES
from rig.units import show

V = TypeVar("V", str, float)

NARROWEST_WINDOW_K = 2.0

WaveformName = Literal[WAVEFORM_NAMES]  # type: ignore[valid-type]  # one list serves the schema and the message
MotionName = Literal[(*WAVEFORM_NAMES, *SIGNAL_NAMES)]  # type: ignore[valid-type]  # the same
CoilCurrent = Annotated[float, Quantity("current", "0 A", "20 A")]
CoilTemperature = Annotated[float, Quantity("temperature", "-40 degC", "250 degC")]
Cycles = Annotated[int, Field(ge=3, le=10_000, description="number of cycles at full amplitude; the first and the "
    "last are discarded")]
RampCycles = Annotated[float, Field(ge=0.5, le=20.0)]
Identifier = Annotated[str, Field(pattern=f"^{IDENTIFIER}$"), Wording(IDENTIFIER_TEXT, "MR-001")]


class Specimen(ExtendedSection):
    """The damper under test."""

    later: ClassVar[frozenset[str]] = frozenset({"coil_inductance_H"})

    serial_number: Identifier
    stroke_m: Annotated[float, Quantity("length", "0 mm", "2 m", above=True)] = Field(alias="stroke")
    mid_stroke_m: Annotated[float, Quantity("length", "-1 m", "1 m")] = Field(default=0.0, alias="mid_stroke")
    prior: str | None = Field(
        default=None, description="expected damper: name of a parameter set, or a fit.json in the folder of this file",
        examples=["demo", "fit.json"],
    )
    max_force_N: Annotated[float, Quantity("force", "0 N", "200 kN", above=True)] | None = Field(
        default=None, alias="max_force"
    )
    max_current_A: Annotated[float, Quantity("current", "0 A", "20 A", above=True)] | None = Field(
        default=None, alias="max_current"
    )
    coil_resistance_ohm: Annotated[float, Quantity("resistance", "0 ohm", "1 kohm", above=True)] | None = Field(
        default=None, alias="coil_resistance"
    )
    coil_inductance_H: Annotated[float, Quantity("inductance", "0 H", "100 H", above=True)] | None = Field(
        default=None, alias="coil_inductance", description="with coil_resistance and the voltage limit of a supply: "
            "how fast the current can change"
    )

    _fitted: AssumedDamper | None = PrivateAttr(default=None)

    @field_validator("prior")
    @classmethod
    def _known_prior(cls, value: str | None) -> str | None:
        if value is None or is_fit_file(value):
            return value
        if value not in PARAMETER_SETS:
            known = _unknown("parameter set", value, sorted(PARAMETER_SETS))
            raise ValueError(f"{known}; a fit file (name ending in {ENDING}) is also accepted")
        _usable(PARAMETER_SETS.__getitem__, value)
        return value

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`; a fit is read here."""
        yield from (*self._one_forecast(), *self._fit_read())

    def _one_forecast(self) -> Iterator[Problem]:
        if self.prior is not None and self.max_force_N is not None:
            yield (), "specify prior or max_force, not both"

    def _fit_read(self) -> Iterator[Problem]:
        if self.prior is not None and is_fit_file(self.prior):
            try:
                self._fitted = of_fit(Path(self.prior))
            except FileProblem as error:
                yield from ((("prior",), f"{Path(self.prior).name}: {problem}") for problem in error.problems)

    @property
    def assumed(self) -> AssumedDamper | None:
        """The damper of `prior`; None without one."""
        return of_set(self.prior) if self.prior is not None and not is_fit_file(self.prior) else self._fitted


class Motions(ExtendedSection):
    """Base of the tables that describe cyclic motions by amplitude or stroke, frequency or peak speed."""

    other_names: ClassVar[Mapping[str, str]] = OTHER_NAMES
    later: ClassVar[frozenset[str]] = frozenset({"stroke_m", "speed_m_s"})


class OneMotion(Motions):
    """Base of the tables that describe one cyclic motion; each has its own entries, whose order digests know."""

    @property
    def size(self) -> MotionSize:
        """What the table states of it."""
        stated = (getattr(self, name) for name in ("amplitude_m", "stroke_m", "frequency_Hz", "speed_m_s"))
        return MotionSize.single(*stated)

    @property
    def form(self) -> str:
        """Name of its waveform."""
        return getattr(self, "waveform", SINE.name)

    @property
    def motion(self) -> tuple[float, float]:
        """Amplitude (m) and frequency (Hz)."""
        return self.size.motions(self.form)[0]

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`."""
        if missing := " and ".join(self.size.missing):
            yield (), f'missing: {missing}. Fix: write, for example, stroke = "100 mm" and speed = "0.131 m/s"'
        yield from self.size.problems((self.form,), listed=False)


class Sweep(Motions):
    """The product of waveforms, currents, amplitudes and frequencies, and how each point is run.

    Of amplitude (or stroke), frequency and speed, any two are given. Signals (`sweep`, `road`, `file`) have tables of
    their own; they are run at every current.
    """

    later: ClassVar[frozenset[str]] = Motions.later | {"iterate"}

    waveform: tuple[MotionName, ...] = Field(default=(SINE.name,), min_length=1)
    amplitude_m: tuple[Amplitude, ...] = Field(default=(), alias="amplitude")
    stroke_m: tuple[Stroke, ...] = Field(default=(), alias="stroke", description=STROKE)
    frequency_Hz: tuple[Frequency, ...] = Field(default=(), alias="frequency")
    speed_m_s: tuple[PeakSpeed, ...] = Field(
        default=(), alias="speed", description=SPEED, examples=[["0.131 m/s", "10 in/s"]]
    )
    current_A: tuple[CoilCurrent, ...] = Field(default=(), alias="current")
    cycles: Cycles = 10
    ramp_in_cycles: RampCycles = 1.0
    ramp_out_cycles: RampCycles = 1.0
    amplitude_tolerance: Annotated[float, Quantity("ratio", "0.1 %", "20 %")] = 0.01
    adapt_amplitude: bool = True
    order: Literal["as written", "random", "by heat"] = "as written"
    seed: int | None = Field(default=None, ge=0)
    repeats: int = Field(default=1, ge=1, le=1000)
    rest_s: Annotated[float, Quantity("time", "0 s", "24 h")] = Field(default=0.0, alias="rest")
    sweep: SweepTable | None = None
    road: RoadTable | None = None
    file: FileTable | None = None
    iterate: IterateTable | None = None

    @property
    def iteration(self) -> IterationSettings | None:
        """How the commands of signals are iterated; None: they are not."""
        return None if self.iterate is None else self.iterate.settings

    @property
    def signals(self) -> dict[str, SignalTable]:
        """The tables of the signals among the waveforms, by name."""
        tables: dict[str, SignalTable | None] = {"sweep": self.sweep, "road": self.road, "file": self.file}
        return {name: table for name, table in tables.items() if table is not None}

    @field_validator("waveform")
    @classmethod
    def _no_waveform_twice(cls, values: tuple[str, ...]) -> tuple[str, ...]:
        return no_value_twice(values, str)

    @field_validator("amplitude_m", "stroke_m")
    @classmethod
    def _no_amplitude_twice(cls, values: tuple[float, ...]) -> tuple[float, ...]:
        return no_value_twice(values, lambda value: show(value, "mm", 10))

    @field_validator("speed_m_s")
    @classmethod
    def _no_speed_twice(cls, values: tuple[float, ...]) -> tuple[float, ...]:
        return no_value_twice(values, lambda value: show(value, "m/s", 10))

    @field_validator("frequency_Hz")
    @classmethod
    def _no_frequency_twice(cls, values: tuple[float, ...]) -> tuple[float, ...]:
        return no_value_twice(values, lambda value: show(value, "Hz", 10))

    @field_validator("current_A")
    @classmethod
    def _no_current_twice(cls, values: tuple[float, ...]) -> tuple[float, ...]:
        return no_value_twice(values, lambda value: show(value, "A", 10))

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`."""
        yield from (*self._described(), *self._product(), *self._seeded())

    def _described(self) -> Iterator[Problem]:
        """Every signal that is asked for has its table, and no other."""
        for name in SIGNAL_NAMES:
            if name in self.waveform and name not in self.signals:
                yield ("waveform",), f"{name} requires a table [matrix.{name}] (see docs/files.md)"
            if name in self.signals and name not in self.waveform:
                yield (name,), f'the table is not used. Fix: write waveform = ["{name}"], or remove the table'
        if self.iterate is not None and not self.signals:
            names = ", ".join(f'"{name}"' for name in SIGNAL_NAMES)
            yield ("iterate",), (
                f"applies only to signals, but none is listed. Fix: list {names} in waveform, or remove the table; the "
                "amplitude of cyclic motions is adapted by adapt_amplitude"
            )

    @property
    def cyclic(self) -> tuple[str, ...]:
        """The waveforms with cycles."""
        return tuple(name for name in self.waveform if name not in SIGNAL_NAMES)

    @property
    def size(self) -> MotionSize:
        """What is stated of the cyclic motions."""
        return MotionSize(self.amplitude_m, self.stroke_m, self.frequency_Hz, self.speed_m_s)

    def _product(self) -> Iterator[Problem]:
        """Of waveforms with cycles, current and two of amplitude, frequency and speed are given, or none of them."""
        size = self.size
        if not self.cyclic:
            if not self.current_A:
                yield ("current",), 'is missing. Fix: write, for example, current = ["0 A"]'
            text = "applies only to cyclic waveforms, but no cyclic waveform is listed; signals have their own tables"
            yield from (((key,), text) for key in size.used)
            return
        missing = [*size.missing, *(() if self.current_A else ("current",))]
        if missing and (size.used or self.current_A):
            yield (), (
                f"missing: {' and '.join(missing)}. Fix: specify current and two of amplitude (or stroke), frequency "
                "and speed, or none of them"
            )
        yield from size.problems(self.cyclic, listed=True)

    def _seeded(self) -> Iterator[Problem]:
        if self.order == "random" and self.seed is None:
            yield (), 'order = "random" requires a seed, for example seed = 1'


class ExtraPoint(OneMotion):
    """One explicit point beside the sweep; what it does not say is as in `[matrix]`."""

    id: Identifier | None = None
    waveform: WaveformName = SINE.name
    amplitude_m: Amplitude | None = Field(default=None, alias="amplitude")
    stroke_m: Stroke | None = Field(default=None, alias="stroke", description=STROKE)
    frequency_Hz: Frequency | None = Field(default=None, alias="frequency")
    speed_m_s: PeakSpeed | None = Field(default=None, alias="speed", description=SPEED)
    current_A: CoilCurrent = Field(alias="current")
    cycles: Cycles | None = None


class WarmUp(OneMotion):
    """The motion that warms a cold damper; without it, the matrix's point with the largest forecast power."""

    amplitude_m: Amplitude | None = Field(default=None, alias="amplitude")
    stroke_m: Stroke | None = Field(default=None, alias="stroke", description=STROKE)
    frequency_Hz: Frequency | None = Field(default=None, alias="frequency")
    speed_m_s: PeakSpeed | None = Field(default=None, alias="speed", description=SPEED)
    current_A: CoilCurrent = Field(alias="current")


class Temperature(Section):
    """Between which coil temperatures a point may be measured, and how the damper warms and cools."""

    window_degC: tuple[CoilTemperature, CoilTemperature] = Field(alias="window", examples=[["25 degC", "45 degC"]])
    ambient_degC: CoilTemperature = Field(default=23.0, alias="ambient")
    heat_capacity_J_K: Annotated[float, Quantity("heat capacity", "1 J/K", "1000 kJ/K")] = Field(
        default=1500.0, alias="heat_capacity"
    )
    heat_loss_W_K: Annotated[float, Quantity("heat loss", "0.01 W/K", "10000 W/K")] = Field(
        default=5.0, alias="heat_loss"
    )
    longest_s: Annotated[float, Quantity("time", "1 s", "24 h")] = Field(default=3600.0, alias="longest")
    warm_up: WarmUp | None = None

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`."""
        low, high = self.window_degC
        if not high - low >= NARROWEST_WINDOW_K:
            yield (), (
                f"window: the first temperature must be at least {NARROWEST_WINDOW_K:g} K below the second, as in "
                '["25 degC", "45 degC"]'
            )
        if high <= self.ambient_degC:
            yield (), (
                f"window: a damper does not cool to {high:g} degC at an ambient temperature of {self.ambient_degC:g} "
                "degC. Fix: raise the window above ambient, or correct ambient"
            )


class Friction(Section):
    """A slow triangle without current: gas force from its mean, friction from its half width."""

    id: Identifier = "friction"
    amplitude_m: Amplitude = Field(alias="amplitude")
    speed_m_s: Annotated[float, Quantity("speed", "0.05 mm/s", "50 mm/s")] = Field(default=0.005, alias="speed")
    cycles: Cycles = 3


class CurrentStep(Section):
    """Currents in turn while the rod stands: the coil's lag is fitted to them."""

    id: Identifier | None = None
    current_A: tuple[CoilCurrent, ...] = Field(min_length=2, max_length=100, alias="current")
    hold_s: Annotated[float, Quantity("time", "50 ms", "60 s")] = Field(default=0.5, alias="hold")

    @field_validator("current_A")
    @classmethod
    def _steps(cls, values: tuple[float, ...]) -> tuple[float, ...]:
        if any(first == second for first, second in itertools.pairwise(values)):
            raise ValueError("two consecutive currents are equal; a step requires two different currents")
        return values


def _methods_of_schema(schema: dict[str, Any]) -> None:
    """The methods that an editor offers: those of plug-ins, too."""
    schema["enum"] = list(method_names())


class FitTable(Section):
    """What is fitted when the last point is recorded."""

    enabled: bool = True
    model: str = "auto"
    method: str = Field(default="separable", json_schema_extra=_methods_of_schema)
    holdout: str | None = Field(default=None, examples=["waveform=triangle", "frequency_Hz=2"])
    current: Literal[DEPENDENCES] = "affine"  # type: ignore[valid-type]  # one list serves the schema and the message
    current_law: Literal[LAWS] = "affine"  # type: ignore[valid-type]  # the same

    @property
    def corrections(self) -> dict[str, Any]:
        """The corrections that are requested, by name."""
        settings = {name: (getattr(self, name), nothing) for name, nothing in SETTINGS.items()}
        return {name: value for name, (value, nothing) in settings.items() if value != nothing}

    @field_validator("model")
    @classmethod
    def _known_model(cls, value: str) -> str:
        residual = named_parts(value)
        base, plus, law = (value if residual is None else residual[0]).partition("+")
        several = ("all", "auto", "few", GREY)
        known = ["all", "auto", *MODELS, "few", GREY]
        if base not in known or (base in several and value != base):
            raise ValueError(_unknown("model", value, known))
        for name in MODELS if value == "all" else () if value in several else (base,):
            _usable(MODELS.__getitem__, name)
        if plus and law != PER_CURRENT:
            try:
                current_law(law)
            except UnknownLaw as error:
                raise ValueError(str(error)) from error
        if residual is not None:
            try:
                with_residual(MODELS[base], residual[1])
            except UnknownPart as error:
                raise ValueError(str(error)) from error
        return value

    @field_validator("method")
    @classmethod
    def _known_method(cls, value: str) -> str:
        if value not in METHODS:
            if value not in method_names():
                raise ValueError(_unknown("method", value, list(method_names())))
            _usable(check_method, value)
        return value


def _entry(correction: Correction) -> tuple[Any, Any]:
    """Type and default of the key of a correction."""
    if correction.quantity is not None:
        return Annotated[float, correction.quantity] | None, None
    return bool if correction.switch else Literal[correction.choices], correction.nothing


def entries_of(corrections: Iterable[Correction]) -> dict[str, Any]:
    """Fields of a table with the keys of the corrections that can be requested."""
    return {one.name: _entry(one) for one in corrections if one.requestable}


if TYPE_CHECKING:
    Identify = FitTable
else:
    Identify = create_model("Identify", __base__=FitTable, __doc__=FitTable.__doc__, **entries_of(CORRECTIONS))


class Campaign(Section):
    """How a campaign treats its points."""

    retries: int = Field(default=0, ge=0, le=2)
    current_settled_A: Annotated[float, Quantity("current", "1 mA", "500 mA")] = Field(
        default=0.020, alias="current_settled"
    )
    demagnetise: bool = False
    require_skew: bool = Field(
        default=False, description="reject a bench if the data format of its load cell or LVDT contains no clock"
    )


def no_value_twice(values: tuple[V, ...], written: Callable[[V], str]) -> tuple[V, ...]:
    """The values as they are.

    Raises:
        ValueError: one stands there twice; it is named as a user writes it.
    """
    for value, count in Counter(map(written, values)).items():  # 0.254 m/s is 10 in/s, whatever the last bit
        if count > 1:
            raise ValueError(f"duplicate value {value}; to repeat points, set `repeats = N`")
    return values


def _usable(load: Callable[[str], object], name: str) -> None:
    """Load what a plug-in may bring: before anything moves, not after the last point.

    Raises:
        ValueError: it cannot be used.
    """
    try:
        load(name)
    except PlugInProblem as error:
        raise ValueError(str(error)) from error


def _unknown(what: str, value: str, known: list[str]) -> str:
    """An unknown name, the nearest known one, and all of them."""
    near = near_names(value, known)
    return f"unknown {what}{f'; did you mean {near[0]}?' if near else ''}; known: {', '.join(known)}"
