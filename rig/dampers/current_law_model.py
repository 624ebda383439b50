"""A damper model behind a current law: the same equation, with what its fluid feels in place of the coil's current."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from rig.dampers.arrays import FloatArray
from rig.dampers.current_law import CurrentLaw, current_law
from rig.dampers.model import DamperModel

if TYPE_CHECKING:
    from rig.dampers.kernel import Kernel
    from rig.dampers.sampled_motion import Motion
    from rig.dampers.separation import MotionScale, Search, Separation

PLUS = "+"
_SHARED = ("states", "positions", "memories", "energy", "forms", "jumps_at", "redundant", "speeds_tell_yield",
           "apart_at_one_current")  # fmt: skip


class CurrentLawModel(DamperModel):
    """A model with a current law; its name is both, such as `asymmetric+saturating`.

    Attributes:
        base: the model.
        law: the law.
    """

    base: DamperModel
    law: CurrentLaw

    def __init__(self, base: DamperModel, law: CurrentLaw) -> None:
        self.base, self.law, self.hysteresis = base, law, base.hysteresis
        self.parameters = (*base.parameters, *law.parameters)

    def of_base(self, values: Mapping[str, float]) -> dict[str, float]:
        """The values that are the base model's own."""
        return {name: values[name] for name in self.base.names if name in values}

    def kernel(self) -> Kernel:
        """See `DamperModel.kernel`."""
        from rig.dampers.compiled_cache import njit  # loads numba
        from rig.dampers.kernel import ForceTarget, Instant, Kernel, kernel_of  # loads numba

        inner, felt = kernel_of(self.base), self.law.compiled(len(self.base.parameters))
        inner_force, inner_rates, inner_rate, inner_step = inner.force, inner.rates, inner.fastest_rate, inner.step

        @njit()
        def force(p: FloatArray, s0: float, s1: float, u: float, v: float, a: float, current: float) -> float:
            return float(inner_force(p, s0, s1, u, v, a, felt(p, current)))

        @njit()
        def rates(p: FloatArray, s0: float, s1: float, u: float, v: float, current: float) -> tuple[float, float]:
            r0, r1 = inner_rates(p, s0, s1, u, v, felt(p, current))
            return r0, r1

        @njit()
        def fastest_rate(p: FloatArray, v: float, current: float) -> float:
            return float(inner_rate(p, v, felt(p, current)))

        @njit()
        def step(p: FloatArray, state: FloatArray, motion: Motion, current: float, dt: float) -> bool:
            return bool(inner_step(p, state, motion, felt(p, current), dt))

        # Parts that the model does not have are not replaced, because loops omit them.
        own = Kernel(force, loop=inner.loop)
        if inner.rates is not own.rates:
            own = replace(own, rates=rates, fastest_rate=fastest_rate)
        if inner.step is not own.step:
            own = replace(own, step=step)
        inner_held = inner.held
        if inner_held is None:
            return own

        @njit()
        def held(p: FloatArray, state: FloatArray, motion: Instant, current: float, target: ForceTarget) -> float:
            return float(inner_held(p, state, motion, felt(p, current), target))

        return replace(own, held=held)

    def separation(self, scale: MotionScale) -> Separation | None:
        """See `DamperModel.separation`: None; a fit searches the law about fits of the base model."""
        del scale
        return None

    def search(self) -> Search:
        """See `DamperModel.search`.

        Raises:
            NotImplementedError: always; a fit searches the law about fits of the base model.
        """
        raise NotImplementedError(
            f"{self.name}: the current law is determined by a search; {self.base.name} is fitted for each candidate law"
        )

    def initial_state(self, u_m: float = 0.0) -> FloatArray:
        """See `DamperModel.initial_state`."""
        return self.base.initial_state(u_m)

    def force(
        self,
        parameters: Mapping[str, float],
        u: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        current: ArrayLike,
        dt_s: float,
    ) -> FloatArray:
        """See `DamperModel.force`.

        Raises:
            KeyError: a parameter is missing or unknown.
        """
        self.vector(parameters)
        return self.base.force(self.of_base(parameters), u, v, a, self.law.felt_A(parameters, current), dt_s)

    def force_at(self, parameters: Mapping[str, float], v: ArrayLike, current: ArrayLike) -> FloatArray:
        """See `DamperModel.force_at`.

        Raises:
            KeyError: a parameter is missing or unknown.
        """
        return self.base.force_at(self.of_base(parameters), v, self.law.felt_A(parameters, current))


@cache
def with_law(base: DamperModel, law_text: str) -> DamperModel:
    """The model behind a law written as `rig.dampers.current_law.current_law` reads it; itself behind `affine`.

    Raises:
        UnknownLaw: there is no such law.
    """
    law = current_law(law_text)
    if law is None:
        return base
    if isinstance(base, CurrentLawModel):
        return with_law(base.base, law_text)
    names: dict[str, Any] = {name: getattr(base, name) for name in _SHARED}
    names["name"] = f"{base.name}{PLUS}{law.text}"
    names["equation"] = f"{base.equation}, with x in place of I, {law.formula}"
    names["demonstration"] = {**base.demonstration, **law.demonstration}
    made: DamperModel = type("CurrentLawModel", (CurrentLawModel,), names)(base, law)
    return made


def base_of(model: DamperModel) -> DamperModel:
    """The model without its current law."""
    return model.base if isinstance(model, CurrentLawModel) else model
