"""What the simulated rig is made of: every constant with its default, replaceable by a TOML file or single options.

`python -m simulators --config FILE.toml` reads tables named like the fields of `RigOptions`;
`--option table.key=value` replaces one value. Values are plain SI numbers, the unit is in the key.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from rig.errors import FileProblem

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    from protocols.sensor_format import SensorFormat

    Options = TypeVar("Options", bound=DataclassInstance)

MAXIMUM_FILE_BYTES = 1 << 20


@dataclass(frozen=True)
class ServoOptions:
    """Servo-hydraulics (PHYSICS section 11).

    `stiffness_N_m` is the position loop's: force and the piston's own friction push the rod by `F / stiffness`; 0 is
    infinitely stiff. In HOLD an error below `overlap_m` opens no valve: the rod rests. `load_train_stiffness_N_m` lies
    between the piston, where the controller's position sensor sits, and the specimen's end, where the LVDT sits; 0 is
    rigid.
    """

    bandwidth_Hz: float = 30.0
    damping: float = 0.7
    rated_speed_m_s: float = 1.2
    supply_Pa: float = 210e5
    low_pressure_Pa: float = 70e5
    piston_area_m2: float = 1.0e-3
    accumulator_recovery_s: float = 0.5
    accumulator_bleed_s: float = 4.0
    accumulator_sag_Pa_m3: float = 4.0e9
    drift_m_s: float = -0.2e-3
    valve_closing_s: float = 0.010
    half_stroke_m: float = 0.100
    stiffness_N_m: float = 20e6
    friction_N: float = 40.0
    friction_speed_m_s: float = 0.001
    overlap_m: float = 50e-6
    load_train_stiffness_N_m: float = 0.0
    start_position_m: float = 0.0


@dataclass(frozen=True)
class InputOptions:
    """One analogue input of the actuator controller, SI: what its register shows is `gain * value + zero`.

    Low-pass of the second order first; `delay_s` comes on top of the filter's and is declared nowhere. The position
    loop is closed over the position input's gain and zero, but not over its filter.
    """

    bandwidth_Hz: float = 500.0
    delay_s: float = 0.0
    gain: float = 1.0
    zero: float = 0.0
    noise: float = 0.0
    resolution: float = 0.0


POSITION_INPUT = InputOptions(noise=10e-6, resolution=2e-6)
FORCE_INPUT = InputOptions(noise=10.0, resolution=0.5)


@dataclass(frozen=True)
class ControllerOptions:
    """The actuator controller: its identity, its limits at boot, its clock.

    Without a `generator` it moves by set-points that are streamed to it, and only so. `register_map` is a user's file
    as which its registers appear; empty: its own.
    """

    serial_number: str = "SIM-ACT-1"
    firmware: str = "1.0"
    boot_count: int = 7
    device_id: int = 1
    position_limit_m: float = 0.095
    speed_max_m_s: float = 1.0
    acceleration_max_m_s2: float = 200.0
    force_max_N: float = 10e3
    fade_out_cycles: float = 1.0
    halt_deceleration_m_s2: float = 20.0
    move_acceleration_m_s2: float = 2.0
    following_error_max_m: float = 0.040
    watchdog_ms: int = 0
    generator: bool = True
    register_map: str = ""
    clock_offset_us: float = math.nan
    clock_ppm: float = math.nan


@dataclass(frozen=True)
class DamperOptions:
    """The specimen's force model; the parameters come from a named set and may be replaced one by one.

    Two thermal nodes: the body is heated by `F v` and loses `heat_loss_W_K` to ambient, the coil is heated by `I^2 R`
    and loses `coil_to_body_W_K` to the body. Force depends on the body's temperature; the ECU sees the coil's.
    """

    set: str = "demo"
    model: str = ""
    hysteresis: str = ""
    values: Mapping[str, float] = field(default_factory=dict)
    gas_force_N: float = 0.0
    seal_friction_N: float = 0.0
    seal_speed_m_s: float = 0.002
    mount_stiffness_N_m: float = 0.0
    free_play_m: float = 0.0
    force_change_per_K: float = 0.0
    heat_capacity_J_K: float = 1500.0
    heat_loss_W_K: float = 5.0
    coil_heat_capacity_J_K: float = 60.0
    coil_to_body_W_K: float = 3.0
    ambient_degC: float = 23.0
    start_degC: float = math.nan


@dataclass(frozen=True)
class SpecimenOptions:
    """The damper as a piece: where its mid-stroke lies in the rig's coordinate, and how long it is."""

    serial_number: str = "MR-001"
    mid_stroke_m: float = 0.0
    stroke_m: float = 0.190
    bump_stiffness_N_m: float = 5e5


