"""What tests of the station's parts share: a configuration without devices, and what was told to the application."""

from __future__ import annotations

from rig.bench.sensor_settings import Calibration, LoadCell, Lvdt
from rig.bench.settings import ActuatorConfig, EcuConfig, Limits, StationConfig


class Journal(list[dict[str, object]]):
    """Events in the order they were emitted."""

    def slugs(self, event: str) -> list[object]:
        """Slugs of the events of that name."""
        return [each["slug"] for each in self if each["event"] == event]


def config_for(url: str = "nowhere", actuator_url: str = "modbus-tcp://127.0.0.1:1") -> StationConfig:
    """A station whose sensors are at `url` and whose controller is at `actuator_url`."""
    return StationConfig(
        actuator=ActuatorConfig(url=actuator_url),
        ecu=EcuConfig(interface="slcan", channel=url),
        load_cell=LoadCell(url=url, rate_Hz=250.0, range_N=1e4, calibration=Calibration(serial_number="LC-1")),
        lvdt=Lvdt(url=url, rate_Hz=250.0, range_m=0.1, calibration=Calibration(serial_number="LV-1")),
        limits=Limits(
            position_m=(-0.085, 0.085), speed_m_s=0.8, acceleration_m_s2=60.0, force_N=5000.0, current_A=3.0,
            coil_temperature_degC=120.0,
        ),
        ring_path="nowhere",
    )
