"""What the simulated rig is made of: every constant with its default, replaceable by a TOML file or single options.

`python -m simulators --config FILE.toml` reads tables named like the fields of `RigOptions`;
`--option table.key=value` replaces one value. Values are plain SI numbers, the unit is in the key.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

from annotated_types import Ge, Gt, Le

from protocols.sensor_format import SensorFormat
from rig.errors import FileProblem
from rig.files.quantity import Check
from rig.files.toml_source import TomlSource, frozen

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    from rig.files.section import DescriptionTable

    Options = TypeVar("Options", bound=DataclassInstance)

HIGHEST_RATE_Hz = 10_000.0
"""Of a simulated sensor."""
OWN_FORMATS = ("frame16", "signed-decimal")
"""Formats that have a writer of their own; any other is described (`--force-format`)."""


def _not_zero(value: float) -> float:
    if value == 0:
        raise ValueError("must not be 0")
    return value


def _sent(value: str | SensorFormat) -> str | SensorFormat:
    if isinstance(value, str) and value not in OWN_FORMATS:
        raise ValueError(f"expected one of {', '.join(OWN_FORMATS)}")
    return value


Positive = Annotated[float, Gt(0.0)]
PositiveInt = Annotated[int, Gt(0)]
NotNegative = Annotated[float, Ge(0.0)]
NotZero = Annotated[float, Check(_not_zero)]


@dataclass(frozen=True)
class ServoOptions:
    """Servo-hydraulics (PHYSICS section 11).

    `stiffness_N_m` is the position loop's: force and the piston's own friction push the rod by `F / stiffness`; 0 is
    infinitely stiff. In HOLD an error below `overlap_m` opens no valve: the rod rests. `load_train_stiffness_N_m` lies
    between the piston, where the controller's position sensor sits, and the specimen's end, where the LVDT sits; 0 is
    rigid.
    """

    bandwidth_Hz: Positive = 30.0
    damping: Positive = 0.7
    rated_speed_m_s: Positive = 1.2
    supply_Pa: Positive = 210e5
    low_pressure_Pa: float = 70e5
    piston_area_m2: Positive = 1.0e-3
    accumulator_recovery_s: Positive = 0.5
    accumulator_bleed_s: Positive = 4.0
    accumulator_sag_Pa_m3: float = 4.0e9
    drift_m_s: float = -0.2e-3
    valve_closing_s: Positive = 0.010
    half_stroke_m: Positive = 0.100
    stiffness_N_m: NotNegative = 20e6
    friction_N: NotNegative = 40.0
    friction_speed_m_s: Positive = 0.001
    overlap_m: NotNegative = 50e-6
    load_train_stiffness_N_m: NotNegative = 0.0
    start_position_m: float = 0.0


@dataclass(frozen=True)
class InputOptions:
    """One analogue input of the actuator controller, SI: what its register shows is `gain * value + zero`.

    Low-pass of the second order first; `delay_s` comes on top of the filter's and is declared nowhere. The position
    loop is closed over the position input's gain and zero, but not over its filter.
    """

    bandwidth_Hz: Positive = 500.0
    delay_s: Annotated[float, Ge(0.0), Le(0.1)] = 0.0
    gain: NotZero = 1.0
    zero: float = 0.0
    noise: float = 0.0
    resolution: float = 0.0


POSITION_INPUT = InputOptions(noise=10e-6, resolution=2e-6)
FORCE_INPUT = InputOptions(noise=10.0, resolution=0.5)


@dataclass(frozen=True)
class ControllerOptions:
    """The actuator controller: its identity, its limits at boot, its clock.

    Without a `generator` it moves by set-points that are streamed to it, and only so. `register_map` names the
    map, or is a user's file, as which its registers appear; empty: the demo's, by whether there is a generator.
    `poll_s` is the period of the host's polls (wall s) in the bench file; 0: as usual for the link and the speed.
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
    poll_s: NotNegative = 0.0
    generator: bool = True
    register_map: str = ""
    clock_offset_us: float = math.nan
    clock_ppm: float = math.nan


