"""Makes the test's own actuator known in every Python process of a campaign, through the door all devices use."""

from drivers.catalogue import register_actuator
from drivers.connection import ActuatorConnection
from drivers.roles import Actuator


def make(connection: ActuatorConnection) -> Actuator:
    from plain_actuator import PlainActuator

    return PlainActuator(connection)


register_actuator("plain", make)
