"""How fast simulated time runs: `speed` times the wall at most, later when this process or a reader falls behind."""

from __future__ import annotations

from collections.abc import Sequence

from simulators.serial_port import CAPACITY, SensorPort

LONGEST_LAG_S = 0.25
LONGEST_LAG_FAST_S = 0.02
LONGEST_WAIT_S = 0.45
CATCH_UP = 4.0


class Pace:
    """Turns wall time into plant steps.

    At speed 1 a short stall is caught up, so that device clocks keep their rate against the host's; a longer one, and
    nearly any at higher speed, is forgotten: simulated time then stays behind. No physics is ever skipped.
    """

    def __init__(self, speed: float, dt_s: float, tick_s: float, largest_slice: int) -> None:
        self.speed = speed
        self._dt_s = dt_s
        self._largest = max(1, min(largest_slice, int(CATCH_UP * speed * tick_s / dt_s)))
        self._lag_s = LONGEST_LAG_S if speed <= 1.0 else LONGEST_LAG_FAST_S
        self._anchor_ns = -1
        self._anchor_step = 0

    def due(self, now_ns: int, step: int) -> int:
        """Steps to run now, bounded to one slice.

        Args:
            now_ns: host's monotonic clock (ns).
            step: steps run so far.
        """
        if self._anchor_ns < 0:
            self.hold(now_ns, step)
        behind = self._behind(now_ns, step)
        longest = self._lag_s * self.speed / self._dt_s
        if behind > longest:
            self.hold(now_ns - int(self._lag_s * 1e9), step)
            behind = longest
        return max(0, min(self._largest, int(behind)))

    def hold(self, now_ns: int, step: int) -> None:
        """Start counting anew: no wall time before `now_ns` is owed."""
        self._anchor_ns = now_ns
        self._anchor_step = step

    def _behind(self, now_ns: int, step: int) -> float:
        target = self._anchor_step + (now_ns - self._anchor_ns) * 1e-9 * self.speed / self._dt_s
        return target - step


class Backpressure:
    """Above speed 1: the rig's clock waits for readers that are alive, `LONGEST_WAIT_S` since their last read."""

    def __init__(self, ports: Sequence[SensorPort]) -> None:
        self._ports = ports
        self._unread = [0] * len(ports)
        self._progress_ns = [0] * len(ports)
        self._bus_full_since_ns = -1

    def holds(self, now_ns: int, bus_congested: bool) -> bool:
        """Whether simulated time should wait.

        Args:
            now_ns: wall time in which this process ran (ns): its own absence is not the reader's.
            bus_congested: whether an slcan client's socket is full.
        """
        waiting = False
        for index, port in enumerate(self._ports):
            unread = port.unread()
            if unread < self._unread[index] or unread <= CAPACITY // 2:
                self._progress_ns[index] = now_ns
            self._unread[index] = unread
            alive = now_ns - self._progress_ns[index] < LONGEST_WAIT_S * 1e9
            waiting = waiting or (port.read_once and unread > CAPACITY // 2 and alive)
        if not bus_congested:
            self._bus_full_since_ns = now_ns
        return waiting or (bus_congested and now_ns - self._bus_full_since_ns < LONGEST_WAIT_S * 1e9)
