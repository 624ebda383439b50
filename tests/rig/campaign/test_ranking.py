"""Of several attempts of one point the best verdict counts, then the latest: in the books and on resuming."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from rig.campaign.results import PointResults
from rig.campaign.resume import take_stock
from rig.matrix.point import TestPoint
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.layout import AlignedChannel, PointFile

POINT = TestPoint("p001", "sine", 0.02, 2.0, 0.5)
ATTEMPTS = [pair for pair in itertools.product(("valid", "suspect", "invalid"), repeat=2) if pair[0] != "valid"]
BEST = {"valid": 3, "suspect": 2, "invalid": 1}


def name_of(attempt: int) -> str:
    return "p001" if attempt == 1 else f"p001-attempt{attempt}"


def expected(verdicts: tuple[str, ...]) -> str:
    best = max(range(len(verdicts)), key=lambda number: (BEST[verdicts[number]], number))
    return f"{name_of(best + 1)}.h5"


def write(folder: Path, attempt: int, verdict: str) -> None:
    time_s = np.arange(16) / 250.0
    write_file(folder / "points" / f"{name_of(attempt)}.h5", PointFile(
        time_s, 250.0, [AlignedChannel(name, time_s, unit, name) for name, unit in (
            ("force", "N"), ("displacement", "m"), ("velocity", "m/s"), ("current", "A"))],
        quality={"verdict": verdict, "reasons": () if verdict == "valid" else (f"amplitude: {attempt}",)},
        test={"id": name_of(attempt), "waveform": "sine", "amplitude_m": 0.02, "frequency_Hz": 2.0, "current_A": 0.5},
        provenance={"point": "p001", "attempt": str(attempt)},
    ))


@pytest.mark.parametrize("verdicts", ATTEMPTS)
def test_the_books_keep_the_best_attempt(verdicts: tuple[str, ...]) -> None:
    results = PointResults((POINT,))
    for attempt, verdict in enumerate(verdicts, start=1):
        results.judged(POINT, Path(f"{name_of(attempt)}.h5"), verdict, (), 0)
    assert str(results.results["p001"].file) == expected(verdicts)


@pytest.mark.parametrize("verdicts", [*ATTEMPTS, ("suspect", "suspect", "invalid"), ("invalid", "suspect", "valid")])
def test_a_resumed_campaign_keeps_the_best_attempt(verdicts: tuple[str, ...], tmp_path: Path) -> None:
    (tmp_path / "points").mkdir()
    for attempt, verdict in enumerate(verdicts, start=1):
        write(tmp_path, attempt, verdict)
    stock = take_stock(tmp_path, (POINT,))
    if set(verdicts) == {"invalid"}:
        assert [point.id for point in stock.remaining] == ["p001"]
    else:
        assert [result.file.name for result in stock.results if result.file] == [expected(verdicts)]
    assert stock.attempts == {"p001": len(verdicts)}
