"""A simulated campaign without faults beside four busy processes: complete and valid, only later."""

from __future__ import annotations

import itertools
import json
import os
import subprocess
import sys
import threading
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import serial
from matrices import BRISK_POINTS

from protocols.frame_format import FrameDecoder

if TYPE_CHECKING:
    from conftest import Start

pytestmark = pytest.mark.wire

MANY_POINTS = BRISK_POINTS.replace('["4 Hz"]', '["0.5 Hz", "1 Hz", "1.5 Hz", "2 Hz"]')


@pytest.fixture
def four_busy_processes() -> Iterator[None]:
    """Nobody leaves this machine's processors idle; the rig goes before nobody, wherever these tests do."""
    precedence = os.getpriority(os.PRIO_PROCESS, 0)
    os.setpriority(os.PRIO_PROCESS, 0, max(0, precedence))
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(4)]
    yield
    for process in busy:
        process.kill()
        process.wait()
    if precedence < 0:
        os.setpriority(os.PRIO_PROCESS, 0, precedence)


@pytest.mark.nightly
@pytest.mark.usefixtures("four_busy_processes")
@pytest.mark.parametrize(
    ("speed", "matrix", "points"), [(1.0, BRISK_POINTS, 2), (5.0, MANY_POINTS, 8)]
)
def test_beside_busy_processes_nothing_is_lost_and_every_point_is_valid(
    start: Start, speed: float, matrix: str, points: int
) -> None:
    ending = start(matrix=matrix, speed=speed).finish()
    assert ending.exit_code == 0, ending.output
    assert ending.trips() == []
    assert {(each["verdict"], each["lost_samples"]) for each in ending.answer["points"]} == {("valid", 0)}
    assert len(ending.answer["points"]) == points


@pytest.mark.nightly
def test_without_waiting_a_reader_that_stalls_loses_what_its_port_cannot_hold(tmp_path: Path) -> None:
    """The same rig with `--drop-unread`: one host that opens its ports, reads a little and then nothing any more."""
    lost: dict[tuple[str, ...], int] = {}
    for extra in ((), ("--drop-unread",)):
        truth = tmp_path / f"truth{len(extra)}.h5"
        with subprocess.Popen(
            [sys.executable, "-m", "simulators", "--speed", "20", "--json", "--truth", str(truth),
             *extra],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        ) as rig:  # fmt: skip
            lost[extra] = lost_by_a_short_stall(rig, truth)
    assert lost[()] == 0
    assert lost["--drop-unread",] > 100


def lost_by_a_short_stall(rig: subprocess.Popen[str], truth: Path) -> int:
    """Samples a host misses, by their sequence numbers, that does not read for 0.3 s in between."""
    assert rig.stdout is not None
    bench = tomllib.loads(Path(json.loads(rig.stdout.readline())["bench"]).read_text(encoding="utf-8"))
    decoder, seen = FrameDecoder(), []
    cell = bench["load_cell"]
    with serial.serial_for_url(cell["url"], baudrate=cell["baudrate"], timeout=5) as port:
        for stalled_s, samples in ((0.0, 3000), (0.3, 6000)):
            threading.Event().wait(stalled_s)
            while len(seen) < samples:
                seen += decoder.feed(port.read(256))
    rig.terminate()
    rig.wait(timeout=30)
    assert truth.exists()
    numbers = [reading[0] for reading in seen]
    return sum((after - before - 1) % 65536 for before, after in itertools.pairwise(numbers))
