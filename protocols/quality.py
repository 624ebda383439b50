"""Quality flags that accompany every sample from the wire to the recorded file."""

from __future__ import annotations

from enum import IntFlag


class Quality(IntFlag):
    """What is known to be wrong with one sample; 0 is a good sample."""

    GOOD = 0
    OVERLOAD = 1
    """The conditioner reports that its input left its range; the value is not the physical quantity."""
    SENSOR_FAULT = 2
    """The conditioner reports a broken sensor or cable."""
    GAP_BEFORE = 4
    """Samples were lost, or the device's clock or sequence jumped, between the previous sample and this one."""
    NOT_A_NUMBER = 8
    """The wire carried NaN or infinity, or an overload token instead of a number."""
    SPIKE = 16
    """Slew beyond what the machine can do; set by the station."""
    STALE = 32
    """Older than its limit when it was used; set by the station."""
    CLOCK_BACK = 64
    """The device's clock went back before this sample: it has no place in time; set when a recording is aligned."""


NO_VALUE = Quality.OVERLOAD | Quality.SENSOR_FAULT | Quality.NOT_A_NUMBER
"""Flags of a sample whose value is not the physical quantity: the project's one definition of a bad sample."""
DOUBTFUL = NO_VALUE | Quality.SPIKE
"""... or may not be."""
