"""The plant as one object: it owns the records, the damper's state and the outputs of the last slice."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig import dampers
from rig.dampers import DamperModel
from rig.dampers.current_law_model import CurrentLawModel
from simulators.controller_input import ControllerInput
from simulators.options import DamperOptions, RigOptions
from simulators.plant.model_step import address_of
from simulators.plant.records import COMMAND, CONSTANTS, EVENT_CAPACITY, MODE_OFF, STATE
from simulators.plant.step import COLUMNS, FORCE, PISTON, plant_loop

FloatArray = NDArray[np.float64]

TABLE_CAPACITY = 4096
MAXIMUM_STEPS = 8192
_EXACT_LAG_ETA = 25.0


class Plant:
    """Physics of the rig in simulated time.

    Attributes:
        constants, command, state: records of `records` (length 1 arrays), SI.
        table: the table waveform, metres about the centre.
        model: the damper's model; `values` its parameters by name.
        out: outputs of the last slice, (steps, `step.COLUMNS`).
        first_step: number of the step before the last slice's first row.
        position_input, force_input: what the controller's own electronics make of piston position and force.
    """

    def __init__(self, options: RigOptions) -> None:
        self.dt_s = 1.0 / options.plant_rate_Hz
        self.model, self.values = specimen_model(options.damper)
        self._base = self.model.vector(self.values)
        self._thermal = np.array([float(parameter.softens) for parameter in self.model.parameters])
        self._change_per_K = options.damper.force_change_per_K
        self._reference_degC = options.damper.ambient_degC
        self._wear = Wear(options.damper)
        self.constants = np.zeros(1, CONSTANTS)
        self.command = np.zeros(1, COMMAND)
        self.state = np.zeros(1, STATE)
        self._fields = {name: self.state[name] for name in STATE.names or ()}
        self._ordered = {name: self.command[name] for name in COMMAND.names or ()}
        self.table: FloatArray = np.zeros(1)
        self._fill_constants(options)
        self._fill_state(options)
        self.position_input = ControllerInput(options.position_input, self.dt_s, self.value("position_m"))
        self.force_input = ControllerInput(options.force_input, self.dt_s, 0.0)
        self._damper = self._base.copy()
        self._damper_state = np.ascontiguousarray(self.model.initial_state(float(self.state["damper_u_m"][0])))
        self._scratch = np.zeros_like(self._damper_state)
        self._buffer = np.zeros((MAXIMUM_STEPS, COLUMNS))
        self._events = np.zeros((EVENT_CAPACITY, 3))
        self.out: FloatArray = self._buffer[:0]
        self.first_step = 0

    @property
    def time_s(self) -> float:
        """Simulated time (s)."""
        return self.step * self.dt_s

    @property
    def step(self) -> int:
        """Number of steps run so far."""
        return int(self._fields["step"].item())

    def advance(self, steps: int) -> list[tuple[float, int, float]]:
        """Run `steps` steps, at most `MAXIMUM_STEPS`; returns the events as (simulated time s, kind, value).

        Raises:
            ValueError: more steps than the output holds.
        """
        if steps > MAXIMUM_STEPS:
            raise ValueError(f"a slice has at most {MAXIMUM_STEPS} steps, got {steps}")
        if self._change_per_K:
            warmer = float(self.state["temperature_degC"][0]) - self._reference_degC
            self._damper[:] = self._base * (1.0 + self._thermal * self._change_per_K * warmer)
        if self._wear.wears:
            self._apply_wear()
        self.first_step = self.step
        count = plant_loop()(
            steps,
            self.constants,
            self.command,
            self.state,
            address_of(self.model),
            self._damper,
            self._damper_state,
            self._scratch,
            self.table,
            self._buffer,
            self._events,
        )
        self.out = self._buffer[:steps]
        self._wear.travel(self.out[:, PISTON])
        self._moved()
        self.position_input.take(self.out[:, PISTON])
        self.force_input.take(self.out[:, FORCE])
        return [(float(time_s), int(kind), float(value)) for time_s, kind, value in self._events[:count]]

    def _apply_wear(self) -> None:
        """Set the constants of the damper to those after the distance travelled so far."""
        for name, value in self._wear.constants().items():
            self.constants[name][0] = value

    def _moved(self) -> None:
        """Where another system than the servo moves the rod: its outputs in place of those of the last slice."""

    def value(self, name: str) -> float:
        """One field of the state, SI."""
        return float(self._fields[name].item())

    def order(self, **fields: float) -> None:
        """Set fields of the command record."""
        for name, value in fields.items():
            self._ordered[name][0] = value

    def _fill_constants(self, options: RigOptions) -> None:
        servo, damper, coil = options.servo, options.damper, options.coil
        play_without_spring = damper.free_play_m > 0.0 and damper.mount_stiffness_N_m <= 0.0
        eta = self.values.get("eta", _EXACT_LAG_ETA) if math.isnan(coil.eta_1_s) else coil.eta_1_s
        fields: dict[str, Any] = {
            "dt_s": self.dt_s,
            "servo_rad_s": 2.0 * math.pi * servo.bandwidth_Hz,
            "servo_damping": servo.damping,
            "servo_stiffness_N_m": servo.stiffness_N_m,
            "actuator_friction_N": servo.friction_N,
            "actuator_friction_speed_m_s": servo.friction_speed_m_s,
            "position_gain": options.position_input.gain,
            "position_zero_m": options.position_input.zero,
            "mid_stroke_m": options.specimen.mid_stroke_m,
            "half_specimen_stroke_m": 0.5 * options.specimen.stroke_m,
            "bump_stiffness_N_m": options.specimen.bump_stiffness_N_m,
            "moving_mass_kg": options.moving_mass_kg,
            "force_scale": 1.0,
            "coil_ohm": coil.ohm,
            "coil_ohm_per_K": coil.ohm_per_K,
            "coil_eta_1_s": eta,
            "coil_voltage_V": coil.supply_V,
        }
        for source in (servo, damper):
            fields |= {name: getattr(source, name) for name in CONSTANTS.names or () if hasattr(source, name)}
        if play_without_spring:
            fields["mount_stiffness_N_m"] = 5e7
        for name, value in fields.items():
            self.constants[name][0] = value

    def _fill_state(self, options: RigOptions) -> None:
        start_m = options.servo.start_position_m
        damper = options.damper
        self.state["position_m"] = self.state["specimen_m"] = start_m
        self.state["setpoint_m"] = options.position_input.gain * start_m + options.position_input.zero
        self.state["damper_u_m"] = start_m - options.specimen.mid_stroke_m
        start_degC = damper.ambient_degC if math.isnan(damper.start_degC) else damper.start_degC
        self.state["temperature_degC"] = self.state["coil_degC"] = start_degC
        self.order(
            mode=MODE_OFF,
            move_acceleration_m_s2=options.controller.move_acceleration_m_s2,
            following_error_max_m=options.controller.following_error_max_m,
            fade_cycles=1.0,
            frequency_Hz=1.0,
        )


class Wear:
    """Wear of the specimen with the distance that its rod travels.

    Args:
        options: its rates; all 0: no wear.
    """

    def __init__(self, options: DamperOptions) -> None:
        self._options = options
        self._last_m = math.nan
        self.travelled_km = options.travelled_km

    @property
    def wears(self) -> bool:
        """Whether anything changes with the distance."""
        rates = self._options
        return rates.force_loss_per_km + rates.friction_gain_N_per_km + rates.gas_loss_N_per_km > 0.0

    def travel(self, position_m: FloatArray) -> None:
        """Add the distance along positions (n,), m."""
        if not self.wears or not len(position_m):
            return
        first_m = 0.0 if math.isnan(self._last_m) else abs(float(position_m[0]) - self._last_m)
        self.travelled_km += 1e-3 * (first_m + float(np.sum(np.abs(np.diff(position_m)))))
        self._last_m = float(position_m[-1])

    def constants(self) -> dict[str, float]:
        """The plant's constants that wear changes."""
        rates, km = self._options, self.travelled_km
        return {
            "force_scale": max(0.0, 1.0 - rates.force_loss_per_km * km),
            "seal_friction_N": rates.seal_friction_N + rates.friction_gain_N_per_km * km,
            "gas_force_N": max(0.0, rates.gas_force_N - rates.gas_loss_N_per_km * km),
        }


def specimen_model(options: DamperOptions) -> tuple[DamperModel, dict[str, float]]:
    """Model and complete parameter values that the options name.

    A model named without a set of its own takes the set `demo-<model>`, or `demo` for the asymmetric model; a current
    law behind its name (`asymmetric+saturating`) has plausible values, which `values` may replace.

    Raises:
        rig.dampers.UnknownName: no such model or set.
        KeyError: a replaced value's name is not one of the model's.
        ValueError: model and set do not belong together.
    """
    name, base = options.set, options.model.partition("+")[0]
    if base and options.set == "demo" and base != "asymmetric":
        name = "demo-" + base.replace("_", "-")
    chosen = dampers.parameter_set(name)
    if base and base != chosen.model:
        raise ValueError(f"parameter set {name!r} belongs to model {chosen.model!r}, not {base!r}")
    hysteresis: Any = options.hysteresis or chosen.hysteresis
    model = dampers.model(options.model or chosen.model, hysteresis)
    values = {**chosen.values, **options.values}
    if isinstance(model, CurrentLawModel):
        values = {**model.law.demonstration, **values}
    model.vector(values)
    return model, values
