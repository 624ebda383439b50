from __future__ import annotations

from datetime import date
from pathlib import Path

import pytest

from rig.bench.model import Bench
from rig.campaign.setup import check_calibrations
from rig.errors import Refused

EXAMPLE = Path(__file__).parents[3] / "examples" / "demo-bench.toml"
FAR_FUTURE = date(2999, 1, 1)


def bench(tmp_path: Path, *, strict: bool) -> Bench:
    text = EXAMPLE.read_text(encoding="utf-8")
    path = tmp_path / "bench.toml"
    path.write_text(text.replace("format = 1", f"format = 1\nrequire_valid_calibration = {str(strict).lower()}", 1))
    return Bench.load(path)


def test_an_overdue_calibration_is_a_warning_with_sensor_and_date(tmp_path: Path) -> None:
    warnings = check_calibrations(bench(tmp_path, strict=False), FAR_FUTURE)
    assert any(text.startswith("load_cell: ") and "was due on" in text for text in warnings)


def test_the_bench_file_may_make_it_a_refusal(tmp_path: Path) -> None:
    with pytest.raises(Refused, match="require_valid_calibration") as refusal:
        check_calibrations(bench(tmp_path, strict=True), FAR_FUTURE)
    assert refusal.value.slug == "calibration-overdue"


def test_a_calibration_that_holds_says_nothing(tmp_path: Path) -> None:
    assert check_calibrations(bench(tmp_path, strict=True), date(2000, 1, 1)) == ()
