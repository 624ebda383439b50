"""Where the values of a ring channel come from, as stated by the driver that makes them; the recording writes that.

A driver that states nothing has its channels recorded without an origin, never with another driver's.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Protocol, runtime_checkable

from drivers.ring import Channel


class ChannelOrigin(NamedTuple):
    """The origin of one channel.

    Attributes:
        source: what gave the value: "ecu", "supply", "output", "operator", "controller", "station".
        from_wire: how the SI value was made of what was on the wire, or computed.
        long_name: one line for people; empty: the channel's general name.
    """

    source: str
    from_wire: str
    long_name: str = ""


Origins = Mapping[Channel, ChannelOrigin]


@runtime_checkable
class StatesOrigins(Protocol):
    """A driver that states the origin of each of its channels."""

    @property
    def origins(self) -> Origins:
        """By channel; a channel that the device does not have is absent."""


def origins_of(driver: object) -> Origins:
    """What a driver states of its channels; empty for one that states nothing."""
    return driver.origins if isinstance(driver, StatesOrigins) else {}
