"""An analogue input of the actuator controller: its filter, delay, gain, zero, noise and resolution."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from simulators.conditioner import condition
from simulators.delay_line import DelayLine
from simulators.options import InputOptions

FloatArray = NDArray[np.float64]
_NONE = np.zeros(0)


class ControllerInput:
    """Follows a quantity of the plant; what a register shows of it is read at any time.

    Attributes:
        zero: as the options say it, until a fault moves it.
    """

    def __init__(self, options: InputOptions, dt_s: float, start: float) -> None:
        self.options = options
        self.zero = options.zero
        self._dt_s = dt_s
        self._delay = DelayLine(options.delay_s, dt_s)
        self._filter = np.array([start, 0.0, start, start])
        self._started = False

    def take(self, signal: FloatArray) -> None:
        """The plant's values (n,) of one slice, SI."""
        if not len(signal):
            return
        if not self._started:
            self._filter[:] = (signal[0], 0.0, signal[0], signal[0])
            self._started = True
        if self.options.delay_s > 0.0:
            signal = self._delay.delayed(signal)
        signal = np.ascontiguousarray(signal)  # a column of the plant's: another layout would be compiled again
        condition(signal, self._dt_s, 2.0 * math.pi * self.options.bandwidth_Hz, self._filter, 0.0, _NONE, _NONE)

    def read(self, random: np.random.Generator) -> float:
        """What the register shows now (SI); every reading has noise of its own."""
        options = self.options
        value: float = options.gain * self._filter.item(0) + self.zero + options.noise * random.standard_normal()
        if options.resolution > 0.0:
            value = round(value / options.resolution) * options.resolution
        return float(value)
