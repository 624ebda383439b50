"""Names of the identification methods a file may ask for.

As in `rig.identification`, which lies above this room and may not be imported here; a test compares the two.
"""

METHODS = (
    "separable", "c_foa", "foa", "ga", "de", "pso", "i_abc", "ga_standard", "ga_kwok", "ga_novel", "hybrid",
    "zhu_three_step",
)  # fmt: skip

DEPENDENCES = ("affine", "per-current-affine", "per-current-polynomial", "per-current-lagrange")
"""How parameters may depend on the current."""
