"""What tests of the station's parts share: a configuration without devices, and what was told to the application."""

from __future__ import annotations

from rig.station.config import ActuatorConfig, EcuConfig, Limits, SensorConfig, StationConfig


class Told(list[dict[str, object]]):
    """Events in the order they were emitted."""

    def slugs(self, event: str) -> list[object]:
        """Slugs of the events of that name."""
        return [each["slug"] for each in self if each["event"] == event]


def config_for(url: str = "nowhere", actuator_url: str = "modbus-tcp://127.0.0.1:1") -> StationConfig:
    """A station whose sensors are at `url` and whose controller is at `actuator_url`."""
    return StationConfig(
        actuator=ActuatorConfig(actuator_url),
        ecu=EcuConfig("slcan", url),
        load_cell=SensorConfig("load_cell", url, 250.0, 1e4, 0.02),
        lvdt=SensorConfig("lvdt", url, 250.0, 0.1, 0.02),
        limits=Limits(-0.085, 0.085, 0.8, 60.0, 5000.0, 3.0, 120.0),
        ring_path="nowhere",
    )