@dataclass(frozen=True)
class CoilOptions:
    """Coil and current ECU; after `temperatures_until_s` (simulated s) it sends no temperature frames.

    The ECU regulates on its own measurement `current_gain * current + current_offset_A`: where that is wrong, the
    reported current still agrees with the commanded one, and the coil's true current is off. At 0 A its output stage is
    off: the coil has none, and the ECU reports its offset.
    """

    ohm: float = 1.5
    ohm_per_K: float = 0.0039
    eta_1_s: float = math.nan
    supply_V: float = 13.5
    limit_A: float = 5.0
    current_noise_A: float = 0.002
    current_gain: float = 1.0
    current_offset_A: float = 0.0
    temperature_offset_K: float = 0.0
    over_temperature_degC: float = 150.0
    command_timeout_s: float = 0.100
    temperatures_until_s: float = math.inf
    serial_number: int = 1001
    boot_count: int = 3
    clock_offset_us: float = math.nan
    clock_ppm: float = math.nan


@dataclass(frozen=True)
class SensorOptions:
    """One serial sensor. Values are in its wire unit (`unit`), `wire_per_si` of it for one SI unit.

    `skew_s` is a delay of the measured quantity beyond the filter's, which neither the bench file nor the latched edges
    show; `clip` is where the amplifier saturates without saying so; without `latches_edges` there are no edge frames.
    After `numbers_until_s` (simulated s) every value is NaN. `drift_per_s` is a zero that creeps from the start (wire
    unit per simulated s), `hum` the amplitude of what the mains induce, `crosstalk_per_A` what the coil's current does.
    With `reversed` it counts the other way round, which the written bench file does not say. `format` is "frame16",
    "signed-decimal", or any described format; `described` is then its name or table in the bench file, and `wire_zero`
    what is on the wire for zero. A format with a request is answered.
    """

    unit: str = "N"
    wire_per_si: float = 1.0
    rate_Hz: float = 250.0
    format: str | SensorFormat = "frame16"
    described: str | Mapping[str, Any] = ""
    wire_zero: float = 0.0
    range: float = 10e3
    noise: float = 5.0
    resolution: float = 0.05
    offset: float = 0.0
    gain: float = 1.0
    reversed: bool = False
    drift_per_s: float = 0.0
    hum: float = 0.0
    hum_Hz: float = 50.0
    crosstalk_per_A: float = 0.0
    bandwidth_Hz: float = 1000.0
    skew_s: float = 0.0
    clip: float = math.inf
    numbers_until_s: float = math.inf
    latches_edges: bool = True
    jitter_s: float = 2e-6
    latency_s: float = 0.5e-3
    burst_rate_Hz: float = 0.2
    burst_s: float = 6e-3
    serial_number: str = "LC-1"
    clock_offset_us: float = math.nan
    clock_ppm: float = math.nan
    baudrate: int = 921_600


LVDT = SensorOptions(
    unit="mm", wire_per_si=1000.0, range=100.0, noise=0.005, resolution=0.001, bandwidth_Hz=500.0,
    serial_number="LVDT-1",
)
AUXILIARY = SensorOptions(unit="m/s^2", range=500.0, noise=0.2, resolution=0.01, serial_number="AUX")


@dataclass(frozen=True)
class LimitOptions:
    """What the written bench file allows."""

    position_m: float = 0.085
    speed_m_s: float = 0.8
    acceleration_m_s2: float = 60.0
    force_N: float = 5e3
    current_A: float = 3.0
    coil_temperature_degC: float = 120.0


@dataclass(frozen=True)
class TransferOptions:
    """The hybrid benchmark's transfer system in the place of servo and damper (`simulators.plant.transfer`).

    Its four parameters as in `rig.hybrid.transfer_system.TransferSystem`; with a stiffness of 0 there is none.
    """

    a3: float = 3.3
    beta1: float = 425.0
    beta2: float = 9.9976e4
    stiffness_N_m: float = 0.0


@dataclass(frozen=True)
class RigOptions:
    """The whole simulated rig; NaN clocks and the like are drawn from the seed."""

    plant_rate_Hz: float = 8000.0
    truth_rate_Hz: float = 1000.0
    moving_mass_kg: float = 0.0
    servo: ServoOptions = field(default_factory=ServoOptions)
    controller: ControllerOptions = field(default_factory=ControllerOptions)
    position_input: InputOptions = POSITION_INPUT
    force_input: InputOptions = FORCE_INPUT
    damper: DamperOptions = field(default_factory=DamperOptions)
    specimen: SpecimenOptions = field(default_factory=SpecimenOptions)
    coil: CoilOptions = field(default_factory=CoilOptions)
    load_cell: SensorOptions = field(default_factory=SensorOptions)
    lvdt: SensorOptions = LVDT
    auxiliary: SensorOptions = AUXILIARY
    limits: LimitOptions = field(default_factory=LimitOptions)
    transfer: TransferOptions = field(default_factory=TransferOptions)


