"""Ids that look like each other's attempts, repeated at random; and what a killed application leaves in memory."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from simulated_campaign import simulated

from rig.campaign.machine_resources import SHARED_MEMORY
from rig.clock import monotonic_ns

MATRIX = """
format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
prior = "demo"
[matrix]
cycles = 4
repeats = {repeats}
order = "random"
seed = {seed}
[campaign]
retries = 1
[identify]
enabled = false
"""
POINT = '\n[[point]]\nid = "{id}"\namplitude = "{amplitude}"\nfrequency = "2 Hz"\ncurrent = "{current}"\n'
ENDED_S = 60.0


def matrix_of(ids: list[str], *, repeats: int = 2, seed: int = 11) -> str:
    points = [POINT.format(id=name, amplitude=f"{10 + number} mm", current=f"{0.2 * number:.1f} A")
              for number, name in enumerate(ids)]
    return MATRIX.format(repeats=repeats, seed=seed) + "".join(points)


@pytest.mark.few(1)
@pytest.mark.parametrize(("ids", "seed"), [(["loop", "loop-1"], 11), (["x", "x-attempt1", "x-attempt4"], 5)])
def test_points_whose_names_begin_like_others_are_all_valid_and_all_there(
    tmp_path: Path, ids: list[str], seed: int
) -> None:
    ended = simulated(tmp_path, matrix_of(ids, seed=seed))
    assert ended.exit_code == 0, ended.output
    expected = {name if repeat == 1 else f"{name}-{repeat}" for name in ids for repeat in (1, 2)}
    assert {point["id"]: point["verdict"] for point in ended.answer["points"]} == dict.fromkeys(expected, "valid")
    assert {point.id for point in ended.run.valid} == expected
    assert not [path.name for path in (ended.folder / "points").iterdir() if path.suffix != ".h5"]


@pytest.mark.nightly
@pytest.mark.wire
def test_a_killed_application_leaves_nothing_in_shared_memory(tmp_path: Path) -> None:
    if not SHARED_MEMORY.is_dir():
        pytest.skip("there is no shared memory to lie in")
    (tmp_path / "matrix.toml").write_text(matrix_of(["loop"]), encoding="utf-8")
    arguments = ["run", str(tmp_path / "matrix.toml"), "--simulate", "--speed", "2", "--out", str(tmp_path / "out")]
    application = subprocess.Popen(
        [sys.executable, "-m", "rig.cli.main", *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        campaign = awaited(lambda: next(iter((tmp_path / "out").glob("*/points/*.journal")), None)).parents[1]
        ring = SHARED_MEMORY / f"mr-damper-rig-{campaign.name}.ring"
        assert ring.exists()
    finally:
        os.kill(application.pid, signal.SIGKILL)
        application.wait()
    awaited(lambda: None if ring.exists() else ring)


def awaited(look: object) -> Path:
    """What `look` gives once it gives something."""
    assert callable(look)
    deadline_ns = monotonic_ns() + int(ENDED_S * 1e9)
    while monotonic_ns() < deadline_ns:
        found = look()
        if isinstance(found, Path):
            return found
    raise AssertionError("it did not come")
