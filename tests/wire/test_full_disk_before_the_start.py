"""A simulated campaign that is refused for want of room on its disk is not held up by its simulated rig."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from rig.campaign.simulated_rig import STOP_TIMEOUT_S
from rig.clock import monotonic_ns
from rig.errors import EXIT_REFUSED

pytestmark = pytest.mark.wire

PATIENCE_S = 170.0
MATRIX = """format = 1
[specimen]
serial_number = "MR-001"
stroke = "150 mm"
[matrix]
amplitude = ["20 mm"]
frequency = ["2 Hz"]
current = ["0 A"]
cycles = 5
"""


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A real file system of 1 MB: room for a campaign's description, not for a campaign or a truth file."""
    place = tmp_path / "out"
    place.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(place)], capture_output=True, text=True, check=False
    ) if shutil.which("mount") else None
    if mounted is None or mounted.returncode != 0:
        pytest.skip(f"no file system can be mounted here: {'' if mounted is None else mounted.stderr.strip()}")
    yield place
    # The simulated rig that waits for room ends when there is some.
    subprocess.run(["mount", "-o", "remount,size=16m", str(place)], check=True)
    subprocess.run(["umount", "-l", str(place)], check=True)


@pytest.mark.nightly
def test_a_campaign_refused_for_want_of_room_is_over_at_once(small_disk: Path, tmp_path: Path) -> None:
    matrix = tmp_path / "matrix.toml"
    matrix.write_text(MATRIX, encoding="utf-8")
    command = [sys.executable, "-m", "rig.cli.main", "run", str(matrix), "--simulate", "--speed", "5", "--json"]
    began_ns = monotonic_ns()
    done = subprocess.run(
        [*command, "--out", str(small_disk)], capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    answer = json.loads(done.stdout)
    assert done.returncode == EXIT_REFUSED
    assert "about" in answer["error"]
    assert "MB needed" in answer["error"]
    assert "it will complete truth.h5 as soon as disk space is available" in done.stderr
    assert (monotonic_ns() - began_ns) / 1e9 < STOP_TIMEOUT_S
