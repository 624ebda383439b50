"""Rings of dead stations do not pile up, those of living ones are left alone."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from drivers.ring import RingWriter
from rig.campaign.ring_place import ring_path_for


def dead_process() -> int:
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        process.wait()
    return process.pid


def ring_of(path: Path, pid: int) -> None:
    with RingWriter(path, 16) as ring:
        ring.append([])
    content = bytearray(path.read_bytes())
    content[40:44] = pid.to_bytes(4, "little")
    path.write_bytes(content)


def test_the_ring_goes_with_its_campaign(tmp_path: Path) -> None:
    with ring_path_for("c1", tmp_path) as path:
        ring_of(path, os.getpid())
        assert path.parent == tmp_path
    assert not path.exists()


def test_only_rings_of_dead_stations_are_removed(tmp_path: Path) -> None:
    dead, alive, foreign = (tmp_path / f"mr-damper-rig-{name}.ring" for name in ("dead", "alive", "begun"))
    ring_of(dead, dead_process())
    ring_of(alive, os.getpid())
    foreign.write_bytes(b"")
    with ring_path_for("c2", tmp_path):
        assert not dead.exists()
        assert alive.exists()
        assert foreign.exists()
