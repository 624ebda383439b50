"""A fitted model that can be evaluated: which values it has at which current."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.current_law import CurrentLaw
from rig.dampers.current_law_model import CurrentLawModel
from rig.dampers.model import DamperModel
from rig.dampers.temperature_law import TemperatureLaw
from rig.errors import IdentificationFailed
from rig.fits.relation import CurrentRelations
from rig.identification.models.measurement import Measurement
from rig.identification.models.model_slope import modelled_force
from rig.identification.models.temperature_effect import force_change_N


@dataclass(frozen=True)
class Law:
    """A damper model with values, which may depend on the current by relations.

    Attributes:
        model: the damper model, without its current law.
        values: parameter name to value (SI), complete but for relations.
        current: relations to the current of parameters fitted at each current alone; None for one set of values.
        eta_1_s: rate of the coil's first-order lag (1/s); None where it is not known.
        felt: the current law and its values; None where the current is felt as it is.
        temperature: how warm oil weakens the damper; None where that is not known. The values are at its reference.
        at_degC: the only temperature (degC) at which it holds; None where there is no such.
    """

    model: DamperModel
    values: Mapping[str, float]
    current: CurrentRelations | None = None
    eta_1_s: float | None = None
    felt: tuple[CurrentLaw, Mapping[str, float]] | None = None
    temperature: TemperatureLaw | None = None
    at_degC: float | None = None

    @classmethod
    def of(cls, model: DamperModel, found: Mapping[str, float | None], current: CurrentRelations | None) -> Law:
        """The law of fitted values; None is a value that is not known.

        Raises:
            IdentificationFailed: values are missing without which the force is not known; they are named.
        """
        eta_1_s = found.get("eta")
        if current is not None:
            return cls(model, {}, current, eta_1_s)
        missing = [name for name in model.names if name != "eta" and found.get(name) is None]
        if missing:
            raise IdentificationFailed(
                f"this fit of {model.name} has no value for {', '.join(missing)}, so the force cannot be computed. "
                "Fix: add the tests that `reason` in the fit recommends"
            )
        values = {name: float(value) for name in model.names if (value := found.get(name)) is not None}
        if "eta" in model.names:
            values.setdefault("eta", model.parameter("eta").start)  # the coil's: no part of the force
        if isinstance(model, CurrentLawModel):
            bend = {name: values.pop(name) for name in model.law.names}
            return cls(model.base, values, None, eta_1_s, (model.law, bend))
        return cls(model, values, None, eta_1_s)

    def at_reference(self) -> Law:
        """The law at its reference temperature, whatever the temperature is."""
        if self.temperature is None:
            return self
        return replace(self, temperature=None, at_degC=self.temperature.reference_degC)

    def vectors(self, current_A: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Parameters at currents (A), shape (1 or n, P), and the current that the equation sees there, shape (n,)."""
        if self.current is None:
            return self.model.vector(self.values)[None, :], np.ascontiguousarray(self._felt_A(current_A), dtype=float)
        levels, place = np.unique(current_A, return_inverse=True)
        rows = np.array([self.model.vector(self._at(float(level))) for level in levels])
        return np.ascontiguousarray(rows[place.ravel()]), np.zeros(current_A.size)

    def _felt_A(self, current_A: FloatArray) -> FloatArray:
        if self.felt is None:
            return current_A
        law, values = self.felt
        return law.felt_A(values, current_A)

    def _at(self, current_A: float) -> dict[str, float]:
        if self.current is None:
            return dict(self.values)
        values = self.current.values_at(self.model, current_A)
        return values | ({"eta": self.model.parameter("eta").start} if "eta" in self.model.names else {})

    def force_of(self, test: Measurement) -> FloatArray:
        """Force (N), shape (n,), of a measured test after a cycle of warm-up, as fits score it."""
        if self.current is None:
            seen = test if self.felt is None else replace(test, current_A=self._felt_A(test.current_A))
            force_N = modelled_force(self.model, self.values, seen)
            if self.temperature is None:
                return force_N
            return force_N + force_change_N(self.model, self.values, self.temperature, seen)
        values = self._at(float(np.mean(test.current_A)))
        still = test.rows(slice(0, test.u_m.size))
        still.__dict__.update(current_A=np.zeros_like(test.current_A))
        return modelled_force(self.model, values, still)
