"""Machines of worlds, one folder each."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import pytest

from simulators.scenarios.disk import Disk
from simulators.scenarios.kernel import Kernel
from simulators.scenarios.machine import Machine


@pytest.fixture
def make(tmp_path: Path) -> Callable[[int], tuple[Machine, Path]]:
    """Makes the machine of a seed, and an empty folder on its disk."""
    numbers = itertools.count()

    def made(seed: int) -> tuple[Machine, Path]:
        root = tmp_path / str(next(numbers))
        folder = root / "folder"
        folder.mkdir(parents=True)
        kernel = Kernel(seed)
        return Machine(kernel, Disk(kernel, root, seed), seed), folder

    return made
