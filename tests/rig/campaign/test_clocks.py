from __future__ import annotations

from pathlib import Path

import pytest

from rig.bench.model import Bench
from rig.campaign.setup import check_clocks
from rig.errors import Refused

EXAMPLE = Path(__file__).parents[3] / "examples" / "demo-bench.toml"


def test_a_load_cell_whose_format_has_no_clock_is_refused_where_the_skew_is_requested(tmp_path: Path) -> None:
    text = EXAMPLE.read_text(encoding="utf-8")
    path = tmp_path / "bench.toml"
    path.write_text(text.replace('format = "frame16"', 'format = "signed-decimal"', 1), encoding="utf-8")
    with pytest.raises(Refused, match=r"\[load_cell\] format = 'signed-decimal'") as refusal:
        check_clocks(Bench.load(path))
    assert refusal.value.slug == "format-without-clock"


def test_sensors_with_clocks_are_accepted() -> None:
    check_clocks(Bench.load(EXAMPLE))
