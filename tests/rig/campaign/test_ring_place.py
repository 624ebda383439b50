"""Rings of dead stations do not pile up, those of living ones are left alone."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

from drivers.ring import RingWriter
from rig.campaign.machine_resources import ring_path_for
from rig.recording.journal.ring_reader import RingReader


def ring_of(path: Path) -> None:
    with RingWriter(path, 16) as ring:
        ring.append([])


def test_the_ring_goes_with_its_campaign(tmp_path: Path) -> None:
    with ring_path_for("c1", tmp_path) as path:
        ring_of(path)
        assert path.parent == tmp_path
    assert not path.exists()


def test_only_rings_of_dead_stations_are_removed(tmp_path: Path) -> None:
    dead, alive, begun, fifo = (tmp_path / f"mr-damper-rig-{name}.ring" for name in ("dead", "alive", "begun", "fifo"))
    ring_of(dead)
    begun.write_bytes(b"")
    os.mkfifo(fifo)
    with RingWriter(alive, 16), ring_path_for("c2", tmp_path):
        assert not dead.exists()
        assert alive.exists()
        assert begun.exists()
        assert fifo.exists()


def test_the_ring_of_a_killed_station_is_removed_although_its_process_number_is_somebody_elses_now(
    tmp_path: Path,
) -> None:
    ring = tmp_path / "mr-damper-rig-killed.ring"
    code = f"import os, signal; from drivers.ring import RingWriter; w = RingWriter({str(ring)!r}, 16); " \
        "os.kill(os.getpid(), signal.SIGKILL)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == -signal.SIGKILL
    content = bytearray(ring.read_bytes())
    content[40:44] = os.getpid().to_bytes(4, "little")
    ring.write_bytes(content)
    with ring_path_for("c3", tmp_path):
        assert not ring.exists()


def test_a_ring_taken_away_can_still_be_read_by_who_has_it_open_and_another_stations_ring_stays(tmp_path: Path) -> None:
    path = tmp_path / "mr-damper-rig-c4.ring"
    writer = RingWriter(path, 16)
    with RingReader(path) as reader:
        writer.append([(1, 2, 3.0, 4, 1, 0)])
        writer.remove()
        assert not path.exists()
        assert reader.read()["value"].tolist() == [3.0]
    first, second = RingWriter(path, 16), RingWriter(path, 16)
    first.remove()
    assert path.exists()
    second.remove()
    assert not path.exists()
