"""Odd records go from import to export without a traceback, and no valid value without a remark is wrong.

A few of the records of `benchmarks/odd_records.py`, which draws thousands.
"""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"


@pytest.mark.parametrize("seed", [37, 38, 52, 144])
def test_a_drawn_record_is_read_right_or_refused(seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(BENCHMARKS)
    outcome = importlib.import_module("odd_records").outcome_of(seed, tmp_path)
    assert outcome.crashes == []
    assert outcome.wrong == []
