"""How fast the rig is stopped: from the last byte of the limit-crossing sample to the stop request, both on the wire.

    python benchmarks/stop_latency.py [--injections 200] [--no-real-time] [--json]

A simulated rig at speed 1 gives controller, ECU and LVDT. Load cell and the controller's TCP connection go through a
process of this benchmark: it sends 250 frames a second on a pseudo terminal and relays Modbus, so that it sees both
moments with one clock. A recorder and a reader of the ring at 25 Hz run beside the station, as in a campaign.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import platform
import select
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import tty
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from campaign_process import sines

from protocols import frame_format
from rig.bench.model import Bench
from rig.campaign.machine_resources import station_config
from rig.clock import monotonic_ns
from rig.matrix.model import load_matrix
from rig.recording.journal.recorder import PointRecorder
from rig.recording.journal.ring_reader import RingReader
from rig.recording.layout import PointContext
from rig.station.client import StationClient
from rig.test_point import TestPoint

RATE_HZ = 250.0
TICK_NS = round(1e9 / RATE_HZ)
PRIORITY = 20
GOAL_S = 0.020
PATIENCE_S = 0.25
"""Ages are allowed to be larger than on hardware, so that no other trip comes before the one that is measured."""
LIMIT_N = 5000.0
APPROACH_N = (2500.0, 4900.0, LIMIT_N + 100.0)
"""A force that crosses the limit as physics can: the last of these samples does."""
COMMAND_ADDRESS, HALT = 300, 9
MATRIX = sines(["2 Hz"], ["1 A"], "10 mm", 6, identify=False)


class Wires:
    """The load cell's end of its line, and a relay in the controller's connection."""

    def __init__(self, controller_port: int) -> None:
        self._controller_port = controller_port
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.pairs: dict[socket.socket, socket.socket] = {}
        self.hosts: set[socket.socket] = set()
        self.crossed_ns = self.stopped_ns = 0
        self._sequence = 0
        self._next_ns = monotonic_ns()
        self._approach: list[float] = []

    def serve(self, orders: Connection) -> None:
        """Work until told to end; every order but that is an injection, answered by its two times (ns)."""
        orders.send((os.ttyname(self.slave), self.listener.getsockname()[1]))
        while True:
            wait_s = max(0.0, (self._next_ns - monotonic_ns()) / 1e9)
            ready, _, _ = select.select([self.listener, orders, *self.pairs], [], [], wait_s)
            self._send_due()
            for each in ready:
                if each is orders:
                    if orders.recv() == "end":
                        return
                    self._approach = list(APPROACH_N)
                    self.crossed_ns = self.stopped_ns = 0
                elif each is self.listener:
                    self._accept()
                elif each in self.pairs:
                    self._relay(each)
            if self.crossed_ns and self.stopped_ns:
                orders.send((self.crossed_ns, self.stopped_ns))
                self.crossed_ns = self.stopped_ns = 0

    def _send_due(self) -> None:
        now_ns = monotonic_ns()
        if now_ns < self._next_ns:
            return
        self._next_ns = max(self._next_ns + TICK_NS, now_ns)
        self._sequence += 1
        force_N = self._approach.pop(0) if self._approach else (self._sequence % 7) - 3.0
        frame = frame_format.encode(force_N, self._sequence & 0xFFFF, now_ns // 1000 & 0xFFFFFFFF)
        os.write(self.master, frame)
        if force_N > LIMIT_N:
            self.crossed_ns = monotonic_ns()

    def _accept(self) -> None:
        host, _ = self.listener.accept()
        device = socket.create_connection(("127.0.0.1", self._controller_port))
        for each in (host, device):
            each.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.pairs |= {host: device, device: host}
        self.hosts.add(host)

    def _relay(self, source: socket.socket) -> None:
        data = source.recv(4096)
        other = self.pairs[source]
        if not data:
            for each in (source, other):
                del self.pairs[each]
                each.close()
            return
        if self.crossed_ns and not self.stopped_ns and source in self.hosts and is_halt(data):
            self.stopped_ns = monotonic_ns()
        other.sendall(data)


def is_halt(request: bytes) -> bool:
    """Whether this Modbus TCP request writes the controller's HALT command."""
    if len(request) < 15 or request[7] != 16:
        return False
    address, _, _, command = struct.unpack_from(">HHBH", request, 8)
    return bool(address == COMMAND_ADDRESS and command == HALT)


