"""Sensors mounted the other way round: said in the bench file they measure right, unsaid they are refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray
from simulated_campaign import Ended, options, session

from rig.dampers import model, parameter_set
from rig.recording.recorded_point import RecordedPoint

ROOT = Path(__file__).parents[2]
QUICK = ROOT / "examples" / "quick.toml"
SHOWN_AT_ZERO_N = 40.0


def run(folder: Path, change: Callable[[str], str]) -> Ended:
    """A campaign on a rig whose load cell and LVDT count the other way, the load cell with an offset.

    `change` makes its bench file of the one that the rig gives.
    """
    folder.mkdir()
    mounted = options("load_cell.reversed=true", "lvdt.reversed=true", f"load_cell.offset={SHOWN_AT_ZERO_N}")
    with session(folder, QUICK.read_text(encoding="utf-8"), *mounted, speed=5.0, seed=3) as begun:
        bench = begun.campaign.stage.root / "bench.toml"
        bench.write_text(change(bench.read_text(encoding="utf-8")), encoding="utf-8")
        return begun.end()


def with_polarity(bench: str, table: str) -> str:
    heading = f"[{table}.calibration]\n"
    assert heading in bench
    return bench.replace(heading, f'{heading}polarity = "reversed"\n')


def true_force_N(point: RecordedPoint) -> NDArray[np.float64]:
    """What the simulated damper answers to the recorded motion (N), (n,)."""
    prior, dt_s = parameter_set("demo"), 1.0 / point.sample_rate_Hz
    acceleration = np.gradient(point.velocity_m_s, dt_s)
    return model(prior.model).force(
        prior.values, point.displacement_m, point.velocity_m_s, acceleration, point.current_A, dt_s
    )


def zeroed(bench: str) -> str:
    return bench.replace('offset = "0 N"', f'offset = "{SHOWN_AT_ZERO_N:g} N"')


@pytest.mark.few(1)
@pytest.mark.parametrize("output_of", ["load_cell", "lvdt"])
def test_one_of_two_reversed_sensors_unsaid_is_refused(tmp_path: Path, output_of: str) -> None:
    ended = run(tmp_path / "wrong", lambda bench: with_polarity(zeroed(bench), output_of))
    assert (ended.exit_code, ended.answer["stopped_by"]) == (3, "sensors-swapped"), ended.output


@pytest.mark.nightly
def test_reversed_sensors_measure_right_once_the_bench_file_says_so(tmp_path: Path) -> None:
    ended = run(tmp_path / "right", lambda bench: with_polarity(with_polarity(zeroed(bench), "load_cell"), "lvdt"))
    assert (ended.exit_code, ended.answer["valid"]) == (0, 2), ended.output
    for point in ended.run.points:
        assert np.nanmean(point.force_N - true_force_N(point)) == pytest.approx(0.0, abs=0.25 * SHOWN_AT_ZERO_N)
        assert np.nanstd(point.force_N - true_force_N(point)) < 0.1 * np.nanmax(np.abs(point.force_N))
        assert point.path is not None
        with h5py.File(point.path) as file:
            attributes = file["entry/data/force"].attrs
            assert (attributes["sensitivity"], attributes["offset"]) == (-1.0, -SHOWN_AT_ZERO_N)
            assert file["entry/data/displacement"].attrs["sensitivity"] == pytest.approx(-0.001)
