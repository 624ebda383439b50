"""Zeros at the end against those of the start: drift is found, noise and resolution are not."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.ring import Channel
from rig.campaign.preflight.zero_return import ZeroReturn, read_zero_checks
from rig.errors import FileProblem
from rig.recording.journal.ring_reader import RecordBlock
from rig.recording.ring_records import RECORD_DTYPE
from rig.signals.rest import AtRest, RestWindow


def rest(
    random: np.random.Generator, force_N: float = 0.0, displacement_m: float = 0.0, *, at_m: float = 0.0,
    static_N: float = 0.0, step_N: float = 0.05, flagged: int = 0, statuses: int = 20,
) -> AtRest:  # fmt: skip
    """A rest window: 5 N and 5 um of noise on the sensors, 10 N and 10 um on the controller's coarse inputs."""
    cell_N = static_N + force_N + 5.0 * random.standard_normal(50)
    return AtRest(
        np.round(cell_N / step_N) * step_N,
        at_m + displacement_m + 5e-6 * random.standard_normal(50),
        at_m + 10e-6 * random.standard_normal(statuses),
        static_N + 10.0 * random.standard_normal(statuses),
        force_flagged=flagged,
    )


def session(
    random: np.random.Generator, end: AtRest, peak_N: float = 1500.0, stroke_m: float = 0.02, statuses: int = 20
) -> ZeroReturn:
    check = ZeroReturn(start=RestWindow.of(rest(random, statuses=statuses)))
    motion = np.linspace(0.0, 2.0 * np.pi, 400)
    records = np.zeros(800, RECORD_DTYPE)
    records["channel"] = np.repeat([Channel.FORCE, Channel.DISPLACEMENT], 400)
    records["value"] = np.concatenate((peak_N * np.cos(motion), stroke_m * np.sin(motion)))
    check.watch(RecordBlock(records))
    check.end = RestWindow.of(end)
    return check


@pytest.mark.few(1)
@pytest.mark.parametrize("statuses", [3, 5, 20])
def test_two_thousand_clean_sessions_are_silent_however_few_statuses_a_fast_rig_gives(statuses: int) -> None:
    random = np.random.default_rng(1)
    for _ in range(2000):
        peak_N, stroke_m = random.uniform(100.0, 4000.0), random.uniform(1e-3, 0.08)
        at_m, static_N = random.uniform(-0.05, 0.05), random.uniform(-300.0, 300.0)
        step_N = float(random.choice([0.05, 1.0, 20.0]))
        end = rest(random, at_m=at_m, static_N=static_N, step_N=step_N, statuses=statuses)
        assert session(random, end, peak_N, stroke_m, statuses).findings() == ()


@pytest.mark.parametrize(
    ("peak_N", "shift_N", "reported"), [(1500, 365, False), (1500, 385, True), (20, 40, False), (20, 60, True)]
)
def test_a_force_at_rest_that_does_not_come_back_is_reported_beyond_a_quarter_of_the_peak_and_the_zeros_tolerance(
    peak_N: float, shift_N: float, reported: bool
) -> None:
    quiet = np.random.default_rng(4)
    check = session(quiet, rest(quiet, shift_N), peak_N=peak_N)
    left = check.force_left(zero_N=50.0)
    assert (left is not None) is reported
    if left is not None:
        assert (left.slug, left.values["limit"]) == ("current-left", pytest.approx(max(50.0, peak_N / 4)))
        assert left.blamed == "bench"
    assert ZeroReturn().force_left(50.0) is None


@pytest.mark.parametrize("drift_N", [60.0, -150.0, 400.0])
def test_a_load_cell_that_drifted_is_named_with_the_other_instrument_and_the_numbers(drift_N: float) -> None:
    random = np.random.default_rng(2)
    (finding,) = session(random, rest(random, drift_N, static_N=200.0)).findings()
    assert (finding.slug, finding.blamed) == ("zero-drift", "bench")
    assert finding.instruments == ("load cell", "controller's force input")
    assert finding.values["drift"] == pytest.approx(drift_N, abs=20.0)
    assert finding.values["largest_measured"] == pytest.approx(1500.0)
    for words in ("load cell", "controller's force input", " N ", "limit"):
        assert words in finding.text


def test_an_lvdt_that_slipped_is_named() -> None:
    random = np.random.default_rng(3)
    (finding,) = session(random, rest(random, displacement_m=0.5e-3, at_m=0.01)).findings()
    assert finding.instruments == ("LVDT", "controller's position input")
    assert "+0.5" in finding.text
    assert "mm" in finding.text


def test_the_limit_goes_with_the_measured_force() -> None:
    random = np.random.default_rng(4)
    assert session(random, rest(random, 60.0), peak_N=1500.0).findings()
    assert not session(random, rest(random, 60.0), peak_N=20_000.0).findings()


def test_nothing_is_reported_without_both_windows_or_of_samples_that_the_sensor_disowns() -> None:
    random = np.random.default_rng(5)
    check = session(random, rest(random, 500.0))
    check.end = None
    assert check.findings() == ()
    assert session(random, rest(random, 500.0, flagged=3)).findings() == ()
    assert session(random, AtRest(np.empty(0), np.empty(0), np.empty(0), np.empty(0))).findings() == ()
    assert ZeroReturn().findings() == ()


@pytest.mark.parametrize(("step_N", "value_N"), [(0.05, -540.0), (1.0, -540.0), (0.05, -14.406000137329098)])
def test_a_stuck_load_cell_says_nothing_of_its_zero_and_a_coarse_one_does(step_N: float, value_N: float) -> None:
    random = np.random.default_rng(7)
    stuck = rest(random, 0.0, step_N=step_N)
    stuck = replace(stuck, force_N=np.full(50, value_N))
    assert session(random, stuck).findings() == ()
    check = session(random, stuck)
    check.start = RestWindow.of(replace(stuck, force_N=np.full(50, value_N + 560.0)))
    assert [finding.slug for finding in check.findings()] == ["zero-drift"]


def test_what_is_kept_in_campaign_json_is_read_again(tmp_path: Path) -> None:
    random = np.random.default_rng(6)
    check = session(random, rest(random, 80.0))
    entries = [check.to_json(), ZeroReturn().to_json()]
    path = tmp_path / "campaign.json"
    path.write_text(json.dumps({"zero_checks": entries}), encoding="utf-8")
    first, second = read_zero_checks(tmp_path)
    assert (first.start, first.end, second.start) == (check.start, check.end, None)
    assert [finding.slug for finding in first.findings()] == ["zero-drift"]
    assert entries[0]["findings"][0]["values"]["drift"] == pytest.approx(80.0, abs=20.0)
    path.write_text(json.dumps({"zero_checks": [{"start": 3}]}), encoding="utf-8")
    with pytest.raises(FileProblem, match="zero_checks"):
        read_zero_checks(tmp_path)
