"""The CAN reader on a full bus: what reading a user's ECU costs the process that owns the ports.

    .venv/bin/python benchmarks/can_reader.py [--seconds 2]

Another process plays an slcan adapter on a socket and sends 4,500 frames/s, what a bus of 500 kbit/s holds of standard
frames of 8 bytes, in hand-overs of 2 ms. Two mixes: the example's ECU (250 statuses/s) among others' frames, and a bus
on which every frame is its status. Measured is the processor time of the reading process, per frame and as a
share of one core; the numbers of docs/benchmarks.md are for `examples/coil-driver.dbc`.
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import socket
import time
from pathlib import Path

from drivers.can_current_source import CanCurrentSource
from drivers.can_port import CanPort
from drivers.connection import CanAddress
from drivers.devices.source import current_source
from rig.files.descriptions import table_of
from rig.files.network_text import dbc_text
from simulators.ecu_wire import Shown
from simulators.emulated_ecu import EmulatedEcuFiles
from simulators.slcan_bus import frame_line

FRAMES_S = 4500
HAND_OVER_S = 0.002
EXAMPLES = Path(__file__).parents[1] / "examples"
DBC, ROLES = EXAMPLES / "coil-driver.dbc", EXAMPLES / "coil-driver-roles.toml"
OWN_EVERY, HEALTH_EVERY = 18, 90
"""Every so many frames one of the ECU's own, 250 of 4,500 a second; 50 of them with faults and temperatures."""
RUNS = 5
COUNTED = 0.97
"""Of the frames; the messages beside status and others are not counted."""


def lines(mix: str, count: int) -> list[bytes]:
    """The bus's frames as lines."""
    emulated = EmulatedEcuFiles(DBC, ROLES).load()
    made = []
    for number in range(count):
        if mix == "own" or number % OWN_EVERY == 0:
            name = "DriverHealth" if number % HEALTH_EVERY == 0 else "DriverStatus"
            made.append(frame_line(*emulated.frame(name, Shown(2, 1.0, device_us=number * 222))))
        else:
            made.append(frame_line(0x200 + number % 300, bytes(8)))
    return made


def adapter(server: socket.socket, mix: str, seconds: float) -> None:
    """Send the frames at their rate once the channel is open, then hang up."""
    prepared = lines(mix, int(FRAMES_S * seconds))
    connection, _ = server.accept()
    heard = b""
    while b"O\r" not in heard:
        heard += connection.recv(64)
    begin, sent = time.monotonic(), 0
    with contextlib.suppress(OSError):  # the reader has had enough
        while sent < len(prepared):
            due = min(len(prepared), int((time.monotonic() - begin) * FRAMES_S))
            connection.sendall(b"".join(prepared[sent:due]))
            sent = due
            time.sleep(HAND_OVER_S)
        time.sleep(1.0)
    connection.close()


def measured(mix: str, seconds: float) -> tuple[int, float, float]:
    """Frames read, processor time (s) and wall time (s) of the reader."""
    server = socket.create_server(("127.0.0.1", 0))
    sender = multiprocessing.Process(target=adapter, args=(server, mix, seconds))
    sender.start()
    channel = f"socket://127.0.0.1:{server.getsockname()[1]}"
    described = current_source(dbc_text(DBC), table_of("ecu-roles", ROLES))
    source = CanCurrentSource(CanPort(CanAddress("slcan", channel)), described)
    source.open()
    while not source.counters.other_frames + source.counters.statuses:
        source.read_batch(0.05)
    begin_s, wall_s = time.process_time(), time.monotonic()
    expected = int(FRAMES_S * seconds)
    while (
        source.counters.other_frames + source.counters.statuses < COUNTED * expected and time.monotonic() < wall_s + 60
    ):
        source.read_batch(0.05)
    used_s, passed_s = time.process_time() - begin_s, time.monotonic() - wall_s
    frames = source.counters.other_frames + source.counters.statuses
    bad = source.counters.bad_checks + source.malformed
    source.close()
    sender.join()
    server.close()
    assert bad == 0, bad
    return frames, used_s, passed_s


def main() -> None:
    """Measure both mixes and print them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=2.0)
    seconds = parser.parse_args().seconds
    for mix in ("mixed", "own"):
        runs = [measured(mix, seconds) for _ in range(RUNS)]
        shares = sorted(100.0 * used_s / passed_s for _, used_s, passed_s in runs)
        frames, used_s, _ = min(runs, key=lambda run: run[1] / run[0])
        print(
            f"{mix:6} {1e6 * used_s / frames:.1f} us of processor a frame at best; share of a core at {FRAMES_S} "
            f"frames/s: {shares[0]:.1f} % to {shares[-1]:.1f} %, median {shares[RUNS // 2]:.1f} %"
        )


if __name__ == "__main__":
    main()
