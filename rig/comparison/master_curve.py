"""Acceptance bands from golden runs: the mean of their values, or those of their fitted models, with a tolerance."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import fmean, stdev

from scipy import stats

from rig.characteristics import characterise
from rig.comparison.bands import Bands
from rig.comparison.differences import motion_rows
from rig.comparison.readings import (
    LOOP_QUANTITIES,
    QUANTITIES,
    SINGLE_QUANTITIES,
    Motion,
    Quantity,
    Reading,
    RunReadings,
    plain,
    readings_of,
)
from rig.comparison.words import number_text
from rig.display import SI, Display, Shown
from rig.errors import RigError, evaluating
from rig.files.loader import validated
from rig.files.toml_source import SIZE_LIMIT_BYTES, parse_toml
from rig.fits.fit_record import fit_in
from rig.identification.application.law import Law
from rig.identification.models.coil import with_lag
from rig.identification.models.measurement import Measurement
from rig.identification.points.preparation import prepare
from rig.recording.quality.campaign_delay import pooled_skews
from rig.recording.run import Run
from rig.test_point import LOOP
from rig.units import DIMENSIONS, UNITS, UnitProblem, parse

PARAMETER = "parameter"
USUAL = ("rebound_force", "jounce_force", "energy", "friction_force", "gas_force")
"""Quantities that a tolerance without a name applies to."""
LARGEST_SHARE = 10.0
FEWEST_SPECIMENS = 3
"""Serial numbers of golden runs from which the variation between dampers is estimated."""
COVERED, CONFIDENCE = 0.95, 0.95
"""Share of the dampers that a tolerance interval contains, and its confidence."""
MOST_NAMED = 3
LONGEST_NAME = 120
AMPLITUDE_DIGITS = 12
"""Of a requested amplitude, which a band must state exactly."""


@dataclass(frozen=True)
class Tolerance:
    """Half of the width of a band: a share of the value, or a constant (SI)."""

    share: float = 0.0
    constant: float = 0.0


def tolerances_of(texts: Sequence[str]) -> dict[str, Tolerance]:
    """Tolerances by quantity: "5 %" for the usual ones, "energy = 2 J" for one.

    Raises:
        RigError: a quantity or a tolerance is not valid.
    """
    known = (*QUANTITIES, PARAMETER)
    general, named = dict[str, Tolerance](), dict[str, Tolerance]()
    for text in texts:
        key, equals, value = (part.strip() for part in text.partition("="))
        if not equals:
            general = dict.fromkeys(USUAL, _tolerance("ratio", key, text))
        elif key not in known:
            raise RigError(f"--tolerance {text!r}: unknown quantity {key}; known: {', '.join(known)}")
        else:
            named[key] = _tolerance(key, value, text)
    return general | named


def _tolerance(key: str, value: str, text: str) -> Tolerance:
    """The tolerance of a quantity.

    Raises:
        RigError: it is not valid.
    """
    unit = "" if key in {"ratio", PARAMETER} else QUANTITIES[key].unit
    dimension = next((one.name for one in DIMENSIONS.values() if one.si == unit and unit != "1"), "ratio")
    try:
        if value.endswith("%") or dimension == "ratio":
            made = Tolerance(share=parse(value, "ratio"))
        else:
            made = Tolerance(constant=parse(value, dimension))
    except UnitProblem as problem:
        raise RigError(f"--tolerance {text!r}: {problem}. Fix: write, for example, --tolerance '5 %'") from problem
    if not (made.share > 0.0 or made.constant > 0.0) or made.share > LARGEST_SHARE:
        raise RigError(f"--tolerance {text!r}: expected more than 0 and at most {100.0 * LARGEST_SHARE:g} %")
    return made


def tolerance_factor(count: int) -> float:
    """Factor k of the two-sided tolerance interval mean +- k s of `count` normally distributed values.

    The interval contains `COVERED` of all values with a probability of `CONFIDENCE`. W. G. Howe, J. American
    Statistical Association 64 (1969) 610; within 1 % of the exact factors in ISO 16269-6.
    """
    freedom = count - 1
    z = float(stats.norm.ppf(0.5 + 0.5 * COVERED))
    spread = freedom / float(stats.chi2.ppf(1.0 - CONFIDENCE, freedom))
    return z * math.sqrt((1.0 + 1.0 / count) * spread)


def _interval(values: Sequence[float]) -> float:
    """Half of the width of the tolerance interval of values, one of each specimen."""
    return tolerance_factor(len(values)) * stdev(values)


@dataclass
class _Bands:
    """Bands as they are made; `within` names those that are narrower than the tolerance interval of the specimens.

    `specimens` are the serial numbers of the runs, empty where a run states none.
    """

    specimens: Sequence[str] = ()
    tables: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    narrow: list[str] = field(default_factory=list)
    within: list[str] = field(default_factory=list)

    def add(self, key: str, where: str, entries: Sequence[str], readings: Sequence[Reading], names: Sequence[str],
            tolerance: Tolerance, shown: Shown) -> None:  # fmt: skip
        """A band about the mean of the readings of each run, in the unit in which its values are shown."""
        unit = shown.unit
        values = [shown.value(reading.value) for reading in readings]
        mean = math.fsum(values) / len(values)
        if tolerance.share and not all(reading.significant for reading in readings):
            example = f"{key}={number_text(max(abs(mean), 1.0), 2)} {unit}"
            self.remarks.append(
                f"{key} at {where}: no band, because {mean:.3g} {unit} is too close to zero for a relative tolerance. "
                f"Fix: specify a tolerance in {unit}, such as --tolerance '{example}'"
            )
            return
        half = tolerance.share * abs(mean) + shown.value(tolerance.constant)
        low, high = mean - half, mean + half
        if key == "jounce_force" and low >= 0.0:
            self.remarks.append(f"{key} at {where}: no band, because the force ({mean:.3g} {unit}) is not negative")
            return
        outside = [name for name, value in zip(names, values, strict=True) if not low <= value <= high]
        if outside:
            self.remarks.append(f"{key} at {where}: the band does not contain the value of {', '.join(outside)}")
        if half < max(shown.value(reading.expanded) for reading in readings):
            self.narrow.append(f"{key} at {where}")
        of_specimen: dict[str, list[float]] = {}
        for specimen, value in zip(self.specimens, values, strict=True):
            if specimen:
                of_specimen.setdefault(specimen, []).append(value)
        if len(of_specimen) >= FEWEST_SPECIMENS and half < (interval := _interval([*map(fmean, of_specimen.values())])):
            self.within.append(f"{key} at {where} (+-{half:.3g} {unit}, tolerance interval +-{interval:.3g} {unit})")
        written = unit if key != PARAMETER else ""
        limits = [f"{name} = {_limit(end, written)}" for name, end in (("low", low), ("high", high))]
        self.tables.append("\n".join([f"[[{key}]]", *entries, *limits]))


@dataclass(frozen=True)
class MasterBands:
    """A bands file.

    Attributes:
        text: of the file.
        count: number of bands.
        remarks: what the file does not contain and why, and bands that are narrower than the measurement allows.
    """

    text: str
    count: int
    remarks: tuple[str, ...]


def make_bands(runs: Sequence[Run], tolerances: Mapping[str, Tolerance], *, fitted: bool = False) -> MasterBands:
    """Acceptance bands about the values that all golden runs have in common.

    The file is in the units of `[display]` of the first run, with forces positive in rebound.

    Args:
        runs: golden runs, of one type of damper.
        tolerances: by quantity, of `tolerances_of`.
        fitted: take forces and energy of loops from the fit of each run instead of its measured forces.

    Raises:
        RigError: the runs have no value in common, or a run has no fit.
        FileProblem: a fit cannot be used.
    """
    read = [fitted_readings(run) if fitted else readings_of(run) for run in runs]
    names = [run.name for run in read]
    left_out = [f"{run.name}: {line}" for run in read for line in run.left_out]
    made = _Bands([run.specimen for run in read], remarks=left_out)
    display = runs[0].display
    loops = [quantity for quantity in LOOP_QUANTITIES if quantity.key in tolerances]
    for row in motion_rows(read) if loops else ():
        present = [loop for loop in row.loops if loop is not None]
        if len(present) < len(read):
            lacking = ", ".join(name for name, loop in zip(names, row.loops, strict=True) if loop is None)
            made.remarks.append(f"{row.motion.phrase(display)}: no band, because {lacking} does not contain this test")
            continue
        for quantity in loops:
            readings = [loop.values[quantity.key] for loop in present if quantity.key in loop.values]
            if len(readings) == len(read):
                made.add(quantity.key, row.motion.phrase(display), list(_motion(row.motion, display)), readings, names,
                         tolerances[quantity.key], _written_as(quantity, display))  # fmt: skip
    for single in SINGLE_QUANTITIES:
        if single.key in tolerances:
            _add_single(made, single, read, tolerances[single.key])
    if PARAMETER in tolerances:
        _add_parameters(made, read, tolerances[PARAMETER])
    if not made.tables:
        why = f": {made.remarks[0]}" if made.remarks else ""
        raise RigError(f"no acceptance bands can be made of these runs{why}. Fix: specify runs with valid loops")
    if made.narrow:
        made.remarks.append(
            "bands that are narrower than the expanded uncertainty of the measured value, so that no value can pass "
            f"with guarded acceptance: {len(made.narrow)}, for example {made.narrow[0]}"
        )
    specimens = {run.specimen for run in read if run.specimen}
    if len(specimens) < FEWEST_SPECIMENS <= len(read):
        made.remarks.append(_few_specimens(sorted(specimens), len(read)))
    elif made.within:
        made.remarks.append(
            f"bands that are narrower than the tolerance interval of the {len(specimens)} golden specimens (mean +-"
            f"{tolerance_factor(len(specimens)):.3g} standard deviations: {100.0 * COVERED:g} % of such dampers, with "
            f"{100.0 * CONFIDENCE:g} % confidence), so that good dampers can fail: {len(made.within)}, for example "
            f"{made.within[0]}"
        )
    return MasterBands(_text(read, made, fitted=fitted), len(made.tables), tuple(made.remarks))


def _few_specimens(specimens: Sequence[str], runs: int) -> str:
    """Why the runs do not show how much dampers differ."""
    way_out = f"Fix: use runs of at least {FEWEST_SPECIMENS} serial numbers to compare the bands with this variation"
    if not specimens:
        return f"the {runs} golden runs state no serial number, so the variation between dampers is unknown. {way_out}"
    if len(specimens) == 1:
        return (f"the {runs} golden runs show only the repeatability of one specimen ({specimens[0]}), not the "
            f"variation between dampers. {way_out}")
    return (f"the {runs} golden runs are of only {len(specimens)} specimens ({', '.join(specimens)}), too few to "
        f"estimate the variation between dampers. {way_out}")


def _add_single(made: _Bands, single: Quantity, read: Sequence[RunReadings], tolerance: Tolerance) -> None:
    readings = [run.singles[single.key] for run in read if single.key in run.singles]
    if len(readings) == len(read):
        names = [run.name for run in read]
        made.add(single.key, "slow triangle", [], readings, names, tolerance,
                 _written_as(single, read[0].run.display))


def _add_parameters(made: _Bands, read: Sequence[RunReadings], tolerance: Tolerance) -> None:
    models = sorted({run.model or "no fit" for run in read})
    if len(models) > 1 or not read[0].model:
        made.remarks.append(f"no bands for parameters, because the runs have different fits ({', '.join(models)})")
        return
    for name, first in read[0].parameters.items():
        fitted = [run.parameters[name] for run in read if name in run.parameters and not run.parameters[name].why]
        if len(fitted) == len(read):
            entries = [f"name = {json.dumps(name)}", f"unit = {json.dumps(first.unit)}"]
            names = [run.name for run in read]
            made.add(PARAMETER, name, entries, [one.reading for one in fitted], names, tolerance,
                     plain(first.unit))


def fitted_readings(run: Run) -> RunReadings:
    """The readings of a run whose loops have the force of its fitted model instead of the measured force.

    Raises:
        RigError: the run has no fit.
        FileProblem: its fit cannot be used.
    """
    fit = fit_in(run.path)
    if fit is None:
        raise RigError(f"{run.path.name}: the run has no fit. Fix: rig identify {run.path}")
    model, values = fit.known_damper()
    law = replace(Law.of(model, values, None), temperature=fit.temperature_law)
    skews, prepared = pooled_skews(run.usable), dict[str, Measurement]()
    for point in run.usable:
        if point.kind == LOOP:
            with evaluating(f"{point.id}"):
                measured = prepare(point, skews.get(point.id))
                if law.eta_1_s is not None:
                    measured = with_lag(measured, law.eta_1_s)
                prepared[point.id] = replace(measured, force_N=law.force_of(measured))
    readings = readings_of(run, characterise(run, prepared))
    poor = "the fit does not describe the tests within measurement noise"
    return replace(readings, left_out=(*readings.left_out, *([poor] if fit.adequate is False else [])))


def _written_as(quantity: Quantity, display: Display) -> Shown:
    """How a bands file states a quantity: in the unit of the display if the file may have it; rebound is positive."""
    shown = replace(quantity.shown(display), positive="rebound")
    return shown if shown.unit in UNITS else plain(quantity.unit)


def _motion(motion: Motion, display: Display) -> Iterator[str]:
    """The entries that choose a motion."""
    yield f"waveform = {json.dumps(motion.waveform)}"
    if display.displacement_unit == SI.displacement_unit:
        yield f"amplitude_m = {motion.amplitude_m!r}"
    else:
        yield f"amplitude = {json.dumps(display.displacement.text(motion.amplitude_m, AMPLITUDE_DIGITS))}"
    yield f"frequency_Hz = {motion.frequency_Hz!r}"
    yield f"current_A = {motion.current_A + 0.0!r}"


def _limit(value: float, unit: str) -> str:
    number = f"{value:.6g}"
    return json.dumps(f"{number} {unit}") if unit else number if "." in number or "e" in number else f"{number}.0"


def _text(read: Sequence[RunReadings], made: _Bands, *, fitted: bool) -> str:
    """The file.

    Raises:
        RigError: it would not be valid.
    """
    sources = ", ".join(run.name for run in read)
    specimens = ", ".join(dict.fromkeys(run.specimen for run in read if run.specimen))
    what = "fitted models" if fitted else "measured values"
    lines = [f"# Master curve from the {what} of {sources}"]
    if any(run.run.simulated for run in read):
        lines.append("# SIMULATED: values of the simulated rig, not of a real damper")
    lines += [
        "format = 1", f"name = {json.dumps(f'master curve of {specimens or sources}'[:LONGEST_NAME])}",
        'decision = "simple"       # or "guarded-acceptance", "guarded-rejection" (ISO 14253-1)',
    ]
    text = "\n".join(lines) + "\n\n" + "\n\n".join(made.tables) + "\n"
    if len(text.encode()) > SIZE_LIMIT_BYTES:
        raise RigError(
            f"{len(made.tables)} bands do not fit into a bands file (at most {SIZE_LIMIT_BYTES // 1024} KiB). Fix: "
            "specify a tolerance for fewer quantities, such as --tolerance 'rebound_force=5 %'"
        )
    _, problems = validated(parse_toml(Path("bands"), text).data, Bands)
    if problems:
        where, problem = problems[0]
        raise RigError(f"the bands are not valid: {'.'.join(map(str, where))}: {problem}")
    return text