@dataclass(frozen=True)
class DamperOptions:
    """The specimen's force model; the parameters come from a named set and may be replaced one by one.

    The specimen wears with the distance that its rod travels, if a rate is given: the model's force falls by
    `force_loss_per_km` of its first value, seal friction grows by `friction_gain_N_per_km`, gas force falls by
    `gas_loss_N_per_km`; `travelled_km` is the distance before the test.

    Two thermal nodes: the body is heated by `F v` and loses `heat_loss_W_K` to ambient, the coil is heated by `I^2 R`
    and loses `coil_to_body_W_K` to the body. Force depends on the body's temperature; the ECU sees the coil's.
    The force follows the coil's current with the time constant `fluid_lag_s`, the fluid's rheological response; 0: at
    once.
    """

    set: str = "demo"
    model: str = ""
    hysteresis: str = ""
    values: Mapping[str, float] = field(default_factory=dict)
    gas_force_N: float = 0.0
    seal_friction_N: float = 0.0
    seal_speed_m_s: Positive = 0.002
    mount_stiffness_N_m: float = 0.0
    free_play_m: float = 0.0
    force_loss_per_km: NotNegative = 0.0
    friction_gain_N_per_km: NotNegative = 0.0
    gas_loss_N_per_km: NotNegative = 0.0
    travelled_km: NotNegative = 0.0
    force_change_per_K: float = 0.0
    fluid_lag_s: NotNegative = 0.0
    heat_capacity_J_K: Positive = 1500.0
    heat_loss_W_K: float = 5.0
    coil_heat_capacity_J_K: Positive = 60.0
    coil_to_body_W_K: NotNegative = 3.0
    ambient_degC: float = 23.0
    start_degC: float = math.nan


@dataclass(frozen=True)
class SpecimenOptions:
    """The damper as a piece: where its mid-stroke lies in the rig's coordinate, and how long it is."""

    serial_number: str = "MR-001"
    mid_stroke_m: float = 0.0
    stroke_m: Positive = 0.190
    bump_stiffness_N_m: float = 5e5


@dataclass(frozen=True)
class CoilOptions:
    """Coil and current ECU; after `temperatures_until_s` (simulated s) it sends no temperature frames.

    The ECU regulates on its own measurement `current_gain * current + current_offset_A`: where that is wrong, the
    reported current still agrees with the commanded one, and the coil's true current is off. At 0 A its output stage is
    off: the coil has none, and the ECU reports its offset. `command_timeout_s` is how long it waits for a command
    before it drives 0 A (wall s); NaN: as its description states.
    """

    ohm: Positive = 1.5
    ohm_per_K: float = 0.0039
    eta_1_s: float = math.nan
    supply_V: Positive = 13.5
    limit_A: float = 5.0
    current_noise_A: float = 0.002
    current_gain: NotZero = 1.0
    current_offset_A: float = 0.0
    temperature_offset_K: float = 0.0
    over_temperature_degC: float = 150.0
    command_timeout_s: Positive = math.nan
    temperatures_until_s: float = math.inf
    serial_number: int = 1001
    boot_count: int = 3
    clock_offset_us: float = math.nan
    clock_ppm: float = math.nan


