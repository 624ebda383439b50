"""A study small enough for a test: few samples, few evaluations."""

from __future__ import annotations

from pathlib import Path

import pytest

SMALL = """
format = 1
name = "small"
seed = 3
[data]
simulate = "table1"
noise = "5 N"
keep_every = 40
[comparison]
methods = ["de", "pso", "c_foa"]
populations = [8, 12]
budgets = [60, 120]
repeats = 2
[symmetry]
population = 8
budget = 120
[sensitivity]
populations = [8, 12]
generations = [4, 6]
resolutions = [100, 10]
[per_current]
model = "bouc_wen"
methods = ["ga_novel", "zhu_three_step"]
current = ["0 A", "0.5 A", "1 A"]
population = 6
budget = 24
repeats = 1
[per_current.data]
simulate = "bouc_wen"
noise = "1 N"
"""


@pytest.fixture
def small_study(tmp_path: Path) -> Path:
    path = tmp_path / "small.toml"
    path.write_text(SMALL)
    return path
