"""A sensor of the simulated rig with its port."""

from __future__ import annotations

from dataclasses import dataclass

from simulators.sensor import Sensor
from simulators.serial_port import SensorPort


@dataclass
class Channel:
    """A sensor, its port, and the column of the plant's output it measures."""

    name: str
    sensor: Sensor
    port: SensorPort
    column: int
