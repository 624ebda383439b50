"""A damper model and what it leaves: the residual force as a small regression on states that the physics defines.

    F = F_model(u, v, a, I) + g(u) g(v) g(I) sum_j (c_j0 + c_j1 y + c_j2 y^2 + c_j3 ((1 - y) / 2)^4) phi_j
    y = (I - i_mid) / i_half

The fourth power is for what differs at small currents only, such as remanence. The regressors phi_j are, by part,

    slip     z_k and z_k^3 of six elastic-plastic elements: z_k moves by du / travel_k and stays within -1 and 1
             (Prandtl 1928; in parallel Iwan 1966): the effect of the travel since the reversal, with inner loops
    speed    s, s^3 and s / sqrt(s^2 + b^2) for three b, s = v / v_top
    stroke   1, r, r^2, r^3, r^4, r = (u - u_mid) / u_half: gas and stops

and g(.) is 1 in the tested range and falls to 0 within `FADES` of it beyond, so that far outside the force is that of
the model alone. All regressors are bounded there and the elements' states by 1, so the residual cannot make a
simulation unstable. At a constant current a stroke term is a potential and returns what it takes; c z + d z^3 stores
energy while its element sticks and dissipates it while it slides, where c + d is not negative
(docs/maintainers/decisions/grey-box.md).

The weights c are found by `rig.identification.grey_box`; the model's own parameters are those of its fit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from rig.dampers.arrays import FloatArray
from rig.dampers.grey_regressors import (
    ELEMENTS,
    OF_CURRENT,
    PARTS,
    REGRESSORS,
    SLIP,
    SPEED,
    TRAVELS,
    residual_force,
    weight_names,
)
from rig.dampers.model import DamperModel, KernelModel
from rig.dampers.parameter import Parameter
from rig.errors import RigError

if TYPE_CHECKING:
    from rig.dampers.kernel import Kernel
    from rig.dampers.separation import MotionScale, Search, Separation

GREY = "grey"
SUFFIX = f"+{GREY}"
AT = "@"
_SHARED = ("positions", "memories", "forms", "jumps_at", "redundant", "speeds_tell_yield", "apart_at_one_current",
           "non_negative", "demonstration")  # fmt: skip


class UnknownPart(RigError):
    """A residual is named by a part that does not exist; the message states those that do."""


def _range_parameters() -> tuple[Parameter, ...]:
    meanings = {
        "u_mid": ("m", 0.0, "middle of the tested displacements"), "u_half": ("m", 0.02, "half of their range"),
        "v_top": ("m/s", 0.2, "largest tested speed"), "i_mid": ("A", 1.0, "middle of the tested currents"),
        "i_half": ("A", 1.0, "half of their range"), "ridge": ("1", 1e-3, "penalty of the weights, as found"),
    }  # fmt: skip
    return tuple(
        Parameter(name, name, unit, start, -1e3 if name.endswith("mid") else 1e-9, 1e3, False, f"residual: {meaning}")
        for name, (unit, start, meaning) in meanings.items()
    )


def _travels() -> tuple[Parameter, ...]:
    return tuple(
        Parameter(name, name, "m", 1e-3, 1e-9, 10.0, False, f"residual: travel of element {k}")
        for k, name in enumerate(TRAVELS, 1)
    )


def _weights(parts: Sequence[str]) -> tuple[Parameter, ...]:
    terms = [regressor for part in parts for regressor in REGRESSORS[part]]
    meanings = [f"residual: {term}{function}" for term in terms for function in OF_CURRENT]
    return tuple(
        Parameter(name, name, "N", 0.0, -1e6, 1e6, True, meaning)
        for name, meaning in zip(weight_names(parts), meanings, strict=True)
    )


class GreyBoxModel(KernelModel):
    """A model and a residual; its name is both, such as `lost_motion+grey@slip,speed`.

    Attributes:
        base: the physical model, with its current law where it has one.
        parts: parts of the residual, of `PARTS`.
        first: place in the kernel's vector of the first of the residual's parameters.
    """

    base: DamperModel
    parts: tuple[str, ...]

    def __init__(self, base: DamperModel, parts: tuple[str, ...]) -> None:
        self.base, self.parts, self.hysteresis = base, parts, base.hysteresis
        self.first = len(base.parameters)
        travels = _travels() if SLIP in parts else ()
        self.parameters = (*base.parameters, *_range_parameters(), *travels, *_weights(parts))

    def of_base(self, values: Mapping[str, float]) -> dict[str, float]:
        """The values that are the physical model's own."""
        return {name: values[name] for name in self.base.names if name in values}

    @property
    def residual_names(self) -> tuple[str, ...]:
        """Names of the residual's parameters: ranges, travels, weights."""
        return tuple(parameter.name for parameter in self.parameters[self.first :])

    @property
    def first_memory(self) -> int:
        """See `DamperModel.first_memory`."""
        return self.base.first_memory

    def initial_state(self, u_m: float = 0.0) -> FloatArray:
        """See `DamperModel.initial_state`; the elements are free of force."""
        own = self.base.initial_state(u_m)[: self.base.states]
        state = np.concatenate((own, np.zeros(self.states - self.base.states)))
        return state if state.size else np.zeros(1)

    def kernel(self) -> Kernel:
        """See `DamperModel.kernel`."""
        from rig.dampers.grey_kernel import grey_kernel  # loads numba

        return grey_kernel(self.base, self.parts, self.first, self.states)

    def separation(self, scale: MotionScale) -> Separation | None:
        """See `DamperModel.separation`: None; the physical model is fitted, then the residual."""
        del scale
        return None

    def search(self) -> Search:
        """See `DamperModel.search`.

        Raises:
            NotImplementedError: always; the physical model is fitted, then the residual.
        """
        raise NotImplementedError(f"{self.name}: {self.base.name} is fitted, then the residual")

    def force_at(self, parameters: Mapping[str, float], v: ArrayLike, current: ArrayLike) -> FloatArray:
        """See `DamperModel.force_at`; all elements slide.

        Raises:
            KeyError: a parameter is missing or unknown.
        """
        self.vector(parameters)
        v_grid, current_grid = np.broadcast_arrays(np.asarray(v, dtype=float), np.asarray(current, dtype=float))
        slides = np.repeat(np.sign(v_grid).reshape(-1, 1), ELEMENTS, axis=1)
        zero = np.zeros(v_grid.size)
        left = residual_force(self.parts, parameters, zero, v_grid.ravel(), current_grid.ravel(), slides)
        return np.asarray(self.base.force_at(self.of_base(parameters), v, current) + left.reshape(v_grid.shape))


