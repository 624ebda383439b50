"""The short form of the fuzz: 2,000 inputs a parser, fewer where an input is a file, and an eighth of it by day."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

FUZZ = Path(__file__).with_name("fuzz.py")


TARGETS = (
    "frame16", "lines", "slcan", "ecu", "modbus", "bench", "matrix", "csv", "foreign", "hdf5", "hdf5-structure",
    "journal",
)


def test_damaged_input_is_refused_or_read_as_it_stands(
    capsys: pytest.CaptureFixture[str], pytestconfig: pytest.Config
) -> None:
    """All targets in one process, whose start takes longer than most of them; an error names target, seed and input."""
    inputs = "250" if pytestconfig.getoption("--short") else "2000"
    command = [sys.executable, str(FUZZ), "--here", "--inputs", inputs, "--seed", "1", *TARGETS]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    assert done.stdout.count("no crash, no wrong value") == len(TARGETS)
    with capsys.disabled():
        sys.stdout.write(f"\n{done.stdout}")