def wires(orders: Connection, controller_port: int, real_time: bool) -> None:
    """The process of the wires; it takes the priority of the simulated rig, as hardware does not wait."""
    if real_time:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    Wires(controller_port).serve(orders)


def watch_ring(path: Path, ending: threading.Event) -> None:
    """Read the ring at 25 Hz, as a page does."""
    with RingReader(path) as ring:
        while not ending.wait(0.04):
            ring.read()


def injections(client: StationClient, orders: Connection, count: int) -> list[float]:
    """Latencies (s) of `count` injections, each from an armed rig at rest.

    One that another trip came before is not among them.
    """
    client.request("connect")
    client.request("arm")
    beating = threading.Event()
    threading.Thread(target=_beat, args=(client, beating), daemon=True).start()
    random = np.random.default_rng(1)
    pause, found = threading.Event(), []
    for _ in range(count):
        pause.wait(float(random.uniform(0.05, 0.15)))
        orders.send("cross")
        if orders.poll(5.0):
            crossed_ns, stopped_ns = orders.recv()
            found.append((stopped_ns - crossed_ns) / 1e9)
        _reset(client, pause)
    beating.set()
    return found


def _beat(client: StationClient, ending: threading.Event) -> None:
    while not ending.wait(0.05) and client.alive:
        client.beat(True)


def _reset(client: StationClient, pause: threading.Event) -> None:
    """Wait for the end of the stop, clear its latch."""
    deadline_ns = monotonic_ns() + 10_000_000_000
    while not client.request("status")["settled"] and monotonic_ns() < deadline_ns:
        pause.wait(0.01)
    pause.wait(0.15)
    client.request("reset", timeout_s=10.0)


def measure(count: int, real_time: bool, folder: Path) -> list[float]:
    """Start everything, inject, end everything; latencies (s)."""
    rig = subprocess.Popen(
        [sys.executable, "-m", "simulators", "--real-time"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        text=True, start_new_session=True,
    )  # fmt: skip
    assert rig.stdout is not None
    bench_path = Path(rig.stdout.readline().strip())
    (folder / "matrix.toml").write_text(MATRIX, encoding="utf-8")
    bench = Bench.load(bench_path)
    config = station_config(bench, load_matrix(folder / "matrix.toml"), folder / "ring")
    context = multiprocessing.get_context("spawn")
    orders, theirs = context.Pipe()
    process = context.Process(target=wires, args=(theirs, int(bench.actuator.url.rpartition(":")[2]), real_time))
    process.start()
    port, relay = orders.recv()
    config = replace(
        config, real_time=real_time, heartbeat_timeout_s=2.0,
        actuator=replace(
            config.actuator, url=f"modbus-tcp://127.0.0.1:{relay}", timeout_s=0.4, stale_after_s=1.0, watchdog_s=1.0
        ),
        ecu=replace(config.ecu, stale_after_s=PATIENCE_S),
        load_cell=replace(config.load_cell, url=port, stale_after_s=PATIENCE_S),
        lvdt=replace(config.lvdt, stale_after_s=PATIENCE_S),
    )  # fmt: skip
    client = StationClient.start(config, folder)
    ending = threading.Event()
    (folder / "points").mkdir()
    recorder = PointRecorder(Path(config.ring_path), folder / "points")
    reader = threading.Thread(target=watch_ring, args=(Path(config.ring_path), ending), daemon=True)
    try:
        recorder.begin(PointContext(TestPoint("p001", "sine", 0.0, 1.0, 0.0, 0), sensors={}), expected_s=600.0)
        reader.start()
        return injections(client, orders, count)
    finally:
        ending.set()
        recorder.end()
        recorder.close()
        client.close()
        orders.send("end")
        process.join(5)
        rig.terminate()
        rig.wait(30)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--injections", type=int, default=200)
    parser.add_argument("--no-real-time", action="store_true")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        latency_ms = 1e3 * np.array(measure(given.injections, not given.no_real_time, Path(folder)))
    result = {
        "injections": given.injections,
        "measured": len(latency_ms),
        "real_time": not given.no_real_time,
        **{f"p{share}_ms": round(float(np.percentile(latency_ms, share)), 3) for share in (50, 90, 99)},
        "max_ms": round(float(latency_ms.max()), 3),
        "goal_p99_ms": 1e3 * GOAL_S,
        "machine": f"{platform.machine()}, {os.cpu_count()} CPUs, load {os.getloadavg()[0]:.1f}",
    }
    print(json.dumps(result) if given.json else "\n".join(f"{name:12} {value}" for name, value in result.items()))


if __name__ == "__main__":
    main()
