"""Provenance of the station's own channels, combined with the channels of the connected devices."""

from __future__ import annotations

from collections.abc import Iterable

from drivers.origins import ChannelOrigin, Origins
from drivers.ring import Channel

COMPUTED = ChannelOrigin("station", "value = computed by the station")
OWN: Origins = {
    Channel.TRIP: ChannelOrigin("station", "value = the station's code of the interlock"),
    Channel.LOOP_LATE: ChannelOrigin("station", "value = measured by the station"),
    Channel.HYBRID_SEEN: ChannelOrigin("station", "value = the newest displacement sample minus the centre"),
    **dict.fromkeys((
        Channel.HYBRID_TIME, Channel.HYBRID_TARGET, Channel.HYBRID_BODY, Channel.HYBRID_WHEEL, Channel.SIGNAL_TIME,
        Channel.SIGNAL_TARGET, Channel.SIGNAL_COMMAND, Channel.SIGNAL_FORCE,
    ), COMPUTED),
}


def stated_origins(of_devices: Iterable[Origins]) -> dict[str, dict[str, str]]:
    """The origin of every channel by its name in the recording, as JSON carries it."""
    merged = dict(OWN)
    for origins in of_devices:
        merged.update(origins)
    return {channel.label: origin._asdict() for channel, origin in merged.items()}
