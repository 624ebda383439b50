"""The array types of this project, and a record of samples as a value; shapes are in the docstrings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class TimeSeries:
    """Samples (n,) of one quantity with their times, s, increasing; NaN where there is none."""

    time_s: FloatArray
    values: FloatArray
