"""Delay of a sensor's filter at low frequencies: a second-order Butterworth low-pass."""

from __future__ import annotations

import math

FILTER_DELAY = math.sqrt(2.0)
"""Group delay times angular cut-off frequency."""
DELAY_TIMES_BANDWIDTH = FILTER_DELAY / math.tau
"""Group delay times cut-off frequency, 0.225."""
