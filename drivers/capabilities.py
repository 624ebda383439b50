"""What an actuator can do, as its description or its driver declares it; and what is left without it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

PRESSURE_LEVELS = ("off", "low", "on")
"""Pressures at which a watchdog may be tested, ascending."""


class WatchdogKind(StrEnum):
    """How an actuator notices that its host is gone."""

    COUNTER = "counter"
    """A changed counter feeds it; reading does not."""
    TIMEOUT = "timeout"
    """A keep-alive, or any command, feeds it."""
    NONE = "none"


@dataclass(frozen=True)
class Capabilities:
    """What an actuator can do.

    Attributes:
        watchdog: how it notices that its host is gone.
        hydraulics: the host can take the pressure (or the drive's power) away, and see that it is gone.
        low_pressure: it has a low pressure between off and full.
        lease: it obeys one host at a time.
        acquires, releases: it has such a command, whether or not it shows who holds the lease.
        acknowledge: its status names the last command and its result.
        echo: its status repeats the watchdog's counter.
        limits_read_back: it holds the rig's limits, which can be read back.
        settings_written: it holds some of them, such as its watchdog's time, which are written and read back.
        settings_hash: its identity shows a reboot or changed settings.
        phase: its status says where in its envelope a program is.
        cycle_pulse: an output pulses at every cycle, for the sensors to latch.
        generator: a function generator of its own runs programs; else the driver makes their set-points.
        table: it plays table waveforms.
        streamed_setpoints: it follows set-points that are sent one by one.
        e_stop_input: it sees the hard-wired chain.
        force_input: it measures a coarse force of its own.
        tried: its description was tried on such a device, or on one made from the maker's document alone.
        sine, triangle: it can produce sine or triangle motions.
        watchdog_tested: the pressure at which its watchdog works and is tested: "off", "low" or "on".
        clock: it tells the time of its own clock; else the host's is taken.
        speed: it measures the rod's speed; else that is a difference of its positions.
    """

    watchdog: WatchdogKind
    hydraulics: bool
    low_pressure: bool = True
    lease: bool = False
    acquires: bool = False
    releases: bool = False
    acknowledge: bool = False
    echo: bool = False
    limits_read_back: bool = False
    settings_written: bool = False
    settings_hash: bool = False
    phase: bool = False
    cycle_pulse: bool = False
    generator: bool = False
    table: bool = False
    streamed_setpoints: bool = False
    e_stop_input: bool = False
    force_input: bool = False
    tried: bool = True
    sine: bool = True
    triangle: bool = True
    watchdog_tested: str = "off"
    clock: bool = True
    speed: bool = True

    @property
    def can_be_stopped(self) -> bool:
        """Something stops the rig when the host does not: a watchdog, or pressure that can be taken away."""
        return self.watchdog is not WatchdogKind.NONE or self.hydraulics

    def lacking(self) -> tuple[tuple[str, str], ...]:
        """What it cannot do: name of the capability, and what is left without it, for people."""
        without = {
            "watchdog": (
                self.watchdog is not WatchdogKind.NONE,
                "the actuator does not detect a failure of the host; only the coil current is set to 0 A, after "
                "the time-out of the current source",
            ),
            "unpowered-watchdog": (
                self.watchdog_tested == "off", "the watchdog works only under pressure (or power), so it is tested "
                f"under pressure: level \"{self.watchdog_tested}\", at rest and at 0 A. Until the end of this test, "
                "only this host can switch the pressure off"
            ),
            "hydraulics": (self.hydraulics, "the pressure cannot be switched off from this host; after a stop the "
                "actuator holds its position"),
            "lease": (self.lease, "commands from another host are not rejected; do not connect a second host"),
            "acknowledge": (
                self.acknowledge, "commands are not acknowledged; a stop is confirmed only by standstill"
            ),
            "echo": (
                self.echo or self.watchdog is WatchdogKind.NONE, "a missing watchdog refresh is detected only when "
                    "the watchdog trips"
            ),
            "limits": (self.limits_read_back, "limits are monitored only by the station, not by the actuator"),
            "settings": (self.settings_hash, "a reboot or changed settings are not detected"),
            "cycle-pulse": (
                self.cycle_pulse, "no cycle pulses: delays between sensors are estimated from their signals; a loose "
                    "joint is not detected during motion"
            ),
            "generator": (self.generator, "the host streams one set-point per poll: only slow motion is possible, "
                "and a delay or failure of the host directly affects the motion"),
            "e-stop-input": (self.e_stop_input, "an open e-stop chain is not detected"),
            "force-input": (self.force_input, "the load cell is not compared with a second force measurement"),
            "trial": (
                self.tried, "unverified: this register map has never been tested on such a device; before any motion, "
                    "check that `rig check` shows the device's own values"
            ),
        }
        return tuple((name, text) for name, (has, text) in without.items() if not has)