@dataclass(frozen=True)
class SensorOptions:
    """One serial sensor. Values are in its wire unit (`unit`); `wire_per_si` is the number of wire units per SI unit.

    `skew_s` is a delay of the measured quantity beyond the filter's, which neither the bench file nor the latched edges
    show; `clip` is where the amplifier saturates without saying so; without `latches_edges` there are no edge frames.
    After `numbers_until_s` (simulated s) every value is NaN. `drift_per_s` is a zero that creeps from the start (wire
    unit per simulated s), `hum` the amplitude of what the mains induce, `crosstalk_per_A` what the coil's current does.
    With `reversed` it counts the other way round, which the written bench file does not say. `format` is "frame16",
    "signed-decimal", or any described format; `described` is then its name or table in the bench file, and `wire_zero`
    what is on the wire for zero. A format with a request is answered. Modbus sensors with the same `line` belong to one
    device if their registers do not overlap.
    """

    unit: Literal["N", "mm", "m/s^2"] = "N"
    wire_per_si: Positive = 1.0
    rate_Hz: Annotated[float, Gt(0.0), Le(HIGHEST_RATE_Hz)] = 250.0
    format: Annotated[str | SensorFormat, Check(_sent, written=str)] = "frame16"
    described: str | Mapping[str, Any] = ""
    wire_zero: float = 0.0
    range: Positive = 10e3
    noise: float = 5.0
    resolution: float = 0.05
    offset: float = 0.0
    gain: NotZero = 1.0
    reversed: bool = False
    drift_per_s: float = 0.0
    hum: float = 0.0
    hum_Hz: float = 50.0
    crosstalk_per_A: float = 0.0
    bandwidth_Hz: Positive = 1000.0
    skew_s: Annotated[float, Ge(0.0), Le(0.1)] = 0.0
    clip: Positive = math.inf
    numbers_until_s: float = math.inf
    latches_edges: bool = True
    jitter_s: float = 2e-6
    latency_s: float = 0.5e-3
    burst_rate_Hz: float = 0.2
    burst_s: float = 6e-3
    serial_number: str = "LC-1"
    clock_offset_us: float = math.nan
    clock_ppm: float = math.nan
    baudrate: PositiveInt = 921_600
    line: str = ""


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
    stiffness_N_m: NotNegative = 0.0


@dataclass(frozen=True)
class RigOptions:
    """The whole simulated rig; NaN clocks and the like are drawn from the seed.

    `display` is handed on to the bench file, as its table `[display]`.
    """

    plant_rate_Hz: Annotated[float, Ge(4000.0), Le(100_000.0)] = 8000.0
    truth_rate_Hz: Annotated[float, Ge(1.0)] = 1000.0
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
    display: Mapping[str, str] = field(default_factory=dict)


SI_UNITS = {"N": "N", "mm": "m", "m/s^2": "m/s^2"}
"""Of a sensor, by its unit on the wire."""


def load_options(path: Path) -> RigOptions:
    """Read a TOML file over the defaults.

    Raises:
        FileProblem: unreadable, not TOML, or with unknown keys, wrong types or values out of range; all are listed.
    """
    from rig.files.loader import load_section  # loads the validator, which a start without a file does not need

    return _over(RigOptions(), load_section(path, _written())[0])


def with_option(options: RigOptions, assignment: str) -> RigOptions:
    """Replace one value given as `table.key=value`.

    Raises:
        FileProblem: no `=`, an unknown key, a wrong type or a value out of range.
    """
    from rig.files.loader import lines_of, validated  # as above
    key, equals, text = assignment.partition("=")
    if not equals:
        raise FileProblem("--option", [f"{assignment!r}: expected table.key=value, such as load_cell.noise=2.0"])
    nested = _parse(text)
    for part in reversed(key.strip().split(".")):
        nested = {part: nested}
    source = TomlSource(Path("--option"), text, frozen(nested), {})
    given, problems = validated(source.data, _written())
    if given is None:
        raise FileProblem("--option", lines_of(source, problems))
    return _over(options, given)


def _parse(text: str) -> object:
    """A TOML value, or the bare text when it is none."""
    try:
        value: object = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text.strip()
    return value


@functools.cache
def _written() -> type[DescriptionTable]:
    """What a file may hold: every constant by its type and range, none of them needed."""
    # loads pydantic: only when needed
    from rig.files.section import all_optional

    return all_optional(RigOptions)


def _over(base: Options, given: DescriptionTable) -> Options:
    """A copy of a dataclass with the values that are given put in."""
    changes: dict[str, Any] = {}
    for name in given.model_fields_set:
        value, present = getattr(given, name), getattr(base, name)
        if dataclasses.is_dataclass(present) and not isinstance(present, type):
            value = _over(present, value)
        changes[name] = {**present, **value} if isinstance(present, Mapping) else value
    return dataclasses.replace(base, **changes)