POSITIVE = {
    "plant_rate_Hz", "truth_rate_Hz", "bandwidth_Hz", "rated_speed_m_s", "supply_Pa", "piston_area_m2", "rate_Hz",
    "accumulator_recovery_s", "accumulator_bleed_s", "valve_closing_s", "half_stroke_m", "ohm", "heat_capacity_J_K",
    "range", "stroke_m", "seal_speed_m_s", "wire_per_si", "baudrate", "clip", "supply_V", "command_timeout_s",
    "damping", "friction_speed_m_s", "coil_heat_capacity_J_K",
}
NONZERO = {"gain", "current_gain"}
SI_UNITS = {"N": "N", "mm": "m", "m/s^2": "m/s^2"}
"""Of a sensor, by its unit on the wire."""
CHOICES = {"unit": tuple(SI_UNITS), "format": ("frame16", "signed-decimal")}
CEILINGS = {"rate_Hz": 10_000.0, "plant_rate_Hz": 100_000.0, "skew_s": 0.1, "delay_s": 0.1}
FLOORS = {
    "plant_rate_Hz": 4000.0, "truth_rate_Hz": 1.0, "skew_s": 0.0, "delay_s": 0.0, "stiffness_N_m": 0.0,
    "load_train_stiffness_N_m": 0.0, "overlap_m": 0.0, "friction_N": 0.0, "coil_to_body_W_K": 0.0,
}


def load_options(path: Path) -> RigOptions:
    """Read a TOML file over the defaults.

    Raises:
        FileProblem: unreadable, not TOML, or with unknown keys, wrong types or values out of range; all are listed.
    """
    try:
        if path.stat().st_size > MAXIMUM_FILE_BYTES:
            raise FileProblem(str(path), [f"larger than {MAXIMUM_FILE_BYTES} bytes, far beyond any configuration"])
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise FileProblem(str(path), [str(error)]) from error
    problems: list[str] = []
    options = _merge(RigOptions(), values, "", problems)
    if problems:
        raise FileProblem(str(path), problems)
    return options


def with_option(options: RigOptions, assignment: str) -> RigOptions:
    """Replace one value given as `table.key=value`.

    Raises:
        FileProblem: no `=`, an unknown key, a wrong type or a value out of range.
    """
    key, equals, text = assignment.partition("=")
    if not equals:
        raise FileProblem("--option", [f"{assignment!r}: expected table.key=value, such as load_cell.noise=2.0"])
    first, *deeper = key.strip().split(".")
    nested = _parse(text)
    for part in reversed(deeper):
        nested = {part: nested}
    problems: list[str] = []
    changed = _merge(options, {first: nested}, "", problems)
    if problems:
        raise FileProblem("--option", problems)
    return changed


def _parse(text: str) -> object:
    """A TOML value, or the bare text when it is none."""
    try:
        value: object = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text.strip()
    return value


def _merge(base: Options, values: Mapping[str, object], place: str, problems: list[str]) -> Options:
    """A copy of dataclass `base` with `values` put in; every misfit is added to `problems`."""
    known = {field.name: getattr(base, field.name) for field in dataclasses.fields(base)}
    changes: dict[str, object] = {}
    for key, value in values.items():
        where = f"{place}{key}"
        if key not in known:
            close = difflib.get_close_matches(key, known, n=1)
            hint = f"; did you mean {place}{close[0]}?" if close else f"; known: {', '.join(known)}"
            problems.append(f"{where}: unknown key{hint}")
            continue
        present = known[key]
        if dataclasses.is_dataclass(present) and not isinstance(present, type):
            if isinstance(value, Mapping):
                changes[key] = _merge(present, value, f"{where}.", problems)
            else:
                problems.append(f"{where} = {value!r}: expected a table of values")
        elif isinstance(present, Mapping):
            changes[key] = _numbers(present, value, where, problems)
        else:
            problem = _misfit(key, present, value)
            if problem:
                problems.append(f"{where} = {value!r}: {problem}")
            else:
                changes[key] = float(value) if isinstance(value, int) and isinstance(present, float) else value
    return dataclasses.replace(base, **changes)


def _numbers(present: Mapping[str, float], value: object, where: str, problems: list[str]) -> dict[str, float]:
    """A mapping of names to finite numbers over the present one."""
    merged = dict(present)
    if not isinstance(value, Mapping):
        problems.append(f"{where} = {value!r}: expected a table of numbers")
        return merged
    for name, number in value.items():
        if isinstance(number, bool) or not isinstance(number, (int, float)) or not math.isfinite(number):
            problems.append(f"{where}.{name} = {number!r}: expected a finite number")
        else:
            merged[name] = float(number)
    return merged


def _misfit(key: str, present: object, value: object) -> str:
    """Why `value` cannot replace `present`, or nothing."""
    if isinstance(present, str):
        if not isinstance(value, str):
            return "expected a text in quotes"
        return "" if value in CHOICES.get(key, (value,)) else f"expected one of {', '.join(CHOICES[key])}"
    if isinstance(present, bool):
        return "" if isinstance(value, bool) else "expected true or false"
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return "expected a number"
    if isinstance(present, int) and not isinstance(value, int):
        return "expected a whole number"
    if not math.isfinite(value):
        return "expected a finite number"
    if key in POSITIVE and value <= 0:
        return "must be greater than 0"
    if key in NONZERO and value == 0:
        return "must not be 0"
    if value > CEILINGS.get(key, math.inf):
        return f"must be at most {CEILINGS[key]:g}"
    if value < FLOORS.get(key, -math.inf):
        return f"must be at least {FLOORS[key]:g}"
    return ""