@cache
def with_residual(base: DamperModel, parts: tuple[str, ...]) -> DamperModel:
    """The model with a residual of these parts; itself without any.

    Raises:
        UnknownPart: there is no such part, or one is named twice or out of order.
    """
    if not parts:
        return base
    if parts != tuple(part for part in PARTS if part in parts):
        raise UnknownPart(
            f"{base.name}{SUFFIX}: got parts {', '.join(parts)}, expected one or more of {', '.join(PARTS)}, each once "
            f"and in this order, such as {base.name}{SUFFIX}{AT}{SLIP},{SPEED}"
        )
    names: dict[str, Any] = {name: getattr(base, name) for name in _SHARED if hasattr(base, name)}
    names["name"] = f"{base.name}{SUFFIX}{AT}{','.join(parts)}"
    names["states"] = base.states + (ELEMENTS if SLIP in parts else 0)
    names["equation"] = f"{base.equation}; plus a fitted residual ({', '.join(parts)}), 0 outside the tested range"
    names["energy"] = f"{base.energy}; the residual is checked on closed cycles within the tested range".lstrip("; ")
    made: DamperModel = type("GreyBoxModel", (GreyBoxModel,), names)(base, parts)
    return made


def named_parts(name: str) -> tuple[str, tuple[str, ...]] | None:
    """The physical model's name and the parts of a grey-box model's name; None if the name has no residual.

    A name without parts, such as `lost_motion+grey`, requests a residual whose parts the fit chooses: ().
    """
    base, suffix, rest = name.rpartition(SUFFIX)
    if not suffix or (rest and not rest.startswith(AT)):
        return None
    return base, tuple(rest[1:].split(",")) if rest else ()


def physical(model: DamperModel) -> DamperModel:
    """The model without its residual."""
    return model.base if isinstance(model, GreyBoxModel) else model
