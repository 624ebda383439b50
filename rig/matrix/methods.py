"""Names of the identification methods that a file may request.

The same as in `rig.identification`, which is above this room and cannot be imported here; a test compares the two.
"""

from __future__ import annotations

from rig import plugins

METHODS = (
    "separable", "c_foa", "foa", "ga", "de", "pso", "i_abc", "ga_standard", "ga_kwok", "ga_novel", "hybrid",
    "zhu_three_step",
)  # fmt: skip

FEW_MODELS = ("asymmetric", "normalized_bouc_wen", "lost_motion", "sprung_bouc_wen", "thixotropic_bouc_wen")
"""A hysteretic tanh, the hysteresis that most publications use, and what fits real dampers best: seconds together."""

DEPENDENCES = ("affine", "per-current-affine", "per-current-polynomial", "per-current-lagrange")
"""How parameters may depend on the current."""

LAWS = ("affine", "saturating", "polynomial", "per-current", "all")
"""What the fluid may feel of the current; `all`: these compared."""


TEMPERATURE_LAWS = ("none", "viscous", "yield", "common", "both")
"""Which parameters warm oil may weaken."""


def method_names() -> tuple[str, ...]:
    """Every method: this program's, then those of plug-ins, of which nothing is loaded."""
    return tuple(dict.fromkeys((*METHODS, *(plug_in.name for plug_in in plugins.found(plugins.METHODS)))))


def check_method(name: str) -> None:
    """Load a method that is a plug-in's; one of this program's needs no look.

    Raises:
        PlugInProblem: the plug-in cannot be used.
        KeyError: no such method.
    """
    if name not in METHODS:
        # loads all algorithms and numpy: only when needed
        from rig.optimisers import METHODS as SEARCHES

        SEARCHES[name]
